"""The trend of one quantity: its changes, its present value, its forecast, and when it leaves its limit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from history.trends.changes import Found, found_in
from history.trends.forecast import Forecast, forecast
from history.trends.limits import Leaving, leaving
from history.trends.model import likeliest
from history.trends.series import Series, day_of
from kinematics.error_model.priors import Priors

FEWEST_RESULTS = 3
"""Fewest results of a trend: from two, a change cannot be told from the scatter of the machine."""
AHEAD_YEARS, A_YEAR = 2.0, 52
"""Length of a forecast, and its times in a year."""


@dataclass(frozen=True)
class Trend:
    """The trend of a quantity."""

    series: Series
    """The results."""
    scatter: float
    """Standard deviation of the machine from result to result: root of the mean variance."""
    changes: tuple[Found, ...]
    """Changes, a slow change and offsets of methods, announced and likely ones."""
    ahead: Forecast
    """From now on, or from the last result if that is later."""
    leaves: Leaving | None
    """None without a limit."""

    def json(self) -> dict[str, Any]:
        """For programs; times as dates, U with k = 2."""
        low, high = self.ahead.band
        points = zip(self.series.times, self.series.values, self.series.u, self.series.methods, self.series.entries,
                     strict=True)  # fmt: skip
        return {
            "name": self.series.name, "unit": self.series.unit,
            "results": [
                {"date": day_of(t).isoformat(), "value": float(y), "U": 2.0 * float(u), "method": m, "entry": n}
                for t, y, u, m, n in points
            ],
            "scatter": self.scatter, "changes": [each.json() for each in self.changes],
            "now": {"value": float(self.ahead.mean[0]), "U": 2.0 * float(self.ahead.u[0])},
            "forecast": [
                {"date": day_of(t).isoformat(), "value": float(y), "low": float(a), "high": float(b)}
                for t, y, a, b in zip(self.ahead.times, self.ahead.mean, low, high, strict=True)
            ],
            "leaves": None if self.leaves is None else self.leaves.json(),
        }  # fmt: skip


def trends_of(
    series: Sequence[Series], priors: Priors, now: float, limits: Mapping[str, float]
) -> tuple[list[Trend], list[Series]]:
    """The trends of all quantities, and the series that are too short for one."""
    found = [_trend(each, priors, now, limits.get(each.name)) for each in series if len(each.times) >= FEWEST_RESULTS]
    return found, [each for each in series if len(each.times) < FEWEST_RESULTS]


def _trend(series: Series, priors: Priors, now: float, limit: float | None) -> Trend:
    structure = likeliest(series, priors)
    begin = max(now, float(series.times[-1]))
    ahead = forecast(structure, begin + np.arange(int(AHEAD_YEARS * A_YEAR) + 1) / A_YEAR)
    leaves = None if limit is None else leaving(structure, ahead, limit)
    return Trend(series, float(np.sqrt(structure.scatter)), tuple(found_in(structure)), ahead, leaves)
