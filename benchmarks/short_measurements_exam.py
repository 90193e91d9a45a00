"""Third exam of `ncomp diagnose`: short measurements, 62 to 150 rows of a laser tracker, with one hidden effect.

    python benchmarks/short_measurements_exam.py --seed 11             # each design with each effect: 98 questions
    python benchmarks/short_measurements_exam.py --seed 11 --most 20   # the first 20 of them
    python benchmarks/short_measurements_exam.py --table               # the table of the recorded answers alone

A C-frame and a gantry, seven designs, fourteen effects. Geometry, kinematics, instrument and files are written here:
the truth shares nothing with ncomp, nor with the two other exams. Every axis has slopes and humps in all six error
motions. The header of the file gives half, once or twice the true noise. Each answer is appended to the file of records
(--records); a question that has its answer there is not asked again.

An effect is named if a cause has its kind and its axis, tied if an alternative has, and unexplained if only variables
are listed. Every other cause is false. Errors at 300 unseen poses are those that the best rigid motion leaves, by the
calibration that --force writes. "worse": ncomp accepts a calibration that leaves more than no correction does.
"refused": it does not accept one that leaves less. "covered" is the share of errors within the intervals of 95 %, of
accepted calibrations.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from shop_floor.sampling import PREDICT, write_samples

ROOT = Path(__file__).parents[1]
Array = NDArray[np.float64]
AXES = "XYZ"
UM = 1e-3
TARGETS = {"a": (0.0, 0.0, -110.0), "b": (80.0, -35.0, -165.0), "c": (-60.0, 50.0, -95.0)}
UNSEEN, DRAWS = 300, 60
LARGEST = 250.0
"""Largest size of an effect, um."""
LUNCH_S, WARMING_S = 3000.0, 600.0


@dataclass(frozen=True)
class Machine:
    """A chain from the workpiece to the tool, each axis with the side that it carries, and its travels, mm."""

    chain: tuple[tuple[str, str], ...]
    travel: dict[str, tuple[float, float]]
    feed: float
    """mm/s"""
    size: float
    """Size of its errors, relative to a gantry."""

    def positions(self, shares: Array) -> Array:
        """Positions `(n, 3)` by shares of the travels."""
        low, high = np.array(list(self.travel.values())).T
        return low + np.atleast_2d(shares) * (high - low)

    def points(self, q: Array, errors: Array, arm: Array) -> Array:
        """Points `(n, 3)` of a target in the frame of the workpiece; errors: `(n, 3, 6)` of the axes, mm and rad."""
        point = arm
        for axis, carries in reversed(self.chain):
            k = AXES.index(axis)
            step, error = np.outer(q[:, k], np.eye(3)[k]), errors[:, k]
            if carries == "tool":
                point = turned(error[:, 3:], point) + error[:, :3] + step
            else:
                point = turned(error[:, 3:], point + step) + error[:, :3]
        return point


MACHINES = {
    "cframe": Machine(
        (("X", "workpiece"), ("Y", "workpiece"), ("Z", "tool")),
        {"X": (0.0, 600.0), "Y": (0.0, 450.0), "Z": (0.0, 500.0)},
        120.0,
        0.6,
    ),
    "gantry": Machine(
        (("X", "tool"), ("Y", "tool"), ("Z", "tool")),
        {"X": (0.0, 5000.0), "Y": (0.0, 3000.0), "Z": (0.0, 1500.0)},
        300.0,
        1.0,
    ),
}


def turned(angles: Array, points: Array) -> Array:
    """Points turned by small angles, to the third order."""
    first = np.cross(angles, points)
    second = np.cross(angles, first)
    return points + first + second / 2 + np.cross(angles, second) / 6


def unit(rng: np.random.Generator) -> Array:
    """A random direction."""
    vector = rng.normal(size=3)
    return vector / np.linalg.norm(vector)


class Geometry:
    """Errors of the axes: a slope and three humps in each of six directions, 5 to 40 um and urad from end to end."""

    def __init__(self, machine: Machine, rng: np.random.Generator) -> None:
        self.travel = np.array(list(machine.travel.values()))
        self.centres, self.widths = rng.uniform(-0.2, 1.2, (3, 6, 3)), rng.uniform(0.2, 0.6, (3, 6, 3))
        self.heights, slope = rng.normal(size=(3, 6, 3)), rng.normal(size=(3, 6))
        self.slopes = slope * np.where(np.arange(6) < 3, 1.5, 0.7)
        size = rng.uniform(5.0, 40.0, (3, 6)) * machine.size * np.where(np.arange(6) < 3, 1e-3, 1e-6)
        self.scale = np.ones((3, 6))
        course = self.of_shares(np.tile(np.linspace(0.0, 1.0, 101)[:, None], 3))
        self.scale = size / np.maximum(np.ptp(course, axis=0), 1e-9)

    def of_shares(self, u: Array) -> Array:
        """Errors `(n, 3, 6)` at shares `(n, 3)` of the travels, zero in the middle."""
        return self.scale * (self.course(u) - self.course(np.full((1, 3), 0.5)))

    def course(self, u: Array) -> Array:
        """Slope and humps `(n, 3, 6)` without their scale."""
        away = (u[:, :, None, None] - self.centres) / self.widths
        return self.slopes * u[:, :, None] + np.sum(self.heights * np.exp(-0.5 * away**2), axis=3)

    def errors(self, q: Array) -> Array:
        """Errors `(n, 3, 6)` of the axes at positions `(n, 3)`, mm and rad."""
        return self.of_shares((q - self.travel[:, 0]) / np.ptp(self.travel, axis=1))


def line(axis: int, at: Array, low: float, high: float, count: int, *, back: bool = True) -> Array:
    """Shares of the travels along an axis, out and, unless not wanted, back."""
    u = np.linspace(low, high, count)
    u = np.concatenate([u, u[::-1]]) if back else u
    rows = np.tile(at, (len(u), 1))
    rows[:, axis] = u
    return rows


def box(rng: np.random.Generator, least: float, most: float) -> Array:
    """Part of the travels, `(3, 2)`, that a measurement covers."""
    width = rng.uniform(least, most, 3)
    low = rng.uniform(0.0, 1.0 - width)
    return np.stack([low, low + width], axis=1)


def part_lines(rng: np.random.Generator) -> Array:
    """Three lines along each axis, out and back, in a part of the volume."""
    part = box(rng, 0.5, 0.8)
    at = (rng.uniform(*part.T) for _ in range(9))
    return np.concatenate([line(a, next(at), *part[a], 5 if a == 2 else 7) for a in rng.permutation(3) for _ in "123"])


def diagonals(_: np.random.Generator) -> Array:
    """Two body diagonals out and back, then two lines along each axis."""
    u = np.linspace(0.03, 0.97, 13)
    rows = [np.stack([w, w if s else 1 - w, w], axis=1) for s in (True, False) for w in (u, u[::-1])]
    rows += [line(a, np.full(3, at), 0.03, 0.97, 7, back=at < 0.5) for a in range(3) for at in (0.15, 0.8)]
    return np.concatenate(rows)


def pairs(rng: np.random.Generator) -> Array:
    """65 random stops with two targets each; a lunch break."""
    return np.repeat(rng.uniform(0.05, 0.95, (65, 3)), 2, axis=0)


def three_rounds(rng: np.random.Generator) -> Array:
    """A line along each axis, the corners and 16 random positions: three times, while the machine warms up."""
    rows = [line(a, np.full(3, 0.5), 0.05, 0.95, 7, back=False) for a in range(3)]
    corners = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 1, 1), (1, 1, 1), (1, 0, 1), (0, 0, 1)]
    rows += [0.08 + 0.84 * np.array(corners, float), rng.uniform(0.1, 0.9, (16, 3))]
    return np.tile(np.concatenate(rows), (3, 1))


def layers(_: np.random.Generator) -> Array:
    """Three layers, each a grid in turning lines, then three lines up."""
    rows = []
    for z in (0.1, 0.5, 0.85):
        for j, y in enumerate(np.linspace(0.05, 0.95, 5)):
            x = np.linspace(0.05, 0.95, 7)[:: 1 - 2 * (j % 2)]
            rows.append(np.stack([x, np.full(7, y), np.full(7, z)], axis=1))
    rows += [line(2, np.array([x, y, 0.0]), 0.1, 0.85, 6, back=False) for x, y in ((0.1, 0.1), (0.9, 0.2), (0.2, 0.9))]
    return np.concatenate(rows)


def sorted_stops(rng: np.random.Generator) -> Array:
    """150 random positions, sorted by slices of X and then by Z."""
    u = rng.uniform(0.02, 0.98, (150, 3))
    return u[np.lexsort((u[:, 2], np.round(u[:, 0] * 5)))]


def sparse(rng: np.random.Generator) -> Array:
    """62 rows: three edges out and back, then 26 random positions."""
    part = box(rng, 0.6, 0.9)
    rows = [line(a, part[:, 0], *part[a], 6) for a in range(3)]
    return np.concatenate([*rows, part[:, 0] + rng.uniform(size=(26, 3)) * np.ptp(part, axis=1)])


@dataclass(frozen=True)
class Design:
    """Positions as shares of the travels, in order, the number of targets, and pauses, s."""

    shares: Callable[[np.random.Generator], Array]
    targets: int
    pause_s: float = 0.0
    rounds: int = 1


DESIGNS = {
    "part-lines": Design(part_lines, 1),
    "diagonals": Design(diagonals, 2),
    "pairs": Design(pairs, 2, LUNCH_S),
    "three-rounds": Design(three_rounds, 2, WARMING_S, 3),
    "layers": Design(layers, 1),
    "sorted": Design(sorted_stops, 3),
    "sparse": Design(sparse, 1),
}
KINDS: dict[str, tuple[str, ...]] = {
    "none": (),
    "backlash": ("backlash", "reversal", "hysteresis"),
    "growth with temperature": ("thermal-scale",),
    "growth with time": ("thermal-scale", "thermal-scale-duty"),
    "pitch": ("cyclic",),
    "crash": ("location-jump",),
    "drift": ("thermal-drift",),
    "knock": ("station-shift",),
    "station drift": ("tracker-drift",),
    "swapped targets": ("outliers", "target-offset"),
    "random walk": (),
    "worn spot": (),
    "sag": ("cross-axis",),
    "stick-slip": ("backlash", "hysteresis", "reversal"),
}
"""Effects, and the kinds of causes that name them."""
OF_ONE_AXIS = ("backlash", "growth with temperature", "growth with time", "pitch", "crash", "stick-slip")


@dataclass
class States:
    """Rows: positions `(n, 3)`, directions of approach `(n, 3)`, times, temperatures and names of targets `(n,)`."""

    q: Array
    approach: Array
    time: Array
    degc: Array
    target: NDArray[np.str_]


@dataclass
class Case:
    """A measurement of one machine with a hidden effect."""

    machine: str
    design: str
    effect: str
    seed: int
    rng: np.random.Generator = field(init=False)

    def __post_init__(self) -> None:
        self.rng = np.random.default_rng([self.seed, zlib.crc32(self.name.encode())])
        self.of, self.plan = MACHINES[self.machine], DESIGNS[self.design]
        self.rows = self._rows()
        self.geometry = Geometry(self.of, self.rng)
        self._instrument()
        self._hidden()

    @property
    def name(self) -> str:
        """Name of the question."""
        return f"{self.machine}/{self.design}/{self.effect}/{self.seed}"

    def _rows(self) -> States:
        rng, names = self.rng, list(TARGETS)[: self.plan.targets]
        q = np.round(self.of.positions(self.plan.shares(rng)), 3)
        n = len(q)
        moved = np.append(0.0, np.abs(np.diff(q, axis=0)).max(axis=1))
        steps = np.where(moved > 0, moved / self.of.feed + rng.uniform(4, 9, n), rng.uniform(2, 4, n))
        time = np.cumsum(steps) * self.plan.rounds
        break_at = rng.uniform(0.35, 0.65) * n
        rounds = np.arange(n) // (n // self.plan.rounds) if self.plan.rounds > 1 else np.arange(n) >= break_at
        time = np.round(time - time[0] + self.plan.pause_s * rounds, 1)
        approach, last = np.zeros((n, 3)), rng.choice([-1.0, 1.0], 3)
        for i in range(n):
            step = np.sign(q[i] - q[max(i - 1, 0)])
            approach[i] = last = np.where(step == 0.0, last, step)
        warming = rng.uniform(0.3, 1.5) * (1 - np.exp(-time / time[-1] * rng.uniform(0.5, 3)))
        degc = 20 + rng.uniform(-1.5, 1.5) + warming + 0.2 * np.sin(time / rng.uniform(300, 900))
        self.stop = np.cumsum(moved > 0.0)
        return States(q, approach, time, np.round(degc, 2), np.array(names)[np.arange(n) % len(names)])

    def _instrument(self) -> None:
        """Noise of the tracker, um and um/m, its pose, and the repeatability of the axes, um."""
        rng, gantry = self.rng, self.machine == "gantry"
        self.range_um = rng.choice([0.0, 0.5]), rng.choice([0.3, 0.5])
        self.across_um = rng.choice([3.0, 6.0, 12.0] if gantry else [1.5, 3.0, 6.0]), rng.choice([0.0, 2.5])
        self.stated = rng.choice([1, 1, 1, 0.5, 2.0])
        self.repeats_um = rng.choice([0.0, 0.0, 0.5, 1.5])
        length = np.ptp(list(self.of.travel.values()), axis=1)
        angle, away = rng.uniform(0, 2 * np.pi), np.hypot(length[0], length[1]) / 2 + rng.uniform(600, 1500)
        height = rng.uniform(-0.3, 0.6) * length[2]
        middle = self.of.positions(np.full((1, 3), 0.5))[0]
        self.origin = middle + np.array([np.cos(angle) * away, np.sin(angle) * away, height])
        yaw, (a, b) = rng.uniform(-3.1, 3.1), rng.uniform(-0.01, 0.01, 2)
        about_z = np.array([[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]])
        frame, _ = np.linalg.qr(about_z @ np.array([[1, 0, a], [0, 1, b], [-a, -b, 1]]))
        self.frame = frame * np.sign(np.linalg.det(frame))

    def _hidden(self) -> None:
        """Size of the hidden effect, 1.5 to 50 times the noise of a reading, and its other parameters."""
        rng, n, q = self.rng, len(self.rows.q), self.rows.q
        noise = self.across_um[0] + self.across_um[1] * np.linalg.norm(q - self.origin, axis=1).mean() / 1000
        self.size = min(float(np.exp(rng.uniform(np.log(1.5), np.log(50)))) * noise, LARGEST) * UM
        self.times_noise = self.size / UM / noise
        self.axis = 0 if self.effect == "sag" else int(rng.integers(3))
        self.since = self.rows.time[int(rng.uniform(0.35, 0.65) * n)] - 0.05
        self.constant = rng.uniform(0.3, 1.2) * self.rows.time[-1] + 300
        self.period, self.phase = float(rng.choice([5, 8, 10, 12, 16, 20])), rng.uniform(0, 6.28)
        self.shift, self.turn, self.fixed = unit(rng), unit(rng), rng.uniform(-0.2, 1.2)
        self.spot, self.width = rng.uniform(0.3, 0.7), rng.uniform(0.06, 0.12)
        self.noise, self.off = rng.normal(size=(n, 3)), rng.normal(size=(self.stop[-1] + 1, 3))
        walk = np.cumsum(rng.normal(size=n))
        self.walk = (walk - walk.mean()) / walk.std()
        self.slips = rng.uniform(size=self.stop[-1] + 1) * (rng.random(self.stop[-1] + 1) < 0.5)
        self.wrong = np.sort(rng.choice(n, max(2, n // 40), replace=False))

    def risen(self, time: Array) -> Array:
        """Course of an exponential, 1 at the end of the measurement."""
        return np.asarray((1 - np.exp(-time / self.constant)) / (1 - np.exp(-self.rows.time[-1] / self.constant)))

    def add_hidden(self, s: States, errors: Array, tool: Array, *, unseen: bool) -> None:
        """Add the hidden effect of the machine to errors `(n, 3, 6)` of the axes and to the tool `(n, 3)`."""
        k, own = self.axis, errors[:, self.axis, self.axis]
        low, high = list(self.of.travel.values())[k]
        x, measured = s.q[:, k], self.rows.q
        first, span = measured[:, k].min(), np.ptp(measured[:, k])
        growing = (x - (low + self.fixed * (high - low))) / span
        u, v = ((s.q - measured.min(axis=0)) / np.ptp(measured, axis=0))[:, :2].T
        if self.effect == "backlash":
            own -= self.size / 2 * s.approach[:, k]
        elif self.effect == "growth with temperature":
            own += self.size * (s.degc - 20) / np.ptp(self.rows.degc) * growing
        elif self.effect == "growth with time":
            own += self.size * self.risen(s.time) * growing
        elif self.effect == "pitch":
            own += self.size / 2 * np.sin(2 * np.pi * x / self.period + self.phase)
        elif self.effect == "crash":
            errors[:, k, (k + 1) % 3] += self.size * (s.time >= self.since) * (x - measured[:, k].mean()) / span
        elif self.effect == "drift":
            tool += np.outer(self.risen(s.time), self.size * np.array([0.1, -0.05, 1.0]))
        elif self.effect == "random walk" and not unseen:
            tool[:, 2] += self.size / 2 * self.walk
        elif self.effect == "worn spot":
            own += self.size * np.exp(-0.5 * ((x - first - self.spot * span) / (self.width * span)) ** 2)
        elif self.effect == "sag":
            errors[:, 0, 2] -= 4 * self.size * (u - 0.5) ** 2 * v
        elif self.effect == "stick-slip":
            own -= self.size * s.approach[:, k] * (0.25 if unseen else self.slips[self.stop])

    def points(self, s: States, *, unseen: bool) -> Array:
        """True points `(n, 3)` of the targets in the frame of the workpiece, mm."""
        errors, tool = self.geometry.errors(s.q), np.zeros((len(s.q), 3))
        self.add_hidden(s, errors, tool, unseen=unseen)
        if not unseen:
            for k in range(3):
                errors[:, k, k] += self.repeats_um * UM * self.off[self.stop, k]
        return self.of.points(s.q, errors, arms(s) + tool)

    def nominal(self, s: States) -> Array:
        """Points `(n, 3)` of a machine without errors."""
        return self.of.points(s.q, np.zeros((len(s.q), 3, 6)), arms(s))

    def readings(self) -> Array:
        """Readings `(n, 3)` of the tracker, mm."""
        seen = (self.points(self.rows, unseen=False) - self.origin) @ self.frame
        tilt = 0.7 * self.size / np.linalg.norm(seen, axis=1).mean() * self.turn
        share = self.rows.time / self.rows.time[-1] if self.effect == "station drift" else self.rows.time >= self.since
        if self.effect in ("knock", "station drift"):
            seen = turned(np.outer(share, tilt), seen) + np.outer(share, 0.7 * self.size * self.shift)
        if self.effect == "swapped targets" and self.plan.targets == 1:  # a reflector that is not seated
            seen[self.wrong] += max(self.size, 0.06) * self.shift
        length = np.linalg.norm(seen, axis=1)
        beam = seen / length[:, None]
        level = np.cross([0.0, 0.0, 1.0], beam)
        level /= np.linalg.norm(level, axis=1)[:, None]
        away = np.stack([base + slope * length / 1000 for base, slope in (self.range_um, self.across_um)], axis=1) * UM
        noise = self.noise * away[:, [0, 1, 1]]
        return seen + beam * noise[:, :1] + level * noise[:, 1:2] + np.cross(beam, level) * noise[:, 2:]

    def write(self, folder: Path) -> None:
        """Write the measurement, and the table of unseen states."""
        rows, target = self.rows, self.rows.target.copy()
        names = list(TARGETS)[: self.plan.targets]
        if self.effect == "swapped targets" and len(names) > 1:
            target[self.wrong] = [names[(names.index(name) + 1) % len(names)] for name in target[self.wrong]]
        arm = [f"# target.{name}: {' '.join(f'{v:g}' for v in TARGETS[name])}" for name in names]
        keys = ("u_range_um", "u_range_um_per_m", "u_angle_um", "u_angle_um_per_m")
        stated = zip(keys, (*self.range_um, *self.across_um), strict=True)
        noise = [f"# {key}: {value * self.stated:g}" for key, value in stated]
        text = [f"# machine: {self.machine}", "# instrument: laser-tracker", *noise, *arm]
        text.append("time_s,X,Y,Z,target,x,y,z,temp_column")
        for i, v in enumerate(self.readings()):
            at, seen = ",".join(f"{x:.3f}" for x in rows.q[i]), ",".join(f"{x:.5f}" for x in v)
            text.append(f"{rows.time[i]:.1f},{at},{target[i]},{seen},{rows.degc[i]:.2f}")
        (folder / "data.csv").write_text("\n".join(text) + "\n", encoding="utf-8")
        s = self.unseen()
        text = [f"# machine: {self.machine}", *arm, "time_s,X,Y,Z,target,temp_column,dir_X,dir_Y,dir_Z"]
        for i in range(len(s.q)):
            at, side = ",".join(f"{x:.3f}" for x in s.q[i]), ",".join(f"{d:.0f}" for d in s.approach[i])
            text.append(f"{s.time[i]:.1f},{at},{s.target[i]},{s.degc[i]:.2f},{side}")
        (folder / "unseen.csv").write_text("\n".join(text) + "\n", encoding="utf-8")

    def unseen(self) -> States:
        """Random states within the measured ranges, with directions of approach that the measurement shows."""
        rng, rows, n = np.random.default_rng(7), self.rows, UNSEEN
        q = np.round(rng.uniform(rows.q.min(axis=0), rows.q.max(axis=0), (n, 3)), 3)
        known = [column[np.argmax(at != at[0]) :] for column, at in zip(rows.approach.T, rows.q.T, strict=True)]
        approach = np.stack([rng.choice(column, n) for column in known], axis=1)
        time = rows.time[-1] if self.effect == "crash" else round(float(rows.time.mean()), 1)
        degc = round(float(rows.degc.mean()), 2)
        target = rng.choice(np.array(list(TARGETS)[: self.plan.targets]), n)
        return States(q, approach, np.full(n, time), np.full(n, degc), target)


def arms(s: States) -> Array:
    """Vectors `(n, 3)` from the tool's reference point to the targets."""
    return np.array([TARGETS[name] for name in s.target])


