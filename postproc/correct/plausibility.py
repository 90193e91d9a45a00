"""Plausibility of a correction: its calibration, its size, its range of use, and its improvement.

An implausible correction is refused with its value, unless the user has accepted the condition by name.
"""

from __future__ import annotations

import datetime
import itertools
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np

from kinematics.error_model.model import ROUNDING, ErrorModel
from kinematics.machine import Machine
from kinematics.state import TEMPERATURE
from kinematics.transforms import Array
from kinematics.user_error import UserError
from postproc.compensation.conditions import Conditions
from postproc.compensation.correction import pose_errors
from postproc.compensation.significance import Significance
from postproc.motion.frames import Frame
from postproc.motion.motions import Motions
from postproc.motion.moves import Kind
from postproc.text.line_numbers import ranges, shortened

REASONS: Mapping[str, str] = {
    "stale": "the calibration is older than its validity (365 days, unless it states its own)",
    "future": "the calibration is dated in the future",
    "temperature": "a temperature of this run is outside the range for which the calibration was measured",
    "outside": "more than 1 % of the evaluated moves end outside the range for which the calibration was measured",
    "insignificant": "for most moves the predicted improvement is below twice its standard uncertainty (k=2)",
    "worse": "a move is predicted to be worse than in the input",
}
"""Conditions that are refused, by their names in `--accept`."""
CLOCKS = datetime.timedelta(minutes=10)
"""Tolerance of the date of a calibration in the future, for differences of clocks."""
OUTSIDE_SHARE = 0.01
"""Share of the evaluated moves that may end outside the measured range."""
MOST = 0.5
"""Share of the moves worth correcting that may have an improvement that is not significant."""
ROTARY_ONLY_HINT = (
    ": rotary axes move at feed, and the linear axes keep their earlier correction; move at rapid (G0), or program X, "
    "Y or Z in this block"
)
HIGHEST_UM = 500.0
"""Largest correction, um, unless the user sets another limit."""
MOST_LINES = 1000
"""Largest number of lines that are kept for a message."""
ENDLESS_MM = 1000.0
"""Length, mm, over which the largest error is searched along a linear axis without travel limits."""
UNSEEN_UM = 1e-4
"""Increase of the error, um, below which a move does not count as worse."""
SAMPLES = 4096
"""Number of positions, besides the corners of the travel, for the search of the largest error."""


def parse_accepted(text: str | None, allowed: Iterable[str] = REASONS) -> frozenset[str]:
    """Names of `--accept`, separated by commas; UserError, with the list of names, for any other name."""
    names = [name.strip().lower() for name in (text or "").split(",")] if text is not None else []
    for name in names:
        if name not in allowed:
            raise UserError(f"--accept {text}: {name!r} is unknown; expected {', '.join(allowed)}")
    return frozenset(names)


@dataclass
class Plausibility:
    """Refuses conditions that are not accepted, and stores accepted ones by name."""

    accepted: frozenset[str] = frozenset()
    met: dict[str, str] = field(default_factory=dict)
    """Accepted conditions that were met: text with the value, by name."""

    def meet(self, name: str, found: str) -> None:
        """Store an implausible condition; UserError unless its name is accepted."""
        if name not in self.accepted:
            raise UserError(f"{found}; --accept {name} continues nevertheless")
        self.met.setdefault(name, found)

    def check_calibration(self, model: ErrorModel, conditions: Conditions, now: datetime.datetime) -> None:
        """Check the age of a calibration, and the temperatures of the run against its range."""
        age = model.age_days(now)
        made = f"calibration {model.id} is dated {model.provenance.made_at.isoformat(' ', 'minutes')}"
        if age > model.valid_days:
            self.meet("stale", f"{made}: it is {age:.0f} days old and valid for {model.valid_days:g} days")
        if model.provenance.made_at - now > CLOCKS and not model.demonstration:
            self.meet("future", f"{made}, {-age:.3g} days ahead of this computer's clock")
        for sensor, (low, high) in sorted(model.temperatures.items()):
            value = conditions.temperatures.get(sensor)
            if value is not None and not low - ROUNDING <= value <= high + ROUNDING:
                measured = f"the calibration was measured from {low:g} to {high:g} degC"
                self.meet("temperature", f"temperature {sensor} is {value:g} degC; {measured}")

    def check_outside(self, outside: Outside) -> None:
        """Check the share of moves outside the calibrated range, once all moves are known."""
        if outside.share > OUTSIDE_SHARE:
            self.meet("outside", outside.text())

    def check_significance(self, significance: Significance) -> None:
        """Check the significance of the improvement, once all moves are known."""
        if significance.unsure > MOST * significance.worthwhile:
            self.meet("insignificant", significance.text())


