"""Mean lines: of a function in a basis, and of an axis' translations at the centre of the measured points.

The sizes of the parameters of a function for a size of its slope are here too.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from kinematics.basis import Basis, Fourier
from kinematics.effects import COMPONENTS, CentredMotion, Effect, ErrorMotion
from kinematics.transforms import Array

SLOPING = 1e-6
"""Part in the slope, as a share of the largest one, from which a parameter counts."""

KEPT_LINES = 64
"""Lines that are kept: a machine has a few bases, each of which is asked for by every pair of its error motions."""


class Line(NamedTuple):
    """Mean and slope of a function of position over its interval, as linear functions of its parameters."""

    mean: Array
    """Mean `(size,)`."""
    slope: Array
    """Slope `(size,)`, per mm or degree."""


@lru_cache(maxsize=KEPT_LINES)
def mean_line(basis: Basis) -> Line:
    """The least squares line through a function in this basis; its arrays cannot be written to."""
    low, high = basis.interval
    x = np.linspace(low, high, 801)
    columns, centred = basis.columns(x), x - x.mean()
    found = Line(columns.mean(axis=0), centred @ columns / (centred @ centred))
    for each in found:
        each.flags.writeable = False
    return found


def sizes_for_slope(basis: Basis, slope: float) -> Array:
    """Standard deviations `(size,)` of independent parameters whose mean line has a slope of this standard deviation.

    They are in proportion to the parts of the parameters in the slope: zero for those without a part in it, and for
    waves. Beside waves a line begins at zero: the constant may have its mean.
    """
    if isinstance(basis, Fourier):
        line = mean_line(basis)
        own = np.eye(basis.size)[1] + np.eye(basis.size)[0] * line.mean[1]
        return np.asarray(slope * own / line.slope[1])
    parts = np.abs(mean_line(basis).slope)
    parts[parts < SLOPING * parts.max(initial=0.0)] = 0.0
    return np.asarray(slope * parts / np.sqrt(np.sum(parts**4)))


def centred(effects: Sequence[Effect], arms: Mapping[str, Array]) -> tuple[Effect, ...]:
    """The effects with angular error motions of linear axes about the centre of the measured points.

    arms: as `arms_of`. Only for axes whose error motions are all there in one basis, so that the same error is one
    about the axis' own point (`about_own_points`).
    """
    motions = [effect for effect in effects if isinstance(effect, ErrorMotion)]
    bases = {axis: {each.basis for each in motions if each.axis == axis} for axis in arms}
    whole = [axis for axis, own in bases.items() if len(own) == 1 and _all_six(motions, axis)]
    return tuple(
        CentredMotion(each.component, each.axis, each.basis, each.parameters, u=each.u, about=point_of(arms[each.axis]))
        if isinstance(each, ErrorMotion) and each.angular and each.axis in whole
        else each
        for each in effects
    )


def _all_six(motions: Sequence[ErrorMotion], axis: str) -> bool:
    return sorted(each.component for each in motions if each.axis == axis) == sorted(COMPONENTS)


def point_of(arms: Array) -> tuple[float, float, float]:
    """The point `(3,)`, mm, with these arms."""
    # a turn about B moves a point at height z along X by z
    return float(arms[1, 2]), float(arms[2, 0]), float(arms[0, 1])