def without_rigid(points: Array, off: Array) -> Array:
    """Displacements `(n, 3)` of points without their best rigid motion."""
    arm = points - points.mean(axis=0)
    arm = arm / np.abs(arm).max()
    motion = np.stack([np.tile(np.eye(3)[k], (len(arm), 1)) for k in range(3)] + [np.cross(e, arm) for e in np.eye(3)])
    columns = motion.reshape(6, -1).T
    return (off.reshape(-1) - columns @ np.linalg.lstsq(columns, off.reshape(-1), rcond=None)[0]).reshape(-1, 3)


def rms(off: Array) -> float:
    """RMS length of displacements `(n, 3)`."""
    return float(np.sqrt(np.mean(np.sum(off**2, axis=1))))


Record = dict[str, Any]


def ncomp(*words: str | Path) -> str:
    """Run ncomp, and return its output."""
    command = [sys.executable, "-c", "from postproc.cli import run; run()", *map(str, words)]
    run = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, check=False)
    return run.stdout + run.stderr


def asked(case: Case, folder: Path) -> Record:
    """The answer to a question."""
    case.write(folder)
    new, out = folder / "new.json", folder / "out.json"
    said = ncomp("diagnose", folder / "data.csv", "-m", case.machine, "-o", new, "--force", "--json", out)
    record: Record = {"name": case.name, "machine": case.machine, "design": case.design, "effect": case.effect}
    record |= {"axis": AXES[case.axis], "times_noise": round(case.times_noise, 2), "stated": float(case.stated)}
    if not out.exists():
        return {**record, "failure": said[-300:]}
    found = json.loads(out.read_text(encoding="utf-8"))
    record |= judged(case, found["effects"], found["unexplained"])
    s = case.unseen()
    nominal = case.nominal(s)
    true = without_rigid(nominal, (case.points(s, unseen=True) - nominal) / UM)
    record |= {"accepted": not found["forced"], "reason": found["forced"] or "", "widened": found["widened"]}
    record |= {"none_um": rms(true), **predicted(case, new, folder, nominal, true)}
    return record


