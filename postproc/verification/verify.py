"""Verification: the tool path of a program before and after correction, by the exact model.

It reads the two texts alone, so it evaluates the written program independently of the correction. It evaluates block
ends and points along straight and circular feed moves, as the control interpolates them in programmed coordinates.
Along a straight move whose errors provably change evenly, those at its points follow from those at its ends.
"""

from __future__ import annotations

import bisect
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from kinematics.columns import length
from kinematics.error_model.model import ErrorModel
from kinematics.machine import Machine, NDArrayBool
from kinematics.second_differences import SecondDifferences
from kinematics.transforms import Array
from postproc.compensation.conditions import Conditions
from postproc.compensation.correction import COLD, PoseErrors, pose_errors
from postproc.compensation.datum import datum_shifts, touched
from postproc.compensation.predicted_error import MachineStates, directions_at, in_a_program
from postproc.control.setup import Setup
from postproc.dialects import Dialect, Interpreter
from postproc.evaluation.joined_moves import Joined, JoinedMoves
from postproc.evaluation.predicted_errors import Statistic
from postproc.evaluation.trace import DrawnPaths
from postproc.execution import execution
from postproc.motion.along import positions_along
from postproc.motion.axis_words import AxisWords
from postproc.motion.motions import Motions
from postproc.motion.moves import Kind
from postproc.motion.reversals import INNER
from postproc.text.blocks import Blocks
from postproc.text.notes import Notes
from postproc.text.source import Source
from postproc.verification.best_fit import BestFit
from postproc.verification.contributions import Contributions
from postproc.verification.in_step import Matched, in_step
from postproc.write.added_blocks import Tag, start_fraction_of, tag_of

EVEN = 5e-6
"""mm, half of the last printed digit: errors that deviate by less from an even change follow from those at the ends."""
STRAIGHT = 1e-3
"""mm: as EVEN, of the places of these errors, which the best fit needs."""


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
    return list(run_motions(source, dialect, dialect.interpreter(machine, setup, Notes())))


def run_motions(
    source: Source, dialect: Dialect, interpreter: Interpreter, progress: Callable[[int], None] = lambda _: None
) -> Iterator[Motions]:
    """As `read_motions`, as they are read, with an interpreter that then holds the set-up that the program used.

    progress: called with the number of characters of each chunk.
    """
    for part in execution(source, dialect, interpreter).parts():
        chunk = _with_tags(part.motions)
        yield replace(chunk, blocks=Blocks(()), words=AxisWords())  # only the columns are used
        progress(part.size)


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
    """Evaluate the moves of a corrected program against those of its original, as `Verifier` does."""
    verifier = Verifier(nominal.machine, model, conditions, tolerance_um)
    for moves in in_step([nominal], [commanded]):
        verifier.add(moves)
    return verifier.verdict()


