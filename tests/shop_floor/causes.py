"""Hidden effects of known kinds, as shops meet them; sizes in um, urad or K."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, Literal

import numpy as np

from shop_floor.chain import Array
from shop_floor.designs import REFERENCE_DEGC, Run
from shop_floor.error_motions import UM, URAD
from shop_floor.hidden import Answer, Hidden, of_axis
from shop_floor.tracker import cartesian, polar

STEEL_UM_PER_M_K = 11.5
OUTLIER_SHARE, OUTLIER_UM = 0.015, 400.0


@dataclass(frozen=True)
class Backlash(Hidden):
    """Lost motion: the axis stops half of it behind the command, on the side that it came from."""

    LARGEST: ClassVar[float] = 150.0
    axis: str = "X"

    def errors(self, run: Run) -> Array:
        return of_axis(run, self.axis, self.axis, -0.5 * self.size * run.direction(self.axis))

    def answer(self, run: Run) -> Answer:
        del run
        return Answer(("backlash", "reversal"), frozenset(self.axis), sizes={"width_um": self.size})


@dataclass(frozen=True)
class Drift(Hidden):
    """The spindle warms up: the tool point runs towards an end."""

    LARGEST: ClassVar[float] = 120.0
    towards: tuple[float, float, float] = (0.0, 0.0, 1.0)
    time_constant_s: float = 1800.0

    def tool(self, run: Run) -> Array:
        course = 1.0 - np.exp(-run.clock / self.time_constant_s)
        return self.size * UM * np.outer(course, self.towards)

    def answer(self, run: Run) -> Answer:
        del run
        main = "XYZ"[int(np.argmax(np.abs(self.towards)))]
        sizes = {
            "amplitudes_um": self.size * float(max(self.towards, key=abs)),
            "time_constants_s": self.time_constant_s,
        }
        kinds = ("thermal-drift", "thermal-drift-sensor")
        also = frozenset(letter for letter, part in zip("XYZ", self.towards, strict=True) if part)
        return Answer(kinds, frozenset(main), also, sizes=sizes)


@dataclass(frozen=True)
class Scale(Hidden):
    """A scale that grows from its zero with the temperature, which is logged.

    In a drifting hall the size is the growth in um/m/K; else it is the temperature rise in K of a steel scale.
    """

    LARGEST: ClassVar[float] = 20.0
    axis: str = "X"
    time_constant_s: float = 2400.0

    def on_run(self, run: Run) -> Run:
        if run.hall:
            return run
        rise = self.size * (1.0 - np.exp(-run.clock / self.time_constant_s))
        return replace(run, temperature=run.temperature + rise)

    def errors(self, run: Run) -> Array:
        growth = self.size if run.hall else STEEL_UM_PER_M_K
        warmth = run.temperature - REFERENCE_DEGC
        return of_axis(run, self.axis, self.axis, growth * warmth * run.place(self.axis) * 1e-3)

    def answer(self, run: Run) -> Answer:
        growth = self.size if run.hall else STEEL_UM_PER_M_K
        kinds = ("thermal-scale", "thermal-scale-sensor", "thermal-scale-quadratic")
        return Answer(kinds, frozenset(self.axis), sizes={"coefficient_um_per_m_per_k": growth})


@dataclass(frozen=True)
class Cross(Hidden):
    """An error motion that also depends on another axis: a beam that sags under a carriage, a twisted bed."""

    LARGEST: ClassVar[float] = 150.0
    axis: str = "Y"
    component: str = "Z"
    other: str = "X"
    shape: Literal["sag", "twist"] = "sag"

    def errors(self, run: Run) -> Array:
        u, v = run.share(self.axis), run.share(self.other)
        along = 4.0 * u * (1.0 - u) if self.shape == "sag" else 2.0 * u - 1.0
        return of_axis(run, self.axis, self.component, self.size * along * (2.0 * v - 1.0))

    def answer(self, run: Run) -> Answer:
        del run
        sizes = {f"P2 {self.axis}": -2.0 / 3.0 * self.size} if self.shape == "sag" else {}
        return Answer(("cross-axis",), frozenset({self.axis, self.other}), component=self.component, sizes=sizes)


@dataclass(frozen=True)
class Knock(Hidden):
    """Somebody knocks against the stand: from a moment on the tracker reads all points elsewhere."""

    LARGEST: ClassVar[float] = 200.0
    since_s: float = 0.0
    towards: tuple[float, float, float] = (1.0, 0.0, 0.0)

    def reading(self, run: Run, points: Array) -> Array:
        return np.asarray(points + self.size * UM * np.outer(run.clock >= self.since_s, self.towards))

    def answer(self, run: Run) -> Answer:
        del run
        shift = tuple(self.size * part for part in self.towards)
        return Answer(("station-shift",), sizes={"shift_um": shift}, either_sign=True)


@dataclass(frozen=True)
class Encoder(Hidden):
    """A circle of the tracker whose disc is off centre (one wave a turn) or elliptic (two)."""

    LARGEST: ClassVar[float] = 60.0
    circle: Literal["azimuth", "elevation"] = "azimuth"
    harmonic: int = 2
    phase: float = 0.0

    def reading(self, run: Run, points: Array) -> Array:
        del run
        azimuth, elevation, length = polar(points)
        angle = azimuth if self.circle == "azimuth" else elevation
        too_much = self.size * URAD * np.sin(self.harmonic * angle + self.phase)
        if self.circle == "azimuth":
            return cartesian(azimuth + too_much, elevation, length)
        return cartesian(azimuth, elevation + too_much, length)

    def answer(self, run: Run) -> Answer:
        del run
        sizes = {
            "sine_urad": self.size * float(np.cos(self.phase)),
            "cosine_urad": self.size * float(np.sin(self.phase)),
        }
        return Answer(("tracker-angle",), frozenset({self.circle}), sizes=sizes, harmonic=self.harmonic)


@dataclass(frozen=True)
class Outliers(Hidden):
    """Rows with a reflector that was not seated, or a beam that was caught again."""

    LARGEST: ClassVar[float] = 400.0
    rows: tuple[int, ...] = ()
    towards: tuple[tuple[float, float, float], ...] = ()

    def reading(self, run: Run, points: Array) -> Array:
        del run
        found = points.copy()
        found[list(self.rows)] += self.size * UM * np.array(self.towards)
        return found

    def answer(self, run: Run) -> Answer:
        del run
        return Answer(("outliers",), rows=frozenset(self.rows))


@dataclass(frozen=True)
class Pitch(Hidden):
    """A screw that is off its lead within each turn."""

    LARGEST: ClassVar[float] = 60.0
    axis: str = "X"
    period_mm: float = 20.0
    phase: float = 0.0

    def errors(self, run: Run) -> Array:
        wave = np.sin(2 * np.pi * run.place(self.axis) / self.period_mm + self.phase)
        return of_axis(run, self.axis, self.axis, self.size * wave)

    def answer(self, run: Run) -> Answer:
        del run
        return Answer(("cyclic",), frozenset(self.axis), sizes={"period_mm": self.period_mm})


@dataclass(frozen=True)
class Crash(Hidden):
    """A collision turns a guide: from a moment on an axis runs out of square, by the size over its travel."""

    LARGEST: ClassVar[float] = 200.0
    axis: str = "Y"
    component: str = "X"
    since_s: float = 0.0

    def errors(self, run: Run) -> Array:
        """See `Hidden.errors`."""
        axis, after = run.machine.axis(self.axis), run.clock >= self.since_s
        slope = self.size / (axis.high - axis.low)
        return of_axis(run, self.axis, self.component, slope * after * run.place(self.axis))

    def answer(self, run: Run) -> Answer:
        """See `Hidden.answer`; the line of the axis turns by the right-handed angle about the third direction."""
        axis = run.machine.axis(self.axis)
        about = ({0, 1, 2} - {"XYZ".index(self.axis), "XYZ".index(self.component)}).pop()
        sideways = np.cross(np.eye(3)[about], axis.line)["XYZ".index(self.component)]
        angle_urad = float(sideways) * self.size / (axis.high - axis.low) * 1e3
        sizes = {"value_urad": angle_urad}
        return Answer(("location-jump",), frozenset({self.axis}), component="ABC"[about], sizes=sizes)


def _unit(rng: np.random.Generator) -> tuple[float, float, float]:
    x, y, z = (vector := rng.normal(size=3)) / np.linalg.norm(vector)
    return float(x), float(y), float(z)


def _moment(run: Run, rng: np.random.Generator) -> float:
    """A moment in the middle of a run, between two rows."""
    row = int(rng.uniform(0.3, 0.7) * len(run))
    return float(run.clock[row - 1] + run.clock[row]) / 2.0


def backlash(run: Run, rng: np.random.Generator) -> Hidden:
    """Of any linear axis."""
    return Backlash(axis=str(rng.choice(run.machine.linear)))


def drift(run: Run, rng: np.random.Generator) -> Hidden:
    """Along Z, with a little to the sides in every second draw."""
    sides = rng.normal(scale=0.15, size=2) * rng.integers(2)
    constant = float(rng.uniform(0.35, 0.9) * max(run.duration, 1800.0))
    return Drift(towards=(float(sides[0]), float(sides[1]), 1.0), time_constant_s=constant)


def scale(run: Run, rng: np.random.Generator) -> Hidden:
    """Of any linear axis."""
    constant = float(rng.uniform(0.4, 1.2) * run.duration)
    return Scale(axis=str(rng.choice(run.machine.linear)), time_constant_s=constant)


def cross(run: Run, rng: np.random.Generator) -> Hidden:
    """A sag or a bow of one axis that another one changes; or a twist."""
    del run
    axis, component, other = CROSSED[int(rng.integers(len(CROSSED)))]
    return Cross(axis=axis, component=component, other=other, shape="sag" if rng.random() < 0.7 else "twist")


CROSSED = (("Y", "Z", "X"), ("X", "Z", "Y"), ("X", "Y", "Z"), ("Y", "X", "Z"), ("Y", "Z", "Z"), ("X", "Z", "Z"))


def shift(run: Run, rng: np.random.Generator) -> Hidden:
    """At any moment in the middle of the run."""
    return Knock(since_s=_moment(run, rng), towards=_unit(rng))


def angle(run: Run, rng: np.random.Generator) -> Hidden:
    """Azimuth in most draws."""
    del run
    circle: Literal["azimuth", "elevation"] = "azimuth" if rng.random() < 0.8 else "elevation"
    return Encoder(circle=circle, harmonic=int(rng.integers(1, 3)), phase=float(rng.uniform(0, 2 * np.pi)))


def outliers(run: Run, rng: np.random.Generator) -> Hidden:
    """1.5 % of the rows off by 0.4 mm."""
    count = max(1, round(OUTLIER_SHARE * len(run)))
    rows = np.sort(rng.choice(len(run), count, replace=False)).tolist()
    return Outliers(OUTLIER_UM, tuple(rows), tuple(_unit(rng) for _ in rows))


def cyclic(run: Run, rng: np.random.Generator) -> Hidden:
    """Screws of usual leads."""
    period = float(rng.choice(LEADS[run.machine.name]))
    return Pitch(axis=str(rng.choice(run.machine.linear)), period_mm=period, phase=float(rng.uniform(0, 2 * np.pi)))


LEADS: Mapping[str, Sequence[float]] = {
    "gantry": (20.0, 32.0, 40.0),
    "cframe": (10.0, 12.0, 16.0),
    "dmu50": (10.0, 20.0),
}


def crash(run: Run, rng: np.random.Generator) -> Hidden:
    """Any two linear axes."""
    axis, component = rng.choice(run.machine.linear, 2, replace=False).tolist()
    return Crash(axis=axis, component=component, since_s=_moment(run, rng))


Draw = Callable[[Run, np.random.Generator], Hidden]
KNOWN: Mapping[str, Draw] = {
    "backlash": backlash, "drift": drift, "scale": scale, "cross": cross, "shift": shift, "angle": angle,
    "outliers": outliers, "cyclic": cyclic, "crash": crash,
}  # fmt: skip
TWO = (
    ("backlash", "drift"), ("cross", "shift"), ("backlash", "scale"), ("drift", "angle"), ("cyclic", "backlash"),
    ("scale", "outliers"), ("cross", "drift"),
)  # fmt: skip
THREE = (
    ("backlash", "drift", "outliers"), ("cross", "scale", "shift"), ("backlash", "cross", "drift"),
    ("cyclic", "drift", "outliers"), ("backlash", "scale", "angle"),
)  # fmt: skip
"""Effects of the draws of `two` and `three`, in turn."""
FIXED_SIZES = ("outliers",)
"""Effects whose size is not that of their signal."""
