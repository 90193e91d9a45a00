"""Distance and time over which a reversal spike decays at each feed.

A spike of the control keeps its time, one of the mechanics its distance.

On a circle of radius r at feed v an axis has moved the distance s after its reversal in the time sqrt(2 r s) / v.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from calibration.circles.candidates import feeds_of, spike_columns, time_of
from calibration.measurement.measurement import Measurement
from kinematics.transforms import Array

STEP = 0.02
"""Step of the logarithm of a distance for its uncertainty."""
SAME_KEPT = 2.0
"""Difference of two feeds in standard deviations up to which they agree."""


@dataclass(frozen=True)
class SpikeAtFeed:
    """The decay of a spike at one feed."""

    feed: float
    """mm/min."""
    way_mm: float
    U_way: float
    """Expanded uncertainty, k = 2, mm."""
    time_ms: float
    U_time: float
    """Expanded uncertainty, k = 2, ms."""

    def json(self) -> dict[str, Any]:
        """For programs."""
        return {
            "feed_mm_min": self.feed,
            "way_mm": self.way_mm,
            "way_U_mm": self.U_way,
            "time_ms": self.time_ms,
            "time_U_ms": self.U_time,
        }


def spikes_by_feed(
    measurement: Measurement,
    transform: Array,
    rows: np.ndarray,
    axis: str,
    ways: Array,
    others: Array,
    deviation: Array,
    noise_um: float,
) -> tuple[SpikeAtFeed, ...]:
    """The decay at each feed, distances and heights free at each; none with one feed.

    ways: first guess by feed in ascending order, mm; others: orthonormal columns `(n, m)` of all other causes.
    """
    from scipy.optimize import minimize

    feeds = feeds_of(measurement, rows)
    if len(feeds) < 2:
        return ()
    target = deviation - others @ (others.T @ deviation)

    def loss(logarithms: Array) -> float:
        """Sum of squares, um^2, that spikes with these decays, ln mm by feed, leave of the deviation."""
        columns = np.concatenate(
            [
                spike_columns(measurement, transform, rows, axis, {feed: float(np.exp(value))})
                for feed, value in zip(feeds, logarithms.tolist(), strict=True)
            ],
            axis=1,
        )
        columns = columns - others @ (others.T @ columns)
        left = target - columns @ np.linalg.lstsq(columns, target)[0]
        return float(left @ left)

    best = minimize(loss, np.log(ways), method="Nelder-Mead", options={"xatol": 1e-3, "fatol": 1e-4 * noise_um**2})
    sizes = np.sqrt(np.maximum(np.diag(_inverse(loss, best.x)), 0.0)) * noise_um * 2.0**0.5
    found = []
    for feed, logarithm, size in zip(feeds, best.x.tolist(), sizes.tolist(), strict=True):
        way = float(np.exp(logarithm))
        time = time_of(measurement, feed, way)
        found.append(SpikeAtFeed(feed, way, 2.0 * size * way, time, size * time))
    return tuple(found)


def kept(spikes: Sequence[SpikeAtFeed]) -> str:
    """`time`, `way`, `both` where these data do not part them, `neither`; empty with one feed."""
    if len(spikes) < 2:
        return ""
    first, last = spikes[0], spikes[-1]
    if any(each.U_way > each.way_mm for each in (first, last)):  # shorter than the distance of rows
        return "both"
    u = np.hypot(first.U_way / first.way_mm, last.U_way / last.way_mm) / 2.0
    by_way = abs(np.log(last.way_mm / first.way_mm)) <= SAME_KEPT * u
    by_time = abs(np.log(last.time_ms / first.time_ms)) <= SAME_KEPT * u / 2.0
    return {(True, True): "both", (True, False): "way", (False, True): "time"}.get((by_way, by_time), "neither")


def _inverse(loss: Any, at: Array) -> Array:
    """Inverse of the second derivatives of a loss at its minimum."""
    k = len(at)
    hessian = np.zeros((k, k))
    e = np.eye(k) * STEP
    for i in range(k):
        for j in range(i, k):
            corners = [loss(at + a * e[i] + b * e[j]) * a * b for a in (1.0, -1.0) for b in (1.0, -1.0)]
            hessian[i, j] = hessian[j, i] = sum(corners) / (4.0 * STEP**2)
    return np.asarray(np.linalg.pinv(hessian))
