"""The rows of a fit on which candidates are evaluated."""

from __future__ import annotations

import numpy as np

from calibration.fit.fit import Fit
from calibration.observation.stops_and_lines import whole_stops

ROWS, LEAST_ROWS = 5000, 1500
"""Largest number of rows, evenly spread, on which candidates are evaluated, for few and for many parameters.

All rows enter the fits."""
ENTRIES = 2_000_000
"""Largest number of entries of the design with more than LEAST_ROWS rows."""
ASTRAY = 300.0
"""Median residual, um, above which a rejected station has failed; below it, the model may be at fault."""
LOST = 5000.0
"""Residual, um, above which an outlier is excluded: no cause of the library is so large."""


def evaluated_rows(fit: Fit) -> np.ndarray:
    """Rows `(n,)` of the measurement: outliers too, but no copies, no impossible ones, and none of failed stations."""
    measurement = fit.measurement
    lost = ~fit.kept & (fit.residual_um > LOST)
    rows = np.flatnonzero(~fit.copies & ~lost & ~np.isin(measurement.groups, _astray(fit)))
    most = _most_rows(fit)
    return rows if len(rows) <= most else rows[whole_stops(measurement.stops[rows], most)]


def _most_rows(fit: Fit) -> int:
    """Largest number of rows on which candidates are evaluated."""
    width = fit.measurement.components * (len(fit.model.parameters) + len(fit.registration.names))
    return min(ROWS, max(LEAST_ROWS, ENTRIES // width))


def _astray(fit: Fit) -> list[str]:
    """Stations that failed by more than a deficient model may cause."""
    groups = fit.measurement.groups
    return [name for name in fit.failed if np.median(fit.residual_um[groups == name]) > ASTRAY]
