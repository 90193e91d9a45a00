"""A question of the exam: a measurement file, and the truth behind it."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from shop_floor import error_motions
from shop_floor.causes import FIXED_SIZES, KNOWN, THREE, TWO, Crash
from shop_floor.chain import MACHINES, Array, no_errors, nominal_points, tool_points, without_rigid_motion
from shop_floor.designs import DESIGNS, Run
from shop_floor.error_motions import UM, ErrorMotions
from shop_floor.hidden import Hidden
from shop_floor.outside_causes import OUTSIDE
from shop_floor.tracker import Noise, Pose, draw_pose, noisy, whitened

CAUSES = ("none", *KNOWN, "strange", *OUTSIDE, "two", "three")
"""`strange`: one of the effects outside every library, in turn; `two` and `three`: so many at once."""
TIMES_NOISE = (0.7, 6.0)
VISIBLE, VISIBLE_SHARE = 100.0, 0.15
"""Least non-centrality, and share of the whitened signal, that smooth error motions and poses leave of an effect."""
TRIES = 30
DEGREE, WAVES = 8, 4
"""Of the smooth error motions of linear axes, and of rotary ones."""
UNSEEN = 400
RIPPLE_PERIODS = (20.0, 30.0)
RIPPLE_SHARE = 0.4
"""Amplitude of fine waves, relative to the noise of a reading."""


class Size(NamedTuple):
    """How large a hidden effect is in the data."""

    times_noise: float
    """RMS of its signal, a rigid motion apart, relative to that of the noise."""
    left: float
    """Non-centrality that smooth error motions and the pose leave of it."""
    share: float
    """Root of its share in that of the whole signal, a rigid motion apart."""


@dataclass(frozen=True)
class Question:
    """Data of one machine with the hidden effects of one cause."""

    design: str
    cause: str
    draw: int
    run: Run
    motions: ErrorMotions
    poses: dict[str, Pose]
    noise: Noise
    normal: Array
    """Standard normal numbers `(n, 3)` of the noise."""
    stops: Array
    """Errors of the stops `(n, axes)`, mm: rows of a stop share them."""
    hidden: tuple[Hidden, ...] = ()
    sizes: tuple[Size, ...] = ()
    unseen_seed: int = 0

    @cached_property
    def logged(self) -> Run:
        """The run as it is logged, temperatures with the hidden effects."""
        run = self.run
        for effect in self.hidden:
            run = effect.on_run(run)
        return run

    def true_points(self, run: Run, *, stops: Array | None = None) -> Array:
        """Points `(n, 3)` of the targets in the workpiece frame, mm, with all errors of the machine."""
        errors = self.motions.errors(run.positions)
        tool = np.zeros((len(run), 3))
        for effect in self.hidden:
            errors = errors + effect.errors(run)
            tool = tool + effect.tool(run)
        if stops is not None:
            for i, axis in enumerate(run.machine.axes):
                errors[:, i, axis.own] += stops[:, i]
        return tool_points(run.machine, run.positions, errors, tool, run.tools)

    @cached_property
    def seen(self) -> Array:
        """Readings `(n, 3)` without noise, mm, in the frames of the set-ups."""
        run = self.logged
        points = self.true_points(run, stops=self.stops)
        station = np.full(len(run), "s1") if run.station is None else run.station
        found = np.zeros_like(points)
        for name, pose in self.poses.items():
            found[station == name] = pose.seen(points[station == name])
        for effect in self.hidden:
            found = effect.reading(run, found)
        return found

    @cached_property
    def readings(self) -> Array:
        """Readings `(n, 3)`, mm."""
        return noisy(self.seen, self.noise, self.normal)

    def sheet(self) -> str:
        """The measurement file (contract 4.2)."""
        run, names = self.logged, self.run.machine.names
        head = _head(run, self.noise)
        station = ["station"] if run.station is not None else []
        lines = [*head, ",".join(["time_s", *names, "target", "x", "y", "z", "temp_scale", *station])]
        for row in range(len(run)):
            cells = [f"{run.clock[row]:.1f}", *(f"{q:.4f}" for q in run.positions[row]), str(run.target[row])]
            cells += [*(f"{value:.5f}" for value in self.readings[row]), f"{run.temperature[row]:.2f}"]
            lines.append(",".join([*cells, *([str(run.station[row])] if run.station is not None else [])]))
        return "\n".join(lines) + "\n"

    @cached_property
    def unseen(self) -> Run:
        """Random poses in the volume, at the mean time and temperature of the run, from either side.

        Later than the mean where the machine has changed later: a calibration describes the machine as it is now.
        """
        run, rng = self.logged, np.random.default_rng(self.unseen_seed)
        changed = [effect.since_s for effect in self.hidden if isinstance(effect, Crash)]
        low = np.array([axis.low for axis in run.machine.axes])
        high = np.array([min(axis.high, 110.0) if axis.name == "B" else axis.high for axis in run.machine.axes])
        return replace(
            run,
            positions=np.round(rng.uniform(low, high, (UNSEEN, len(low))), 4),
            target=rng.choice(np.array(list(run.targets)), UNSEEN),
            clock=np.full(UNSEEN, np.ceil(10.0 * max([float(run.clock.mean()), *changed])) / 10.0),
            temperature=np.full(UNSEEN, round(float(run.temperature.mean()), 2)),
            station=None,
            approach=rng.choice([-1.0, 1.0], (UNSEEN, len(low))),
        )

    def unseen_sheet(self) -> str:
        """The file of the unseen poses for `ncomp predict`."""
        run, names = self.unseen, self.run.machine.names
        head = [line for line in _head(run, self.noise) if not line.startswith(("# u_", "# instrument"))]
        lines = [*head, ",".join(["time_s", *names, "target", "temp_scale", *(f"dir_{name}" for name in names)])]
        for row in range(len(run)):
            cells = [f"{run.clock[row]:.1f}", *(f"{q:.4f}" for q in run.positions[row]), str(run.target[row])]
            cells += [f"{run.temperature[row]:.2f}", *(f"{side:.0f}" for side in run.directions[row])]
            lines.append(",".join(cells))
        return "\n".join(lines) + "\n"

    def unseen_errors(self, predicted: Array) -> Array:
        """Errors `(n, 3)`, um, of predicted deviations `(n, 3)`, um, at the unseen poses, a rigid motion apart."""
        run = self.unseen
        nominal = nominal_points(run.machine, run.positions, run.tools)
        true = self.true_points(run) - nominal
        return without_rigid_motion(nominal, predicted * UM - true) / UM

    def without_rigid_motion(self, predicted: Array) -> Array:
        """Predicted deviations `(n, 3)` at the unseen poses less the best rigid motion, in their unit."""
        run = self.unseen
        return without_rigid_motion(nominal_points(run.machine, run.positions, run.tools), predicted)

    def nameable(self) -> Question:
        """The same data with those hidden effects only that a library of causes can hold."""
        return self.having(*(effect for effect in self.hidden if effect.answer(self.run).kinds))

    def having(self, *hidden: Hidden) -> Question:
        """The same data with other hidden effects."""
        return replace(self, hidden=hidden)


def ask(design: str, cause: str, machine: str, draw: int, seed: int = 0) -> Question:
    """The question of a design, a cause, a machine and a draw."""
    question = _nothing_hidden(design, machine, draw, seed)
    rng = _random(seed, design, machine, draw, cause)
    for name in kinds_of(cause, draw):
        question = _with_effect(question, name, rng)
    return replace(question, cause=cause)


def earlier(machine: str, draw: int, seed: int = 0) -> Question:
    """The measurement from which the machine of the design `again` was calibrated: its own order, poses and noise."""
    now = _nothing_hidden("again", machine, draw, seed)
    before = _nothing_hidden("random3", machine, draw, seed + 1)
    return replace(before, motions=now.motions)


def kinds_of(cause: str, draw: int) -> Sequence[str]:
    """Hidden effects of a cause in a draw."""
    if cause == "strange":
        return (list(OUTSIDE)[draw % len(OUTSIDE)],)
    chosen = {"none": (), "two": TWO[draw % len(TWO)], "three": THREE[draw % len(THREE)]}
    return chosen.get(cause, (cause,))


def _random(seed: int, *names: str | int) -> np.random.Generator:
    return np.random.default_rng([seed, zlib.crc32("/".join(map(str, names)).encode())])


def _nothing_hidden(design: str, machine: str, draw: int, seed: int) -> Question:
    """Machine, run, set-ups and noise of a draw."""
    found = MACHINES[machine]
    rng = _random(seed, design, machine, draw)
    motions = error_motions.draw(found, rng)
    run = DESIGNS[design](found, rng, draw)
    nominal = nominal_points(found, run.positions, run.tools)
    poses = {name: draw_pose(nominal, rng) for name in (["s1"] if run.station is None else ["s1", "s2"])}
    noise = Noise(found.angle_noise_um)
    if run.ripple:
        waves = {
            name: (
                RIPPLE_SHARE * noise.angle_um * rng.uniform(0.7, 1.3),
                rng.uniform(*RIPPLE_PERIODS),
                rng.uniform(0, 6),
            )
            for name in found.linear
        }
        motions = replace(motions, ripple=waves)
    repeats = rng.normal(size=(int(run.stop[-1]) + 1, len(found.axes))) * run.repeatability_um * UM
    stops = np.where([axis.rotary for axis in found.axes], 0.0, repeats)[run.stop]
    normal = rng.normal(size=(len(run), 3))
    return Question(
        design, "none", draw, run, motions, poses, noise, normal, stops, unseen_seed=int(rng.integers(2**31))
    )


def _with_effect(question: Question, name: str, rng: np.random.Generator) -> Question:
    """The question with one more hidden effect, of a size that its data can show."""
    kind = KNOWN[name] if name in KNOWN else OUTSIDE[name]
    absorbed = _absorbed(question)
    for _ in range(TRIES):
        effect = kind(question.run, rng)
        if name in FIXED_SIZES:
            size = signal_of(question, effect, absorbed)
            break
        unit = signal_of(question, effect.sized(10.0), absorbed)
        least = max(TIMES_NOISE[0], unit.times_noise * np.sqrt(VISIBLE / max(unit.left, 1e-12)))
        most = min(TIMES_NOISE[1], unit.times_noise * effect.LARGEST / 10.0)
        if least <= most and unit.share >= VISIBLE_SHARE:
            times = float(np.exp(rng.uniform(np.log(least), np.log(most))))
            ratio = times / unit.times_noise
            effect, size = effect.sized(10.0 * ratio), Size(times, unit.left * ratio**2, unit.share)
            break
    else:
        raise RuntimeError(f"{question.design}: no {name} of {TRIES} could be seen")
    return replace(question, hidden=(*question.hidden, effect), sizes=(*question.sizes, size))


def signal_of(question: Question, effect: Hidden, absorbed: Array | None = None) -> Size:
    """How large an effect is in the data of a question.

    absorbed: orthonormal columns of all that error motions and poses can imitate; worked out when it is missing.
    """
    plain, with_it = question.having(), question.having(effect)
    moved = with_it.seen - plain.seen
    station = question.run.station
    group = None if station is None else np.unique(station, return_inverse=True)[1]
    rigid = without_rigid_motion(plain.seen, moved, group)
    length = np.linalg.norm(plain.seen, axis=1)
    noise = np.sqrt(np.mean(2 * question.noise.across(length) ** 2 + question.noise.along(length) ** 2))
    white = _white(question, plain.seen, moved)
    columns = _absorbed(question) if absorbed is None else absorbed
    left = white - columns @ (columns.T @ white)
    whole = float(np.linalg.norm(_white(question, plain.seen, rigid)))
    share = float(np.linalg.norm(left)) / max(whole, 1e-12)
    return Size(float(np.sqrt(np.mean(np.sum(rigid**2, axis=1))) / noise), float(left @ left), share)


def _white(question: Question, points: Array, moved: Array) -> Array:
    """Displacements `(n, 3)` in standard uncertainties of a row, `(3 n,)`; those of stops are part of them."""
    length = np.linalg.norm(points, axis=1)
    along, across = question.noise.along(length), question.noise.across(length)
    rows = np.bincount(question.run.stop)[question.run.stop]
    repeats = rows * (question.run.repeatability_um * UM) ** 2
    unit = whitened(points, moved, question.noise)
    shrink = np.stack([across / np.sqrt(across**2 + repeats)] * 2 + [along / np.sqrt(along**2 + repeats)], axis=1)
    return np.asarray((unit * shrink).reshape(-1))


def _absorbed(question: Question) -> Array:
    """Orthonormal columns `(3 n, k)`: the signals of smooth error motions of every axis and of every set-up's pose."""
    run, plain = question.run, question.having()
    machine, step = run.machine, 1e-6
    nominal = nominal_points(machine, run.positions, run.tools)
    station = np.full(len(run), "s1") if run.station is None else run.station
    turn = np.stack([question.poses[str(name)].orientation for name in station])
    columns = []
    for i, axis in enumerate(machine.axes):
        functions = _smooth(axis.rotary, run.positions[:, i], axis.low, axis.high)
        for k in range(6):
            errors = no_errors(run.positions)
            errors[:, i, k] = step
            moved = tool_points(machine, run.positions, errors, np.zeros_like(run.tools), run.tools) - nominal
            white = _white(question, plain.seen, np.einsum("ni,nij->nj", moved / step, turn)).reshape(-1, 3)
            columns += [(white * function[:, None]).reshape(-1) for function in functions.T]
    for name in question.poses:
        rows = (station == name)[:, None]
        for direction in np.eye(3):
            for moved in (np.tile(direction, (len(run), 1)), np.cross(direction, plain.seen)):
                columns.append(_white(question, plain.seen, moved * rows))
    matrix = np.stack(columns, axis=1)
    matrix /= np.maximum(np.linalg.norm(matrix, axis=0), 1e-12)
    left, values, _ = np.linalg.svd(matrix, full_matrices=False)
    return np.asarray(left[:, values > 1e-7 * values[0]])


def _smooth(rotary: bool, position: Array, low: float, high: float) -> Array:
    """Smooth functions `(n, k)` of a position."""
    if rotary:
        q = np.radians(position)
        waves = [wave(n * q) for n in range(1, WAVES + 1) for wave in (np.cos, np.sin)]
        return np.stack([np.ones_like(q), *waves], axis=1)
    return np.asarray(np.polynomial.legendre.legvander(2.0 * (position - low) / (high - low) - 1.0, DEGREE))


def _head(run: Run, noise: Noise) -> list[str]:
    """Header lines of a file."""
    times = run.header_noise
    return [
        f"# machine: {run.machine.name}",
        "# instrument: laser-tracker",
        f"# u_range_um_per_m: {noise.range_um_per_m * times:g}",
        f"# u_angle_um: {noise.angle_um * times:g}",
        f"# u_angle_um_per_m: {noise.angle_um_per_m * times:g}",
        *(f"# target.{name}: {x:g} {y:g} {z:g}" for name, (x, y, z) in run.targets.items()),
    ]
