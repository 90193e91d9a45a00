"""From a calibration to the kinematic parameters of a control, and the remaining errors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any, NamedTuple

import msgspec
import numpy as np

from kinematics.effects import Effect
from kinematics.error_model.joined import joined
from kinematics.error_model.model import ErrorModel
from kinematics.files.number_text import uncertainty
from kinematics.machine import Machine
from kinematics.transforms import Array
from kinematics.user_error import UserError
from postproc.compensation.correction import PoseErrors
from postproc.control_data.exported import WORTH_UM, ExportedData, Listing, Page, Unrepresented
from postproc.control_data.format import Settings, Sign, in_words
from postproc.control_data.parameters.best_lines import Best, Volume, best_lines, unheld
from postproc.control_data.parameters.line_errors import errors_of_lines
from postproc.control_data.parameters.parameter_numbers import Number, signed
from postproc.control_data.parameters.rotary_lines import Freedom, moved_lines, positions_with
from postproc.control_data.remaining_error import summary, volume_points
from postproc.control_data.tables.export_tables import NothingToHold
from postproc.control_data.tables.target import Target, positional

if TYPE_CHECKING:
    from postproc.control_data.parameters.parameter_format import ParameterFormat
    from postproc.control_data.tables.export_tables import Exported

FITTED_COMMANDS = 512
"""Commands of the volume at which the lines are fitted."""
LONGER_MM = 100.0
"""Half of the commands have a tool that is longer by this, so that the lines are right for every tool."""


STAGES = {
    "before": "without compensation",
    "before_and_datum_shift": "without compensation, work offset touched off again",
    "after_parameters": "with these parameters and the old work offset",
    "after_parameters_and_datum_shift": "with these parameters, work offset touched off again",
    "after_parameters_datum_shift_and_tables": "the same, with the control's tables for the remaining errors",
    "after_nc_correction": "with corrected programs and the old parameters",
    "after_parameters_and_nc_correction_of_the_rest": "with these parameters and programs corrected for the rest",
}
WHERE = (
    "Kinematic parameters act only where the control positions the tool point (TCP: G43.4, TRAORI, M128, kinematics of "
    "LinuxCNC) and in tilted planes. Programs of axis positions do not change: correct them with the whole calibration."
)


class Change(NamedTuple):
    """One freedom of a line with its change, and the standard uncertainty by the calibration."""

    freedom: Freedom
    value: float
    """um or urad."""
    u: float


@dataclass(frozen=True, repr=False)
class ExportedParameters(ExportedData):
    """Kinematic parameters of one control."""

    format: ParameterFormat
    """The format of the parameters."""
    freedoms: tuple[Freedom, ...]
    """Lines of rotary axes that the parameters can shift or turn."""
    best: Best
    """The shift of the work offset that belongs to them, mm and rad."""
    values: Array
    """Changes of the lines `(k,)`, mm and rad, as the control holds them."""

    @cached_property
    def moved(self) -> Machine:
        """The machine with the lines that the control gets."""
        return moved_lines(self.machine, self.freedoms, self.values)

    @cached_property
    def numbers(self) -> tuple[list[Number], list[Number]]:
        """The numbers in the control: by the machine file, and with the changes."""
        before, after = (self.format.numbers_of(each, self.settings) for each in (self.machine, self.moved))
        return before, signed(before, after, self.sign)

    @property
    def files(self) -> dict[str, str]:
        """Texts by name: the parameters, and those of the machine file to go back to."""
        before, after = self.numbers
        headings = (f"machine {self.machine.name}, calibration {self.whole.id}", f"machine {self.machine.name}")
        return self.format.files(self.machine, self.settings, (after, before), headings)

    @property
    def changes(self) -> list[Change]:
        """The change of each line, um and urad."""
        sizes = np.array([1e6 if freedom.tilt else 1e3 for freedom in self.freedoms])
        rows = zip(self.freedoms, (self.values * sizes).tolist(), (self.best.u * sizes).tolist(), strict=True)
        return [Change(*row) for row in rows]

    @cached_property
    def taken(self) -> ErrorModel:
        """The errors that the parameters correct, for programs that the control's kinematics position."""
        effects: tuple[Effect, ...] = tuple(errors_of_lines(self.machine, self.moved))
        return msgspec.structs.replace(self.whole, effects=effects, covariance=None)

    @property
    def left(self) -> list[Unrepresented]:
        """Errors that the parameters cannot hold, the largest first."""
        errors = [effect for effect in self.whole.effects if effect.ACTS_ON != "instrument"]
        held = [effect for effect in errors if positional(effect)]
        found = [
            Unrepresented(effect.name, float("nan"), "depends on more than positions")
            for effect in errors
            if not positional(effect)
        ]
        alone = [msgspec.structs.replace(self.whole, effects=(effect,), covariance=None) for effect in held]
        for effect, rms in zip(held, unheld(self._fitted_volume, alone, self.freedoms), strict=True):
            if rms > WORTH_UM:
                found.append(Unrepresented(effect.name, round(rms, 4), effect.beyond_kinematics(self.machine)))
        return sorted(found, key=lambda each: -each.rms_um if each.rms_um == each.rms_um else 0.0)

    def errors_in_the_volume(self) -> dict[str, Any]:
        """Tool point and axis errors over the working volume, by stage."""
        return summary(self._stages())

    def _stages(self) -> dict[str, PoseErrors]:
        machine, model = self.machine, self.whole.part(positional)
        points = volume_points(Target(machine, model, self.tool))
        rest = joined(model, self.taken.effects, -1.0)
        nominal = np.broadcast_to(self.tool, points.tool.shape)

        left = partial(points.errors, machine, model)

        def lines(q: Array, frame: Array | None = None) -> Array:
            return positions_with(machine, self.moved, q, nominal, frame)

        found = {
            "before": left(points.q),
            "before_and_datum_shift": left(positions_with(machine, machine, points.q, nominal, self.best.frame_alone)),
            "after_parameters": left(lines(points.q)),
            "after_parameters_and_datum_shift": left(lines(points.q, self.best.frame)),
        }
        with_tables = "after_parameters_datum_shift_and_tables"
        try:
            tables = self._tables(model)
        except NothingToHold:
            tables, found[with_tables] = None, found["after_parameters_and_datum_shift"]
        if tables is not None:
            shift = np.array([tables.datum.get(axis.name, 0.0) for axis in machine.axes]) * machine.scale
            commands = lines(points.q, self.best.frame)
            found[with_tables] = left(tables.moves(commands, points.approach) + shift)
        found["after_nc_correction"] = left(points.corrected(machine, model))
        found["after_parameters_and_nc_correction_of_the_rest"] = left(lines(points.corrected(machine, rest)))
        return found

    def _tables(self, model: ErrorModel) -> Exported | None:
        """The tables of the same control for the errors that lines and work offset leave; None where it has none.

        NothingToHold where they hold none of these errors.
        """
        rest = joined(model, errors_of_lines(self.machine, self.moved, self.best.frame), -1.0)
        form, tool = self.format.tables, tuple(self.tool.tolist())
        try:
            return form.export(self.machine, rest, form.settings(), "correction", tool)
        except NothingToHold:
            raise
        except UserError:
            return None

    @property
    def _fitted_volume(self) -> Volume:
        return fitted_volume(self.machine, self.whole, self.tool)

    def page(self, _volume: Mapping[str, Any]) -> Page:
        """See `ExportedData.page`."""
        text = " ".join(filter(None, (self.format.meaning, self.format.remark(self.machine))))
        meant = "have the direction described here" if self.sign == "correction" else "are reversed"
        shift = _offset_shift(self.best)
        return Page(
            tool=f"tool length {-self.tool[2]:zg} mm.",
            stages=STAGES,
            stage="after_parameters_and_datum_shift",
            shift=shift,
            notices=[*self.unit_notes, WHERE, f"**{shift}.**"],
            meanings=[in_words(text, self.unit), f"The changes {meant}: {self.origin}."],
            listings=self._listings(),
            decimals=2,
        )

    def _listings(self) -> list[Listing]:
        numbers = [
            (new.name, old.text, new.text, f"{new.value - old.value:+z.{new.decimals}f}", new.unit)
            for old, new in zip(*self.numbers, strict=True)
        ]
        lines = [
            (line.name, f"{value:+.2f} {line.unit}", f"{uncertainty(2.0 * u, 2)} {line.unit}")
            for line, value, u in self.changes
        ]
        head = ("parameter", "by the machine file", "new", "change", "unit")
        title, text = "Lines of the rotary axes", "Shifts and tilts of the lines at zero pose, machine frame:"
        long = "The table has the shifts and tilts of the lines of the rotary axes at zero pose, in the machine frame."
        return [
            Listing("Parameters", head, numbers, "", WHERE),
            Listing(title, ("line", "change", "U (k = 2)"), lines, text, None),
            Listing(title, ("line", "change", "U (k=2)"), lines, None, long),
        ]


