"""Outliers: rows that do not agree with the others are found, listed and left out of the fit.

The rule: d2 is the squared Mahalanobis distance of a row's residual by the instrument's covariance, times a robust
variance factor of the whole (from the median of all d2; at least 1 where the specification holds). A row is an outlier
when so large a d2 occurs in fewer than one of a hundred such measurements with noise alone (Bonferroni, chi2 with the
row's components). During the iterations of the fit, rows have Huber's weights instead. A station most of whose rows are
outliers has failed as a whole and is left out, unless such stations hold more than half of the rows.

At most `OUTLIER_SHARE` of the other rows are left out. If more rows disagree, the model is at fault and not single
rows: a fit without them would have small residuals because it leaves out the rows that it cannot explain. Then all rows
stay, and count fully in every figure; the fit keeps Huber's weights.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np
from scipy import special

from calibration.instruments.of_points import LINE_RMS_MM, width
from calibration.measurement.measurement import Measurement
from calibration.registration.registration import RIGID
from kinematics.transforms import Array
from kinematics.user_error import UserError

Variance = Literal["sheet", "estimate"]
"""Variance of the instrument's noise: from its specification, or that times a factor from the residuals."""
FALSE_OUTLIER_PROBABILITY = 0.01
"""Probability that a measurement of n rows without outliers has a row rejected."""
FULL_WEIGHT_SHARE = 0.95
"""Share of good rows that keep their full weight."""
FAILED = 0.5
"""Share of outliers among the rows of a station above which it has failed; largest share of rows of such stations."""
OUTLIER_SHARE = 0.05
"""Largest share of rows that are left out as outliers; a single row may always be."""


class LeftOut(NamedTuple):
    """Rows that the fit leaves out, and rows that it would leave out if they were fewer."""

    rows: np.ndarray
    """True `(n,)` for outliers, rows of failed stations and copies."""
    failed: tuple[str, ...]
    """Stations that failed as a whole."""
    suspected: np.ndarray
    """True `(n,)` for rows that disagree with the others but stay, because they are more than `OUTLIER_SHARE`."""

    @classmethod
    def of(cls, measurement: Measurement, outlying: np.ndarray, *, stay: bool = False) -> LeftOut:
        """Rows to leave out, of those `outlying` `(n,)`; stay: all rows but copies and failed stations stay."""
        copies = measurement.copies
        failed = failed_stations(measurement.groups, outlying)
        lost = np.isin(measurement.groups, failed)
        if lost.mean() > FAILED:
            failed, lost = [], np.zeros(len(lost), bool)
        single = outlying & ~lost
        if stay or too_many(int(single.sum()), int(np.count_nonzero(~copies & ~lost))):
            return cls(copies | lost, tuple(failed), single)
        return cls(copies | lost | single, tuple(failed), np.zeros(len(lost), bool))


def too_many(lost: int, rows: int) -> bool:
    """True where more of the rows are lost than may be left out."""
    return lost > max(1.0, OUTLIER_SHARE * rows)


def robust_factor(
    distances: Array, components: int, effective_parameters: float, least: float, stop: np.ndarray
) -> float:
    """Variance factor, at least `least`, that brings the median of squared distances `(n,)` to that of chi2.

    effective_parameters: degrees of freedom that the fit took out of the residuals. stop: number `(n,)` of the stop of
    each row; all stops count alike, since a long standstill contains no more about the motion than a short one.
    """
    scalars = distances.size * components
    share = (
        _median(distances, 1.0 / np.bincount(stop)[stop])
        / float(special.chdtri(components, 0.5))
        * scalars
        / max(scalars - effective_parameters, 1.0)
    )
    return max(share, least)


def _median(values: Array, weights: Array) -> float:
    """Median of values `(n,)` with weights `(n,)`: half of the weight lies on either side."""
    order = np.argsort(values)
    below = np.cumsum(weights[order])
    low, high = np.searchsorted(below, np.array([0.5 - 1e-12, 0.5 + 1e-12]) * below[-1])
    return float(values[order[[low, min(high, len(values) - 1)]]].mean())


def huber_weights(distances: Array, components: int, factor: float) -> Array:
    """Weights `(n,)` of rows with these squared distances."""
    limit = special.chdtri(components, 1.0 - FULL_WEIGHT_SHARE) * factor
    return np.asarray(np.sqrt(limit / np.maximum(distances, limit)))


def outlying(distances: Array, components: int, factor: float) -> np.ndarray:
    """True `(n,)` for outliers, by the rule of this module."""
    return np.asarray(distances > largest_distance(len(distances), components) * factor)


def largest_distance(rows: int, components: int) -> float:
    """Squared distance from which one of so many rows is an outlier."""
    return float(special.chdtri(components, FALSE_OUTLIER_PROBABILITY / max(rows, 1)))


def failed_stations(groups: np.ndarray, bad: np.ndarray) -> list[str]:
    """Names of the groups `(n,)` most of whose rows are bad; none where there is only one group."""
    names = np.unique(groups).tolist()
    return [name for name in names if bad[groups == name].mean() > FAILED] if len(names) > 1 else []


def refuse_lines(measurement: Measurement) -> None:
    """UserError where a station observed points on one line only: its rotation about the line is undetermined."""
    if measurement.instrument.moves != RIGID:
        return
    points, groups = measurement.nominal_points, measurement.groups
    for name in np.unique(groups).tolist():
        mine = points[groups == name]
        if len(mine) > 2 and np.ptp(mine, axis=0).max() > LINE_RMS_MM > width(mine):
            raise UserError(
                f"{measurement.source}: all points of station {name} lie on one line: the rotation of the instrument "
                "about it is unidentifiable, and errors across it would get wrong directions. Measure some points off "
                "the line"
            )