@dataclass
class Outside:
    """Evaluated moves that end outside the range of the calibration, collected chunk by chunk."""

    moves: int = 0
    outside: int = 0
    lines: list[int] = field(default_factory=list)
    """Lines of the first MOST_LINES moves outside."""
    largest: dict[tuple[str, str], float] = field(default_factory=dict)
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


class Guard:
    """Compares the error of every evaluated move with its error in the input.

    The error may be larger than in the input by the rounding of the words of the move: by this rounding at its end; by
    twice this along a straight move, because its chord error may be that large before it is split; by four times this
    along an arc, because the rounding of its centre moves a nearly full circle by as much as the rounding of two ends.
    """

    def __init__(self, machine: Machine, plausibility: Plausibility, *, turns: bool) -> None:
        rounding = machine.rounding_mm + (machine.turned_mm if turns else 0.0)
        self._rounding_um, self._plausibility = rounding * 1e3, plausibility
        self._lines: list[int] = []
        self._largest = (0.0, 0.0)
        self._worse = 0
        self._rounded: dict[str, tuple[int, float]] = {}
        """Number of moves that are worse by their rounding, and the largest increase, um; by `where` of `_check`."""

    def check_ends(self, motions: Motions, rows: np.ndarray, errors: Array) -> None:
        """Compare errors `(k, 2)`, um, before and after at the ends of rows `(k,)` of a chunk.

        Refusal at the first move that is worse by more than its rounding, unless that is accepted.
        """
        self._check(motions, rows, errors, np.full(len(rows), self._rounding_um), "at its end", {})

    def check_paths(
        self, motions: Motions, rows: np.ndarray, errors: Array, reasons: Mapping[int, str], otherwise: str
    ) -> None:
        """Compare the largest errors `(k, 2)`, um, before and after along moves that end at rows `(k,)`.

        Refusal as by `check_ends`; `reasons`: why a move is not split, by block.
        """
        factors = np.where(motions.kind[rows] == Kind.ARC, 4.0, 2.0)
        hints = {int(block): f": {reasons.get(int(block), otherwise)}" for block in motions.block[rows]}
        self._check(motions, rows, errors, factors * self._rounding_um, "between its ends", hints)

    def _check(
        self,
        motions: Motions,
        rows: np.ndarray,
        errors: Array,
        limits: Array,
        where: str,
        hints: Mapping[int, str],
    ) -> None:
        """Refusal, with the hint for its block, at the first move that is worse by more than its limit `(k,)`, um."""
        before, after = errors.T
        excess = after - before
        rounded = (excess > UNSEEN_UM) & (excess <= limits)
        if rounded.any():
            count, largest = self._rounded.get(where, (0, 0.0))
            self._rounded[where] = count + int(rounded.sum()), max(largest, float(excess[rounded].max()))
        worse = np.flatnonzero(excess > limits)
        for i, line in zip(worse.tolist(), motions.line[rows[worse]].tolist(), strict=True):
            row = int(rows[i])
            found = f"predicted to be worse than in the input {where}: {after[i]:.3g} um instead of {before[i]:.3g} um"
            if "worse" not in self._plausibility.accepted:
                hint = ROTARY_ONLY_HINT if motions.rotary_only[row] else hints.get(int(motions.block[row]), "")
                refused = motions.blocks[motions.block[row]]
                raise refused.refuse(f"{found}{hint}; --accept worse continues nevertheless")
            self._add(line, float(before[i]), float(after[i]))

    def notes(self) -> list[str]:
        """Notes with the numbers of moves that are worse than in the input by their rounding."""
        return [
            f"{count} moves are predicted to be worse than in the input {where.replace('its', 'their')} by at most "
            f"{largest:.2g} um, the rounding of their words"
            for where, (count, largest) in self._rounded.items()
        ]

    def _add(self, line: int, before: float, after: float) -> None:
        self._worse += 1
        self._lines += [line] if len(self._lines) < MOST_LINES else []
        self._largest = max(self._largest, (after, before))
        after, before = self._largest
        self._plausibility.met["worse"] = (
            f"{self._worse} moves are predicted to be worse than in the input, at most {after:.3g} um instead of "
            f"{before:.3g} um (lines {shortened(ranges(self._lines))})"
        )


