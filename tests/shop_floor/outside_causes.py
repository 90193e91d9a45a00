"""Six hidden effects that no library of causes holds, one for each kind of knowledge that a library lacks.

- `swing`: Y of the tool: tanh(6(u - 1/2)) exp(-2w) cos(2 pi t / T), u and w the shares of X and Z. Three variables, a
  different form in each: a draught on one side of a hot column.
- `product`: Z of the tool: (2u - 1)(2v - 1)(2w - 1). A product of three positions: cross-axis effects have two.
- `walk`: one direction of the tool: a random walk, a step each 45 s. No time constant and no rate: a loose spindle
  nose, a door that opens.
- `stick-slip`: positioning of an axis: a sawtooth whose phase depends on another axis. Steps of tables and cyclic
  errors have a phase that is constant.
- `beam`: elevation of the tracker: proportional to azimuth times elevation. The effects of angle encoders depend on
  their own angle.
- `floor`: Z of the tool: -exp(-((u - 0.3) / 0.15)^2) (t / 1 h)^2, u the share of the heaviest axis. One pad of the
  foundation gives way under a mass, faster and faster: distortion by heat is a polynomial of degree 3 or less, with a
  rate or a time constant.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from shop_floor.causes import Draw
from shop_floor.chain import Array
from shop_floor.designs import Run
from shop_floor.error_motions import UM, URAD
from shop_floor.hidden import Answer, Hidden, of_axis
from shop_floor.tracker import cartesian, polar

HEAVIEST = {"gantry": "X", "cframe": "Y", "dmu50": "X"}
STEP_S = 45.0


def _along(direction: str, values: Array) -> Array:
    """Displacement `(n, 3)`, mm, in one direction, of values in um."""
    found = np.zeros((len(values), 3))
    found[:, "XYZ".index(direction)] = values * UM
    return found


@dataclass(frozen=True)
class Swing(Hidden):
    """A draught on one side of a hot column that swings with the control of the hall."""

    period_s: float = 1600.0

    def tool(self, run: Run) -> Array:
        shape = np.tanh(6.0 * (run.share("X") - 0.5)) * np.exp(-2.0 * run.share("Z"))
        return _along("Y", self.size * shape * np.cos(2 * np.pi * run.clock / self.period_s))

    def answer(self, run: Run) -> Answer:
        del run
        return Answer(variables=frozenset({"X", "Z", "time"}))


@dataclass(frozen=True)
class Product(Hidden):
    """A frame that warps with the positions of all three axes."""

    def tool(self, run: Run) -> Array:
        return _along("Z", self.size * np.prod([2.0 * run.share(axis) - 1.0 for axis in "XYZ"], axis=0))

    def answer(self, run: Run) -> Answer:
        del run
        return Answer(variables=frozenset("XYZ"))


@dataclass(frozen=True)
class Walk(Hidden):
    """A tool point that wanders at random."""

    direction: str = "Z"
    steps: tuple[float, ...] = (0.0,)

    def tool(self, run: Run) -> Array:
        walked = np.cumsum(self.steps)
        return _along(self.direction, self.size * np.interp(run.clock / STEP_S, np.arange(len(walked)), walked))

    def answer(self, run: Run) -> Answer:
        del run
        return Answer(relatives=("thermal-drift", "tracker-drift"), variables=frozenset({"time"}))


@dataclass(frozen=True)
class StickSlip(Hidden):
    """A guide that holds and lets go; where it lets go depends on the load, and so on another axis."""

    axis: str = "X"
    other: str = "Y"
    teeth: float = 7.0
    turns: float = 1.0

    def errors(self, run: Run) -> Array:
        phase = self.teeth * run.share(self.axis) + self.turns * run.share(self.other) ** 2
        return of_axis(run, self.axis, self.axis, self.size * 2.0 * (phase - np.floor(phase) - 0.5))

    def answer(self, run: Run) -> Answer:
        del run
        return Answer(variables=frozenset({self.axis, self.other}))


@dataclass(frozen=True)
class Beam(Hidden):
    """A tracker whose elevation reads wrong by the product of azimuth and elevation."""

    LARGEST: ClassVar[float] = 500.0

    def reading(self, run: Run, points: Array) -> Array:
        del run
        azimuth, elevation, length = polar(points)
        centre = np.angle(np.mean(np.exp(1j * azimuth)))
        aside = np.angle(np.exp(1j * (azimuth - centre)))
        return cartesian(azimuth, elevation + self.size * URAD * aside * elevation, length)

    def answer(self, run: Run) -> Answer:
        del run
        return Answer(relatives=("tracker-angle",))


@dataclass(frozen=True)
class Floor(Hidden):
    """A pad of the foundation that gives way under the heaviest axis, faster and faster."""

    def tool(self, run: Run) -> Array:
        dip = np.exp(-(((run.share(HEAVIEST[run.machine.name]) - 0.3) / 0.15) ** 2))
        return _along("Z", -self.size * dip * (run.clock / 3600.0) ** 2)

    def answer(self, run: Run) -> Answer:
        return Answer(variables=frozenset({HEAVIEST[run.machine.name], "time"}))


def _swing(run: Run, rng: np.random.Generator) -> Hidden:
    return Swing(period_s=float(rng.uniform(0.3, 0.7) * max(run.duration, 1800.0)))


def _walk(run: Run, rng: np.random.Generator) -> Hidden:
    steps = rng.normal(size=int(run.duration / STEP_S) + 2)
    return Walk(direction=str(rng.choice(list("XYZ"))), steps=tuple(steps.tolist()))


def _stick_slip(run: Run, rng: np.random.Generator) -> Hidden:
    axis, other = rng.choice(run.machine.linear, 2, replace=False).tolist()
    return StickSlip(axis=axis, other=other, teeth=float(rng.uniform(5, 9)), turns=float(rng.uniform(0.7, 1.6)))


OUTSIDE: Mapping[str, Draw] = {
    "swing": _swing,
    "product": lambda _run, _rng: Product(),
    "walk": _walk,
    "stick-slip": _stick_slip,
    "beam": lambda _run, _rng: Beam(),
    "floor": lambda _run, _rng: Floor(),
}
