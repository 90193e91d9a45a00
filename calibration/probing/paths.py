"""Moves from centre to centre that are clear of spheres and stems: by a parking position where rotary axes turn."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from calibration.probing.bodies import Bodies, joined_moves, least_clearance
from calibration.probing.touches import Approach, Centre, centre_of, within_travel
from kinematics.forward import forward
from kinematics.inverse import linear_positions
from kinematics.transforms import Array
from kinematics.user_error import UserError

HIGHER_MM = (0.0, 25.0, 50.0, 100.0, 150.0, 200.0, 300.0, 400.0)
"""Distances above the raised position, along the spindle axis, of the corner of a path to another position, mm."""
PARKING_TURNS = 60
"""Number of random turns by which a parking position is chosen."""
MOVE, TOUCH = 0, 1
"""Kinds of moves: at the feed, and at the probing feed up to the contact."""


@dataclass(frozen=True)
class Moves:
    """Straight moves of a measuring program, from the parking position back to it."""

    positions: Array
    """End of each move `(m, axes)`, mm and rad; the first is the parking position."""
    kind: np.ndarray
    """MOVE or TOUCH `(m,)`."""
    row: np.ndarray
    """Row of the plan `(m,)` to which the move belongs."""
    touch: np.ndarray
    """Number of the touch `(m,)` from 1; 0 for other moves."""
    sphere: np.ndarray
    """Number of the sphere that the tip approaches `(m,)`; -1 for none."""


@dataclass
class Ways:
    """The centres that are within reach, with the paths to them from one parking position."""

    bodies: Bodies
    approach: Approach
    rotary: Array
    """Rotary positions `(n, axes)`, mm and rad, with linear axes at home, between which the machine turns."""
    seed: int = 0
    _found: dict[tuple[bytes, int], Reached | None] = field(default_factory=dict)

    @cached_property
    def park(self) -> Array:
        """Positions `(axes,)` of the linear axes at which all rotary axes turn: far back, and clear.

        UserError where the turning spheres hit the probe at all of them.
        """
        rng = np.random.default_rng(self.seed)
        pairs = rng.integers(0, len(self.rotary), (PARKING_TURNS, 2))
        for linear in self._parks():
            start, end = (np.where(self.bodies.machine.rotary, self.rotary[pairs[:, k]], linear) for k in (0, 1))
            if _is_clear(self.bodies, start, end, self.approach.margin):
                return linear
        raise UserError(
            "the machine has no position of its linear axes at which the rotary axes turn clear of the probe: state "
            "smaller ranges (--range), spheres nearer to the lines of the rotary axes, or a shorter probe"
        )

    def parked(self, rotary: Array) -> Array:
        """The parking position `(axes,)` with these rotary positions."""
        return np.asarray(np.where(self.bodies.machine.rotary, rotary, self.park))

    def reached(self, rotary: Array, sphere: int) -> Reached | None:
        """A sphere in an orientation with its touches and the path from the parking position; None out of reach."""
        key = (rotary.tobytes(), sphere)
        if key not in self._found:
            self._found[key] = self._reach(rotary, sphere)
        return self._found[key]

    def across(self, one: Reached, other: Reached) -> list[Array]:
        """Corners of the path from one centre to another one in the same orientation, without both raised positions."""
        for higher in HIGHER_MM:
            corners = [self._higher(one.centre, higher), self._higher(other.centre, higher)]
            whole = [one.centre.raised, *corners, other.centre.raised]
            if within_travel(self.bodies, np.array(corners)) and self._clear(whole):
                return corners
        return [*one.way[:0:-1], one.way[0], *other.way[1:]]

    def _reach(self, rotary: Array, sphere: int) -> Reached | None:
        centre = centre_of(self.bodies, rotary, sphere, self.approach)
        if centre is None:
            return None
        for higher in HIGHER_MM:
            corner = self._higher(centre, higher)
            way = [self.parked(rotary), corner]
            if within_travel(self.bodies, corner[None]) and self._clear([*way, centre.raised]):
                return Reached(centre, way)
        return None

    def _higher(self, centre: Centre, higher: float) -> Array:
        """The position `(axes,)` above the raised one by `higher` mm along the spindle axis."""
        point = centre_point(self.bodies, centre) + centre.directions[0] * (
            self.bodies.contact + 2.0 * self.approach.clearance + higher
        )
        at = linear_positions(self.bodies.machine, centre.raised[None], point[None], self.bodies.probe.tip)
        return np.asarray(at[0])

    def _clear(self, corners: Sequence[Array]) -> bool:
        return _is_clear(self.bodies, *joined_moves(corners), self.approach.margin)

    def _parks(self) -> Iterator[Array]:
        """Positions of the linear axes: farthest back along the spindle first, then the nearest to the artefact."""
        machine = self.bodies.machine
        middle = np.mean(list(self.bodies.artefact.centres.values()), axis=0)
        home = np.array([axis.home for axis in machine.axes]) * machine.scale
        over = linear_positions(machine, home[None], middle[None], self.bodies.probe.tip)[0]
        low, high = machine.travel
        over = np.clip(over, low, high)
        linear = np.flatnonzero(~machine.rotary)
        choices = [sorted({float(low[i]), float(over[i]), float(high[i])}) for i in linear]
        if not all(np.isfinite(each).all() for each in choices):
            raise UserError("a linear axis has no end of travel: state its travel in the machine file")
        corners = np.tile(home, (3 ** len(linear), 1))[: np.prod([len(each) for each in choices])]
        corners[:, linear] = list(itertools.product(*choices))
        pose = forward(machine, corners)
        height = pose.translation @ pose.rotation[0, :, 2]
        aside = np.linalg.norm(corners - over, axis=1)
        yield from corners[np.lexsort((aside, -np.round(height, 6)))]


@dataclass(frozen=True)
class Reached:
    """A centre with its touches, and the path to it."""

    centre: Centre
    way: list[Array]
    """Positions `(axes,)` from the parking position to the one before the raised position."""


def centre_point(bodies: Bodies, centre: Centre) -> Array:
    """The stated centre `(3,)` of the sphere, mm, workpiece frame."""
    return np.array(list(bodies.artefact.centres.values())[centre.sphere])


def moves_of(ways: Ways, rows: Sequence[Reached]) -> Moves:
    """All moves of a program that measures centres in this order."""
    out = _Recorder()
    last: Reached | None = None
    for row, reached in enumerate(rows):
        if last is None:
            out.move(reached.way, row)
        elif np.array_equal(_turned(ways, last), _turned(ways, reached)):
            out.move(ways.across(last, reached), row)
        else:
            out.move([*last.way[::-1], *reached.way], row)
        out.touches(reached.centre, row)
        last = reached
    if last is not None:
        out.move(last.way[::-1], len(rows) - 1)
    return out.moves()


def unproven(ways: Ways, moves: Moves) -> np.ndarray:
    """Numbers of the moves whose clearance is not proven to be the margin or more; index 0 is the start."""
    margin = ways.approach.margin
    least = least_clearance(ways.bodies, moves.positions[:-1], moves.positions[1:], moves.sphere[1:], margin)
    return np.flatnonzero(least < margin) + 1


def _turned(ways: Ways, reached: Reached) -> Array:
    return np.asarray(reached.centre.raised[ways.bodies.machine.rotary])


def _is_clear(bodies: Bodies, start: Array, end: Array, margin: float) -> bool:
    least = least_clearance(bodies, start, end, np.full(len(start), -1), margin)
    return bool(np.all(least >= margin))


class _Recorder:
    """Moves in order."""

    def __init__(self) -> None:
        self._positions: list[Array] = []
        self._marks: list[tuple[int, int, int, int]] = []

    def move(self, corners: Sequence[Array], row: int) -> None:
        """Moves through corners; a corner at the present position is left out."""
        for corner in corners:
            self._add(corner, (MOVE, row, 0, -1))

    def touches(self, centre: Centre, row: int) -> None:
        """All touches of a centre, each from the raised position and back."""
        self.move([centre.raised], row)
        for k, (above, start, end) in enumerate(zip(centre.above, centre.starts, centre.ends, strict=True), start=1):
            self.move([above, start], row)
            self._add(end, (TOUCH, row, k, centre.sphere))
            self._add(start, (MOVE, row, 0, centre.sphere))
            self.move([above, centre.raised], row)

    def moves(self) -> Moves:
        """The moves."""
        kind, row, touch, sphere = np.array(self._marks, int).reshape(-1, 4).T
        return Moves(np.array(self._positions), kind, row, touch, sphere)

    def _add(self, position: Array, mark: tuple[int, int, int, int]) -> None:
        if not self._positions or not np.allclose(self._positions[-1], position, rtol=0.0, atol=1e-9):
            self._positions.append(position)
            self._marks.append(mark)