class Verifier:
    """Evaluates the moves of a corrected program against those of its original, some thousand at a time.

    Backlash take-ups and segments belong to the moves of the original. Directions are those of the moves of each text;
    a travel below half of the tolerance is no reversal.
    """

    def __init__(
        self,
        machine: Machine,
        model: ErrorModel,
        conditions: Conditions,
        tolerance_um: float,
        *,
        traced: bool = False,
    ) -> None:
        """`traced`: keep feed moves for a figure of the tool path."""
        self._model, self._conditions = model.part(in_a_program), conditions
        before = MachineStates(self._model, machine, conditions, tolerance_um)
        after = MachineStates(self._model, machine, conditions, tolerance_um, written=True)
        self._tracked, self._joined = (before, after), JoinedMoves(machine, 9)
        self.paths = DrawnPaths() if traced else None
        self._contributions = Contributions(machine, self._model, conditions)
        self._verdict = Verdict(0, Statistic(), Statistic(), Statistic(), Statistic(), {})

    def verdict(self) -> Verdict:
        """Errors of all moves that were added."""
        return replace(self._verdict, contributions=self._contributions.statistics())

    def add(self, moves: Matched) -> None:
        """Add the errors of the next moves of both programs, at their ends and along feed moves."""
        nominal = moves.matched
        relative = self._verdict.relative or bool(touched(nominal)[0])
        self._verdict = replace(self._verdict, moves=self._verdict.moves + len(moves.nominal), relative=relative)
        shift = datum_shifts(nominal, self._model, self._conditions).T
        at_ends, feed = nominal.evaluated, nominal.evaluated_paths
        directions = [
            states.along(motions) for states, motions in zip(self._tracked, (nominal, moves.commanded), strict=True)
        ]
        ends = np.full((3, 3, len(nominal)), np.nan)
        some = np.flatnonzero(at_ends | feed)
        ends[..., some] = self._vectors(moves, directions, 1.0, some)
        self._add(ends[..., at_ends], shift[:, at_ends], at_end=True)
        joined = self._joined.follow(nominal, moves.commanded, moves.commanded.machine_target, ends.reshape(9, -1).T)
        between, straight = np.flatnonzero(feed), self._straight(nominal, joined)[feed]
        starts, exact = joined.first.T.reshape(ends.shape)[..., between], np.flatnonzero(~straight)
        ways, shift = ends[..., between] - starts, shift[:, between]
        for share in INNER:
            vectors = starts + share * ways
            if len(exact):
                vectors[..., exact] = self._vectors(moves, directions, share, between[exact])
            self._add(vectors, shift, at_end=False)
        self._contributions.add(nominal, self._tracked[0].approach)
        if self.paths is not None:
            self.paths.add_moves(self._model, nominal, moves.commanded, self._tracked)

    def _vectors(self, moves: Matched, directions: Sequence[Array | None], share: float, rows: np.ndarray) -> Array:
        """Nominal tool points, and the absolute errors before and after `(3, 3, k)`, mm, workpiece frame.

        At a share of the paths of rows `(k,)`, by the exact model.
        """
        looked_at, shares = bisect.bisect_left((*INNER, 1.0), share), np.full(len(rows), share)
        bare, found, aim = moves.matched.bare.take(rows), list[PoseErrors](), None
        positions = [
            bare.in_machine(text.target[rows] if share == 1.0 else positions_along(text, rows, shares))
            for text in (moves.matched, moves.commanded)
        ]
        for q, approach in zip(positions, directions, strict=True):
            states = self._conditions.states(directions_at(approach, looked_at, rows))
            found.append(pose_errors(bare.machine, self._model, q, positions[0], bare.tool, states, nominal_pose=aim))
            aim = found[0].nominal_pose
        return np.array([found[0].nominal.T, *(errors.apart.T for errors in found)])

    def _straight(self, nominal: Motions, joined: Joined) -> NDArrayBool:
        """Rows `(n,)` along which the errors before and after are evenly spread between those at both ends, to EVEN."""
        machine, n = nominal.machine, len(nominal)
        if any(states.axes for states in self._tracked):
            return np.zeros(n, bool)
        bounds = SecondDifferences(self._conditions.errors(machine, self._model)).bounds
        before, after = (
            bounds(start, end, nominal.tool, nominal.tcp, np.zeros(n, bool), np.zeros((n, 3)), EVEN / 2.0)
            for start, end in zip(joined.starts, joined.ends, strict=True)
        )
        even = (np.maximum(before, after + joined.bends) <= EVEN) & (joined.path_bends <= STRAIGHT)
        return np.asarray(joined.rows & even & np.isfinite(joined.first).all(axis=1))

    def _add(self, vectors: Array, shift: Array, *, at_end: bool) -> None:
        """Add errors at the ends of moves or between them; vectors `(3, 3, k)` as of `_vectors`, shift `(3, k)`, mm."""
        verdict, absolute = self._verdict, self._verdict.absolute
        pairs = (
            ((verdict.before, absolute.before), (verdict.after, absolute.after))
            if at_end
            else ((verdict.path_before, absolute.path_before), (verdict.path_after, absolute.path_after))
        )
        point, *errors = vectors
        for (relative, from_offset), fit, error in zip(pairs, verdict.best_fit, errors, strict=True):
            relative.add(length(error - shift) * 1e3)
            from_offset.add(length(error) * 1e3)
            if not at_end:
                fit.add(point.T, error.T)
