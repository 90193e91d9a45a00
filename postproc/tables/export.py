"""From a calibration to the files of one control, and the remaining errors."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any, Protocol

import msgspec
import numpy as np

from kinematics.correction import correct_position
from kinematics.effects import Effect
from kinematics.error_model.model import ErrorModel
from kinematics.machine import Machine
from kinematics.state import State
from kinematics.transforms import Array
from kinematics.user_error import UserError
from postproc.tables.build import build
from postproc.tables.format import Content, Format, Settings, Sign
from postproc.tables.motion_tables import build_motions, effects_of_motions
from postproc.tables.not_representable import Unrepresented, not_representable, short_waves
from postproc.tables.remaining_error import EvaluationPoints, Move, stages, summary, volume_points
from postproc.tables.table_model import effects_of, joined
from postproc.tables.target import Target, positional, too_fine
from postproc.tables.terms import added

ANGULAR = 1e-9
"""rad: resolution of angular errors in formats that hold them."""


@dataclass(frozen=True)
class Exported:
    """Tables of one control."""

    format: Format
    content: Content
    target: Target
    whole: ErrorModel
    """The calibration."""
    files: dict[str, str]
    taken: ErrorModel
    """The errors that the tables correct."""
    datum: dict[str, float] = field(default_factory=dict)
    """Constants by axis, mm or degrees, that the tables must not hold."""

    @property
    def rest(self) -> ErrorModel:
        """The calibration minus the effect of the tables: the errors that corrected programs must still correct."""
        left = joined(self.whole, self.taken.effects, -1.0)
        source = f"{self.whole.provenance.source}; less tables in the control ({self.format.name})".lstrip("; ")
        return msgspec.structs.replace(left, provenance=msgspec.structs.replace(left.provenance, source=source))

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

    def errors_in_the_volume(self) -> dict[str, Any]:
        """By stage."""
        return self.errors_at(volume_points(self.target))

    def errors_at(self, points: EvaluationPoints) -> dict[str, Any]:
        """By stage."""
        return summary(stages(self.target, self.moves, self.taken, self.datum, points))

    def _by_motions(self, q: Array, approach: Array) -> Array:
        machine = self.target.machine
        tool, movable = np.broadcast_to(self.target.tool, (len(q), 3)), np.ones(q.shape, bool)
        return correct_position(machine, lambda p: self.taken.errors(machine, State(p, approach)), q, tool, movable)


class Signed(Protocol):
    """A format with a name, and a sign if it is known."""

    @property
    def name(self) -> str:
        """Its name."""
        ...

    @property
    def sign(self) -> Sign | None:
        """Meaning of its values; None if no source states it."""
        ...


def sign_of(format: Signed, given: str | None, probe: str = "ncomp export --probe AXIS") -> Sign:
    """Meaning of the values of its files; UserError if it is not known, or contradicts the option.

    probe: the command that writes the table which shows the sign.
    """
    if given not in (None, "error", "correction"):
        raise UserError(f"--sign {given}: expected error or correction")
    if format.sign is None and given is None:
        raise UserError(
            f"no source states whether values of {format.name} are errors or corrections: find out with the table that "
            f"'{probe}' writes, and give --sign error or --sign correction"
        )
    if format.sign is not None and given not in (None, format.sign):
        raise UserError(f"--sign {given}: values of {format.name} are known to mean the {format.sign}")
    return format.sign or ("error" if given == "error" else "correction")


def export(
    machine: Machine, model: ErrorModel, format: Format, settings: Settings, sign: Sign, tool: tuple[float, ...]
) -> Exported:
    """The tables of a control for one tool, in its format."""
    whole = model.part(positional)
    part = whole.part(lambda effect: not too_fine(effect, machine))
    if not part.effects:
        raise UserError("the calibration has no errors that a table can hold")
    limits = format.limits(settings)
    if format.capabilities is None:
        target = Target(machine, part, np.array(tool))
        motions = tuple(build_motions(target, limits, ANGULAR, bidirectional=format.name == "csv"))
        content, datum = Content(machine, settings, sign, motions=motions), {}
        effects: list[Effect] = effects_of_motions(machine, motions)
    else:
        capabilities = format.capabilities(settings)
        rotary = any(axis.rotary and axis.name[0] in capabilities.outputs for axis in machine.axes) and capabilities.own
        target = Target(machine, part, np.array(tool), rotary)
        built = build(target, capabilities, limits, format.name)
        content, datum = Content(machine, settings, sign, terms=built.terms), built.datum
        effects = effects_of(machine, built.terms)
    taken = msgspec.structs.replace(model, effects=tuple(effects), covariance=None)
    target = replace(target, model=whole)
    return Exported(format, content, target, model, format.write(content), taken, datum)
