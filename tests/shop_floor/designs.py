"""Designs: where the axes go in which order, which targets are read, when, at which temperature, from which set-up."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from shop_floor.chain import Array, Machine, Vector

TARGETS: Mapping[str, Vector] = {"t1": (0.0, 0.0, -120.0), "t2": (90.0, 40.0, -180.0), "t3": (-70.0, 55.0, -90.0)}
READING_S = 6.0
"""Time to settle, read and log a row."""
FEED_MM_PER_S = 250.0
TURN_DEG_PER_S = 30.0
REFERENCE_DEGC = 20.0
BREAK_S = 45 * 60.0
HALVES = (0.0, 0.5, 1.0)
Number = NDArray[np.int_]


@dataclass(frozen=True)
class Run:
    """A measurement before anything is measured: rows in the order of acquisition."""

    machine: Machine
    positions: Array
    """Commanded positions `(n, axes)`, mm and degrees."""
    target: NDArray[np.str_]
    clock: Array
    """Time `(n,)` from the first row, s."""
    came_from: Array
    """Direction `(axes,)`, 1 or -1, of the last move of each axis before the first row: known to nobody."""
    temperature: Array
    """Temperature `(n,)` of the scales, degC."""
    station: NDArray[np.str_] | None = None
    repeatability_um: float = 0.0
    """Standard deviation of the position in which an axis stops, of each linear axis."""
    header_noise: float = 1.0
    """Uncertainties in the header of the file, relative to the true ones."""
    ripple: bool = False
    """True where positioning errors have waves that are finer than any basis."""
    targets: Mapping[str, Vector] = field(default_factory=lambda: TARGETS)
    hall: bool = False
    """True where the temperature follows the hall instead of the run."""
    approach: Array | None = None
    """Direction `(n, axes)` of the last move of each axis, where it does not follow from the order of the rows."""

    def __len__(self) -> int:
        return len(self.positions)

    @cached_property
    def directions(self) -> Array:
        """Direction `(n, axes)`, 1 or -1, of the last move of each axis."""
        if self.approach is not None:
            return self.approach
        found = np.zeros(self.positions.shape)
        last = self.came_from
        for row, step in enumerate(np.diff(self.positions, axis=0, prepend=self.positions[:1])):
            last = np.where(step == 0.0, last, np.sign(step))
            found[row] = last
        return found

    @cached_property
    def stop(self) -> Number:
        """Number `(n,)` of the stop of each row: rows in sequence at one position share it."""
        moved = np.any(np.diff(self.positions, axis=0) != 0.0, axis=1)
        return np.concatenate([[0], np.cumsum(moved)])

    @cached_property
    def tools(self) -> Array:
        """Target vectors `(n, 3)`, mm."""
        return np.array([self.targets[name] for name in self.target.tolist()])

    def place(self, axis: str) -> Array:
        """Positions `(n,)` of an axis."""
        return np.asarray(self.positions[:, self.machine.column(axis)])

    def share(self, axis: str) -> Array:
        """Share `(n,)` of the travel of an axis."""
        return self.machine.axis(axis).share(self.place(axis))

    def direction(self, axis: str) -> Array:
        """Direction `(n,)` of the last move of an axis."""
        return np.asarray(self.directions[:, self.machine.column(axis)])

    @property
    def duration(self) -> float:
        """Time of the last row, s."""
        return float(self.clock[-1])


def _at(machine: Machine, **shares: float | Array) -> Array:
    """Positions `(n, axes)` by shares of the travel of linear axes; rotary axes at 0."""
    n = max(np.size(value) for value in shares.values())
    found = np.zeros((n, len(machine.axes)))
    for i, axis in enumerate(machine.axes):
        if not axis.rotary:
            found[:, i] = axis.low + np.broadcast_to(shares[axis.name], (n,)) * (axis.high - axis.low)
    return np.round(found, 4)


def _lines(machine: Machine, points: int, *, back: bool, places: tuple[float, ...] = HALVES) -> Array:
    """Along each linear axis, at all places of the other two: so many positions out, and back."""
    parts = []
    ladder = np.linspace(0.0, 1.0, points)
    way = np.concatenate([ladder, ladder[::-1]]) if back else ladder
    for along in sorted(machine.linear):
        first, second = (name for name in sorted(machine.linear) if name != along)
        for one, other in itertools.product(places, places):
            shares: dict[str, float | Array] = {along: way, first: one, second: other}
            parts.append(_at(machine, **shares))
    return np.concatenate(parts)


def _anywhere(machine: Machine, rng: np.random.Generator, count: int, *, turned: bool = True) -> Array:
    """Random positions in the volume; B within 110 and C within 360 degrees."""
    low = np.array([axis.low for axis in machine.axes])
    high = np.array([min(axis.high, 110.0) if axis.name == "B" else axis.high for axis in machine.axes])
    found = rng.uniform(low, high, (count, len(low)))
    if not turned:
        found[:, [axis.rotary for axis in machine.axes]] = 0.0
    return np.round(found, 4)


def _volume(machine: Machine, rng: np.random.Generator, count: int) -> Array:
    """Random positions; machines with rotary axes get 250 with these turned besides."""
    straight = _anywhere(machine, rng, count, turned=False)
    if len(machine.linear) == len(machine.axes):
        return straight
    return np.concatenate([straight, _anywhere(machine, rng, 250)])


def _grid(machine: Machine, *counts: int) -> Array:
    """A grid in boustrophedon order, X running first."""
    xs, ys, zs = (np.linspace(0.0, 1.0, count) for count in counts)
    shares = []
    for k, z in enumerate(zs):
        for j, y in enumerate(ys if k % 2 == 0 else ys[::-1]):
            forward = (k * len(ys) + j) % 2 == 0
            shares += [(x, y, z) for x in (xs if forward else xs[::-1])]
    x, y, z = np.array(shares).T
    return _at(machine, X=x, Y=y, Z=z)


def _run(machine: Machine, positions: Array, rng: np.random.Generator, targets: int = 2, *, each: int = 1) -> Run:
    """A run of positions, so many targets in turn; `each`: targets read one after the other at one stop."""
    names = np.array(list(TARGETS))[:targets]
    positions = np.repeat(positions, each, axis=0)
    steps = np.abs(np.diff(positions, axis=0, prepend=positions[:1]))
    speed = np.array([TURN_DEG_PER_S if axis.rotary else FEED_MM_PER_S for axis in machine.axes])
    clock = np.cumsum(READING_S + (steps / speed).max(axis=1)) - READING_S
    return Run(
        machine,
        positions,
        names[np.arange(len(positions)) % targets],
        np.round(clock, 1),
        rng.choice([-1.0, 1.0], len(machine.axes)),
        np.full(len(positions), REFERENCE_DEGC),
        targets={name: TARGETS[name] for name in names.tolist()},
    )


def lines(machine: Machine, rng: np.random.Generator, draw: int) -> Run:
    """Line after line out and back, then 150 random positions; two targets in turn."""
    del draw
    positions = np.concatenate([_lines(machine, 9, back=True), _volume(machine, rng, 150)])
    return _run(machine, positions, rng)


def serpentine(machine: Machine, rng: np.random.Generator, draw: int) -> Run:
    """A grid there and the same path back; two targets in turn."""
    del draw
    there = _grid(machine, 7, 5, 5)
    if len(machine.linear) < len(machine.axes):
        there = np.concatenate([there, _anywhere(machine, rng, 150)])
    return _run(machine, np.concatenate([there, there[::-1]]), rng)


def random3(machine: Machine, rng: np.random.Generator, draw: int) -> Run:
    """Random stops, once; three targets one after the other at each."""
    del draw
    return _run(machine, _volume(machine, rng, 120), rng, 3, each=3)


def lines_once(machine: Machine, rng: np.random.Generator, draw: int) -> Run:
    """Lines in one direction only, then 120 random positions."""
    del draw
    positions = np.concatenate([_lines(machine, 9, back=False), _volume(machine, rng, 120)])
    return _run(machine, positions, rng)


def faces(machine: Machine, rng: np.random.Generator, draw: int) -> Run:
    """One face of the volume after the other, each a grid in boustrophedon order."""
    del draw
    ladder = np.linspace(0.0, 1.0, 7)
    parts = []
    for across, side in itertools.product(sorted(machine.linear), (0.0, 1.0)):
        first, second = (name for name in sorted(machine.linear) if name != across)
        for k, v in enumerate(ladder):
            way = ladder if k % 2 == 0 else ladder[::-1]
            parts.append(_at(machine, **{across: side, first: way, second: v}))
    if len(machine.linear) < len(machine.axes):
        parts.append(_anywhere(machine, rng, 200))
    return _run(machine, np.concatenate(parts), rng)


def diagonals(machine: Machine, rng: np.random.Generator, draw: int) -> Run:
    """The four body diagonals out and back, then the twelve edges out and back."""
    del draw
    parts = []
    u = np.concatenate([np.linspace(0.0, 1.0, 17), np.linspace(1.0, 0.0, 17)])
    for y, z in itertools.product((u, 1.0 - u), (u, 1.0 - u)):
        parts.append(_at(machine, X=u, Y=y, Z=z))
    parts.append(_lines(machine, 9, back=True, places=(0.0, 1.0)))
    if len(machine.linear) < len(machine.axes):
        parts.append(_anywhere(machine, rng, 200))
    return _run(machine, np.concatenate(parts), rng)


def drifting_hall(machine: Machine, rng: np.random.Generator, draw: int) -> Run:
    """Lines; the temperature swings by 1 K with the control of the hall and rises besides."""
    run = lines(machine, rng, draw)
    swing = rng.uniform(0.6, 1.2) * np.sin(2 * np.pi * run.clock / rng.uniform(2400, 5400) + rng.uniform(0, 2 * np.pi))
    rise = rng.choice([-1.0, 1.0]) * rng.uniform(2.0, 4.0) * run.clock / run.duration
    noise = rng.normal(scale=0.01, size=len(run))
    return replace(run, temperature=np.round(REFERENCE_DEGC + rise + swing + noise, 2), hall=True)


def lunch_break(machine: Machine, rng: np.random.Generator, draw: int) -> Run:
    """Lines with a break of 45 minutes within the run."""
    run = lines(machine, rng, draw)
    since = int(rng.uniform(0.35, 0.65) * len(run))
    return replace(run, clock=run.clock + BREAK_S * (np.arange(len(run)) >= since))


def two_stations(machine: Machine, rng: np.random.Generator, draw: int) -> Run:
    """Lines; the tracker is moved to a second set-up before the middle of the random positions."""
    run = lines(machine, rng, draw)
    half = np.arange(len(run)) >= len(run) * 3 // 5
    return replace(run, station=np.where(half, "s2", "s1"), clock=run.clock + 600.0 * half)


def few(machine: Machine, rng: np.random.Generator, draw: int) -> Run:
    """80 rows: 40 random positions there and back."""
    del draw
    there = _anywhere(machine, rng, 40)
    return _run(machine, np.concatenate([there, there[::-1]]), rng)


def many(machine: Machine, rng: np.random.Generator, draw: int) -> Run:
    """5000 rows: lines at 25 places, out and back, then random positions."""
    del draw
    grid = _lines(machine, 25, back=True, places=(0.0, 0.25, 0.5, 0.75, 1.0))
    return _run(machine, np.concatenate([grid, _anywhere(machine, rng, 5000 - len(grid))]), rng)


def one_target(machine: Machine, rng: np.random.Generator, draw: int) -> Run:
    """Lines with one target."""
    del draw
    return _run(machine, np.concatenate([_lines(machine, 9, back=True), _volume(machine, rng, 150)]), rng, 1)


def three_targets(machine: Machine, rng: np.random.Generator, draw: int) -> Run:
    """Lines of five positions out and back, three targets at each stop."""
    del draw
    return _run(machine, np.concatenate([_lines(machine, 5, back=True), _volume(machine, rng, 60)]), rng, 3, each=3)


def bad_repeat(machine: Machine, rng: np.random.Generator, draw: int) -> Run:
    """Axes that repeat to 3 um; lines in even draws (two targets in turn), random stops with three targets in odd."""
    return replace((random3 if draw % 2 else lines)(machine, rng, draw), repeatability_um=3.0)


def wrong_noise(machine: Machine, rng: np.random.Generator, draw: int) -> Run:
    """Lines; the header gives half of the noise in even draws and the double in odd ones."""
    return replace(lines(machine, rng, draw), header_noise=2.0 if draw % 2 else 0.5)


def fine_waves(machine: Machine, rng: np.random.Generator, draw: int) -> Run:
    """Lines in even draws, 360 random positions in odd ones; positioning errors have waves finer than any basis."""
    return replace(
        _run(machine, _volume(machine, rng, 360), rng) if draw % 2 else lines(machine, rng, draw), ripple=True
    )


def again(machine: Machine, rng: np.random.Generator, draw: int) -> Run:
    """Lines on a machine that is calibrated before, by other lines without hidden effects (`question.py`)."""
    return lines(machine, rng, draw)


Design = Callable[[Machine, np.random.Generator, int], Run]
DESIGNS: Mapping[str, Design] = {
    "lines": lines, "serpentine": serpentine, "random3": random3, "bad-repeat": bad_repeat, "lines-once": lines_once,
    "faces": faces, "diagonals": diagonals, "drifting-hall": drifting_hall, "break": lunch_break,
    "two-stations": two_stations, "few": few, "many": many, "one-target": one_target, "three-targets": three_targets,
    "wrong-noise": wrong_noise, "fine-waves": fine_waves, "again": again,
}  # fmt: skip
