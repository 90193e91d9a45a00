"""Spectra of a residual over the positions of an axis, and the periods that these positions resolve."""

from __future__ import annotations

from collections.abc import Sequence

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


def strengths(sensitivities: Sequence[Sensitivity], x: Array, frequencies: Array) -> Array:
    """Power `(c, frequencies)` of waves, as for dense positions and without the part that the model imitates."""
    squares = np.array([sensitivity.squares.sum() for sensitivity in sensitivities])[:, None]
    sums = spectrum(np.stack([sensitivity.along for sensitivity in sensitivities]), x, frequencies)
    return np.asarray(np.abs(sums) ** 2 / np.maximum(squares, 1e-300))


def spectrum(values: Array, x: Array, frequencies: Array) -> np.ndarray:
    """Sums `(c, m)` of values `(c, n)` times exp(2 pi i x f): positions `(n,)`, evenly spaced frequencies `(m,)`.

    Every frequency is a coarse one plus a multiple of the step, every wave the product of the two: few exponentials
    are computed.
    """
    turns, fine = 2j * np.pi * x[:, None], int(np.ceil(np.sqrt(len(frequencies))))
    step = (frequencies[-1] - frequencies[0]) / max(len(frequencies) - 1, 1)
    begun = values[:, None, :] * np.exp(turns * frequencies[::fine]).T
    sums = begun.reshape(-1, len(x)) @ np.exp(turns * step * np.arange(fine))
    return np.asarray(sums.reshape(len(values), -1)[:, : len(frequencies)])


def peaks(power: Array, count: int) -> np.ndarray:
    """Indices of at most `count` local maxima, the highest first."""
    beside = np.concatenate([[-np.inf], power, [-np.inf]])
    top = np.flatnonzero((power >= beside[:-2]) & (power >= beside[2:]))
    return np.asarray(top[np.argsort(power[top])[::-1][:count]])


def finest(sensitivity: Sensitivity, x: Array, tried: Array, step: float, unit: float) -> tuple[Array, Array]:
    """The frequencies `(k,)` that explain most, each between its neighbours, and their gains `(k,)`.

    unit: amplitude of a wave, mm or rad.
    """

    def gains_of(frequencies: Array) -> Array:
        """Gains of waves of these frequencies."""
        phase = 2 * np.pi * x[:, None] * frequencies.ravel()
        return sensitivity.wave_gains(unit * np.sin(phase), unit * np.cos(phase)).reshape(frequencies.shape)

    best = tried[np.argsort(gains_of(tried))[::-1][:REFINED]]
    gains = gains_of(best)
    for _ in range(4):
        around = best + step * np.array([[-1.0], [0.0], [1.0]])
        found = gains_of(around)
        chosen = np.argmax(found, axis=0)
        best, gains = (np.take_along_axis(table, chosen[None], axis=0)[0] for table in (around, found))
        step /= 2
    return best, gains


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
