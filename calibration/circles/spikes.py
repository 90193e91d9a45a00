"""Distance and time over which a reversal spike decays at each feed.

A spike of the control keeps its time, one of the mechanics its distance.

On a circle of radius r at feed v an axis has moved the distance s after its reversal in the time sqrt(2 r s) / v.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from calibration.circles.terms import feeds_of, spike_by_feed, time_of, ways_of
from calibration.diagnosis.candidates import Candidates

SHORTEST_SPIKE_MM, LONGEST_SPIKE_MM = 1e-3, 10.0
"""Range of the distances: from far below that of rows, to a tenth of the axes' travel on a small circle."""
TRIED_DISTANCES, CLOSER_PASSES = 25, 4
"""Distances that are tried at a time, and how often closer ones."""
NEXT_PASS_SIGMA = 4.0
"""Standard deviations on either side of the mean that the distances of the next pass cover."""
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


def spikes_by_feed(candidates: Candidates, number: int) -> tuple[SpikeAtFeed, ...]:
    """The decay at each feed of a spike, by its number among the terms, heights free at each; none with one feed."""
    measurement = candidates.structure.data.observations.measurement
    feeds = feeds_of(measurement)
    if len(feeds) < 2:
        return ()
    found = []
    for feed in feeds:
        mean, u = _logarithm(candidates, number, feed)
        way = float(np.exp(mean))
        time = time_of(measurement, feed, way)
        found.append(SpikeAtFeed(feed, way, 2.0 * u * way, time, u * time))
    return tuple(found)


def _logarithm(candidates: Candidates, number: int, feed: float) -> tuple[float, float]:
    """Posterior mean and standard deviation of the logarithm of a distance, mm, at one feed, beside the others."""
    structure = candidates.structure
    observations, term = structure.data.observations, structure.terms[number]
    axis, ways = str(term.where), ways_of(observations.measurement, term)
    elsewhere = spike_by_feed(observations, axis, {other: way for other, way in ways.items() if other != feed})
    beside = candidates.beside((*(each for each in structure.terms if each is not term), elsewhere))
    tried = np.linspace(np.log(SHORTEST_SPIKE_MM), np.log(LONGEST_SPIKE_MM), 2 * TRIED_DISTANCES)
    for _ in range(CLOSER_PASSES):
        odds = beside.exact([spike_by_feed(observations, axis, {feed: way}) for way in np.exp(tried).tolist()])
        weights = np.exp(odds - odds.max())
        mean = float(weights @ tried / weights.sum())
        u = float(np.sqrt(weights @ (tried - mean) ** 2 / weights.sum()))
        reach = NEXT_PASS_SIGMA * max(u, float(tried[1] - tried[0]) / 2.0)
        tried = np.linspace(mean - reach, mean + reach, TRIED_DISTANCES)
    return mean, u


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
