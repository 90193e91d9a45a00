"""Bodies of a measurement with a touch probe as capsules, and their clearance along moves.

A capsule is a segment with a radius. The probe is its tip, its stylus and its body up to the spindle nose; an artefact
is a ball and its stem, which points from the ball down to the table. Everything is in the workpiece frame. Between two
positions every axis moves in proportion to all others, as in a straight move without tool centre point. A point of one
body then moves relative to the other by at most a `path`; the clearance of two bodies changes by no more. This proves
the clearance between two evaluated positions without evaluating those between them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from kinematics.forward import forward
from kinematics.machine import Machine, Vector
from kinematics.transforms import Array

SHORTEST_PART_MM = 0.02
"""Path, mm, below which a part of a move is not divided any further."""
POINTS_OF_PROBE_PART = 9
"""Number of points along each part of the probe whose distances from the table are calculated."""


@dataclass(frozen=True)
class Probe:
    """A touch probe in the spindle, with its stylus along the spindle axis; mm."""

    tip: Vector
    """Centre of the tip from the spindle nose."""
    ball: float = 6.0
    """Diameter of the tip."""
    stylus: float = 4.0
    """Diameter of the stylus."""
    free_length: float = 40.0
    """Length of the stylus from the centre of the tip to the probe's body."""
    body: float = 50.0
    """Diameter of the body."""


@dataclass(frozen=True)
class Artefact:
    """Spheres on stems; mm."""

    centres: Mapping[str, Vector]
    """Stated centres by name, in the workpiece frame at zero pose."""
    ball: float = 25.0
    """Diameter of each sphere."""
    stem: float = 8.0
    """Diameter of the stems."""
    stem_length: float = 60.0
    """Length of the stems from the centre of the sphere towards the table (-z of the workpiece)."""
    table_margin: float = 40.0
    """Distance from the spheres to the edge of the table, which counts as a disc below the stems."""


class Capsules(NamedTuple):
    """Capsules `k` in `n` states."""

    start: Array
    """Start of each segment `(n, k, 3)`, mm."""
    end: Array
    radius: Array
    """Radii `(k,)`, mm."""


class Table(NamedTuple):
    """The upper face of a table in the workpiece frame."""

    middle: Array
    """Middle `(3,)`, mm."""
    edge: float
    """Radius, mm."""


