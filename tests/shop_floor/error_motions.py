"""Random error motions: half-widths of the virtual-calibration paper (its Table 1), and those of rotary axes.

Linear axes: a0 + a1 u + b1 sin(n1 pi u) + c1 cos(n1 pi u) + b2 sin(n2 pi u) + c2 cos(n2 pi u), u = 0 ... 1 over the
travel; straightness has a slope besides (squareness). Each coefficient is uniform between plus and minus its
half-width. Rotary axes: a constant and three harmonics. A machine of size s has s times these errors.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from shop_floor.chain import COMPONENTS, Array, Machine

UM = 1e-3
URAD = 1e-6
PER_MICRO = np.array([UM, UM, UM, URAD, URAD, URAD])
SQUARENESS = 20.0
"""Half-width of the slope of a straightness over the travel, um."""
ANGLE = (10.0, 20.0, 0.5, 10.0, 10.0)
STRAIGHT = (0.0, SQUARENESS, 0.5)
COARSE: Mapping[str, tuple[float, float, float, float, float]] = {
    "XX": (0, 70, 0.5, 20, 20), "YX": (*STRAIGHT, 30, 0), "ZX": (*STRAIGHT, 15, 0),
    "AX": ANGLE, "BX": ANGLE, "CX": ANGLE,
    "XY": (*STRAIGHT, 15, 0), "YY": (0, 30, 0.5, 5, 5), "ZY": (*STRAIGHT, 15, 0),
    "AY": (10, 30, 0.5, 10, 10), "BY": (10, 30, 0.5, 10, 10), "CY": (10, 30, 0.5, 10, 10),
    "XZ": (*STRAIGHT, 15, 0), "YZ": (*STRAIGHT, 15, 0), "ZZ": (0, 30, 0.5, 30, 30),
    "AZ": (10, 30, 0.5, 10, 10), "BZ": (10, 30, 0.5, 10, 10), "CZ": (10, 30, 0.5, 10, 10),
}  # fmt: skip
"""Half-widths a0, a1, number n1 of half periods, half-widths b1, c1; um and urad."""
FINE: Mapping[str, tuple[float, tuple[float, float, float]]] = {
    "X": (5.0, (10.0, 3.0, 5.0)), "Y": (2.0, (3.0, 5.0, 5.0)), "Z": (1.0, (3.0, 5.0, 3.0))
}  # fmt: skip
"""By axis: number n2 of half periods, half-widths b2 = c2 of positioning, straightness and angles."""
HARMONICS = 3
ROTARY_UM, ROTARY_URAD = 10.0, 25.0
"""Half-widths of the constant and, over n, of harmonic n of a rotary axis."""


@dataclass(frozen=True)
class ErrorMotions:
    """The error motions of a machine: coefficients by axis, `(6, terms)` in um and urad."""

    machine: Machine
    coefficients: Mapping[str, Array]
    ripple: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)
    """Finer waves of positioning errors, by axis: amplitude in um, periods over the travel, phase."""

    def errors(self, positions: Array) -> Array:
        """Errors `(n, axes, 6)`, mm and rad, at positions `(n, axes)`, mm and degrees."""
        result = np.zeros((*positions.shape, 6))
        for i, axis in enumerate(self.machine.axes):
            terms = _terms(self.machine, axis.name, positions[:, i])
            result[:, i] = np.einsum("nct,ct->nc", terms, self.coefficients[axis.name]) * PER_MICRO
            if axis.name in self.ripple:
                amplitude, periods, phase = self.ripple[axis.name]
                wave = np.sin(2 * np.pi * periods * axis.share(positions[:, i]) + phase)
                result[:, i, axis.own] += amplitude * PER_MICRO[axis.own] * wave
        return result


def draw(machine: Machine, rng: np.random.Generator) -> ErrorMotions:
    """Random error motions of a machine."""
    coefficients = {}
    for axis in machine.axes:
        widths = _rotary_widths() if axis.rotary else _widths(axis.name)
        coefficients[axis.name] = machine.size * widths * rng.uniform(-1.0, 1.0, widths.shape)
    return ErrorMotions(machine, coefficients)


def _widths(axis: str) -> Array:
    """Half-widths `(6, 6)` of a linear axis."""
    rows = []
    for component in COMPONENTS:
        a0, a1, _, b1, c1 = COARSE[component + axis]
        kind = 0 if component == axis else 1 if component in "XYZ" else 2
        fine = FINE[axis][1][kind]
        rows.append([a0, a1, b1, c1, fine, fine])
    return np.array(rows)


def _rotary_widths() -> Array:
    """Half-widths `(6, 7)` of a rotary axis."""
    fading = np.array([1.0, *(1.0 / n for n in range(1, HARMONICS + 1) for _ in range(2))])
    return np.outer([ROTARY_UM] * 3 + [ROTARY_URAD] * 3, fading)


def _terms(machine: Machine, name: str, position: Array) -> Array:
    """Functions `(n, 6 components, terms)` of a position."""
    axis = machine.axis(name)
    if axis.rotary:
        q = np.radians(position)
        waves = [wave(n * q) for n in range(1, HARMONICS + 1) for wave in (np.cos, np.sin)]
        one = np.stack([np.ones_like(q), *waves], axis=1)
        return np.repeat(one[:, None], 6, axis=1)
    u, fine = np.pi * axis.share(position), FINE[name][0]
    rows = []
    for component in COMPONENTS:
        n1 = COARSE[component + name][2]
        waves = [np.sin(n1 * u), np.cos(n1 * u), np.sin(fine * u), np.cos(fine * u)]
        rows.append(np.stack([np.ones_like(u), u / np.pi, *waves], axis=1))
    return np.stack(rows, axis=1)