def _offset_shift(best: Best) -> str:
    """The change of work offsets that belongs to the parameters."""
    shift, turn = np.split(best.frame, 2)
    text = ", ".join(f"{letter} {value:+.4f}" for letter, value in zip("XYZ", shift.tolist(), strict=True))
    aligned = ", ".join(f"{letter} {value * 1e6:+.2f}" for letter, value in zip("ABC", turn.tolist(), strict=True))
    alignment = f" and turned by {aligned} urad about the axes of the machine" if turn.any() else ""
    return (
        "Work offset: touch the workpiece off again after the parameters are set. On the average of the volume a work "
        f"offset that stays on its workpiece is shifted by {text} mm{alignment}"
    )


def fitted_volume(machine: Machine, model: ErrorModel, tool: Array) -> Volume:
    """Commands over the working volume, for the tool and for a longer one."""
    q = Target(machine, model, tool).volume(FITTED_COMMANDS) * machine.scale
    tools = np.tile(tool, (len(q), 1))
    tools[1::2, 2] -= LONGER_MM
    approach = np.random.default_rng(len(q)).choice([-1.0, 1.0], q.shape)
    return Volume(machine, q, approach, tools)


def export_parameters(
    machine: Machine, model: ErrorModel, form: ParameterFormat, settings: Settings, sign: Sign, tool: tuple[float, ...]
) -> ExportedParameters:
    """The kinematic parameters of a control that leave the least tool point error over the working volume."""
    part = model.part(positional)
    if not part.effects:
        raise UserError("the calibration has no errors of positions alone: no kinematic parameter can hold any of it")
    freedoms = tuple(form.freedoms(machine, settings))
    best = best_lines(fitted_volume(machine, part, np.array(tool, float)), part, freedoms)
    steps = np.array([form.steps_of(machine, settings)[freedom.tilt] for freedom in freedoms])
    values = np.round(best.values / steps) * steps
    return ExportedParameters(form, machine, settings, sign, np.array(tool, float), model, freedoms, best, values)
