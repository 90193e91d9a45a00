"""Machines and designs that ncomp's planning does not make: other chains, sizes and orders, parts of a turn, one axis
at a time, inches, trackers on the bed or within the volume.

A machine is drawn as the text of a machine file, a design as positions with targets. The readings of a tracker on the
machine with its errors are written as a measurement file. The true errors at other positions test the fitted model.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from virtual_machine.chain import Array, Chain, applied, bed_poses, nominal_points, read, rotations, tool_points
from virtual_machine.observe import Stand, Tracker
from virtual_machine.truth import Curves, smooth

TARGETS = {"t1": (0.0, 0.0, -120.0), "t2": (110.0, 60.0, -200.0), "t3": (-90.0, 100.0, -150.0)}
TABLE = {"p": (150.0, 20.0, 20.0), "q": (-80.0, 120.0, 60.0), "k": (-60.0, -110.0, 110.0)}
SHEET = Tracker(0.5, 0.3, 2.0, 1.0)
INCH = 25.4
Ranges = dict[str, tuple[float, float]]


def machine_file(rng: np.random.Generator, rotary: int = 2) -> str:
    """The text of a machine file: three linear axes in any order on either side, so many rotary ones, odd sizes."""
    letters = rng.permutation(["X", "Y", "Z"]).tolist()
    turning = rng.permutation(["A", "B", "C"]).tolist()[:rotary]
    on_table = [letters.pop() for _ in range(int(rng.integers(0, 3)))]
    table_rotary = [turning.pop() for _ in range(int(rng.integers(0, rotary + 1)))] if rotary else []
    before = [*table_rotary, *on_table] if rng.random() < 0.7 else [*on_table, *table_rotary]
    lines = ['name = "strange"', f'chain = "{" ".join(["w", *before, "b", *letters, *turning, "t"])}"']
    for axis in (*before, *letters, *turning):
        lines.append(f"[axes.{axis}]")
        if axis in "ABC":
            lines.append(f"point = {np.round(rng.uniform(-80, 80, 3), 2).tolist()}")
            endless = rng.random() < 0.4
            lines.append("travel = [-inf, inf]" if endless else f"travel = [{-rng.integers(60, 120)}, 200]")
        else:
            low, size = float(rng.integers(-900, 100)), float(rng.choice([203.2, 355.6, 812.8, 2540.0]))
            lines.append(f"travel = [{low}, {low + size}]\nhome = {low + 50}")
    return "\n".join(lines) + "\n"


@dataclass(frozen=True)
class Design:
    """A measurement: positions `(n, axes)`, mm and degrees, a target each, and the position of the tracker."""

    chain: Chain
    positions: Array
    target: np.ndarray
    stand: Stand
    on_bed: bool = False
    targets: Mapping[str, tuple[float, float, float]] = field(default_factory=lambda: TARGETS)
    table: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)
    bed: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)
    run: np.ndarray | None = None

    @property
    def ranges(self) -> Ranges:
        """Least and largest position of each axis."""
        return {
            name: (float(q.min()), float(q.max())) for name, q in zip(self.chain.names, self.positions.T, strict=True)
        }


def ranges_of(chain: Chain, rng: np.random.Generator, arc: float = 360.0) -> Ranges:
    """The whole travel of linear axes, an arc somewhere in the travel of rotary ones."""
    found: Ranges = {}
    for axis in chain.axes:
        low, high = axis.travel
        if axis.rotary:
            low = float(rng.integers(-200, 100)) if np.isinf(low) else low
            found[axis.name] = (low, min(low + arc, high))
        else:
            found[axis.name] = (low, high)
    return found


def scattered(chain: Chain, rng: np.random.Generator, ranges: Ranges, count: int) -> Array:
    """Positions anywhere within the ranges."""
    low, high = np.array([ranges[name] for name in chain.names]).T
    return np.round(rng.uniform(low, high, (count, len(chain.axes))), 4)


def one_at_a_time(chain: Chain, rng: np.random.Generator, ranges: Ranges, count: int) -> Array:
    """Each axis through its range while the others are at a random position."""
    standing = scattered(chain, rng, ranges, 1)[0]
    parts = []
    for i, name in enumerate(chain.names):
        part = np.tile(standing, (count, 1))
        part[:, i] = np.linspace(*ranges[name], count)
        parts.append(part)
    return np.round(np.concatenate(parts), 4)


def inch_grid(chain: Chain, rng: np.random.Generator, ranges: Ranges, steps: int) -> Array:
    """Linear axes on whole inches, to and fro; rotary axes somewhere."""
    ladders = []
    for axis in chain.axes:
        low, high = ranges[axis.name]
        whole = np.linspace(np.ceil(low / INCH), np.floor(high / INCH), steps).round() * INCH
        ladders.append(rng.uniform(low, high, 1) if axis.rotary else whole)
    grid = np.stack(np.meshgrid(*ladders, indexing="ij"), axis=-1).reshape(-1, len(chain.axes))
    turning = [i for i, axis in enumerate(chain.axes) if axis.rotary]
    for i in turning:
        grid[:, i] = rng.uniform(*ranges[chain.names[i]], len(grid))
    return np.round(grid, 4)


def every_target(positions: Array, names: list[str]) -> tuple[Array, np.ndarray]:
    """All positions with one target, then all with the next."""
    return np.tile(positions, (len(names), 1)), np.repeat(names, len(positions))


def stand_beside(chain: Chain, rng: np.random.Generator, positions: Array, away: float = 900.0) -> Stand:
    """A tracker so far from the nominal points, mm; within them for 0."""
    points = nominal_points(chain, chain.to_radians(positions), np.tile(TARGETS["t1"], (len(positions), 1)))
    middle, size = points.mean(axis=0), float(np.linalg.norm(np.ptp(points, axis=0))) / 2.0
    way = rng.normal(size=3) * (1.0, 1.0, 0.3)
    origin = middle + way / np.linalg.norm(way) * ((size + away) if away else 60.0)
    return Stand(origin, np.array([*rng.normal(scale=2e-3, size=2), rng.uniform(-np.pi, np.pi)]))


def truth_of(design: Design, rng: np.random.Generator) -> Curves:
    """Smooth error motions over the measured range."""
    return smooth(_measured_chain(design), rng)


def errors_of(design: Design, truth: Curves, positions: Array) -> Array:
    """`(n, axes, 6)`, mm and rad, at positions, mm and degrees."""
    return truth.errors(_measured_chain(design), positions)


def _measured_chain(design: Design) -> Chain:
    travel = {name: (low, high if high > low else low + 1.0) for name, (low, high) in design.ranges.items()}
    return Chain(design.chain.name, tuple(replace(axis, travel=travel[axis.name]) for axis in design.chain.axes))


def deviations(
    design: Design, truth: Curves, positions: Array, target: tuple[float, float, float]
) -> tuple[Array, Array]:
    """Nominal positions of a target on the tool, and their errors, `(n, 3)` each, mm, workpiece frame."""
    chain, q = design.chain, design.chain.to_radians(positions)
    arms = np.tile(target, (len(q), 1))
    nominal = nominal_points(chain, q, arms)
    real = tool_points(chain, q, errors_of(design, truth, positions), np.zeros((len(q), 6)), arms)
    return nominal, real - nominal


def readings(design: Design, truth: Curves, rng: np.random.Generator) -> Array:
    """Readings of the tracker `(n, 3)`, mm, with its noise."""
    chain, q = design.chain, design.chain.to_radians(design.positions)
    errors = errors_of(design, truth, design.positions)
    places = {**design.targets, **design.table, **design.bed}
    arms = np.array([places[name] for name in design.target.tolist()])
    points = tool_points(chain, q, errors, np.zeros((len(q), 6)), arms)
    fixed, beside = np.isin(design.target, list(design.table)), np.isin(design.target, list(design.bed))
    points[fixed] = arms[fixed]
    if design.on_bed:
        points = applied(np.linalg.inv(bed_poses(chain, q, errors)), points)
        points[beside] = arms[beside]
    points = (points - design.stand.origin) @ rotations(design.stand.turn[None])[0]
    length = np.linalg.norm(points, axis=1)
    beam, drawn = points / length[:, None], rng.normal(size=points.shape)
    along = np.sum(drawn * beam, axis=1, keepdims=True) * beam
    return np.asarray(points + along * SHEET.along(length)[:, None] + (drawn - along) * SHEET.across(length)[:, None])


def sheet(design: Design, points: Array) -> str:
    """The measurement file."""
    head = ["machine: strange", "instrument: laser-tracker", f"stands_on: {'bed' if design.on_bed else 'workpiece'}"]
    head += [f"u_range_um: {SHEET.u_range_um}", f"u_range_um_per_m: {SHEET.u_range_um_per_m}"]
    head += [f"u_angle_um: {SHEET.u_angle_um}", f"u_angle_um_per_m: {SHEET.u_angle_um_per_m}"]
    for key, places in (("target", design.targets), ("table", design.table), ("bed", design.bed)):
        head += [f"{key}.{name}: {' '.join(map(str, place))}" for name, place in places.items()]
    lines = [f"# {line}" for line in head] + [",".join([*design.chain.names, "target", "x", "y", "z"])]
    for q, name, point in zip(design.positions.tolist(), design.target.tolist(), points.tolist(), strict=True):
        lines.append(",".join([*(f"{v:.4f}" for v in q), name, *(f"{v:.6f}" for v in point)]))
    return "\n".join(lines) + "\n"


def points_file(design: Design, positions: Array) -> str:
    """States to predict at, with the first target."""
    lines = ["# machine: strange", f"# target.t1: {' '.join(map(str, TARGETS['t1']))}", ",".join(design.chain.names)]
    return "\n".join([*lines, *(",".join(f"{v:.4f}" for v in q) for q in positions.tolist())]) + "\n"


def left_over(points: Array, moved: Array) -> Array:
    """Displacements `(n, 3)` at points after the best-fit shift and rotation."""
    centred = points - points.mean(axis=0)
    turns = np.cross(np.eye(3)[None], centred[:, None] / np.abs(centred).max())
    columns = np.concatenate([np.broadcast_to(np.eye(3), turns.shape), turns], axis=1)
    design = columns.transpose(0, 2, 1).reshape(-1, 6)
    solved = np.linalg.lstsq(design, moved.reshape(-1), rcond=None)[0]
    return np.asarray((moved.reshape(-1) - design @ solved).reshape(-1, 3))


def design_of(kind: str, toml: str, rng: np.random.Generator) -> Design:
    """A design of DESIGNS for a machine."""
    return DESIGNS[kind](read(toml), rng)


def _part_of_turn(chain: Chain, rng: np.random.Generator) -> Design:
    positions = scattered(chain, rng, ranges_of(chain, rng, 150.0), 130)
    return _with_targets(chain, rng, positions)


def _whole_turn(chain: Chain, rng: np.random.Generator) -> Design:
    return _with_targets(chain, rng, scattered(chain, rng, ranges_of(chain, rng), 130))


def _single(chain: Chain, rng: np.random.Generator) -> Design:
    positions, target = every_target(one_at_a_time(chain, rng, ranges_of(chain, rng), 13), list(TARGETS))
    return Design(chain, positions, target, stand_beside(chain, rng, positions))


def _inches(chain: Chain, rng: np.random.Generator) -> Design:
    return _with_targets(chain, rng, inch_grid(chain, rng, ranges_of(chain, rng), 5))


def _within(chain: Chain, rng: np.random.Generator) -> Design:
    positions = scattered(chain, rng, ranges_of(chain, rng), 130)
    return _with_targets(chain, rng, positions, away=0.0)


def _on_bed(chain: Chain, rng: np.random.Generator) -> Design:
    design = _with_targets(chain, rng, scattered(chain, rng, ranges_of(chain, rng), 200))
    names = np.array([*TARGETS, *TABLE])
    return replace(design, on_bed=True, table=TABLE, target=names[rng.integers(0, len(names), len(design.target))])


def _few(chain: Chain, rng: np.random.Generator) -> Design:
    return _with_targets(chain, rng, scattered(chain, rng, ranges_of(chain, rng), 14))


def _on_a_line(chain: Chain, rng: np.random.Generator) -> Design:
    ranges = ranges_of(chain, rng)
    positions = np.tile(scattered(chain, rng, ranges, 1)[0], (30, 1))
    first = next(i for i, axis in enumerate(chain.axes) if not axis.rotary)
    positions[:, first] = np.linspace(*ranges[chain.names[first]], 30)
    return replace(_with_targets(chain, rng, np.round(positions, 4)), target=np.full(30, "t1"))


def _bed_only(chain: Chain, rng: np.random.Generator) -> Design:
    design = _with_targets(chain, rng, scattered(chain, rng, ranges_of(chain, rng), 40))
    bed = {"d1": (500.0, -450.0, -100.0), "d2": (-500.0, 450.0, -100.0), "d3": (500.0, 450.0, 0.0)}
    return replace(design, on_bed=True, bed=bed, target=np.array(list(bed))[np.arange(40) % 3])


def _table_only(chain: Chain, rng: np.random.Generator) -> Design:
    design = _with_targets(chain, rng, scattered(chain, rng, ranges_of(chain, rng), 90))
    return replace(design, on_bed=True, table=TABLE, target=np.array(list(TABLE))[np.arange(90) % 3])


def _three_points(chain: Chain, rng: np.random.Generator) -> Design:
    """Every axis alone, its three targets one after the other, the tracker on the bed; three rounds."""
    ranges = ranges_of(chain, rng, 300.0)
    standing = scattered(chain, rng, ranges, 1)[0]
    parts, names = [], []
    for i, axis in enumerate(chain.axes):
        for name in TABLE if axis.on_workpiece_side else TARGETS:
            part = np.tile(standing, (13, 1))
            part[:, i] = np.linspace(*ranges[axis.name], 13)
            parts.append(part)
            names += [name] * 13
    positions, target = np.tile(np.round(np.concatenate(parts), 4), (3, 1)), np.tile(names, 3)
    return Design(chain, positions, target, stand_beside(chain, rng, positions), on_bed=True, table=TABLE)


def _with_targets(chain: Chain, rng: np.random.Generator, positions: Array, away: float = 900.0) -> Design:
    names = np.array(list(TARGETS))
    target = names[rng.integers(0, len(names), len(positions))]
    return Design(chain, positions, target, stand_beside(chain, rng, positions, away))


DESIGNS: Mapping[str, Callable[[Chain, np.random.Generator], Design]] = {
    "whole-turn": _whole_turn, "part-of-turn": _part_of_turn, "one-at-a-time": _single, "inches": _inches,
    "within": _within, "bed": _on_bed, "few": _few, "line": _on_a_line, "bed-only": _bed_only, "table-only": _table_only,
    "three-points": _three_points,
}  # fmt: skip
