"""What every measurement contains: the error motions of each axis that moves, and the unknown side of its first move.

Error motions are Legendre polynomials of a high degree, or harmonics of a whole turn. No basis is chosen: the
coefficients of a band of degrees share one size, which the data decide.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.gaussian_terms.observations import Observations
from calibration.gaussian_terms.priors import BANDS, FALL, FIRST_SIDE, MOTION
from calibration.measurement.measurement import Measurement
from calibration.observation.full_model import BasisChoice, axis_motions
from kinematics.effects import Effect, UnknownApproach
from kinematics.transforms import Array
from kinematics.turn import gap_of

DEGREE, HARMONICS = 20, 8
"""Largest degree of an error motion over an interval, and its harmonics over a whole turn."""


@dataclass(frozen=True)
class Geometry:
    """Columns that are always present, in units of their prior sizes, and the bands whose columns share a size."""

    effects: tuple[Effect, ...]
    columns: Array
    """`(n, d, p)`"""
    scales: Array
    """Prior sizes `(p,)` of the parameters, in their units."""
    bands: np.ndarray
    """Number `(p,)` of the band of each column."""
    coarser: np.ndarray
    """Number of the next coarser band of each band; -1 for the coarsest one of an axis."""
    fixed: np.ndarray
    """True for each band whose size is not fitted."""

    @property
    def first_sizes(self) -> Array:
        """Sizes of the bands before any fit, in prior sizes."""
        return np.where(self.fixed, FIRST_SIDE, 1.0)


def geometry(observations: Observations) -> Geometry:
    """The geometry of the axes that move in the observations."""
    measurement = observations.measurement
    effects: list[Effect] = []
    scales, keys = [], []
    for effect, degrees in _motions(measurement):
        effects.append(effect)
        scales.append(MOTION / np.maximum(degrees, 1) ** FALL)
        keys += [(effect.axes[0], effect.angular, _band(degree)) for degree in degrees.tolist()]
    for side in _first_sides(measurement):
        effects.append(side)
        scales.append(np.array(side.typical))
        keys.append((side.name, False, -1))
    known = list(dict.fromkeys(keys))
    coarser = [known.index((*key[:2], key[2] - 1)) if (*key[:2], key[2] - 1) in known else -1 for key in known]
    sizes = np.concatenate(scales)
    return Geometry(
        tuple(effects),
        observations.columns(effects) * sizes,
        sizes,
        np.array([known.index(key) for key in keys]),
        np.array(coarser),
        np.array([key[2] < 0 for key in known]),
    )


def _band(degree: int) -> int:
    return next(number for number, (low, high) in enumerate(BANDS) if low <= degree <= high)


def _motions(measurement: Measurement) -> list[tuple[Effect, np.ndarray]]:
    """The error motions that the instrument observes, and the degree of each of their columns `(size,)`."""
    found = []
    for axis, arc in measurement.moving.items():
        own = measurement.machine.axes[measurement.machine.index(axis)]
        closed = own.turns_fully and not gap_of(arc)
        degree = min(DEGREE, measurement.distinct_positions[axis] + 1)
        choice = BasisChoice("fourier", HARMONICS) if closed else BasisChoice("legendre", degree)
        for effect in axis_motions(measurement, axis, choice):
            found.append((effect, degrees_of(len(effect.parameters), closed=closed)))
    return found


def degrees_of(size: int, *, closed: bool) -> np.ndarray:
    """Degree, or order of the harmonic, of each function `(size,)` of a basis."""
    return (np.arange(size) + 1) // 2 if closed else np.arange(size)


def _first_sides(measurement: Measurement) -> list[UnknownApproach]:
    """Errors of the axes that had not moved before the first rows."""
    approach = measurement.state.approach
    if approach is None:
        return []
    unknown = [axis for axis in measurement.moving if np.any(approach[:, measurement.machine.index(axis)] == 0.0)]
    return [UnknownApproach(axis=axis, offset=0.0) for axis in unknown]
