"""Evaluation of written moves: the errors that the exact model predicts before and after the correction."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Set
from functools import cached_property
from typing import NamedTuple

import msgspec
import numpy as np

from kinematics.columns import ChainColumns, Vector
from kinematics.error_model.model import ErrorModel
from kinematics.machine import Machine, NDArrayBool
from kinematics.transforms import Array, read_only
from postproc.compensation.conditions import Conditions
from postproc.compensation.correction import PoseErrors, pose_errors
from postproc.compensation.predicted_error import MachineStates
from postproc.compensation.significance import Significance
from postproc.evaluation.guard import Guard, Outside, WorseMove
from postproc.evaluation.joined_moves import JoinedMoves
from postproc.evaluation.predicted_errors import AT_ENDS, BETWEEN_ENDS, UNCORRECTED, PredictedErrors, UnsplitMoves
from postproc.evaluation.sampled_uncertainty import SampledUncertainties
from postproc.evaluation.trace import Trace
from postproc.motion.along import CLOSELY, INNER, positions_along
from postproc.motion.motions import Motions
from postproc.motion.moves import Kind

PREDICTED_SHARES = (0.25, 0.5, 0.75)
"""Shares of the path of a written block at which the error between its ends is predicted."""
STRAIGHT_SHARE = 0.02
"""Share of the tolerance by which the error between the ends of a move may deviate from that at its ends, if it is not
evaluated there."""
NOWHERE = read_only(np.empty(0))
"""Errors of no place."""
ERROR_JUMPS = "its error jumps, or an axis with backlash reverses within it"
ROTARY_ONLY = (
    "a feed move of rotary axes only keeps its linear axes, because F would mean another speed with them; "
    "--rotary-feed inverse-time corrects it, except in Klartext"
)


class ErrorsBefore(NamedTuple):
    """Errors in the input at the ends of n rows; columns `(n,)`, or `(1,)` where all rows are equal."""

    there: Vector
    """Nominal tool points, mm, workpiece frame."""
    point_um: Array
    """As of PoseErrors, like the others."""
    absolute_um: Array
    axis_urad: Array

    @classmethod
    def of(cls, found: PoseErrors) -> ErrorsBefore:
        """Those at nominal positions."""
        return cls(found.there, found.point_um, found.absolute_um, found.axis_urad)

    def rows(self, rows: NDArrayBool) -> ErrorsBefore:
        """Those of some rows, by a mask `(n,)`."""
        if rows.all():
            return self
        x, y, z, *errors = (np.broadcast_to(column, rows.shape)[rows] for column in (*self.there, *self[1:]))
        return ErrorsBefore((x, y, z), *errors)


class WrittenMoves(msgspec.Struct, frozen=True, dict=True):
    """The moves of a chunk, as programmed and as written."""

    motions: Motions
    commanded: Motions
    """The rows with starts, ends and arcs as they are written."""
    lines: np.ndarray
    """Number of the first line of the block of each row `(n,)`."""
    bounds: Array
    """Upper bounds `(n,)`, mm, of the second difference of the error along each move."""
    unsplit: Mapping[int, str]
    """Reason why a move beyond the tolerance is not split, by block."""
    suspect: Set[int]
    """Blocks whose moves may exceed their limits."""
    before: ErrorsBefore | None = None
    """Errors in the input at the ends of the rows, if the correction has found them."""

    @cached_property
    def written(self) -> Array:
        """Axis positions `(n, axes)` at the written ends, mm and rad."""
        return self.motions.in_machine(self.commanded.target)

    @cached_property
    def correctable(self) -> NDArrayBool:
        """Rows `(n,)` that end programmed moves."""
        return np.asarray(self.motions.programmed & ~self.motions.intermediate)

    @property
    def moved(self) -> Array:
        """Written minus programmed ends `(n, axes)`, mm and degrees."""
        return np.asarray(self.commanded.target - self.motions.target)

    @property
    def corrected(self) -> NDArrayBool:
        """True `(n, axes)` where the program has given the position at the end of a programmed move."""
        return np.asarray(self.motions.correctable & self.correctable[:, None])


class Evaluated(NamedTuple):
    """Results of an evaluation."""

    errors: PredictedErrors
    outside: Outside
    worse: str
    """Text on moves that are worse than in the input, if that is accepted; empty for none."""
    notes: list[str]
    trace: Trace | None


class Evaluation:
    """Evaluates the moves of a program, chunk after chunk."""

    def __init__(
        self,
        machine: Machine,
        model: ErrorModel,
        conditions: Conditions,
        tolerance_um: float,
        *,
        worse: bool,
        turns: bool,
        traced: bool,
    ) -> None:
        """`worse`: moves may be worse than in the input; `turns`: rotary axes are corrected; `traced`: for figures."""
        self.machine, self._model, self._conditions, self._tolerance_um = machine, model, conditions, tolerance_um
        self._before = MachineStates(model, machine, conditions, tolerance_um)
        self._after = MachineStates(model, machine, conditions, tolerance_um, written=True)
        self._uncertainties = SampledUncertainties(machine, model, conditions, Significance(tolerance_um))
        self._found = PredictedErrors(
            uncertainty=self._uncertainties.statistic, significance=self._uncertainties.significance
        )
        self._guard = Guard(machine, tolerance_um, worse=worse, turns=turns)
        self._outside = Outside()
        self._trace = Trace(machine, model) if traced else None
        self._joined = JoinedMoves(machine, 3)

    def add(self, moves: WrittenMoves) -> None:
        """Evaluate the moves of the next chunk; Refusal for one that is worse than in the input."""
        try:
            self.evaluate(moves)
        except WorseMove as found:
            raise moves.motions.blocks[found.block].refuse(found.reason) from None

    def settle(self) -> None:
        """All chunks are evaluated already."""

    def evaluate(self, moves: WrittenMoves) -> None:
        """Add moves like `add`, but raise WorseMove instead of a Refusal: no texts are needed."""
        motions, evaluated = moves.motions, moves.motions.evaluated
        errors, left = np.full((len(motions), 2), np.nan), np.full((len(motions), 3), np.nan)
        errors[evaluated], left[evaluated] = self._evaluate_ends(moves, evaluated)
        self._guard.check_ends(motions, moves.lines, np.flatnonzero(evaluated), errors[evaluated])
        self._evaluate_between(moves, errors[:, 0], left)
        self._evaluate_uncorrected(moves)
        if self._trace is not None:
            moved = np.where(moves.corrected, moves.moved, np.nan)
            self._trace.add(motions, moves.lines, moves.correctable, moved, errors)
            self._trace.add_paths(motions, moves.commanded, (self._before, self._after))

    def finish(self) -> Evaluated:
        """The results for all moves."""
        self._uncertainties.finish()
        return Evaluated(self._found, self._outside, self._guard.worse(), self._guard.notes(), self._trace)

    def _evaluate_ends(self, moves: WrittenMoves, evaluated: NDArrayBool) -> tuple[Array, Array]:
        """Errors `(k, 2)`, um, before and after at the ends of the evaluated rows, and those after as vectors `(k, 3)`.

        Vectors in mm, workpiece frame, relative to the datum.
        """
        motions, found, machine = moves.motions, self._found, self.machine
        tool = motions.tool[evaluated]
        states_before = self._before.states(motions, evaluated)
        states_after = self._after.states(moves.commanded, evaluated)
        if not evaluated.any():
            return np.empty((0, 2)), np.empty((0, 3))
        nominal, ends = motions.machine_target[evaluated], moves.written[evaluated]
        shift = self._before.datum_shifts(motions)[evaluated]
        if moves.before is None:
            found_before = pose_errors(machine, self._model, nominal, nominal, tool, states_before, shift)
            nominal_pose, before = found_before.nominal_pose, ErrorsBefore.of(found_before)
        else:
            before = moves.before.rows(evaluated)
            nominal_pose = ChainColumns(machine, nominal), before.there
        after = pose_errors(machine, self._model, ends, nominal, tool, states_after, shift, nominal_pose)
        found.before.add(before.point_um)
        found.after.add(after.point_um)
        found.absolute_before.add(before.absolute_um)
        found.absolute_after.add(after.absolute_um)
        found.tilt_before.add(before.axis_urad)
        found.tilt_after.add(after.axis_urad)
        found.anywhere.add(AT_ENDS, before.point_um, after.point_um)
        errors = np.stack([before.point_um, after.point_um], axis=1)
        touch_offs = [frame.touch_off for frame in motions.frames], motions.frame[evaluated]
        self._uncertainties.add(nominal, states_before.approach, tool, touch_offs, errors)
        self._outside.add(self._model.excesses(machine, states_before(nominal)), moves.lines[evaluated])
        return errors, after.apart - shift

    def _evaluate_between(self, moves: WrittenMoves, before: Array, left: Array) -> None:
        """Evaluate feed moves between their ends; before `(n,)`: errors in the input at the ends of all rows, um.

        left `(n, 3)`: errors after the correction at these ends, mm.
        """
        motions, commanded = moves.motions, moves.commanded
        errors_by_ends, rows = self._between_by_ends(moves, before, left), motions.known_paths
        if not rows.any():
            return
        evaluated = motions.evaluated_paths[rows]
        if self._trace is not None:
            self._trace.between_before.add(self._errors_between(motions, motions, self._before, rows)[evaluated])
        errors_between = errors_by_ends[rows]
        exact, found = np.isnan(errors_between), np.flatnonzero(rows)
        if exact.any():
            some = found[exact]
            errors_between[exact] = self._errors_between(motions, commanded, self._after, some)
            some = some[self._may_be_largest(moves, before, some)]
            self._found.anywhere.add(BETWEEN_ENDS, self._errors_between(motions, motions, self._before, some), NOWHERE)
        self._found.anywhere.add(BETWEEN_ENDS, NOWHERE, errors_between)
        self._add_closely(moves, found[errors_between > self._tolerance_um])
        self._found.between_ends.add(errors_between[evaluated])
        self._guard_between(moves, before, found[evaluated], errors_between[evaluated])
        beyond, rotary_only = errors_between > self._tolerance_um, motions.rotary_only
        for row, size in zip(found[beyond].tolist(), errors_between[beyond].tolist(), strict=True):
            block = int(motions.block[row])
            reason = ROTARY_ONLY if rotary_only[row] else moves.unsplit.get(block, ERROR_JUMPS)
            self._found.not_split.setdefault(reason, UnsplitMoves()).add(int(moves.lines[row]), size)

    def _may_be_largest(self, moves: WrittenMoves, before: Array, rows: np.ndarray) -> NDArrayBool:
        """True `(rows,)` for moves whose error in the input may exceed the largest one so far; before: as above.

        The error along a straight move deviates from a straight line by no more than a bound of its second difference,
        so that it exceeds those at both ends by no more, as long as each axis stays on its side of the play.
        """
        motions, steady = moves.motions, self._before.steady
        joined = (motions.kind[1:] == Kind.LINE) & (motions.frame[1:] == motions.frame[:-1])
        joined &= (motions.start[1:] == motions.target[:-1]).all(axis=1)
        if steady is not None:
            joined &= steady[1:]
        largest = np.full(len(motions), np.inf)
        bounds = moves.bounds[1:] * 1e3
        largest[1:] = np.where(joined, np.maximum(before[1:], before[:-1]) + bounds, np.inf)
        return np.asarray(~(largest[rows] <= self._found.anywhere.before))

    def _add_closely(self, moves: WrittenMoves, rows: np.ndarray) -> None:
        """Add the errors of rows beyond the tolerance to the largest ones, at the places where `verify` looks."""
        pairs = ((moves.motions, self._before), (moves.commanded, self._after))
        reverses = [states.reverses[rows] for _, states in pairs if states.reverses is not None]
        turned = rows[np.any(reverses, axis=0)] if reverses else rows[:0]
        for some, shares in ((rows, INNER), (turned, CLOSELY)):
            if len(some):
                both = [self._errors_between(moves.motions, text, states, some, shares) for text, states in pairs]
                self._found.anywhere.add(BETWEEN_ENDS, *both)

    def _evaluate_uncorrected(self, moves: WrittenMoves) -> None:
        """Evaluate the moves with axes that are not corrected, at their ends and, of feed moves, between them."""
        motions = moves.motions
        for rows, shares in ((motions.uncorrected_paths, INNER), (motions.uncorrected_moves, (1.0,))):
            if rows.any():
                before, after = (
                    self._errors_between(motions, text, states, rows, shares)
                    for text, states in ((motions, self._before), (moves.commanded, self._after))
                )
                self._found.anywhere.add(UNCORRECTED, before, after)

    def _between_by_ends(self, moves: WrittenMoves, before: Array, left: Array) -> Array:
        """Largest errors `(n,)`, um, between the ends of straight moves, from the errors at both ends; nan if unknown.

        The error deviates from the straight line between those of the ends by no more than a bound of its second
        difference, as long as each axis stays on its side of the play; it is unknown where this is more than a share
        `STRAIGHT_SHARE` of the tolerance, or could make the move worse than the tolerance or the input.
        """
        found = np.full(len(left), np.nan)
        joined = self._joined.follow(moves.motions, moves.commanded, moves.written, left)
        bound, first = (moves.bounds + joined.bends) * 1e3, joined.first
        largest = (
            np.max([np.linalg.norm((1.0 - share) * first + share * left, axis=1) for share in PREDICTED_SHARES], axis=0)
            * 1e3
        )
        tolerance = self._tolerance_um
        straight = (
            joined.rows & (bound <= STRAIGHT_SHARE * tolerance) & (largest + bound <= np.minimum(tolerance, before))
        )
        if self._after.steady is not None:
            straight &= self._after.steady
        found[straight] = largest[straight]
        return found

    def _guard_between(self, moves: WrittenMoves, before: Array, rows: np.ndarray, errors_between: Array) -> None:
        """Compare programmed moves between their ends with the input; errors_between `(rows,)`: of their segments, um.

        In the input the largest error of a path is at least that of its end: moves within that error need no further
        evaluation.
        """
        motions = moves.motions
        ends = np.flatnonzero(~motions.intermediate)
        move = np.searchsorted(ends, rows)
        doubtful = np.zeros(len(ends), bool)
        doubtful[move[~(errors_between <= before[ends[move]])]] = True
        suspect = np.isin(motions.block[ends], list(moves.suspect))
        chosen = (doubtful | suspect)[move]
        if not chosen.any():
            return
        rows, move = rows[chosen], move[chosen]
        largest, mean = np.zeros((2, len(ends), 2))
        lengths = motions.path_lengths[rows]
        whole = np.bincount(move, lengths, len(ends))[move]
        weights = np.divide(lengths, whole, out=np.ones(len(rows)), where=whole > 0.0) / len(CLOSELY)
        for column, (text, states) in enumerate(((motions, self._before), (moves.commanded, self._after))):
            for share in CLOSELY:
                errors = self._errors_between(motions, text, states, rows, (share,))
                np.maximum.at(largest[:, column], move, errors)
                np.add.at(mean[:, column], move, weights * errors)
        found, reverses = np.unique(move), np.zeros(len(ends), bool)
        self._found.anywhere.add(BETWEEN_ENDS, *largest[found].T)
        if self._after.reverses is not None:
            reverses[move[self._after.reverses[rows]]] = True
        self._guard.check_paths(
            motions,
            moves.lines,
            ends[found],
            (largest[found], mean[found]),
            reverses[found],
            moves.unsplit,
            ERROR_JUMPS,
        )

    def _errors_between(
        self,
        motions: Motions,
        commanded: Motions,
        machine_states: MachineStates,
        rows: np.ndarray,
        shares: Iterable[float] = PREDICTED_SHARES,
    ) -> Array:
        """Largest errors `(rows,)`, um, of commanded moves between their ends; rows as a mask or by their numbers."""
        rows = np.flatnonzero(rows) if rows.dtype == bool else rows
        bare, tool, shift = motions.bare.take(rows), motions.tool[rows], machine_states.datum_shifts(motions)[rows]
        errors_between = np.zeros(len(rows))
        for share in shares if len(rows) else ():
            nominal, actual = (
                bare.in_machine(
                    text.target[rows] if share == 1.0 else positions_along(text, rows, np.full(len(rows), share))
                )
                for text in (motions, commanded)
            )
            states = machine_states.states_at(rows, share, actual)
            here = pose_errors(self.machine, self._model, actual, nominal, tool, states, shift).point_um
            errors_between = np.maximum(errors_between, here)
        return errors_between
