"""From a calibration to the kinematic parameters of a control, and the remaining errors."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any, NamedTuple

import msgspec
import numpy as np

from kinematics.effects import Effect, LocationError
from kinematics.error_model.model import ErrorModel
from kinematics.machine import Machine
from kinematics.transforms import Array
from kinematics.user_error import UserError
from postproc.compensation.correction import PoseErrors
from postproc.kinematic_parameters.as_errors import errors_of_lines
from postproc.kinematic_parameters.best import Best, Volume, best_lines, unheld
from postproc.kinematic_parameters.format import Number, ParameterFormat, signed
from postproc.kinematic_parameters.lines import Freedom, moved_lines, positions_with
from postproc.tables.export import Exported
from postproc.tables.export import export as export_tables
from postproc.tables.format import Settings, Sign, parse_settings
from postproc.tables.formats import find_format
from postproc.tables.not_representable import WORTH, Unrepresented
from postproc.tables.remaining_error import summary, volume_points
from postproc.tables.table_model import joined
from postproc.tables.target import Target, positional

POINTS = 512
"""Commands of the volume at which the lines are fitted."""
LONGER_MM = 100.0
"""Half of the commands have a tool that is longer by this, so that the lines are right for every tool."""


class Change(NamedTuple):
    """One freedom of a line with its change, and the standard uncertainty by the calibration."""

    freedom: Freedom
    value: float
    """um or urad."""
    u: float


@dataclass(frozen=True)
class ExportedParameters:
    """Kinematic parameters of one control."""

    format: ParameterFormat
    machine: Machine
    settings: Settings
    sign: Sign
    tool: Array
    """`(3,)`, mm."""
    whole: ErrorModel
    """The calibration."""
    freedoms: tuple[Freedom, ...]
    best: Best
    values: Array
    """Changes of the lines `(k,)`, mm and rad, as the control holds them."""

    @cached_property
    def moved(self) -> Machine:
        """The machine with the lines that the control gets."""
        return moved_lines(self.machine, self.freedoms, self.values)

    @cached_property
    def numbers(self) -> tuple[list[Number], list[Number]]:
        """The numbers in the control: by the machine file, and with the changes."""
        before, after = (self.format.numbers(each, self.settings) for each in (self.machine, self.moved))
        return before, signed(before, after, self.sign)

    @property
    def files(self) -> dict[str, str]:
        """Texts by name: the parameters, and those of the machine file to go back to."""
        form, name = self.format, self.machine.name
        before, after = self.numbers
        headings = {form.file: f"machine {name}, calibration {self.whole.id}", form.file_before: f"machine {name}"}
        return {
            file: form.write(found, self.machine, self.settings, headings[file])
            for file, found in ((form.file, after), (form.file_before, before))
        }

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

    @cached_property
    def rest(self) -> ErrorModel:
        """The calibration minus the errors that the parameters correct."""
        left = joined(self.whole, self.taken.effects, -1.0)
        source = f"{self.whole.provenance.source}; less parameters in the control ({self.format.name})".lstrip("; ")
        return msgspec.structs.replace(left, provenance=msgspec.structs.replace(left.provenance, source=source))

    @property
    def left(self) -> list[Unrepresented]:
        """Errors that the parameters cannot hold, the largest first."""
        volume, found = self._fitted_volume, []
        for effect in self.whole.effects:
            if effect.ACTS_ON == "instrument":
                continue
            if not positional(effect):
                found.append(Unrepresented(effect.name, float("nan"), "depends on more than positions"))
                continue
            alone = msgspec.structs.replace(self.whole, effects=(effect,), covariance=None)
            rms = unheld(volume, alone, self.freedoms)
            if rms > WORTH:
                found.append(Unrepresented(effect.name, round(rms, 4), _reason(effect, self.machine)))
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
        tables = self._tables(model)
        if tables is not None:
            shift = np.array([tables.datum.get(axis.name, 0.0) for axis in machine.axes]) * machine.scale
            commands = lines(points.q, self.best.frame)
            found["after_parameters_datum_shift_and_tables"] = left(tables.moves(commands, points.approach) + shift)
        found["after_nc_correction"] = left(points.corrected(machine, model))
        found["after_parameters_and_nc_correction_of_the_rest"] = left(lines(points.corrected(machine, rest)))
        return found

    def _tables(self, model: ErrorModel) -> Exported | None:
        """The tables of the same control for the errors that lines and work offset leave; None where it has none."""
        rest = joined(model, errors_of_lines(self.machine, self.moved, self.best.frame), -1.0)
        form = find_format(self.format.tables)
        try:
            tool = tuple(self.tool.tolist())
            return export_tables(self.machine, rest, form, parse_settings(form.settings, ()), "correction", tool)
        except UserError:
            return None

    @property
    def _fitted_volume(self) -> Volume:
        return fitted_volume(self.machine, self.whole, self.tool)


def _reason(effect: Effect, machine: Machine) -> str:
    """Why the parameters of a control's kinematics do not hold an error."""
    if not isinstance(effect, LocationError):
        return "it changes with positions: for tables or corrected programs"
    axis = machine.axes[machine.index(effect.axis)]
    if not axis.rotary:
        return "location error of a linear axis"
    if effect.component == axis.name[0]:
        return "zero angle of the axis: its reference position"
    return "tilt of the line" if effect.component in "ABC" else "displacement that these parameters do not have"


def fitted_volume(machine: Machine, model: ErrorModel, tool: Array) -> Volume:
    """Commands over the working volume, for the tool and for a longer one."""
    q = Target(machine, model, tool).volume(POINTS) * machine.scale
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
    steps = np.array([form.steps(settings)[freedom.tilt] for freedom in freedoms])
    values = np.round(best.values / steps) * steps
    return ExportedParameters(form, machine, settings, sign, np.array(tool, float), model, freedoms, best, values)
