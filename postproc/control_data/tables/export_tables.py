"""From a calibration to the files of one control, and the remaining errors."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import msgspec
import numpy as np

from kinematics.correction import correct_position
from kinematics.error_model.model import ErrorModel
from kinematics.machine import Machine
from kinematics.state import State
from kinematics.transforms import Array
from kinematics.user_error import UserError
from postproc.compensation.correction import PoseErrors
from postproc.control_data.exported import ExportedData, Listing, Page, Unrepresented
from postproc.control_data.format import Settings, Sign, in_words
from postproc.control_data.remaining_error import EvaluationPoints, Move, stages, summary, volume_points
from postproc.control_data.tables.build import build
from postproc.control_data.tables.content import Content
from postproc.control_data.tables.control_parameters import parameter_rows
from postproc.control_data.tables.motion_tables import build_motions, effects_of_motions
from postproc.control_data.tables.not_representable import not_representable, short_waves
from postproc.control_data.tables.table_model import effects_of
from postproc.control_data.tables.target import Target, positional, too_fine
from postproc.control_data.tables.terms import added
from rendering.volume import Field

if TYPE_CHECKING:
    from postproc.control_data.tables.table_format import TableFormat

ANGULAR = 1e-9
"""rad: resolution of angular errors in formats that hold them."""


COORDINATES = "from the spindle nose. Positions are in machine coordinates."
STAGES = {
    "before": "without compensation",
    "after_tables": "with these tables",
    "after_tables_and_datum_shift": "with these tables and the zero of the axes shifted as stated at the top",
    "after_nc_correction": "with corrected programs and no tables",
    "after_tables_and_nc_correction_of_the_rest": "with these tables and programs corrected for the remaining errors",
}


class TableRow(NamedTuple):
    """The contents of one table."""

    name: str
    points: str
    first: str
    last: str
    largest: str


class NothingToHold(UserError):
    """A format of tables can hold no error of a calibration."""


@dataclass(frozen=True, repr=False)
class Exported(ExportedData):
    """Tables of one control."""

    format: TableFormat
    """The format of the tables."""
    content: Content
    """The tables before they are written: nodes, mm or degrees, and corrections, mm or rad."""
    target: Target
    """Machine, calibration and tool for which they are made."""
    datum: dict[str, float] = field(default_factory=dict)
    """Constants by axis, mm or degrees, that the tables must not hold."""

    @cached_property
    def files(self) -> dict[str, str]:
        """Texts of the files by their names."""
        return self.format.write(self.content.in_unit(self.unit))

    @cached_property
    def taken(self) -> ErrorModel:
        """The errors that the tables correct."""
        effects = effects_of(self.machine, self.content.terms) + effects_of_motions(self.machine, self.content.motions)
        return msgspec.structs.replace(self.whole, effects=tuple(effects), covariance=None)

    @property
    def moves(self) -> Move:
        """The effect of the tables on commands."""
        if self.format.capabilities is not None:
            return lambda q, approach: q + added(self.content.terms, self.target.machine, q, approach)
        return self._by_motions

    @property
    def left(self) -> list[Unrepresented]:
        """Errors that the tables cannot represent."""
        points = self.format.limits(self.content.settings).points
        terms = None if self.format.capabilities is None else self.content.terms
        return [*not_representable(self.target, self.whole, terms), *short_waves(self.target, points)]

    @cached_property
    def _in_the_volume(self) -> dict[str, PoseErrors]:
        return stages(self.target, self.moves, self.taken, self.datum, volume_points(self.target))

    def errors_in_the_volume(self) -> dict[str, Any]:
        """By stage."""
        return summary(self._in_the_volume)

    def errors_at(self, points: EvaluationPoints) -> dict[str, Any]:
        """By stage."""
        return summary(stages(self.target, self.moves, self.taken, self.datum, points))

    def _by_motions(self, q: Array, approach: Array) -> Array:
        machine = self.target.machine
        tool, movable = np.broadcast_to(self.target.tool, (len(q), 3)), np.ones(q.shape, bool)
        return correct_position(machine, lambda p: self.taken.errors(machine, State(p, approach)), q, tool, movable)

    @cached_property
    def loading(self) -> str:
        """For sheet.md: how the files are loaded into the control."""
        text = "\n\n".join(filter(None, (self.format.loading, self.format.remark(self.content))))
        return in_words(text, self.unit)

    @property
    def rows(self) -> list[TableRow]:
        """The contents of all tables; positions in mm and degrees."""
        return list(_rows(self.content))

    def page(self, volume: Mapping[str, Any]) -> Page:
        """See `ExportedData.page`."""
        sizes, (x, y, z) = volume["tool_point_um"], self.tool
        stage = "after_tables_and_datum_shift" if self.datum else "after_tables"
        none = sizes[stage]["max"] >= sizes["before"]["max"]
        shift = _zero_shift(self.datum, sizes)
        meant = "the error (actual minus commanded)" if self.sign == "error" else "the correction (added)"
        return Page(
            tool=f"tool tip at ({x:zg}, {y:zg}, {z:zg}) mm\n{COORDINATES}",
            stages=STAGES,
            stage=stage,
            remark=" The largest error does not become smaller." if none else "",
            shift=shift,
            notices=[*([f"**{shift}.**"] if shift else []), *self.unit_notes],
            meanings=[f"Values are {meant}: {self.origin}.", in_words(self.format.meaning, self.unit)],
            listings=[self._along_axes(stage), *self._listings()],
            fields=[Field("without tables", self.whole), Field("left by the tables", self.rest)],
            decimals=3,
            closing=[f"- the orientation of the tool: RMS {volume['tool_axis_urad']['after_tables']['rms']:.2f} urad"],
        )

    def _along_axes(self, stage: str) -> Listing:
        """The error before, and at a stage, in X, Y and Z."""
        apart = [(STAGES[each], self._in_the_volume[each].apart) for each in ("before", stage)]
        rows = [(name, *(f"{um:.2f}" for um in 1e3 * np.sqrt(np.mean(each**2, axis=0)))) for name, each in apart]
        text = "Tool point error over the working volume in the coordinates of the workpiece, um RMS."
        return Listing("Errors along X, Y and Z", ("errors of the machine", "X", "Y", "Z"), rows, text, text)

    def _listings(self) -> list[Listing]:
        head = ("table", "points", "from", "to", "largest value")
        tables = Listing("Tables", head, self.rows, "", "Positions are in mm and degrees.")
        rows = parameter_rows(self.whole, self.content, self.format.family)
        text = "Values of the calibration; do not set a parameter whose value the tables contain already."
        parameters = Listing("Parameters", ("of", "value", "where", "held by the tables"), rows, text, None)
        return [tables, parameters] if rows else [tables]


def _zero_shift(datum: Mapping[str, float], sizes: Mapping[str, Mapping[str, float]]) -> str:
    """The remaining error without a shift of the axes' zeros, and the shift; empty if none is needed."""
    if not datum:
        return ""
    before, alone, both = (sizes[stage] for stage in ("before", "after_tables", "after_tables_and_datum_shift"))
    worse = "; that is worse than no tables" if any(alone[k] > before[k] for k in ("rms", "max")) else ""
    shift = ", ".join(f"{axis} {value:+.6f}" for axis, value in datum.items())
    return (
        f"Zero shift: the tables hold no constant and alone leave {_pair(alone)} of {_pair(before)} um (RMS, max)"
        f"{worse}. With the zeros of the axes shifted by {shift} (mm, degrees, added to commands) they leave "
        f"{_pair(both)} um. Programs corrected with the calibration of --rest contain this shift already: do not shift "
        "the zeros for them"
    )