def judged(case: Case, effects: list[Record], unexplained: Record | None) -> Record:
    """Verdict on the causes, and those that are not there."""

    def fits(cause: Record) -> bool:
        where = case.effect not in OF_ONE_AXIS or cause.get("axis") in (AXES[case.axis], None)
        return cause["kind"] in KINDS[case.effect] and where

    named = [each for each in effects if fits(each)]
    tied = [each for each in effects if each not in named and any(map(fits, each.get("alternatives", [])))]
    false = [each for each in effects if each not in named and each not in tied]
    verdict = "named" if named else "tied" if tied else "unexplained" if unexplained else "missed"
    words = [f"{each['kind']} {each.get('axis') or ''} {each['verdict']}" for each in false]
    return {"verdict": verdict, "false": words, "variables": (unexplained or {}).get("variables")}


def predicted(case: Case, new: Path, folder: Path, nominal: Array, true: Array) -> Record:
    """Error that the calibration leaves, um, the uncertainty of its predictions, and the share within the intervals."""
    if not new.exists():
        return {}
    samples = folder / "samples"
    samples.mkdir()
    calibration = json.loads(new.read_text(encoding="utf-8"))
    drawn = write_samples(calibration, samples)
    (samples / "_.json").write_text(json.dumps({**calibration, "covariance": None}), encoding="utf-8")
    words = [sys.executable, "-c", PREDICT, folder / "unseen.csv", case.machine, samples]
    subprocess.run(list(map(str, words)), capture_output=True, cwd=ROOT, check=True)
    order = sorted(path.stem for path in samples.glob("*.json"))
    tables = [without_rigid(nominal, table) for table in np.load(samples / "deviations.npy")]
    own = tables.pop(order.index("_"))
    record: Record = {"after_um": rms(own - true)}
    if drawn:
        u = np.sqrt(np.mean((np.stack(tables) - own) ** 2, axis=0))
        record |= {"u_um": rms(u), "covered": float(np.mean(np.abs(own - true) <= 2.0 * u))}
    return record