@dataclass(frozen=True)
class Bodies:
    """The probe and the artefact on a machine."""

    machine: Machine
    probe: Probe
    artefact: Artefact

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the spheres."""
        return tuple(self.artefact.centres)

    @property
    def contact(self) -> float:
        """Distance of the centres of tip and sphere in contact, mm."""
        return (self.probe.ball + self.artefact.ball) / 2.0

    def probe_capsules(self, positions: Array) -> Capsules:
        """Tip, stylus and body of the probe at axis positions `(n, axes)`, mm and rad."""
        probe, nose = self.probe, forward(self.machine, positions)
        tip = nose.apply(probe.tip)
        up = nose.rotation[:, :, 2]
        at_body = tip + (probe.free_length + probe.body / 2.0) * up
        top = tip + max(-probe.tip[2], probe.free_length + probe.body) * up
        start = np.stack([tip, tip, at_body], axis=1)
        end = np.stack([tip, tip + probe.free_length * up, top], axis=1)
        return Capsules(start, end, np.array([probe.ball, probe.stylus, probe.body]) / 2.0)

    def artefact_capsules(self) -> Capsules:
        """All balls, then all stems."""
        balls = np.array(list(self.artefact.centres.values()))
        feet = balls - [0.0, 0.0, self.artefact.stem_length]
        radii = np.repeat([self.artefact.ball, self.artefact.stem], len(balls)) / 2.0
        return Capsules(np.concatenate([balls, balls])[None], np.concatenate([balls, feet])[None], radii)

    def clearances(self, positions: Array, touched: np.ndarray) -> Array:
        """Least distance `(n,)`, mm, of the surfaces of probe and artefact at axis positions `(n, axes)`.

        touched: number of the sphere `(n,)` that the tip approaches, whose ball does not count; -1 for none.
        """
        probe, artefact = self.probe_capsules(positions), self.artefact_capsules()
        apart = _segment_distances(probe, artefact) - probe.radius[:, None] - artefact.radius
        rows = np.flatnonzero(touched >= 0)
        # tip and stylus touch the ball; the probe's body must still be clear of it
        apart[rows[:, None], [0, 1], touched[rows][:, None]] = np.inf
        return np.asarray(np.minimum(apart.min(axis=(1, 2)), self._above_table(probe)))

    def _above_table(self, probe: Capsules) -> Array:
        """Least distance `(n,)`, mm, of the probe from the table below the stems, less half a step along the probe."""
        table = self.table
        share = np.linspace(0.0, 1.0, POINTS_OF_PROBE_PART)[:, None]
        points = probe.start[:, :, None] + share * (probe.end - probe.start)[:, :, None]
        beside = np.maximum(np.linalg.norm((points - table.middle)[..., :2], axis=-1) - table.edge, 0.0)
        apart = np.hypot(beside, np.maximum(points[..., 2] - table.middle[2], 0.0)).min(axis=2)
        step = np.linalg.norm(probe.end - probe.start, axis=2) / (POINTS_OF_PROBE_PART - 1)
        return np.asarray((apart - step / 2.0 - probe.radius).min(axis=1))

    @property
    def table(self) -> Table:
        """The table: a disc at the lowest foot of a stem, with everything below it."""
        balls = np.array(list(self.artefact.centres.values()))
        middle = balls.mean(axis=0)
        edge = np.linalg.norm((balls - middle)[:, :2], axis=1).max() + self.artefact.table_margin
        middle[2] = balls[:, 2].min() - self.artefact.stem_length
        return Table(middle, float(edge))

    def paths(self, start: Array, end: Array) -> Array:
        """Upper bound `(n,)`, mm, of the relative paths of points of probe and artefact in straight moves."""
        moved = np.abs(end - start)
        linear = np.linalg.norm(np.where(self.machine.rotary, 0.0, moved), axis=1)
        return np.asarray(linear + moved @ self._arms)

    @property
    def _arms(self) -> Array:
        """Largest distance `(axes,)`, mm, of the turned body from each rotary axis; 0 for linear axes."""
        machine = self.machine
        capsules, table = self.artefact_capsules(), self.table
        artefact = np.concatenate([capsules.start[0], capsules.end[0], table.middle[None]])
        around = np.append(np.zeros(2 * len(self.names) * 2), table.edge)
        probe = np.array([[0.0, 0.0, 0.0], self.probe.tip])
        arms = np.zeros(len(machine.axes))
        for side, points, radii in (("workpiece", artefact, around), ("tool", probe, np.zeros(2))):
            own = [i for i, axis in enumerate(machine.axes) if axis.side == side]
            # from the body outwards: the nearer axis turns it about its own point
            arms[own] = _reaches(machine, own if side == "workpiece" else own[::-1], points, radii)[own]
        return arms


def least_clearance(bodies: Bodies, start: Array, end: Array, touched: np.ndarray, margin: float) -> Array:
    """Lower bound `(n,)`, mm, of the clearance along straight moves, exact to `SHORTEST_PART_MM` / 2 below margin.

    start, end: axis positions `(n, axes)`, mm and rad. Parts of moves whose bound is not yet above the margin are
    halved until they are short.
    """
    n = len(start)
    found = np.full(n, np.inf)
    low, high, of = start, end, np.arange(n)
    at_low, at_high = bodies.clearances(low, touched), bodies.clearances(high, touched)
    while len(of):
        path = bodies.paths(low, high)
        bound = (at_low + at_high - path) / 2.0
        done = (bound >= margin) | (path < SHORTEST_PART_MM) | (np.minimum(at_low, at_high) < margin)
        least = np.where(bound >= margin, bound, np.minimum(bound, np.minimum(at_low, at_high)))
        np.minimum.at(found, of[done], least[done])
        rows = np.flatnonzero(~done & (found[of] >= margin))
        middle = (low[rows] + high[rows]) / 2.0
        at_middle = bodies.clearances(middle, touched[of[rows]])
        low, high = np.concatenate([low[rows], middle]), np.concatenate([middle, high[rows]])
        at_low = np.concatenate([at_low[rows], at_middle])
        at_high = np.concatenate([at_middle, at_high[rows]])
        of = np.concatenate([of[rows], of[rows]])
    return found


def _segment_distances(one: Capsules, other: Capsules) -> Array:
    """Distances `(n, k, m)` of the segments of two sets of capsules (Ericson, Real-Time Collision Detection, 5.1.9)."""
    p, q = one.start[:, :, None], other.start[:, None]
    d, e = one.end[:, :, None] - p, other.end[:, None] - q
    r = p - q
    a, b, f = np.sum(d * d, axis=-1), np.sum(e * e, axis=-1), np.sum(e * r, axis=-1)
    c, across = np.sum(d * r, axis=-1), np.sum(d * e, axis=-1)
    safe_a, safe_b = np.where(a > 0.0, a, 1.0), np.where(b > 0.0, b, 1.0)
    denominator = a * b - across * across
    flat = denominator <= 1e-12 * a * b
    s = np.where(flat, 0.0, np.clip((across * f - c * b) / np.where(flat, 1.0, denominator), 0.0, 1.0))
    t = np.where(b > 0.0, (across * s + f) / safe_b, 0.0)
    inside = np.clip(t, 0.0, 1.0)
    s = np.where(a > 0.0, np.clip((across * inside - c) / safe_a, 0.0, 1.0), 0.0)
    gap = (p + s[..., None] * d) - (q + inside[..., None] * e)
    return np.asarray(np.linalg.norm(gap, axis=-1))


def _reaches(machine: Machine, outwards: Sequence[int], points: Array, radii: Array) -> Array:
    """Largest distance `(axes,)`, mm, of balls of points `(k, 3)` and radii `(k,)` from each rotary axis of a side.

    outwards: numbers of the axes of the side, from the body on.
    """
    arms = np.zeros(len(machine.axes))
    reach, last = 0.0, None
    for i in outwards:
        axis = machine.axes[i]
        if not axis.rotary:
            reach += float(np.abs(axis.travel).max())
            continue
        point = np.array(axis.point)
        gap = (np.linalg.norm(points - point, axis=1) + radii).max() if last is None else np.linalg.norm(point - last)
        reach += float(gap)
        arms[i], last = reach, point
    return arms


def joined_moves(waypoints: Sequence[Array]) -> tuple[Array, Array]:
    """Starts and ends `(n, axes)` of the straight moves along waypoints."""
    points = np.array(waypoints)
    return points[:-1], points[1:]
