"""Noise of a continuous run: spectrum from the run itself, as an autoregressive process that whitens it.

The error of an axis has little power at high frequencies, unlike the laser and a vibrating machine. From the frequency
at which the spectrum (Welch, Hann) has fallen to the level of its flat part, all of it is noise. Below, the noise is
assumed to continue at the level just above; one run cannot contradict this. Two runs of one direction can: half the
spectrum of their difference is noise at every frequency, and the larger of both counts. The process follows from the
autocovariance of the spectrum (Yule-Walker), its order from BIC.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.linalg import solve_toeplitz
from scipy.signal import detrend, welch

from calibration.continuous.error_curve import Course
from kinematics.transforms import Array

LEAST_SPECTRUM_PARTS = 8
"""Least number of parts of a course for its spectrum; they overlap by half their length."""
LONGEST_PART = 2048
ORDERS = (0, 1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64)
FLAT_SPECTRUM_RATIO = 2.0
"""Ratio to the level of the flat part, below which the spectrum belongs to it."""
ABOVE = 3.0
"""Upper end, as a multiple of the edge, of the band whose level is the noise below the edge."""
PEAK = 4.0
"""Ratio to the level of the flat part, above which a part of the spectrum is a vibration."""


class Noise(NamedTuple):
    """Noise of the blocks of one course, um."""

    filter: Array
    """Coefficients 1, a1 ... ap of the innovation: difference of a block from its prediction by the p blocks before."""
    innovation: float
    """Standard deviation of the innovation, um."""
    total: float
    """Standard deviation of the noise, um."""
    low: float
    """One-sided spectral density at low frequencies, um2/Hz, which limits the estimated curve."""
    vibrations: tuple[tuple[float, float], ...]
    """Frequency, Hz, and amplitude, um, of the peaks of the spectrum."""

    @property
    def order(self) -> int:
        """Order p of the process."""
        return len(self.filter) - 1

    def scaled(self, factor: float) -> Noise:
        """Noise of the same spectrum, `factor` times as large."""
        return self._replace(
            innovation=self.innovation * factor, total=self.total * factor, low=self.low * factor * factor
        )


def noise_of_course(course: Course, error: Array, difference: Array | None = None) -> Noise:
    """The noise of a course whose errors `(n,)`, um, are free of jumps and waves.

    difference `(n,)`: half the difference from another run at the same positions, times sqrt(2), um.
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
    """Values on the whole time raster, with gaps interpolated linearly."""
    slots = course.slot - course.slot[0]
    if slots[-1] + 1 == len(slots):
        return values
    return np.interp(np.arange(slots[-1] + 1), slots, values)


def _spectrum(values: Array, period: float) -> tuple[Array, Array]:
    """Frequencies, Hz, and one-sided density `(m,)`, um2/Hz."""
    part = min(len(values) // LEAST_SPECTRUM_PARTS * 2, LONGEST_PART)
    frequency, density = welch(values, 1.0 / period, "hann", part, detrend=detrend)
    density[0] = density[1]
    return np.asarray(frequency), np.maximum(density, 1e-15)


def _edge(frequency: Array, density: Array, flat: float) -> float:
    """The frequency, Hz, below which the error of the axis dominates: first two bins at the level of the flat part."""
    low = density <= FLAT_SPECTRUM_RATIO * flat
    both = np.flatnonzero(low[:-1] & low[1:])
    return float(frequency[both[0] if len(both) else len(frequency) // 2])


def _autoregression(covariance: Array, n: int) -> tuple[Array, float]:
    """Filter and innovation variance, of the order with the smallest BIC."""
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
    """Frequency, Hz, and amplitude, um, of peaks of the spectrum above the flat part, strongest first."""
    out = (density > PEAK * flat) & (frequency > ABOVE * edge)
    bounds = np.flatnonzero(np.diff(np.concatenate([[0], out.astype(int), [0]])))
    step, found = frequency[1] - frequency[0], []
    for first, stop in zip(bounds[::2].tolist(), bounds[1::2].tolist(), strict=True):
        part = slice(first, stop)
        power = float(density[part].sum() * step)
        centre = float((frequency[part] * density[part]).sum() / density[part].sum())
        found.append((centre, float(np.sqrt(2.0 * power))))
    return tuple(sorted(found, key=lambda each: -each[1])[:5])
