"""The mean line of a function in a basis, and the sizes of its parameters for a size of its slope."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from kinematics.basis import Basis
from kinematics.transforms import Array

SLOPING = 1e-6
"""Part in the slope, as a share of the largest one, from which a parameter counts."""


class Line(NamedTuple):
    """Mean and slope of a function of position over its interval, as linear functions of its parameters."""

    mean: Array
    """Mean `(size,)`."""
    slope: Array
    """Slope `(size,)`, per mm or degree."""


def mean_line(basis: Basis) -> Line:
    """The least squares line through a function in this basis."""
    low, high = basis.interval
    x = np.linspace(low, high, 801)
    columns, centred = basis.columns(x), x - x.mean()
    return Line(columns.mean(axis=0), centred @ columns / (centred @ centred))


def sizes_for_slope(basis: Basis, slope: float) -> Array:
    """Standard deviations `(size,)` of independent parameters whose mean line has a slope of this standard deviation.

    They are in proportion to the parts of the parameters in the slope: zero for those without a part in it.
    """
    parts = np.abs(mean_line(basis).slope)
    parts[parts < SLOPING * parts.max(initial=0.0)] = 0.0
    return np.asarray(slope * parts / np.sqrt(np.sum(parts**4)))