def questions(seed: int) -> Iterator[tuple[str, str, str, int]]:
    """Each design with each effect, in an order in which all of both come early; the machines in turn."""
    for j in range(len(DESIGNS)):
        for k, effect in enumerate(KINDS):
            yield ("cframe", "gantry")[(j + k) % 2], list(DESIGNS)[(3 * k + j) % len(DESIGNS)], effect, seed


def table(records: list[Record]) -> Iterator[str]:
    """Lines of the table: all, by design and by effect."""
    head = ("asked", "named", "tied", "unexplained", "missed", "false", "worse", "refused", "covered")
    yield f"{'':32}{''.join(f'{word:>12}' for word in head)}"
    groups: dict[str, list[Record]] = {"all": records}
    for key in ("design", "effect"):
        for name in DESIGNS if key == "design" else KINDS:
            groups[f"{key} {name}"] = [record for record in records if record[key] == name]
    for name, some in groups.items():
        if some:
            yield f"{name:32}{''.join(f'{figure:>12}' for figure in summary(some))}"


def summary(some: list[Record]) -> list[str]:
    """Figures of some answers."""
    answers = [each for each in some if "failure" not in each]
    count = dict.fromkeys(("named", "tied", "unexplained", "missed"), 0)
    for each in answers:
        count[each["verdict"]] += each["effect"] != "none"
    written = [each for each in answers if "after_um" in each]
    worse = sum(each["accepted"] and each["after_um"] > each["none_um"] for each in written)
    refused = sum(not each["accepted"] and each["after_um"] < each["none_um"] for each in written)
    inside = [each["covered"] for each in written if "covered" in each and each["accepted"]]
    covered = f"{100 * np.mean(inside):.1f} %" if inside else ""
    false = sum(bool(each["false"]) for each in answers)
    return [*map(str, (len(some), *count.values(), false, worse, refused)), covered]


