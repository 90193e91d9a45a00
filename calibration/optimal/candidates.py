"""Candidates of a measurement: positions over the whole volume with every target, as far as a tracker sees them."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibration.instruments import LaserTracker
from calibration.measurement.measurement import Measurement, Target
from calibration.measurement.plan import Choices
from calibration.observation.reach import Reach, in_reach
from calibration.planning.strategies import fixed_positions, limits, rounded
from calibration.registration.observed_points import nominal_points
from kinematics.machine import Machine, Vector
from kinematics.state import State
from kinematics.transforms import Array, Pose
from kinematics.user_error import UserError

BEYOND = 1.25
"""Factor by which positions are spread beyond the travel, then clipped to its ends: faces and edges are most useful."""
NEAREST_MM = 100.0
"""Smallest distance, mm, from the tracker to a target."""
OFF_MM, LOW = 1500.0, 0.2
"""Distance, mm, from the volume to a tracker without a given position; its lower height, as a share of the volume's."""


@dataclass(frozen=True)
class Obstacle:
    """A box in the workpiece frame, mm, in which no target may be and which no beam may cross."""

    low: Vector
    high: Vector

    def contains(self, points: Array) -> np.ndarray:
        """Mask `(n,)` of the points `(n, 3)` inside the box."""
        return np.asarray(np.all((points >= self.low) & (points <= self.high), axis=1))

    def between(self, origin: Array, points: Array) -> np.ndarray:
        """Mask `(n,)` of the lines from the origin `(3,)` to points `(n, 3)` that cross the box (slab method)."""
        low, high, directions = np.array(self.low), np.array(self.high), points - origin
        along = np.abs(directions) < 1e-9
        ends = np.stack([low - origin, high - origin])[:, None] / np.where(along, 1.0, directions)
        # a line along the faces of a slab is in it from end to end, or nowhere
        within = np.where((low <= origin) & (origin <= high), np.inf, -np.inf)
        enters = np.where(along, -within, ends.min(axis=0)).max(axis=1)
        leaves = np.where(along, within, ends.max(axis=0)).min(axis=1)
        return np.asarray((enters <= leaves) & (leaves >= 0.0) & (enters <= 1.0))


def obstacle_of(box: Mapping[str, tuple[float, float]]) -> Obstacle:
    """The obstacle of ranges by x, y, z, infinite where none is given.

    UserError for other letters, and for ranges that do not go from a lower to a higher position.
    """
    unknown = sorted(set(box) - set("xyz"))
    if unknown or not box:
        raise UserError(f"obstacle: expected ranges of x, y, z, got {', '.join(unknown) or 'none'}")
    for letter, (low, high) in box.items():
        if not low < high:
            raise UserError(f"obstacle {letter}={low:g}:{high:g}: it must go from a lower to a higher position")
    x, y, z = (box.get(letter, (-np.inf, np.inf)) for letter in "xyz")
    return Obstacle((x[0], y[0], z[0]), (x[1], y[1], z[1]))


def positions(machine: Machine, choices: Choices, number: int) -> Array:
    """Positions `(number or fewer, axes)`, mm and rad, evenly over the whole volume and denser at its ends (Halton)."""
    from scipy.stats import qmc

    low, high = limits(machine, choices)
    together = choices.rotary in ("random", "simultaneous")
    if choices.rotary == "swept":
        raise UserError("an optimised plan moves rotary axes along with the others (--rotary random) or not at all")
    moving = [i for i in range(len(low)) if low[i] < high[i] and (together or not machine.rotary[i])]
    endless = [machine.names[i] for i in moving if not np.isfinite(high[i] - low[i])]
    if endless or not moving:
        raise UserError(f"axis {endless[0]} has no end of travel: state its range" if endless else "nothing moves")
    share = np.clip((qmc.Halton(len(moving), seed=choices.seed).random(number) - 0.5) * BEYOND + 0.5, 0.0, 1.0)
    found = np.tile(fixed_positions(machine, choices), (number, 1))
    found[:, moving] = low[moving] + share * (high - low)[moving]
    return np.unique(rounded(found, machine, choices), axis=0) * machine.scale


def with_targets(positions_of_axes: Array, targets: Mapping[str, Target]) -> State:
    """States of every position with every target, approached in random order, as in a shuffled plan."""
    rng = np.random.default_rng(0)
    every = np.tile(positions_of_axes, (len(targets), 1))
    n = len(every)
    order = rng.permutation(n)
    moves = np.empty_like(every)
    moves[order] = np.diff(every[order], axis=0, prepend=every[order[:1]])
    time = np.empty(n)
    time[order] = np.arange(n) * 15.0
    at_rest = np.zeros_like(every)
    return State(
        every, approach=np.sign(moves), last_move=moves, velocity=at_rest, acceleration=at_rest, time=time,
        cycle=np.zeros(n), target=np.repeat(list(targets), len(positions_of_axes)),
    )  # fmt: skip


def visible_from(
    machine: Machine,
    state: State,
    targets: Mapping[str, Target],
    position: Vector,
    pose: Pose,
    reach: Reach | None,
    obstacles: Sequence[Obstacle],
) -> np.ndarray:
    """Mask `(n,)` of the states whose target a tracker at a position `(3,)`, mm, sees."""
    stationed = replace(state, station=np.full(len(state), "s1"))
    nothing = np.zeros((len(state), 3))
    blank = Measurement(machine, LaserTracker(), stationed, nothing, targets)
    points = nominal_points(blank)
    free = np.linalg.norm(points - position, axis=1) > NEAREST_MM
    for obstacle in obstacles:
        free &= ~obstacle.contains(points) & ~obstacle.between(np.array(position), points)
    if reach is not None and free.any():
        rows = np.flatnonzero(free)
        free[rows] = in_reach(blank.rows(rows), {"s1": pose}, reach).rows
    return np.asarray(free)


def positions_around(machine: Machine, choices: Choices, target: Target) -> list[Vector]:
    """Possible tracker positions, mm: 1.5 m off the corners and sides of the volume, at a low and a middle height."""
    low, high = limits(machine, choices)
    linear = np.flatnonzero(~machine.rotary)
    corners = np.tile(fixed_positions(machine, choices), (2 ** len(linear), 1))
    corners[:, linear] = list(itertools.product(*zip(low[linear], high[linear], strict=True)))
    named = np.full(len(corners), "1")
    state = State(corners * machine.scale, target=named)
    blank = Measurement(machine, LaserTracker(), state, np.zeros((len(corners), 3)), {"1": target})
    points = nominal_points(blank)
    least, most = points.min(axis=0), points.max(axis=0)
    middle = (least + most) / 2
    x, y = ((least[k] - OFF_MM, middle[k], most[k] + OFF_MM) for k in (0, 1))
    heights = (least[2] + LOW * (most[2] - least[2]), middle[2])
    around = [position for position in itertools.product(x, y) if position != (middle[0], middle[1])]
    return [(round(float(a)), round(float(b)), round(float(z))) for a, b in around for z in heights]
