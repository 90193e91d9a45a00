"""Measurement designs: where a tracker stands, what it observes in which order, and how long that takes."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from virtual_machine.chain import Array, Chain
from virtual_machine.observe import Stand, Tracker
from virtual_machine.session import Session

DWELL_S = 4.0
SPEED, TURNING = 200.0, 20.0
"""mm/s and degrees/s between positions."""
FEEDS = (3000.0, 12000.0)
"""mm/min, of rows in motion."""


@dataclass(frozen=True)
class Place:
    """A machine's surroundings."""

    tracker: Tracker
    targets: Mapping[str, tuple[float, float, float]]
    origins: tuple[tuple[float, float, float], ...]
    """Where the tracker can stand, mm, workpiece frame: outside the volume."""
    near: tuple[tuple[float, float, float], ...]
    """As near as it can stand, so that the beam turns far."""
    references: tuple[tuple[float, float, float], ...]
    """Nests on the table."""
    positions: int
    """That a fit of this machine needs."""


THREE = {"t1": (0.0, 0.0, -120.0), "t2": (110.0, 60.0, -200.0), "t3": (-90.0, 100.0, -150.0)}
PLACES = {
    "gantry": Place(
        Tracker(0.5, 0.3, 3.0, 1.0),
        {"t1": (0.0, 0.0, -200.0), "t2": (300.0, 150.0, -450.0), "t3": (-250.0, 300.0, -300.0)},
        ((-1500.0, 1500.0, 300.0), (2600.0, -1800.0, 500.0), (4200.0, 4600.0, 200.0)),
        ((2500.0, -600.0, 300.0), (-600.0, 1500.0, 900.0), (4200.0, 3600.0, 300.0)),
        ((200.0, 300.0, -400.0), (4800.0, 400.0, -400.0), (2500.0, 2800.0, -400.0)),
        110,
    ),
    "cframe": Place(
        Tracker(0.5, 0.3, 2.0, 1.0),
        THREE,
        ((-900.0, 200.0, 100.0), (350.0, -900.0, 300.0), (1100.0, 1000.0, 0.0)),
        ((300.0, -350.0, 100.0), (-350.0, 225.0, 250.0), (800.0, 750.0, 100.0)),
        ((20.0, 30.0, -250.0), (580.0, 40.0, -250.0), (300.0, 440.0, -250.0)),
        110,
    ),
    "dmu50": Place(
        Tracker(0.5, 0.3, 2.0, 1.0),
        THREE,
        ((1400.0, 400.0, -200.0), (-900.0, 1200.0, 300.0), (-300.0, -1400.0, 600.0)),
        ((900.0, 250.0, 150.0), (-500.0, 800.0, 100.0), (-200.0, -900.0, 300.0)),
        ((240.0, 0.0, -30.0), (-120.0, 200.0, -30.0), (-120.0, -200.0, -30.0)),
        150,
    ),
}