def read(path: Path) -> list[Record]:
    """The recorded answers."""
    return [json.loads(text) for text in path.read_text(encoding="utf-8").splitlines()] if path.exists() else []


def main() -> None:
    """Ask, record and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=1, help="seed of the draws")
    parser.add_argument("--most", type=int, default=None, metavar="N", help="the first N questions only")
    parser.add_argument("--only", default="", metavar="TEXT", help="questions whose name contains it: pitch, layers/")
    parser.add_argument("--records", type=Path, default=Path("out/short_measurements_exam.jsonl"), help="the answers")
    parser.add_argument("--table", action="store_true", help="the table of the records, asking nothing")
    given = parser.parse_args()
    given.records.parent.mkdir(parents=True, exist_ok=True)
    known = {record["name"] for record in read(given.records)}
    for words in [] if given.table else list(questions(given.seed))[: given.most]:
        case = Case(*words)
        if case.name in known or given.only not in case.name:
            continue
        with tempfile.TemporaryDirectory() as folder:
            record = asked(case, Path(folder))
        with given.records.open("a", encoding="utf-8") as file:
            file.write(json.dumps(record) + "\n")
        after = f"{record.get('none_um', 0):.1f} -> {record.get('after_um', 0):.1f} um"
        print(record["name"], record.get("verdict", record.get("failure")), record.get("false"), after, flush=True)
    print("\n".join(table(read(given.records))))


if __name__ == "__main__":
    main()