class CorrectionLimit:
    """Largest plausible correction of a linear axis, um.

    It is the limit of the user, or twice the largest error of the calibration over the travel of the machine with the
    tools that the program uses, at most HIGHEST_UM. Twice, because a correction relative to a datum is a difference of
    two errors. If the orientation is corrected, linear axes also compensate the rotation of rotary axes: HIGHEST_UM.
    """

    def __init__(
        self, machine: Machine, model: ErrorModel, conditions: Conditions, given_um: float | None, *, turns: bool
    ) -> None:
        self._machine, self._model, self._conditions, self._turns = machine, model, conditions, turns
        self._given_um = given_um
        self._largest: dict[tuple[float, ...], float] = {}

    def um(self, frame: Frame) -> float:
        """Limit in a frame, um, for its tool and for the probe of its touch-off."""
        if self._given_um is not None:
            return self._given_um
        if self._turns:
            return HIGHEST_UM
        tools = [frame.tool, *([] if frame.touch_off is None else [(0.0, 0.0, -frame.touch_off.length)])]
        return min(2.0 * max(map(self._largest_um, tools)), HIGHEST_UM)

    def _largest_um(self, tool: tuple[float, ...]) -> float:
        if tool not in self._largest:
            self._largest[tool] = largest_error_um(self._machine, self._model, self._conditions, tool)
        return self._largest[tool]

    @property
    def origin(self) -> str:
        """Text on the origin of the limit."""
        if self._given_um is not None:
            return "--max-correction-um"
        if self._turns:
            return "the largest correction without --max-correction-um"
        return f"twice the largest error of the calibration over the machine's travel, at most {HIGHEST_UM:g} um"

    def check(self, motions: Motions, nominal: Array, corrected: Array) -> float:
        """Largest limit of a chunk, um; Refusal at the first move with a correction beyond the limit of its frame.

        Nominal and corrected positions `(n, axes)`, mm and rad.
        """
        used = set(motions.frame.tolist())
        limits = np.array([self.um(frame) if i in used else 0.0 for i, frame in enumerate(motions.frames)])
        columns = motions.machine.translators
        size = np.abs(corrected - nominal)[:, columns] * 1e3
        resolution = np.array([motions.machine.axes[i].resolution for i in columns]) * 1e3
        limit = limits[motions.frame]
        for row in np.flatnonzero((~(size <= limit[:, None] + resolution)).any(axis=1))[:1]:
            i = int(np.argmax(size[row]))
            raise motions.blocks[motions.block[row]].refuse(
                f"{motions.machine.names[columns[i]]} would be corrected by {size[row, i]:.4g} um, more than "
                f"{limit[row]:.4g} um ({self.origin}): check calibration, machine and set-up; "
                "--max-correction-um sets another limit"
            )
        return float(limits.max(initial=0.0))


def largest_error_um(machine: Machine, model: ErrorModel, conditions: Conditions, tool: tuple[float, ...]) -> float:
    """Largest predicted error of a tool tip `(3,)`, mm, over the travel of the machine, um."""
    low, high = machine.travel
    endless = np.isinf(low) | np.isinf(high)
    low, high = np.where(endless, 0.0, low), np.where(endless, np.where(machine.rotary, 2.0 * np.pi, ENDLESS_MM), high)
    axes = len(machine.axes)
    shares = np.vstack([_evenly(SAMPLES, 2 * axes), _corners(axes)])
    positions = low + (high - low) * shares[:, :axes]
    approach = np.where(shares[:, axes:] < 0.5, -1.0, 1.0)
    tips = np.broadcast_to(np.array(tool, float), (len(positions), 3))
    states = conditions.states(approach)
    return float(pose_errors(machine, model, positions, positions, tips, states).point_um.max())


def _evenly(n: int, dimensions: int) -> Array:
    """Evenly distributed points `(n, dimensions)` of the unit cube, from powers of the generalised golden ratio."""
    ratio = 2.0
    for _ in range(64):
        ratio = (1.0 + ratio) ** (1.0 / (dimensions + 1))
    return np.asarray((0.5 + np.arange(1, n + 1)[:, None] * ratio ** -np.arange(1.0, dimensions + 1)) % 1.0)


def _corners(axes: int) -> Array:
    """Corners of the travel as shares, with approach in both directions `(2 ** (axes + 1), 2 * axes)`."""
    ends = np.array(list(itertools.product((0.0, 1.0), repeat=axes)))
    return np.vstack([np.hstack([ends, np.full_like(ends, direction)]) for direction in (0.0, 1.0)])