def scattered(
    chain: Chain,
    rng: np.random.Generator,
    *,
    passes: int = 3,
    stations: int = 1,
    with_references: bool = False,
    positions: int | None = None,
) -> Session:
    """Corners and random positions, each with one of the targets, in a new order in every pass.

    Each pass is a run; the passes are shared out to the stations one after the other. Nests on the table are read
    before every twelfth row.
    """
    place = PLACES[chain.name]
    count = positions or place.positions
    low, high = np.array([axis.travel for axis in chain.axes]).T
    where = rng.uniform(low, high, (count, len(chain.axes)))
    corners = np.array(list(itertools.product(*[axis.travel for axis in chain.axes])))
    some = rng.permutation(len(corners))[: count // 3]
    where[: len(some)] = corners[some]
    names = list(place.targets)
    which = rng.permutation(np.arange(count) % len(names))
    rows: list[tuple[Array, str, int]] = []
    for number in range(passes):
        for k, i in enumerate(rng.permutation(count).tolist()):
            if with_references and k % 12 == 0:
                at = rows[-1][0] if rows else where[i]
                rows += [(at, f"nest{j + 1}", number) for j in range(len(place.references))]
            rows.append((where[i], names[which[i]], number))
    run = np.array([number for _, _, number in rows])
    session = Session(
        chain,
        np.round([position for position, _, _ in rows], 3),
        np.array([name for _, name, _ in rows]),
        {name: np.array(vector) for name, vector in place.targets.items()},
        {f"nest{j + 1}": np.array(at) for j, at in enumerate(place.references)} if with_references else {},
        run=np.array([f"r{number + 1}" for number in run.tolist()]),
        station=np.array([f"s{number * stations // passes + 1}" for number in run.tolist()]) if stations > 1 else None,
    )
    return _on_the_clock(session, rng)


def swept(chain: Chain, rng: np.random.Generator, shape: tuple[int, int, int]) -> Session:
    """One sweep over a grid of three linear axes, to and fro in equal steps, the last axis fastest; one target a row."""
    place = PLACES[chain.name]
    ladders = [np.linspace(*axis.travel, n) for axis, n in zip(chain.axes, shape, strict=True)]
    path: list[list[float]] = [[]]
    for ladder in ladders:
        path = [[*head, at] for i, head in enumerate(path) for at in (ladder if i % 2 == 0 else ladder[::-1]).tolist()]
    names = list(place.targets)
    session = Session(
        chain,
        np.array(path),
        np.array([names[i] for i in rng.integers(0, len(names), len(path)).tolist()]),
        {name: np.array(vector) for name, vector in place.targets.items()},
    )
    return _on_the_clock(session, rng)


def in_motion(chain: Chain, rng: np.random.Generator, *, lines: int = 3, points: int = 6) -> Session:
    """Straight lines along each linear axis and across all, read in passing, to and fro, at two feeds; then standing.

    The first row of a line is read standing (feed 0). Rotary axes turn between lines only.
    """
    low, high = np.array([axis.travel for axis in chain.axes]).T
    linear = [chain.index(name) for name in chain.linear]
    standing = scattered(chain, rng, passes=2, positions=PLACES[chain.name].positions // 2)
    names, parts, feeds, targets, runs = list(standing.targets), [], [], [], []
    ways = [[i] for i in linear for _ in range(lines)] + [linear] * lines
    for way in ways:
        start = rng.uniform(low, high)
        end = start.copy()
        flip = rng.random(len(way)) < 0.5
        start[way], end[way] = np.where(flip, high[way], low[way]), np.where(flip, low[way], high[way])
        line = start + np.linspace(0.0, 1.0, points)[:, None] * (end - start)
        target = names[int(rng.integers(len(names)))]
        for number, (feed, back) in enumerate(itertools.product(FEEDS, (False, True))):
            parts.append(line[::-1] if back else line)
            feeds += [0.0] + [feed] * (points - 1)
            targets += [target] * points
            runs += [f"m{number + 1}"] * points
    session = replace(
        standing,
        positions=np.round(np.concatenate([*parts, standing.positions]), 3),
        target=np.array([*targets, *standing.target.tolist()]),
        feed=np.array([*feeds, *[0.0] * len(standing)]),
        run=np.array([*runs, *np.asarray(standing.run).tolist()]),
    )
    return _on_the_clock(session, rng)


def hexahedron(chain: Chain, rng: np.random.Generator, *, edge: int, inside: int) -> Session:
    """The twelve edges of a three-axis volume, so many positions each, and random ones; one target, in the spindle nose."""
    low, high = np.array([axis.travel for axis in chain.axes]).T
    ladder = np.linspace(0.0, 1.0, edge)
    edges = []
    for along, (first, second) in itertools.product(range(3), itertools.product((0.0, 1.0), repeat=2)):
        line = np.empty((edge, 3))
        line[:, along], line[:, (along + 1) % 3], line[:, (along + 2) % 3] = ladder, first, second
        edges.append(line)
    shares = np.concatenate([np.unique(np.concatenate(edges), axis=0), rng.uniform(size=(inside, 3))])
    positions = np.round(low + rng.permutation(shares) * (high - low), 3)
    session = Session(chain, positions, np.full(len(positions), "t1"), {"t1": np.zeros(3)})
    return _on_the_clock(session, rng)


def along_one(chain: Chain, rng: np.random.Generator, axis: str, *, points: int = 60, runs: int = 3) -> Session:
    """An interferometer's runs: one linear axis forward and backward, the others in the middle, rotary ones at 0.

    The axis runs over at both ends, so that every row is reached in the direction of its half of the run.
    """
    low, high = chain.axis(axis).travel
    middle = np.array([0.0 if a.rotary else np.mean(a.travel) for a in chain.axes])
    ladder = np.sort(rng.uniform(low, high, points))
    ladder[[0, -1]] = low, high
    there_and_back = np.tile(middle, (2 * points * runs, 1))
    there_and_back[:, chain.index(axis)] = np.tile(np.concatenate([ladder, ladder[::-1]]), runs)
    name, vector = next(iter(PLACES[chain.name].targets.items()))
    session = Session(
        chain,
        np.round(there_and_back, 3),
        np.full(len(there_and_back), name),
        {name: np.array(vector)},
        run=np.repeat(np.arange(1, runs + 1), 2 * points),
        came={axis: np.tile(np.repeat([1.0, -1.0], points), runs)},
    )
    return _on_the_clock(session, rng)


def stands(chain: Chain, rng: np.random.Generator, *, near: bool = False) -> dict[str, Stand]:
    """A tracker's stands s1, s2, ... round the machine, nearly upright, facing anywhere."""
    found, place = {}, PLACES[chain.name]
    for i, origin in enumerate(place.near if near else place.origins):
        turn = np.array([*rng.normal(scale=2e-3, size=2), rng.uniform(-np.pi, np.pi)])
        found[f"s{i + 1}"] = Stand(np.array(origin) + rng.normal(scale=20.0, size=3), turn)
    return found


def _on_the_clock(session: Session, rng: np.random.Generator) -> Session:
    """The session with its time, and the temperature of a hall that is not that of the clock."""
    speed = np.array([TURNING if axis.rotary else SPEED for axis in session.chain.axes])
    way = np.abs(np.diff(session.positions, axis=0, prepend=session.positions[:1]))
    travelled = np.max(way / speed, axis=1)
    if session.feed is None:
        stopped = np.ones(len(session), bool)
    else:
        stopped = session.feed == 0
        passing = np.linalg.norm(way, axis=1) / np.where(stopped, 1.0, session.feed / 60.0)
        travelled = np.where(stopped, travelled, passing)
    time = np.round(np.cumsum(travelled + stopped * (DWELL_S + rng.uniform(0.0, 1.0, len(session)))), 1)
    time -= time[0]
    phase = 2 * np.pi * time / time[-1]
    (slow, fast), (first, second) = rng.uniform(1.1, 1.6, 2), rng.uniform(0.0, 2 * np.pi, 2)
    warmth = 20.0 + 1.5 * np.sin(slow * phase + first) + 0.7 * np.sin(2 * fast * phase + second)
    return replace(session, time=time, temperatures={"scale": np.round(warmth, 3)})
