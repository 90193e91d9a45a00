"""Evaluated moves that are implausible: outside the range of the calibration, or worse than in the input."""

from __future__ import annotations

from collections.abc import Mapping

import msgspec
import numpy as np

from kinematics.error_model.model import ROUNDING
from kinematics.machine import Machine
from kinematics.state import TEMPERATURE
from kinematics.transforms import Array
from postproc.motion.motions import Motions
from postproc.motion.moves import Kind
from postproc.text.line_numbers import ranges, shortened

ROTARY_ONLY_HINT = (
    ": rotary axes move at feed, and the linear axes keep their earlier correction; move at rapid (G0), or program X, "
    "Y or Z in this block"
)
MOST_LINES = 1000
"""Largest number of lines that are kept for a message."""
UNSEEN_UM = 1e-4
"""Increase of the error, um, below which a move does not count as worse."""


class Outside(msgspec.Struct):
    """Evaluated moves that end outside the range of the calibration, collected chunk by chunk."""

    moves: int = 0
    outside: int = 0
    lines: list[int] = msgspec.field(default_factory=list)
    """Lines of the first MOST_LINES moves outside."""
    largest: dict[tuple[str, str], float] = msgspec.field(default_factory=dict)
    """Largest excess by effect and unit, as `ErrorModel.outside`."""

    def add(self, excesses: Mapping[tuple[str, str], Array], lines: Array) -> None:
        """Add the excesses of moves `(n,)`, as from `ErrorModel.excesses`, and their lines in the program."""
        self.moves += len(lines)
        beyond = np.zeros(len(lines), bool)
        for quantity, excess in excesses.items():
            if excess.max(initial=0.0) > ROUNDING:
                self.largest[quantity] = max(float(excess.max()), self.largest.get(quantity, 0.0))
                if f" in {TEMPERATURE}" not in quantity[0]:
                    beyond |= excess > ROUNDING
        self.outside += int(beyond.sum())
        self.lines += lines[beyond][: MOST_LINES - len(self.lines)].tolist()

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


class Guard:
    """Compares the error of every evaluated move with its error in the input.

    The error may be larger than in the input by the rounding of the words of the move: by this rounding at its end; by
    twice this along a straight move, because its chord error may be that large before it is split; by four times this
    along an arc, because the rounding of its centre moves a nearly full circle by as much as the rounding of two ends.
    """

    def __init__(self, machine: Machine, *, worse: bool, turns: bool) -> None:
        """`worse`: moves may be worse; `turns`: rotary axes are corrected."""
        rounding = machine.rounding_mm + (machine.turned_mm if turns else 0.0)
        self._rounding_um, self._may_be_worse = rounding * 1e3, worse
        self._lines: list[int] = []
        self._largest = (0.0, 0.0)
        self._worse = 0
        self._rounded: dict[str, tuple[int, float]] = {}
        """Number of moves that are worse by their rounding, and the largest increase, um; by `where` of `_check`."""

    def check_ends(self, motions: Motions, lines: np.ndarray, rows: np.ndarray, errors: Array) -> None:
        """Compare errors `(k, 2)`, um, before and after at the ends of rows `(k,)` of a chunk.

        lines `(n,)`: numbers of the lines of all rows. WorseMove for the first move that is worse by more than its
        rounding, unless that is accepted.
        """
        self._check(motions, lines, rows, errors, np.full(len(rows), self._rounding_um), "at its end", {})

    def check_paths(
        self,
        motions: Motions,
        lines: np.ndarray,
        rows: np.ndarray,
        errors: Array,
        reasons: Mapping[int, str],
        otherwise: str,
    ) -> None:
        """Compare the largest errors `(k, 2)`, um, before and after along moves that end at rows `(k,)`.

        WorseMove as by `check_ends`; `reasons`: why a move is not split, by block.
        """
        factors = np.where(motions.kind[rows] == Kind.ARC, 4.0, 2.0)
        hints = {int(block): f": {reasons.get(int(block), otherwise)}" for block in motions.block[rows]}
        self._check(motions, lines, rows, errors, factors * self._rounding_um, "between its ends", hints)

    def _check(
        self,
        motions: Motions,
        lines: np.ndarray,
        rows: np.ndarray,
        errors: Array,
        limits: Array,
        where: str,
        hints: Mapping[int, str],
    ) -> None:
        """WorseMove, with the hint of its block, for the first move that is worse by more than its limit `(k,)`, um."""
        before, after = errors.T
        excess = after - before
        rounded = (excess > UNSEEN_UM) & (excess <= limits)
        if rounded.any():
            count, largest = self._rounded.get(where, (0, 0.0))
            self._rounded[where] = count + int(rounded.sum()), max(largest, float(excess[rounded].max()))
        for i in np.flatnonzero(excess > limits).tolist():
            row = int(rows[i])
            if not self._may_be_worse:
                block = int(motions.block[row])
                hint = ROTARY_ONLY_HINT if motions.rotary_only[row] else hints.get(block, "")
                raise WorseMove(
                    block,
                    f"predicted to be worse than in the input {where}: {after[i]:.3g} um instead of "
                    f"{before[i]:.3g} um{hint}; --accept worse continues nevertheless",
                )
            self._add(int(lines[row]), float(before[i]), float(after[i]))

    def notes(self) -> list[str]:
        """Notes with the numbers of moves that are worse than in the input by their rounding."""
        return [
            f"{count} moves are predicted to be worse than in the input {where.replace('its', 'their')} by at most "
            f"{largest:.2g} um, the rounding of their words"
            for where, (count, largest) in self._rounded.items()
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
        self._lines += [line] if len(self._lines) < MOST_LINES else []
        self._largest = max(self._largest, (after, before))
