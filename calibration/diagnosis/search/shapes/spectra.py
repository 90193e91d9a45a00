"""Spectra of a residual over the positions of an axis, and the periods that these positions resolve."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from calibration.diagnosis.search.shapes.sensitivity import Sensitivity
from kinematics.transforms import Array

BEYOND = 16.0
"""Most waves over the travel per position: irregular positions resolve more than their mean distance."""
SHORTEST, POSITIONS = 1.0, 4
"""Shortest period of a cyclic error, mm or degrees: leads and gears have longer ones. Those of encoders are shorter;
single positions show them by chance alone, unless there are so many to a period."""
REFINED = 12
"""Most frequencies that are refined: at few positions several explain nearly as much."""
LATTICE = 0.02
"""Largest distance of positions from a lattice, as a share of its pitch."""


class Waves(NamedTuple):
    """Waves exp(2 pi i x f) of evenly spaced frequencies f at positions x.

    Every frequency is a coarse one plus a multiple of the step, every wave the product of the two: few exponentials
    are computed.
    """

    x: Array
    """`(n,)`"""
    frequencies: Array
    """`(m,)`"""
    step: float
    coarse: np.ndarray
    """`(n, m / k)`"""
    fine: np.ndarray
    """`(n, k)`"""

    @classmethod
    def of(cls, x: Array, frequencies: Array) -> Waves:
        """The waves of evenly spaced frequencies."""
        fine = int(np.ceil(np.sqrt(len(frequencies))))
        step = float(frequencies[-1] - frequencies[0]) / max(len(frequencies) - 1, 1)
        return cls(
            x, frequencies, step, wave(x, frequencies[::fine]), wave(x, np.asarray(step * np.arange(fine), float))
        )

    def sums(self, values: Array) -> np.ndarray:
        """Sums `(c, m)` over the positions of values `(c, n)` times the waves."""
        sums = (values[:, None, :] * self.coarse.T).reshape(-1, len(self.x)) @ self.fine
        return np.asarray(sums.reshape(len(values), -1)[:, : len(self.frequencies)])

    def at(self, numbers: np.ndarray) -> np.ndarray:
        """The waves `(n, k)` of some of the frequencies."""
        coarse, fine = np.divmod(numbers, self.fine.shape[1])
        return np.asarray(self.coarse[:, coarse] * self.fine[:, fine])


def wave(x: Array, frequencies: Array) -> np.ndarray:
    """Waves exp(2 pi i x f) `(n, k)`."""
    return np.asarray(np.exp(2j * np.pi * x[:, None] * frequencies))


def strengths(sensitivities: Sequence[Sensitivity], waves: Waves) -> Array:
    """Power `(c, frequencies)` of waves, as for dense positions and without the part that the model imitates."""
    squares = np.array([sensitivity.squares.sum() for sensitivity in sensitivities])[:, None]
    sums = waves.sums(np.stack([sensitivity.along for sensitivity in sensitivities]))
    return np.asarray(np.abs(sums) ** 2 / np.maximum(squares, 1e-300))


def peaks(power: Array, count: int) -> np.ndarray:
    """Indices of at most `count` local maxima, the highest first."""
    beside = np.concatenate([[-np.inf], power, [-np.inf]])
    top = np.flatnonzero((power >= beside[:-2]) & (power >= beside[2:]))
    return np.asarray(top[np.argsort(power[top])[::-1][:count]])


def finest(sensitivity: Sensitivity, waves: Waves, tried: np.ndarray, unit: float) -> tuple[Array, Array]:
    """The frequencies `(k,)` that explain most, each between its neighbours, and their gains `(k,)`.

    tried: numbers of the frequencies that are compared; unit: amplitude of a wave, mm or rad.
    """

    def gains_of(waves: np.ndarray) -> Array:
        """Gains of waves `(n, k)`."""
        return sensitivity.wave_gains(unit * waves.imag, unit * waves.real)

    best = tried[np.argsort(gains_of(waves.at(tried)))[::-1][:REFINED]]
    frequencies, own, step = waves.frequencies[best], waves.at(best), waves.step / 2
    gains = gains_of(own)
    for _ in range(4):
        turn = wave(waves.x, np.array([step]))
        around = np.stack([own * turn.conj(), own, own * turn])
        lower, higher = np.split(gains_of(np.concatenate([around[0], around[2]], axis=1)), 2)
        found = np.stack([lower, gains, higher])
        chosen = np.argmax(found, axis=0)
        frequencies = frequencies + step * (chosen - 1)
        gains = np.take_along_axis(found, chosen[None], axis=0)[0]
        own = np.take_along_axis(around, chosen[None, None], axis=0)[0]
        step /= 2
    return frequencies, gains


def resolved(x: Array, travel: float) -> float:
    """Most waves over the travel that positions resolve."""
    pitch = lattice(x)
    return BEYOND * len(np.unique(np.round(x, 3))) if pitch is None else 0.5 * travel / pitch


def aliases(x: Array, period: float) -> list[float]:
    """Other periods that positions `(n,)` on a lattice cannot distinguish from this one."""
    pitch = lattice(x)
    if pitch is None:
        return []
    return [float(1.0 / abs(m / pitch + sign / period)) for m in (1, 2) for sign in (-1, 1)]


def usual_waves(x: Array, travel: float) -> float:
    """Most waves over the travel that positions `(n,)` resolve and that leads, gears and encoders may have.

    None is shorter than SHORTEST, but where neighbouring positions are so close that they show shorter ones by design.
    """
    between = np.diff(np.unique(np.round(x, 4)))
    shortest = min(SHORTEST, POSITIONS * float(np.median(between))) if len(between) else SHORTEST
    return min(resolved(x, travel), travel / shortest)


def lattice(x: Array) -> float | None:
    """Pitch of a lattice that all positions lie on; None where they do not, or where most of its points are empty."""
    apart = np.diff(np.unique(np.round(x, 3)))
    pitch = float(apart.min(initial=np.inf))
    off = np.abs(apart / pitch - np.round(apart / pitch)).max(initial=0.0)
    return pitch if np.isfinite(pitch) and off < LATTICE and np.ptp(x) / pitch < 4 * len(apart) else None
