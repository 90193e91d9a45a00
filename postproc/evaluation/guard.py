"""Evaluated moves that are implausible: outside the range of the calibration, or worse than in the input."""

from __future__ import annotations

import math
from collections.abc import Mapping

import msgspec
import numpy as np

from kinematics.error_model.model import MODEL_ROUNDING
from kinematics.machine import Machine, NDArrayBool
from kinematics.state import TEMPERATURE
from kinematics.transforms import Array
from postproc.motion.motions import Motions
from postproc.text.line_numbers import ranges, shortened

ROTARY_ONLY_HINT = (
    ": rotary axes move at feed, and the linear axes keep their earlier correction; choose "
    "--rotary-feed inverse-time (not in Klartext), move at rapid (G0), or program X, Y or Z in this block"
)
MOST_MESSAGE_LINES = 1000
"""Largest number of lines that are kept for a message."""
LAST_DIGIT_UM = 1e-4
"""Increase of the error, um, below which a move does not count as worse: the last digit of the results."""


class Outside(msgspec.Struct):
    """Evaluated moves that end outside the range of the calibration, collected chunk by chunk."""

    moves: int = 0
    outside: int = 0
    lines: list[int] = msgspec.field(default_factory=list)
    """Lines of the first `MOST_MESSAGE_LINES` moves outside."""
    largest: dict[tuple[str, str], float] = msgspec.field(default_factory=dict)
    """Largest excess by effect and unit, as `ErrorModel.outside`."""

    def add(self, excesses: Mapping[tuple[str, str], Array], lines: Array) -> None:
        """Add the excesses of moves `(n,)`, as from `ErrorModel.excesses`, and their lines in the program."""
        self.moves += len(lines)
        beyond = np.zeros(len(lines), bool)
        for quantity, excess in excesses.items():
            if excess.max(initial=0.0) > MODEL_ROUNDING:
                self.largest[quantity] = max(float(excess.max()), self.largest.get(quantity, 0.0))
                if f" in {TEMPERATURE}" not in quantity[0]:
                    beyond |= excess > MODEL_ROUNDING
        self.outside += int(beyond.sum())
        self.lines += lines[beyond][: MOST_MESSAGE_LINES - len(self.lines)].tolist()

    @property
    def share(self) -> float:
        """Share of the evaluated moves that end outside."""
        return self.outside / self.moves if self.moves else 0.0

    def text(self) -> str:
        """Text with numbers and lines."""
        return (
            f"{self.outside} of {self.moves} evaluated moves ({self.share:.1%}) end outside the range for which "
            f"the calibration was measured (lines {shortened(ranges(self.lines))})"
        )


class WorseMove(Exception):
    """A move that is predicted to be worse than in the input: index of its block in the chunk, and the reason."""

    def __init__(self, block: int, reason: str) -> None:
        super().__init__(block, reason)
        self.block, self.reason = block, reason


class Roundings:
    """By how much the rounding of words may change the error of a move, um.

    Each word is rounded by at most half a step of its axis, and the end of a move deviates by the sum of its axes.
    Along its path, the chord error may be as large again before a move is split (`Limits` of
    `postproc/correct/chord_error.py`). The rounding of its centre moves an arc by twice as much at most, and its end
    where an angle gives it. An arc whose ends lie at different radii, by the rounding of the input, is written about a
    centre between them where an angle gives its end: its path deviates by no more than this difference, and its end
    where both ends are close together (`between` of `postproc/motion/circles.py`).
    """

    def __init__(self, machine: Machine, *, turns: bool) -> None:
        """`turns`: rotary axes are corrected."""
        self._end = 1e3 * (machine.rounding_mm + (machine.turned_mm if turns else 0.0))
        self._centre = 2e3 * machine.rounding_mm * math.sqrt(2.0 / 3.0)  # two axes of three

    def at_ends(self, motions: Motions) -> Array:
        """At the ends of all rows `(n,)`."""
        found = np.full(len(motions), self._end)
        if motions.arcs:
            circles = motions.circles
            found[circles.rows] += self._centre + np.where(circles.nearly_full, circles.out_of_round * 1e3, 0.0)
        return found

    def along(self, motions: Motions) -> Array:
        """Along the paths of all rows `(n,)`: the chord error, and what the rounding does at the start and the end."""
        ends = self.at_ends(motions)
        found = self._end + np.maximum(ends, np.append(self._end, ends[:-1]))
        if motions.arcs:
            found[motions.circles.rows] += motions.circles.out_of_round * 1e3
        return np.asarray(found)


