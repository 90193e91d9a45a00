"""Candidates of a measurement: positions over the whole volume, targets, and places of the instrument; what it sees."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from calibration.instruments import Instrument, LaserTracker
from calibration.measurement.measurement import Measurement, Target
from calibration.measurement.plan import Choices
from calibration.observation.reach import Reach, in_reach
from calibration.planning.strategies import fixed_positions, limits, rounded
from calibration.simulation.simulate import tracker_pose
from kinematics.machine import Machine, Vector
from kinematics.state import State
from kinematics.transforms import Array
from kinematics.user_error import UserError

BEYOND = 1.25
"""Factor by which positions are spread beyond the travel, then clipped to its ends: faces and edges are most useful."""
NEAREST_CANDIDATE_MM = 100.0
"""Smallest distance, mm, from the tracker to a target."""
INSTRUMENT_DISTANCES_MM, INSTRUMENT_HEIGHTS = (300.0, 1500.0), (0.2, 0.5, 1.0)
"""Distances, mm, from the volume to an instrument without a given position; its heights, as shares of the volume's."""


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


def with_set_ups(positions_of_axes: Array, targets: Sequence[str], stations: Sequence[str]) -> State:
    """States of every position with every target from every station, approached in random order, as if shuffled."""
    rng = np.random.default_rng(0)
    each = len(positions_of_axes)
    every = np.tile(positions_of_axes, (len(targets) * len(stations), 1))
    n = len(every)
    order = rng.permutation(n)
    moves = np.empty_like(every)
    moves[order] = np.diff(every[order], axis=0, prepend=every[order[:1]])
    time = np.empty(n)
    time[order] = np.arange(n) * 15.0
    at_rest = np.zeros_like(every)
    return State(
        every, approach=np.sign(moves), last_move=moves, velocity=at_rest, acceleration=at_rest, time=time,
        cycle=np.zeros(n), target=np.tile(np.repeat(list(targets), each), len(stations)),
        station=np.repeat(list(stations), each * len(targets)),
    )  # fmt: skip


def visible(
    machine: Machine,
    instrument: Instrument,
    state: State,
    targets: Mapping[str, Target],
    stations: Mapping[str, Vector],
    reach: Reach | None,
    obstacles: Sequence[Obstacle],
) -> np.ndarray:
    """Mask `(n,)` of the states whose target the instrument sees from its station, mm."""
    blank = Measurement(machine, instrument, state, np.zeros((len(state), 3)), targets)
    points = blank.nominal_points
    free = np.zeros(len(state), bool)
    for name, position in stations.items():
        rows = np.flatnonzero(blank.groups == name)
        seen = np.linalg.norm(points[rows] - position, axis=1) > NEAREST_CANDIDATE_MM
        for obstacle in obstacles:
            seen &= ~obstacle.contains(points[rows]) & ~obstacle.between(np.array(position), points[rows])
        free[rows] = seen
    if reach is not None and free.any():
        poses = {name: tracker_pose(position, np.random.default_rng(0)) for name, position in stations.items()}
        rows = np.flatnonzero(free)
        free[rows] = in_reach(blank.rows(rows), poses, reach).rows
    return free


def volume_of_targets(machine: Machine, choices: Choices) -> tuple[Array, Array]:
    """Least and largest coordinates `(3,)`, mm, of the targets at the corners of the volume, workpiece frame."""
    low, high = limits(machine, choices)
    linear = np.flatnonzero(~machine.rotary)
    corners = np.tile(fixed_positions(machine, choices), (2 ** len(linear), 1))
    corners[:, linear] = list(itertools.product(*zip(low[linear], high[linear], strict=True)))
    state = with_set_ups(corners * machine.scale, list(choices.targets), ["1"])
    blank = Measurement(machine, LaserTracker(), state, np.zeros((len(state), 3)), choices.targets)
    points = blank.nominal_points
    return points.min(axis=0), points.max(axis=0)


def places_around(machine: Machine, choices: Choices) -> list[Vector]:
    """Possible places of the instrument, mm: near and far off the corners and sides of the volume, at three heights."""
    least, most = volume_of_targets(machine, choices)
    middle = (least + most) / 2
    sides = [side for side in itertools.product((-1, 0, 1), repeat=2) if side != (0, 0)]
    half = (most - least) / 2
    around = [middle[:2] + np.array(side) * (half[:2] + off) for off in INSTRUMENT_DISTANCES_MM for side in sides]
    heights = [least[2] + share * (most[2] - least[2]) for share in INSTRUMENT_HEIGHTS]
    return [(round(float(a)), round(float(b)), round(float(z))) for a, b in around for z in heights]


def refuse_inside(machine: Machine, choices: Choices, places: Sequence[Vector]) -> None:
    """UserError for a place within the volume of the targets, where the machine would hit the instrument."""
    least, most = volume_of_targets(machine, choices)
    for place in places:
        if np.all((least < place) & (place < most)):
            ends = ", ".join(
                f"{name} {low:g} to {high:g}"
                for name, low, high in zip("xyz", least.tolist(), most.tolist(), strict=True)
            )
            raise UserError(
                f"--tracker {','.join(f'{v:g}' for v in place)} is inside the volume of the targets ({ends} mm): the "
                "machine would hit the instrument there: give a place outside, or limit an axis (--range Z=300:800)"
            )
