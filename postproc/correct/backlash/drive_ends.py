"""Where drives with play must go so that the axes reach their targets: the play operator, inverted.

An axis that continues, or reverses by more than the dead band, is pushed by its drive, which ends half of the play
ahead of it, on that side. If an axis has to go back by less, its drive keeps its side. Within a move an axis may
reverse more than once. There the drive runs from its side at the start to its side at the end, and the side at the end
is the one with which the play operator ends at the target.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

import numpy as np

from kinematics.error_model.play import followed, held, side_of
from kinematics.machine import NDArrayBool
from kinematics.transforms import Array
from postproc.motion.path_points import PathPoints

PUSHED = 1e-7
"""mm or rad: an axis that ends so near to its target is there."""
SIDE_BISECTIONS = 24
"""Steps of the search for the side at the end of a move: to 1e-7 of the play."""
COLUMN_MOVES = 32
"""Number of moves of one point each from which columns take less time than one move after the other."""


class Targets(NamedTuple):
    """Where axes shall be at k points of the paths of n moves, and what is known about their drives."""

    points: PathPoints
    axis: Array
    """Targets `(k, axes)`, mm and rad: what the command would be without play."""
    drift: Array
    """Command minus target and side `(k, axes)`: the command of a path leaves the straight line between its ends."""
    half: Array
    """Half of the play `(k, axes)`, as of `half_play`."""
    known: NDArrayBool
    """True `(n, axes)` where the position before a move is known."""
    chosen: NDArrayBool
    """True `(n, axes)` where the correction chooses the command; elsewhere it is the target, with what was added to the
    command before where this is `kept`."""
    kept: NDArrayBool
    ready: NDArrayBool
    """True `(n, axes)` where a backlash take-up may be added before the move."""


class Sides(NamedTuple):
    """Sides of the play `(n, axes)`, -1 ... 1, after the drives went where they must."""

    returned: Array
    """After the return of a canned cycle to the start of a move; nan for other moves."""
    first: Array
    """At the start of a move, if a backlash take-up can be added before it."""
    last: Array
    """At its end."""


class DriveEnds:
    """Follows the axes with play through a program, chunk after chunk."""

    def __init__(self, axes: Iterable[int], band: Array) -> None:
        """band: way `(axes,)`, mm and rad, that an axis must go back before this counts as a reversal."""
        self._drives = {axis: Drive(float(band[axis])) for axis in axes}
        self._count = len(band)

    @property
    def last(self) -> Array:
        """Sides `(axes,)` after the last move."""
        sides = np.zeros(self._count)
        for axis, drive in self._drives.items():
            sides[axis] = drive.side
        return sides

    @property
    def ahead(self) -> Array:
        """Part of the last commands `(axes,)`, mm and rad, that takes up the play."""
        ahead = np.zeros(self._count)
        for axis, drive in self._drives.items():
            ahead[axis] = drive.ahead
        return ahead

    def copied(self) -> DriveEnds:
        """A copy of the state, to be followed in another way."""
        return copy.deepcopy(self)

    def follow(self, targets: Targets) -> Sides:
        """The sides during the moves of the next chunk."""
        n = len(targets.points.ends)
        found = Sides(np.full((n, self._count), np.nan), np.zeros((n, self._count)), np.zeros((n, self._count)))
        for axis, drive in self._drives.items():
            _follow(drive, targets, axis, Sides(*(column[:, axis] for column in found)))
        return found


def _follow(drive: Drive, targets: Targets, axis: int, found: Sides) -> None:
    """Put the sides of one axis into `found`: of like moves of one point each together, of the others one by one."""
    ends = targets.points.ends
    begins, n = np.concatenate([[0], ends[:-1] + 1]), len(ends)
    at, half = targets.axis[:, axis], targets.half[:, axis]
    known, chosen, kept = targets.known[:, axis], targets.chosen[:, axis], targets.kept[:, axis]
    single = (begins == ends) & (targets.points.share[ends] > 0.0) & known
    kind = np.where(single, 1 + chosen + 2 * kept + 4 * drive.in_play(half[ends], chosen), 0)
    changes = np.append(np.flatnonzero(np.diff(kind)) + 1, n)
    lists = [column[:, axis].tolist() for column in targets[1:]]
    shares, points = targets.points.share.tolist(), [*begins.tolist(), len(at)]
    row = 0
    while row < n:
        end = int(changes[np.searchsorted(changes, row, side="right")])
        if kind[row] and end - row >= COLUMN_MOVES:
            run = slice(begins[row], begins[row] + end - row)
            first, last = drive.follow_together(at[run], half[run], bool(chosen[row]), bool(kept[row]))
            found.first[row : row + len(first)], found.last[row : row + len(last)] = first, last
            row += len(first)
        if row < end:
            path = Path(points[row], points[row + 1], shares, *lists[:3])
            sides = drive.follow(path, *(flag[row] for flag in lists[3:]))
            found.returned[row], found.first[row], found.last[row] = sides
            row += 1


class Path(NamedTuple):
    """Points `begin` to `end` of lists, which one axis passes in one move."""

    begin: int
    end: int
    shares: Sequence[float]
    axis: Sequence[float]
    drift: Sequence[float]
    half: Sequence[float]

    @property
    def last(self) -> tuple[float, float]:
        """Target and half of the play at the end."""
        return self.axis[self.end - 1], self.half[self.end - 1]


class Drive:
    """One axis and its drive; positions in mm or rad."""

    def __init__(self, band: float) -> None:
        self._band = band
        self._axis = math.nan
        """Position of the axis."""
        self.ahead = 0.0
        """Command minus target: the part of the correction that takes the play up."""
        self.side = 0.0
        """Side of the play on which the drive leaves the axis."""

    def follow(self, path: Path, known: bool, chosen: bool, kept: bool, ready: bool) -> tuple[float, float, float]:
        """Sides of a move, as in `Sides`."""
        returned, (target, half), before = math.nan, path.last, self.side
        if not known or math.isnan(self._axis):
            self._axis, self.ahead, self.side = target, 0.0, 0.0
            return returned, 0.0, 0.0
        if path.shares[path.begin] == 0.0:
            returned = before = self._go(path.axis[path.begin], path.half[path.begin])
            path = path._replace(begin=path.begin + 1)
        if not chosen:
            first = self._unchosen(path, kept)
        elif path.end - path.begin == 1 or half <= self._band / 2.0:
            first = self._go(path.axis[path.begin], path.half[path.begin])
            for point in range(path.begin + 1, path.end):
                self._go(path.axis[point], path.half[point])
        else:
            return returned, self._turning(path, ready), self.side
        return returned, self._or_before(first, before, half), self.side

    def in_play(self, half: Array, chosen: NDArrayBool) -> NDArrayBool:
        """True `(n,)` for moves in which the axis lies where the play leaves it: it has play that nobody corrects."""
        return np.asarray(~chosen & (half > self._band / 2.0))

    def follow_together(self, target: Array, half: Array, chosen: bool, kept: bool) -> tuple[Array, Array]:
        """Sides at the starts and ends of alike moves with a known start and one point each, as `follow`.

        target, half: `(n,)` as of `Path`. They are `(m,)`, of the first m moves: the next one has to be followed alone.
        """
        ahead = self.ahead if kept or chosen else 0.0
        drive = target if chosen else target + ahead
        if math.isnan(self._axis):
            return np.zeros(0), np.zeros(0)
        if self.in_play(half[:1], np.array([chosen])).all():
            positions, _ = followed(self._axis, drive, half)
            last = side_of(drive, positions, half)
            first, before = last.copy(), np.concatenate([[self.side], last[:-1]])
            for row in np.flatnonzero(np.abs(before) < 1.0).tolist():
                first[row] = self._or_before(float(last[row]), float(before[row]), float(half[row]))
            self._axis = float(positions[-1])
        elif abs(self.side) == 1.0:
            reach = np.full(len(drive), self._band / 2.0)
            _, pushed = followed(self._axis - self.side * self._band / 2.0, drive, reach)
            turned = np.abs(pushed) > reach
            first = last = held(np.sign(pushed), turned, self.side)
            self._axis = float(held(drive, turned, self._axis)[-1])
        else:
            reversal = np.flatnonzero(np.abs(drive - self._axis) > self._band)
            first = last = np.full(reversal[0] if len(reversal) else len(drive), self.side)
        if len(last):
            self.side = float(last[-1])
            self.ahead = self.side * float(half[len(last) - 1]) if chosen else ahead
        return first, last

    def _or_before(self, first: float, before: float, half: float) -> float:
        """The side at the start of a move: the one inside the play before it, if it is nearer than the dead band."""
        inside = half > self._band / 2.0 and abs(before) not in (0.0, 1.0)
        return before if inside and abs(first - before) * half <= self._band else first

    def _go(self, target: float, half: float) -> float:
        """The side after a monotonic move of the axis."""
        way = target - self._axis
        if way * self.side > 0.0 and abs(self.side) == 1.0:
            self._axis = target
        elif abs(way) > self._band:
            self._axis, self.side = target, math.copysign(1.0, way)
        self.ahead = self.side * half
        return self.side

    def _unchosen(self, path: Path, kept: bool) -> float:
        """The side at the start of a move whose command is not chosen."""
        ahead = self.ahead if kept else 0.0
        for point in range(path.begin, path.end):
            drive, half = path.axis[point] + ahead, path.half[point]
            if half > self._band / 2.0:
                self._axis = min(max(self._axis, drive - half), drive + half)
                self.side = float(side_of(drive, self._axis, half))
            else:
                self._go(drive, half)
        self.ahead = ahead
        return self.side

    def _turning(self, path: Path, ready: bool) -> float:
        """The side at the start of a move within which the axis may reverse."""
        target, half = path.last
        ways = (path.axis[point] - self._axis for point in range(path.begin, path.end))
        first = next((math.copysign(1.0, way) for way in ways if abs(way) > self._band), self.side)
        first = self._or_before(first, self.side, half)
        ahead = first * half if ready else self.ahead

        def end(last: float) -> float:
            """The axis at the end, if the drive is then so far ahead of the target."""
            axis = self._axis
            for point in range(path.begin, path.end):
                drive = path.axis[point] + path.drift[point] + ahead + path.shares[point] * (last - ahead)
                axis = min(max(axis, drive - path.half[point]), drive + path.half[point])
            return axis

        stays = abs(end(ahead) - target) <= self._band
        last = min(max(ahead, -half), half) if stays else _root(lambda last: end(last) - target, half)
        self._axis, self.ahead, self.side = end(last), last, last / half
        return first


def _root(beyond: Callable[[float], float], half: float) -> float:
    """The argument, -half ... half, at which an increasing function is 0; an end where it is 0 there."""
    low, high = -half, half
    for end in (low, high):
        if abs(beyond(end)) < PUSHED:
            return end
    for _ in range(SIDE_BISECTIONS):
        middle = (low + high) / 2.0
        low, high = (low, middle) if beyond(middle) > 0.0 else (middle, high)
    return (low + high) / 2.0
