"""Noise of a continuous run: its spectrum from the run itself, as an autoregressive process that whitens it.

The error of an axis has little at high frequencies, the laser and a vibrating machine have. From the frequency on
where the spectrum (Welch, Hann) has fallen to the level of its flat part, all is noise; below, noise is taken to go on
at the level just above, which one run can't contradict. Two runs of one direction can: half the spectrum of their
difference is noise at every frequency, and the larger of both counts. The process is that of the spectrum's
autocovariance (Yule-Walker), its order by BIC.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.linalg import solve_toeplitz
from scipy.signal import detrend, welch

from calibration.continuous.error_curve import Course
from kinematics.transforms import Array

PARTS = 8
"""Parts that a course is cut into, at least, for its spectrum."""
LONGEST_PART = 2048
ORDERS = (0, 1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64)
FLAT = 2.0
"""Times the level of the flat part, below which the spectrum belongs to it."""
ABOVE = 3.0
"""The noise below the edge is that from the edge to so many times it."""
PEAK = 4.0
"""Times the level of the flat part, from which a part of the spectrum is a vibration."""


class Noise(NamedTuple):
    """Noise of the blocks of one course, um."""

    filter: Array
    """1, a1 ... ap: what a block differs by from what the p before it foretell."""
    innovation: float
    """Standard deviation of that, um."""
    total: float
    """Standard deviation of the noise itself, um."""
    low: float
    """Spectral density at low frequencies, um2/Hz, one-sided: what the estimated curve suffers from."""
    vibrations: tuple[tuple[float, float], ...]
    """Frequency, Hz, and amplitude, um, of parts of the spectrum that stand out."""

    @property
    def order(self) -> int:
        """p."""
        return len(self.filter) - 1

    def scaled(self, factor: float) -> Noise:
        """The same course of noise, `factor` times as large."""
        return self._replace(
            innovation=self.innovation * factor, total=self.total * factor, low=self.low * factor * factor
        )


def noise_of_course(course: Course, error: Array, difference: Array | None = None) -> Noise:
    """The noise of a course whose errors `(n,)`, um, are free of jumps and waves.

    difference `(n,)`: half the difference from another run at the same positions, times sqrt(2).
    """
    frequency, density = _spectrum(_even(course, error), course.period_s)
    flat = float(np.median(density[len(density) // 2 :]))
    edge = _edge(frequency, density, flat)
    above = (frequency >= edge) & (frequency <= ABOVE * edge)
    level = float(np.median(density[above])) if above.any() else flat
    density = np.where(frequency < edge, level, density)
    if difference is not None:
        own = _spectrum(_even(course, difference), course.period_s)[1]
        density = np.where(frequency < edge, np.maximum(density, own), density)
    low = float(density[: max(int(np.searchsorted(frequency, edge)), 1)].mean())
    covariance = np.fft.irfft(density, 2 * (len(density) - 1)) / (2.0 * course.period_s)
    coefficients, variance = _autoregression(covariance, len(course))
    return Noise(
        coefficients,
        float(np.sqrt(variance)),
        float(np.sqrt(covariance[0])),
        low,
        _vibrations(frequency, density, max(flat, 1e-12), edge),
    )


def _even(course: Course, values: Array) -> Array:
    """Values on the whole raster of time, gaps bridged straight."""
    slots = course.slot - course.slot[0]
    if slots[-1] + 1 == len(slots):
        return values
    return np.interp(np.arange(slots[-1] + 1), slots, values)


def _spectrum(values: Array, period: float) -> tuple[Array, Array]:
    """Frequencies, Hz, and one-sided density `(m,)`, um2/Hz."""
    part = min(len(values) // PARTS * 2, LONGEST_PART)
    frequency, density = welch(values, 1.0 / period, "hann", part, detrend=detrend)
    density[0] = density[1]
    return np.asarray(frequency), np.maximum(density, 1e-15)


def _edge(frequency: Array, density: Array, flat: float) -> float:
    """The frequency, Hz, below which the error of the axis shows: the first bins that have fallen to the flat part."""
    low = density <= FLAT * flat
    both = np.flatnonzero(low[:-1] & low[1:])
    return float(frequency[both[0] if len(both) else len(frequency) // 2])


def _autoregression(covariance: Array, n: int) -> tuple[Array, float]:
    """Filter and variance of its outcome, of the order of least BIC."""
    found: list[tuple[float, Array, float]] = []
    for order in ORDERS:
        filter_, variance = np.ones(1), float(covariance[0])
        if order:
            inner = solve_toeplitz(covariance[:order], covariance[1 : order + 1])
            filter_ = np.concatenate([[1.0], -inner])
            variance = float(covariance[0] - inner @ covariance[1 : order + 1])
        if variance <= 0.0:
            break
        found.append((n * np.log(variance) + order * np.log(n), filter_, variance))
    _, filter_, variance = min(found, key=lambda each: each[0])
    return filter_, variance


def _vibrations(frequency: Array, density: Array, flat: float, edge: float) -> tuple[tuple[float, float], ...]:
    """Parts of the spectrum above the edge that stand out of the flat part, strongest first."""
    out = (density > PEAK * flat) & (frequency > ABOVE * edge)
    bounds = np.flatnonzero(np.diff(np.concatenate([[0], out.astype(int), [0]])))
    step, found = frequency[1] - frequency[0], []
    for first, stop in zip(bounds[::2].tolist(), bounds[1::2].tolist(), strict=True):
        part = slice(first, stop)
        power = float(density[part].sum() * step)
        centre = float((frequency[part] * density[part]).sum() / density[part].sum())
        found.append((centre, float(np.sqrt(2.0 * power))))
    return tuple(sorted(found, key=lambda each: -each[1])[:5])
