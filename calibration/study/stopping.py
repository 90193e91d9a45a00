"""Stopping rule of a study: the adaptive procedure of GUM Supplement 1 (JCGM 101:2008, 7.9)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from kinematics.transforms import Array

LEVEL = 0.95
FEWEST_BATCHES = 3
"""Smallest number of batches: two hardly determine their scatter."""


class Estimates(NamedTuple):
    """Estimates from the results of draws, um, that have to converge."""

    mean: float
    deviation: float
    quantile: float
    """The 95 % quantile."""


def estimates(values: Array) -> Estimates:
    """Mean, standard deviation and quantile of the results `(draws,)`."""
    return Estimates(float(values.mean()), float(values.std(ddof=1)), float(np.quantile(values, LEVEL)))


def uncertainties(batches: Sequence[Array]) -> Estimates:
    """Standard uncertainties of the estimates, from their scatter over batches of draws (7.9.4 e)."""
    each = np.array([estimates(batch) for batch in batches])
    return Estimates(*(each.std(axis=0, ddof=1) / np.sqrt(len(each))).tolist())


def enough(batches: Sequence[Array], tolerance: float) -> bool:
    """True when twice the standard uncertainty of each estimate is within the tolerance (7.9.4 f)."""
    return len(batches) >= FEWEST_BATCHES and 2.0 * max(uncertainties(batches)) <= tolerance
