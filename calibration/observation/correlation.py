"""Correlation of residuals along the order of the rows."""

from __future__ import annotations

import numpy as np

from kinematics.transforms import Array

UNSEEN = 1e-12
"""Least length of a signal that has a direction."""
CHANCE = 2.5
"""Standard deviations of an autocorrelation up to which it counts as noise."""


def lines_of(signal: Array) -> Array:
    """Unit vectors `(n, d)` along a signal `(n, d)`, of any sign: each turned to the side of the one before."""
    lines = signal / np.maximum(np.linalg.norm(signal, axis=1, keepdims=True), UNSEEN)
    turned = np.sum(lines[1:] * lines[:-1], axis=1) < 0.0
    return np.asarray(lines * np.cumprod(np.append(1.0, np.where(turned, -1.0, 1.0)))[:, None])


def correlation_length(residual: Array) -> float:
    """Integrated autocorrelation, in rows, of white residuals `(n, d)` in the order of the rows; at least 1.

    Sums of two successive autocorrelations are added up to the first that noise may have (Geyer, Statist. Sci. 7, 1992,
    section 3.3).
    """
    n = len(residual)
    spectrum = np.sum(np.abs(np.fft.rfft(residual, 2 * n, axis=0)) ** 2, axis=1)
    covariance = np.fft.irfft(spectrum)[:n]
    if not covariance[0] > 0.0 or n < 3:
        return 1.0
    pairs = covariance[1 : 1 + 2 * ((n - 1) // 2)].reshape(-1, 2).sum(axis=1) / covariance[0]
    noise = CHANCE * np.sqrt(2.0 / residual.size)
    return float(1.0 + 2.0 * pairs[: int(np.argmax(np.append(pairs < noise, True)))].sum())
