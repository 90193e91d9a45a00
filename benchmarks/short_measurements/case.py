"""A question: a short measurement of one machine by a laser tracker, with one hidden effect."""

from __future__ import annotations

import zlib
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from short_measurements.designs import DESIGNS
from short_measurements.machines import MACHINES, Array, Geometry, turned, unit

UM = 1e-3
TARGETS = {"a": (0.0, 0.0, -110.0), "b": (80.0, -35.0, -165.0), "c": (-60.0, 50.0, -95.0)}
UNSEEN = 300
LARGEST = 250.0
"""Largest size of an effect, um."""
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
    "random walk": ("random-walk",),
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
