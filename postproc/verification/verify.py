"""Verification: the tool path of a program before and after correction, by the exact model.

It reads the two texts alone, so it evaluates the written program independently of the correction. It evaluates block
ends and points along straight and circular feed moves, as the control interpolates them in programmed coordinates.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from kinematics.error_model.model import ErrorModel
from kinematics.error_transform import error_names_with_tool, error_transform_with_tool
from kinematics.machine import Machine
from kinematics.state import State
from kinematics.transforms import Array
from kinematics.user_error import UserError
from postproc.compensation.conditions import Conditions
from postproc.compensation.correction import COLD, pose_errors
from postproc.compensation.datum import datum_shifts, poses, touched
from postproc.compensation.predicted_error import MachineStates, directions_at, in_a_program
from postproc.control.setup import Setup
from postproc.dialects import Dialect, Interpreter
from postproc.evaluation.predicted_errors import Statistic
from postproc.execution import execution
from postproc.motion.axis_words import AxisWords
from postproc.motion.motions import Motions
from postproc.motion.moves import Kind
from postproc.motion.reversals import INNER
from postproc.motion.segments import like
from postproc.text.blocks import Blocks
from postproc.text.notes import Notes
from postproc.text.source import CHUNK, Source
from postproc.verification.best_fit import BestFit
from postproc.write.added_blocks import Tag, start_fraction_of, tag_of

CONTRIBUTION_ROWS = 2000
"""Approximate number of moves, evenly spaced, from which the contributions of error motions are computed."""


@dataclass(frozen=True)
class Absolute:
    """Errors of the tool point, um, if the work offsets are true."""

    before: Statistic = field(default_factory=Statistic)
    after: Statistic = field(default_factory=Statistic)
    path_before: Statistic = field(default_factory=Statistic)
    path_after: Statistic = field(default_factory=Statistic)


@dataclass(frozen=True)
class Verdict:
    """Errors of the tool point relative to the datum, um, before and after; contributions of error motions before.

    If the work offsets are true, errors relative to the datum are absolute errors.
    """

    moves: int
    before: Statistic
    after: Statistic
    path_before: Statistic
    path_after: Statistic
    contributions: dict[str, Statistic]
    absolute: Absolute = field(default_factory=Absolute)
    relative: bool = False
    """True if a work offset was touched off: errors relative to the datum then differ from absolute errors."""
    best_fit: tuple[BestFit, BestFit] = field(default_factory=lambda: (BestFit(), BestFit()))
    """Best fit of the errors along feed moves, before and after, all aligned as one part."""

    def json(self) -> dict[str, Any]:
        """The machine-readable form; every length in um."""
        return {
            "moves": self.moves,
            "errors_relative_to": "datum" if self.relative else "work offset",
            "block_ends_um": {"before": self.before.json(), "after": self.after.json()},
            "along_feed_moves_um": {"before": self.path_before.json(), "after": self.path_after.json()},
            "absolute_block_ends_um": {"before": self.absolute.before.json(), "after": self.absolute.after.json()},
            "absolute_along_feed_moves_um": {
                "before": self.absolute.path_before.json(),
                "after": self.absolute.path_after.json(),
            },
            "best_fit_along_feed_moves_um": {
                when: fit.json() for when, fit in zip(("before", "after"), self.best_fit, strict=True)
            },
            "contributions_before_um": {name: statistic.json() for name, statistic in self.contributions.items()},
        }


def read_motions(source: Source, dialect: Dialect, machine: Machine, setup: Setup) -> list[Motions]:
    """All moves of a program, chunk by chunk; UserError, located, at the first block that is not understood."""
    return run_motions(source, dialect, dialect.interpreter(machine, setup, Notes()))


def run_motions(source: Source, dialect: Dialect, interpreter: Interpreter) -> list[Motions]:
    """As `read_motions`, with an interpreter that then holds the set-up that the program used."""
    motions = []
    for part in execution(source, dialect, interpreter).parts():
        chunk = _with_tags(part.motions)
        motions.append(replace(chunk, blocks=Blocks(()), words=AxisWords()))  # only the columns are used
    return motions


def _with_tags(motions: Motions) -> Motions:
    """The moves of a corrected program, with the added blocks marked."""
    tagged = motions.blocks.marked(lambda block: tag_of(block.text) is not None)
    if not tagged.any():
        return motions
    takes_up = motions.blocks.marked(lambda block: tag_of(block.text) is Tag.TAKE_UP)
    start_fraction = np.zeros(len(tagged))
    for index in np.flatnonzero(tagged).tolist():
        start_fraction[index] = start_fraction_of(motions.blocks[index].text)
    kind = np.where(takes_up[motions.block] & (motions.kind == Kind.LINE), Kind.TAKE_UP, motions.kind)
    return replace(motions, kind=kind, added=tagged[motions.block], start_fraction=start_fraction[motions.block])


def verify(
    nominal: Motions, commanded: Motions, model: ErrorModel, conditions: Conditions = COLD, tolerance_um: float = 1.0
) -> Verdict:
    """Evaluate the moves of a corrected program against those of its original, which must match one to one.

    Backlash take-ups and segments belong to the moves of the original. Directions are those of the moves of each text;
    a travel below half of the tolerance is no reversal. UserError for programs with different moves.
    """
    moves, model = len(nominal), model.part(in_a_program)
    matched = like(nominal, commanded)
    if matched is None:
        raise UserError("the two programs do not make the same moves: is the second one a correction of the first?")
    machine = nominal.machine
    before = MachineStates(model, machine, conditions, tolerance_um)
    after = MachineStates(model, machine, conditions, tolerance_um, written=True)
    relative = bool(touched(nominal)[0])
    verdict = Verdict(moves, Statistic(), Statistic(), Statistic(), Statistic(), {}, relative=relative)
    ends: list[Array] = [np.empty((0, len(machine.axes)))]
    starts = np.flatnonzero(~matched.added)[::CHUNK]  # segments of one move stay together
    for rows in np.split(np.arange(len(matched)), starts[1:]):
        _evaluate((matched.take(rows), commanded.take(rows)), (before, after), model, conditions, verdict)
        if before.approach is not None:
            ends.append(before.approach)
    evaluated = matched.evaluated
    approach = np.concatenate(ends)[evaluated] if before.axes else None
    some = np.arange(int(evaluated.sum()))[:: max(1, int(evaluated.sum()) // CONTRIBUTION_ROWS)]
    state = conditions.state(matched.machine_target[evaluated], approach).rows(some)
    _contributions(model, conditions, matched.bare.take(np.flatnonzero(evaluated)[some]), state, verdict.contributions)
    return verdict


def _evaluate(
    texts: tuple[Motions, Motions],
    tracked: tuple[MachineStates, MachineStates],
    model: ErrorModel,
    conditions: Conditions,
    verdict: Verdict,
) -> None:
    """Add the errors at some rows of both texts, at their ends and along feed moves, to the verdict."""
    nominal, _ = texts
    machine, tool, absolute = nominal.machine, nominal.tool, verdict.absolute
    shift = datum_shifts(nominal, model, conditions)
    directions = [machine_states.along(motions) for machine_states, motions in zip(tracked, texts, strict=True)]
    feed = nominal.evaluated_paths
    along = ((verdict.path_before, absolute.path_before), (verdict.path_after, absolute.path_after))
    ends = ((verdict.before, absolute.before), (verdict.after, absolute.after))
    evaluations = [*((share, i, feed, along) for i, share in enumerate(INNER)), (1.0, -1, nominal.evaluated, ends)]
    for share, i, rows, statistics in evaluations:
        nominal_q = nominal.in_machine(nominal.along(share))[rows]
        columns = zip(texts, directions, statistics, verdict.best_fit, strict=True)
        for motions, approach, (relative, from_offset), best_fit in columns:
            q = motions.in_machine(motions.along(share))[rows]
            states = conditions.states(directions_at(approach, i, rows))
            found = pose_errors(machine, model, q, nominal_q, tool[rows], states, shift[rows])
            relative.add(found.point_um)
            from_offset.add(found.absolute_um)
            if i >= 0:
                best_fit.add(found.nominal, found.apart)


def _contributions(
    model: ErrorModel, conditions: Conditions, motions: Motions, state: State, into: dict[str, Statistic]
) -> None:
    """Add the contribution of each error motion to the tool point error relative to the datum, first order.

    At the ends of `motions`; `state`: of the same rows. Location errors count with their error motions.
    """
    if not len(motions):
        return
    machine, (touch_offs, which) = motions.machine, touched(motions)
    parts = _parts(machine, model, state, motions.tool)
    if touch_offs:
        q, tool = poses(machine, touch_offs)
        at_datum = _parts(machine, model, conditions.state(q, np.zeros_like(q)), tool)
        parts = parts - np.concatenate([at_datum, np.zeros((1, *parts.shape[1:]))])[which]
    for i, name in enumerate(error_names_with_tool(machine)):
        if parts[:, :, i].any():
            into.setdefault(name, Statistic()).add(np.linalg.norm(parts[:, :, i], axis=1) * 1e3)


def _parts(machine: Machine, model: ErrorModel, state: State, tool: Array) -> Array:
    """Displacement of the tool point by each error motion `(n, 3, error motions)`, mm, first order; tool `(n, 3)`."""
    errors = model.errors(machine, state).reshape(len(state), -1)
    return np.asarray(error_transform_with_tool(machine, state.positions, tool)[:, :3] * errors[:, None])