class Guard:
    """Compares the error of every evaluated move with its error in the input.

    A move is worse if the error at its end, or the mean error along its path, is larger than in the input by more than
    the rounding of its words. Where an axis with backlash reverses in it, the place of the reversal is known no better
    than its dead band, which is the tolerance in a corrected program: the mean may be larger by as much. A larger error
    on a part of the path is noted: an axis with backlash that cannot be taken up before the move, for example, errs at
    the start by twice as much as in the input, and not at the end.
    """

    def __init__(self, machine: Machine, tolerance_um: float, *, worse: bool, turns: bool) -> None:
        """`worse`: moves may be worse; `turns`: rotary axes are corrected."""
        self._roundings, self._tolerance_um = Roundings(machine, turns=turns), tolerance_um
        self._may_be_worse = worse
        self._lines: list[int] = []
        self._largest = (0.0, 0.0)
        self._worse = 0
        self._noted: dict[str, tuple[int, float]] = {}
        """Number of moves with larger errors that are not worse, and the largest increase, um; by the cause."""

    def check_ends(self, motions: Motions, lines: np.ndarray, rows: np.ndarray, errors: Array) -> None:
        """Compare errors `(k, 2)`, um, before and after at the ends of rows `(k,)` of a chunk.

        lines `(n,)`: numbers of the lines of all rows. WorseMove for the first move that is worse by more than its
        rounding, unless that is accepted.
        """
        limits = self._roundings.at_ends(motions)[rows]
        self._note("at their ends", errors, limits)
        self._check(motions, lines, rows, errors, errors[:, 1] - errors[:, 0] > limits, "at its end", {})

    def check_paths(
        self,
        motions: Motions,
        lines: np.ndarray,
        rows: np.ndarray,
        errors: tuple[Array, Array],
        reverses: NDArrayBool,
        reasons: Mapping[int, str],
        otherwise: str,
    ) -> None:
        """Compare the largest and the mean errors `(k, 2)`, um, before and after along moves that end at rows `(k,)`.

        WorseMove as by `check_ends`; reverses `(k,)`: moves in which an axis with backlash reverses. `reasons`: why a
        move is not split, by block.
        """
        largest, mean = errors
        limits = self._roundings.along(motions)[rows] + np.where(reverses, self._tolerance_um, 0.0)
        self._note("between their ends", largest, limits)
        hints = {int(block): f": {reasons.get(int(block), otherwise)}" for block in motions.block[rows]}
        worse = mean[:, 1] - mean[:, 0] > limits
        self._check(motions, lines, rows, mean, worse, "between its ends", hints, " on average")

    def _check(
        self,
        motions: Motions,
        lines: np.ndarray,
        rows: np.ndarray,
        errors: Array,
        worse: NDArrayBool,
        where: str,
        hints: Mapping[int, str],
        measure: str = "",
    ) -> None:
        """WorseMove, with the hint of its block, for the first move that is worse `(k,)`; `measure` of its errors."""
        for i in np.flatnonzero(worse).tolist():
            row, (before, after) = int(rows[i]), errors[i].tolist()
            if not self._may_be_worse:
                block = int(motions.block[row])
                hint = ROTARY_ONLY_HINT if motions.rotary_only[row] else hints.get(block, "")
                raise WorseMove(
                    block,
                    f"predicted to be worse than in the input {where}: {after:.3g} um instead of "
                    f"{before:.3g} um{measure}{hint}; --accept worse continues nevertheless",
                )
            self._add(int(lines[row]), before, after)

    def _note(self, where: str, errors: Array, limits: Array) -> None:
        """Note the moves whose errors `(k, 2)`, um, are larger than in the input; limits `(k,)`: their rounding, um."""
        excess = errors[:, 1] - errors[:, 0]
        rounded = (excess > LAST_DIGIT_UM) & (excess <= limits)
        beyond = excess > limits
        for cause, some in (
            (f"{where} by at most {{:.2g}} um, the rounding of their words", rounded),
            ("on a part of their paths by at most {:.3g} um", beyond & (where == "between their ends")),
        ):
            if some.any():
                count, largest = self._noted.get(cause, (0, 0.0))
                self._noted[cause] = count + int(some.sum()), max(largest, float(excess[some].max()))

    def notes(self) -> list[str]:
        """Notes with the numbers of moves whose errors are larger than in the input, and that are not worse."""
        return [
            f"{count} moves are predicted to be worse than in the input {cause.format(largest)}"
            for cause, (count, largest) in self._noted.items()
        ]

    def worse(self) -> str:
        """Text on the moves that are worse and accepted; empty for none."""
        if not self._worse:
            return ""
        after, before = self._largest
        return (
            f"{self._worse} moves are predicted to be worse than in the input, at most {after:.3g} um instead of "
            f"{before:.3g} um (lines {shortened(ranges(self._lines))})"
        )

    def _add(self, line: int, before: float, after: float) -> None:
        self._worse += 1
        self._lines += [line] if len(self._lines) < MOST_MESSAGE_LINES else []
        self._largest = max(self._largest, (after, before))
