"""Verification: the tool path of a program before and after correction, by the exact model.

It reads the two texts alone, so it evaluates the written program independently of the correction. It evaluates block
ends and points along straight and circular feed moves, as the control interpolates them in programmed coordinates.
Along a straight move whose errors provably change evenly, those at its points follow from those at its ends.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
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
from postproc.compensation.predicted_error import MachineStates, in_a_program
from postproc.control.interpreter import Interpreter
from postproc.control.setup import Setup
from postproc.control.without_effect import refuse_without_effect, unused_set_up
from postproc.dialects import Dialect
from postproc.evaluation.joined_moves import Joined, JoinedMoves
from postproc.evaluation.predicted_errors import AT_ENDS, BETWEEN_ENDS, UNCORRECTED, LargestErrors, Statistic
from postproc.evaluation.trace import DrawnPaths
from postproc.execution import execution
from postproc.motion.along import CLOSELY, INNER, positions_along
from postproc.motion.axis_words import AxisWords
from postproc.motion.motions import Motions, merged
from postproc.motion.moves import Kind
from postproc.text.blocks import Blocks
from postproc.text.notes import Notes
from postproc.text.source import Source
from postproc.verification.best_fit import BestFit
from postproc.verification.contributions import Contributions
from postproc.verification.in_step import Matched, in_step
from postproc.write.added_blocks import Tag, start_fraction_of, tag_of

EVEN = 5e-6
"""mm, half of the last printed digit: errors that deviate by less from an even change follow from those at the ends."""
STRAIGHT_MM = 1e-3
"""mm: as EVEN, of the places of these errors, which the best fit needs."""
VERIFIED_SHARES = (0.0, 0.25, 0.5, 0.75, 1.0)
MOST_MOVE_HALVINGS = 7
"""An eighth of a move is halved so often at most: 1024 places, 128 features of the errors along a move."""


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
    anywhere: LargestErrors = field(default_factory=LargestErrors)
    """Largest errors of all these, and of moves with axes that are not corrected."""

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
            "anywhere_um": self.anywhere.json(),
            "contributions_before_um": {name: statistic.json() for name, statistic in self.contributions.items()},
        }


def read_motions(source: Source, dialect: Dialect, machine: Machine, setup: Setup) -> list[Motions]:
    """All moves of a program, chunk by chunk; UserError, located, at the first block that is not understood."""
    return list(run_motions(source, dialect, dialect.interpreter(machine, setup, Notes())))


def motions_with_lines(source: Source, dialect: Dialect, machine: Machine, setup: Setup) -> Motions:
    """All moves of a program together, with their blocks, and so with the numbers of their lines."""
    parts = execution(source, dialect, dialect.interpreter(machine, setup, Notes())).parts()
    return merged([_with_tags(part.motions) for part in parts])


def assumed_motions(source: Source, dialect: Dialect, machine: Machine, setup: Setup) -> tuple[Motions, str]:
    """All moves of a program together, and the part of the set-up that is assumed, as a sentence; empty for none."""
    interpreter = dialect.interpreter(machine, setup, Notes())
    motions = merged(list(run_motions(source, dialect, interpreter)))
    refuse_without_effect(unused_set_up(interpreter.control_state))
    return motions, interpreter.control_state.assumption()


def run_motions(
    source: Source,
    dialect: Dialect,
    interpreter: Interpreter,
    progress: Callable[[int], None] = lambda _: None,
    called: list[Source] | None = None,
) -> Iterator[Motions]:
    """The moves of a program chunk by chunk; the interpreter then has the set-up that the program used.

    progress: called with the number of characters of each chunk; `called` gets the files of called programs.
    """
    program = execution(source, dialect, interpreter)
    for part in program.parts():
        chunk = _with_tags(part.motions)
        yield replace(chunk, blocks=Blocks(()), words=AxisWords())  # only the columns are used
        progress(part.size)
    if called is not None:
        called += [file.source for file in program.called_files]


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


def between_eighths(halvings: np.ndarray) -> Iterator[tuple[float, np.ndarray]]:
    """Shares of moves between their eighths, and the moves whose eighths are halved so often; halvings `(k,)`."""
    for level in range(1, int(halvings.max(initial=0)) + 1):
        rows, parts = np.flatnonzero(halvings >= level), 8 * 2**level
        for odd in range(1, parts, 2):
            yield odd / parts, rows


class Verifier:
    """Evaluates the moves of a corrected program against those of its original, some thousand at a time.

    Backlash take-ups and segments belong to the moves of the original. Axes with backlash follow the moves of their
    text.
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
        self._features = self._model.feature_lengths(machine)
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
        datum = datum_shifts(nominal, self._model, self._conditions).T
        at_ends, feed = nominal.evaluated, nominal.evaluated_paths
        for states, motions in zip(self._tracked, (nominal, moves.commanded), strict=True):
            states.follow(motions)
        ends = np.full((3, 3, len(nominal)), np.nan)
        some = np.flatnonzero(at_ends | feed)
        ends[..., some] = self._vectors(moves, 1.0, some)
        self._add(ends[..., at_ends], datum[:, at_ends], at_end=True)
        joined = self._joined.follow(nominal, moves.commanded, moves.commanded.machine_target, ends.reshape(9, -1).T)
        between, straight = np.flatnonzero(feed), self._straight(moves, joined)[feed]
        starts, exact = joined.first.T.reshape(ends.shape)[..., between], np.flatnonzero(~straight)
        ways, shift = ends[..., between] - starts, datum[:, between]
        for share in INNER:
            vectors = starts + share * ways
            if len(exact):
                vectors[..., exact] = self._vectors(moves, share, between[exact])
            self._add(vectors, shift, at_end=False)
        self._add_closely(moves, joined, between[exact], datum)
        self._add_uncorrected(moves, datum)
        self._contributions.add(nominal, self._tracked[0].approach)
        if self.paths is not None:
            self.paths.add_moves(self._model, nominal, moves.commanded, self._tracked)

    def _halvings(self, motions: Motions, joined: Joined, rows: np.ndarray) -> np.ndarray:
        """How often the eighths of moves `(k,)` are halved until eight are in each shortest feature of the errors."""
        ways = np.abs(joined.ends[0] - joined.starts[0])[rows]
        others = np.flatnonzero(~joined.rows[rows] | motions.tcp[rows] | np.isin(rows, list(motions.arcs)))
        if len(others):
            some = rows[others]
            bare, shares = motions.bare.take(some), (np.full(len(some), share) for share in VERIFIED_SHARES)
            positions = [bare.in_machine(positions_along(motions, some, share)) for share in shares]
            ways[others] = np.abs(np.diff(positions, axis=0)).sum(axis=0)
        features = (ways / self._features).max(axis=1, initial=1.0)
        return np.asarray(np.minimum(np.ceil(np.log2(features)), MOST_MOVE_HALVINGS).astype(int))

    def _add_closely(self, moves: Matched, joined: Joined, rows: np.ndarray, shift: Array) -> None:
        """Add the errors between the eighths of feed moves `(k,)` to the largest ones, where they may be larger."""
        for share, some in between_eighths(self._halvings(moves.matched, joined, rows)):
            self._add_largest(moves, BETWEEN_ENDS, share, rows[some], shift)
        reverses = [states.reverses[rows] for states in self._tracked if states.reverses is not None]
        turned = rows[np.any(reverses, axis=0)] if reverses else rows[:0]
        for share in CLOSELY if len(turned) else ():
            self._add_largest(moves, BETWEEN_ENDS, share, turned, shift)

    def _add_uncorrected(self, moves: Matched, shift: Array) -> None:
        """Add moves with axes that are not corrected, and moves from such places, to the largest errors."""
        motions = moves.matched
        for where, some, shares in (
            (UNCORRECTED, motions.uncorrected_paths, INNER),
            (UNCORRECTED, motions.uncorrected_moves, (1.0,)),
            (BETWEEN_ENDS, motions.known_paths & ~motions.evaluated_paths, INNER),
        ):
            rows = np.flatnonzero(some)
            for share in shares if len(rows) else ():
                self._add_largest(moves, where, share, rows, shift)

    def _add_largest(self, moves: Matched, where: str, share: float, rows: np.ndarray, shift: Array) -> None:
        """Add the errors at a share of the paths of moves `(k,)` to the largest ones; shift `(3, n)`, mm: datum's."""
        _, *errors = self._vectors(moves, share, rows)
        self._verdict.anywhere.add(where, *(length(error - shift[:, rows]) * 1e3 for error in errors))

    def _vectors(self, moves: Matched, share: float, rows: np.ndarray) -> Array:
        """Nominal tool points, and the absolute errors before and after `(3, 3, k)`, mm, workpiece frame.

        At a share of the paths of rows `(k,)`, by the exact model.
        """
        shares = np.full(len(rows), share)
        bare, found, aim = moves.matched.bare.take(rows), list[PoseErrors](), None
        positions = [
            text.bare.take(rows).in_machine(text.target[rows] if share == 1.0 else positions_along(text, rows, shares))
            for text in (moves.matched, moves.commanded)
        ]
        for q, tracked in zip(positions, self._tracked, strict=True):
            states = tracked.states_at(rows, share, q)
            found.append(pose_errors(bare.machine, self._model, q, positions[0], bare.tool, states, nominal_pose=aim))
            aim = found[0].nominal_pose
        return np.array([found[0].nominal.T, *(errors.apart.T for errors in found)])

    def _straight(self, moves: Matched, joined: Joined) -> NDArrayBool:
        """Rows `(n,)` along which the errors before and after are evenly spread between those at both ends, to EVEN."""
        nominal = moves.matched
        machine, n = nominal.machine, len(nominal)
        if any(states.axes for states in self._tracked):
            return np.zeros(n, bool)
        bounds = SecondDifferences(self._conditions.errors(machine, self._model)).bounds
        before, after = (
            bounds(start, end, nominal.tool, nominal.tcp, np.zeros(n, bool), np.zeros((n, 3)), EVEN / 2.0)
            for start, end in zip(joined.starts, joined.ends, strict=True)
        )
        even = (np.maximum(before, after + joined.bends) <= EVEN) & (joined.path_bends <= STRAIGHT_MM)
        even &= nominal.tcp == moves.commanded.tcp
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
        largest = [length(error - shift) * 1e3 for error in errors]
        verdict.anywhere.add(AT_ENDS if at_end else BETWEEN_ENDS, *largest)
        for (relative, from_offset), fit, error, size in zip(pairs, verdict.best_fit, errors, largest, strict=True):
            relative.add(size)
            from_offset.add(length(error) * 1e3)
            if not at_end:
                fit.add(point.T, error.T)