def _pair(numbers: Mapping[str, float]) -> str:
    return f"{numbers['rms']:.1f}, {numbers['max']:.1f}"


def _rows(content: Content) -> Iterator[TableRow]:
    for term in content.terms:
        unit = content.machine.axes[content.machine.index(term.output)].unit
        for k, factor in enumerate(term.factors):
            nodes = factor.nodes if isinstance(factor.nodes, tuple) else (factor.nodes,)
            first, last = (", ".join(f"{n[end]:g}" for n in nodes) for end in (0, -1))
            size = f"{np.abs(factor.values).max():.6f} {'x' if k else unit}"
            name = term.name if len(term.factors) == 1 else f"{term.name}, factor of {factor.axes[0]}"
            yield TableRow(name, " x ".join(str(len(n)) for n in nodes), first, last, size)
    for table in content.motions:
        largest = max(np.abs(table.forward).max(), np.abs(table.backward).max())
        size = f"{largest * 1e6:.3f} urad" if table.angular else f"{largest * 1e3:.3f} um"
        yield TableRow(table.name, str(len(table.nodes)), f"{table.nodes[0]:g}", f"{table.nodes[-1]:g}", size)


def export(
    machine: Machine, model: ErrorModel, form: TableFormat, settings: Settings, sign: Sign, tool: tuple[float, ...]
) -> Exported:
    """The tables of a control for one tool, in its format."""
    whole = model.part(positional)
    part = whole.part(lambda effect: not too_fine(effect, machine))
    if not part.effects:
        raise UserError("the calibration has no errors that a table can hold")
    limits, tip = form.limits_mm(settings, machine), np.array(tool)
    if form.capabilities is None:
        target = Target(machine, part, tip)
        motions = tuple(build_motions(target, limits, ANGULAR, bidirectional=form.name == "csv"))
        content, datum = Content(machine, settings, sign, motions=motions), {}
    else:
        capabilities = form.capabilities(settings)
        rotary = any(axis.rotary and axis.name[0] in capabilities.outputs for axis in machine.axes) and capabilities.own
        target = Target(machine, part, tip, rotary)
        built = build(target, capabilities, limits, form.name)
        content, datum = Content(machine, settings, sign, terms=built.terms), built.datum
        if not content.terms:
            raise NothingToHold(
                f"{form.title} can hold nothing of this calibration ({', '.join(each.name for each in part.effects)}): "
                "choose another format, or correct programs instead"
            )
    exported = Exported(form, machine, settings, sign, tip, model, content, replace(target, model=whole), datum)
    _ = exported.files  # UserError for tables that the format cannot hold
    return exported
