"""Smooth error motions of every axis, drawn at random: what the model of a fit has to hold without a rest."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import legendre

from virtual_machine.chain import Array, Axis, Chain

SIZE = (10.0, 30.0)
"""um and urad: largest value of an error motion over the travel."""
FADING = (1.0, 0.5, 0.2)
"""Shares of the Legendre polynomials of degree 1, 2, 3."""
WAVE = 0.02
"""Share of a wave over the travel, beside them: no curve is exactly a polynomial."""
FADING_OF_TURNS = (1.0, 1.0, 0.5, 0.5)
"""Shares of one and two waves a turn, cosine and sine."""
MICRO = np.array([1e-3] * 3 + [1e-6] * 3)
"""mm per um and rad per urad, of E_X ... E_C."""
TABLE_1: Mapping[str, tuple[float, ...]] = {
    "XX": (0, 70, 0.5, 20, 20, 5, 10, 10),
    "YX": (0, 0, 0.5, 30, 0, 5, 3, 3),
    "ZX": (0, 0, 0.5, 15, 0, 5, 3, 3),
    **{f"{letter}X": (10, 20, 0.5, 10, 10, 5, 5, 5) for letter in "ABC"},
    "YY": (0, 30, 0.5, 5, 5, 2, 3, 3),
    "ZY": (0, 0, 0.5, 15, 0, 2, 5, 5),
    "XY": (0, 0, 0.5, 15, 0, 2, 5, 5),
    **{f"{letter}Y": (10, 30, 0.5, 10, 10, 2, 5, 5) for letter in "ABC"},
    "XZ": (0, 0, 0.5, 15, 0, 1, 5, 5),
    "YZ": (0, 0, 0.5, 15, 0, 1, 5, 5),
    "ZZ": (0, 30, 0.5, 30, 30, 1, 3, 3),
    **{f"{letter}Z": (10, 30, 0.5, 10, 10, 1, 3, 3) for letter in "ABC"},
}
"""Virtual calibration paper, Table 1: half-widths a0, a1, n1, b1, c1, n2, b2, c2 by component and axis, um and urad."""


@dataclass(frozen=True)
class Curves:
    """Error motions by axis: coefficients `(6, terms)`, um and urad, of the terms of `_terms` or of Table 1."""

    coefficients: Mapping[str, Array]
    waves: Mapping[str, Array] | None = None
    """Wave numbers n `(6, 2)` of Table 1, by axis."""

    def errors(self, chain: Chain, positions: Array) -> Array:
        """`(n, axes, 6)`, mm and rad, at positions `(n, axes)`, mm and degrees."""
        result = np.empty((*positions.shape, 6))
        for i, axis in enumerate(chain.axes):
            if self.waves is None:
                values = _terms(axis, positions[:, i]) @ self.coefficients[axis.name].T
            else:
                values = _waves(axis, positions[:, i], self.waves[axis.name], self.coefficients[axis.name])
            result[:, i] = values * MICRO
        return result


def smooth(chain: Chain, rng: np.random.Generator) -> Curves:
    """Low Legendre polynomials and a wave on linear axes, two harmonics of a turn on rotary ones; no constants."""
    found = {}
    for axis in chain.axes:
        fading = np.array(FADING_OF_TURNS if axis.rotary else FADING)
        drawn = rng.normal(size=(6, len(fading))) * fading
        everywhere = _terms(axis, np.linspace(*axis.travel, 101))[:, : len(fading)]
        size = rng.uniform(*SIZE, 6)[:, None]
        drawn *= size / np.abs(everywhere @ drawn.T).max(axis=0)[:, None]
        phase = rng.uniform(0.0, 2 * np.pi, (6, 1))
        wave = WAVE * size * np.concatenate([np.sin(phase), np.cos(phase)], axis=1)
        found[axis.name] = drawn if axis.rotary else np.concatenate([drawn, wave], axis=1)
    return Curves(found)


def table_1(chain: Chain, rng: np.random.Generator) -> Curves:
    """The gantry of the virtual calibration paper: every coefficient uniform between its half-widths."""
    widths = {axis: np.array([TABLE_1[f"{letter}{axis}"] for letter in "XYZABC"], float) for axis in chain.names}
    kept = [0, 1, 3, 4, 6, 7]
    coefficients = {axis: rng.uniform(-1.0, 1.0, (6, 6)) * width[:, kept] for axis, width in widths.items()}
    return Curves(coefficients, {axis: width[:, [2, 5]] for axis, width in widths.items()})


def none(chain: Chain) -> Curves:
    """A machine without error motions."""
    return Curves({axis.name: np.zeros((6, _terms(axis, np.zeros(1)).shape[1])) for axis in chain.axes})


def _terms(axis: Axis, position: Array) -> Array:
    """`(n, terms)`: Legendre degrees 1 ... 3 and a wave over the travel; or one and two waves a turn."""
    if axis.rotary:
        angle = np.radians(position)
        return np.stack([wave(n * angle) for n in (1, 2) for wave in (np.sin, np.cos)], axis=1)
    low, high = axis.travel
    u = (position - low) / (high - low)
    wave = np.stack([np.sin(2 * np.pi * u), np.cos(2 * np.pi * u)], axis=1)
    return np.concatenate([legendre.legvander(2.0 * u - 1.0, 3)[:, 1:], wave], axis=1)


def _waves(axis: Axis, position: Array, n: Array, coefficients: Array) -> Array:
    """`(rows, 6)`: a0 + a1 u + b1 sin(n1 pi u) + c1 cos(n1 pi u) + b2 sin(n2 pi u) + c2 cos(n2 pi u), u = 0 ... 1."""
    u = ((position - axis.travel[0]) / (axis.travel[1] - axis.travel[0]))[:, None]
    a0, a1, b1, c1, b2, c2 = coefficients.T
    first, second = n.T * np.pi
    slow = b1 * np.sin(first * u) + c1 * np.cos(first * u)
    return np.asarray(a0 + a1 * u + slow + b2 * np.sin(second * u) + c2 * np.cos(second * u))
