"""What every measurement contains: the error motions of each axis that moves, and the unknown side of its first move.

Error motions are Legendre polynomials of a high degree, or harmonics of a whole turn. No basis is chosen: the
coefficients of a band of degrees share one size, which the data decide. Where a calibration is given, its parameters
take the place of the error motions of its axes, with their covariance as prior.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple, cast

import numpy as np
from scipy.linalg import block_diag

from calibration.gaussian_terms.observations import Observations
from calibration.measurement.measurement import Measurement
from calibration.observation.full_model import BasisChoice, axis_motions
from kinematics.effects import Effect, ErrorMotion, UnknownApproach
from kinematics.effects.base import own_component
from kinematics.error_model.model import ErrorModel
from kinematics.error_model.priors import BANDS
from kinematics.transforms import Array
from kinematics.turn import gap_of

DEGREE, HARMONICS = 20, 8
"""Largest degree of an error motion over an interval, and its harmonics over a whole turn."""

KNOWN = 1e-12
"""Share of the largest variance of a calibration, in squares of its uncertainties, below which one is rounding."""
Key = tuple[str, str, int]
"""Band: axis, kind of error motion, and number; numbers below 0 are of sizes that are not fitted."""
WAVY = 2
"""Number of the coarsest band that may contain a periodic error."""
FIRST = -1
"""Number of the band of an error before the first move of an axis."""
CALIBRATED: Key = ("", "", -2)
"""Band of the parameters of a given calibration: their covariance is their size."""


@dataclass(frozen=True)
class Geometry:
    """Columns that are always present, in units of their prior sizes, and the bands whose columns share a size."""

    effects: tuple[Effect, ...]
    """Those of a given calibration first."""
    columns: Array
    """`(n, d, p)`"""
    parameters: Array
    """Parameters of the effects, one after the other, by the coefficients of the columns `(P, p)`."""
    before: Array
    """Parameters `(P,)` without any data: those of a given calibration, else 0."""
    bands: np.ndarray
    """Number `(p,)` of the band of each column."""
    coarser: np.ndarray
    """Number of the next coarser band of each band; -1 for the coarsest one of an axis."""
    falls: Array
    """Size of the coarser band, in prior sizes, at which both have coefficients of equal size, for a size of 1."""
    fixed: np.ndarray
    """True for each band whose size is not fitted."""
    first_sizes: Array
    """Sizes of the bands before any fit, in prior sizes."""
    wavy: np.ndarray
    """True for each band whose functions have two waves or more over the travel, as a periodic error has."""

    @classmethod
    def none(cls, observations: Observations) -> Geometry:
        """No columns: all that may be in the observations is a term."""
        nothing, no_band = np.zeros(0), np.zeros(0, bool)
        columns = np.zeros((*observations.residual.shape, 0))
        number = np.zeros(0, int)
        return cls((), columns, np.zeros((0, 0)), nothing, number, number, nothing, no_band, nothing, no_band)

    @property
    def width(self) -> int:
        """Number p of columns."""
        return len(self.bands)

    def values(self, mean: Array) -> Array:
        """Parameters `(P,)` of the effects by the coefficients of the columns `(p,)`."""
        return np.asarray(self.before + self.parameters @ mean)


class _Part(NamedTuple):
    """Some columns of a geometry."""

    effect: Effect
    scales: Array
    """Prior sizes of its parameters."""
    keys: list[Key]
    """Band of each of its columns."""


def geometry(observations: Observations) -> Geometry:
    """The geometry of the axes that move in the observations."""
    given, parts = observations.given, list(_parts(observations))
    effects = (*(given.effects if given else ()), *(part.effect for part in parts))
    root = root_of(given) if given else np.zeros((0, 0))
    sizes = np.concatenate([np.zeros(0), *(part.scales for part in parts)])
    keys = [CALIBRATED] * root.shape[1] + [key for part in parts for key in part.keys]
    known = list(dict.fromkeys(keys))
    coarser = [known.index((*key[:2], key[2] - 1)) if (*key[:2], key[2] - 1) in known else -1 for key in known]
    columns = observations.columns(effects)
    of_given = columns[:, :, : len(root)] @ root
    return Geometry(
        effects,
        np.concatenate([of_given, columns[:, :, len(root) :] * sizes], axis=2),
        block_diag(root, np.diag(sizes)),
        np.concatenate([given.parameters if given else np.zeros(0), np.zeros(len(sizes))]),
        np.array([known.index(key) for key in keys], int),
        np.array(coarser, int),
        np.array([_fall(key[2]) ** observations.priors.smoothness for key in known]),
        np.array([key[2] < 0 for key in known], bool),
        np.array([observations.priors.first_side if key[2] == FIRST else 1.0 for key in known]),
        np.array([key[2] >= WAVY for key in known], bool),
    )


def root_of(model: ErrorModel) -> Array:
    """A root R `(P, r)` of the covariance R R' of a model's parameters, in their units."""
    u = np.array([value for effect in model.effects for value in effect.uncertainties])
    if model.covariance is None:
        return np.diag(u)[:, u > 0.0]
    covariance = np.array(model.covariance)
    unit = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    safe = np.where(unit > 0.0, unit, 1.0)
    values, vectors = np.linalg.eigh(covariance / safe[:, None] / safe)
    kept = values > KNOWN * max(float(values.max(initial=0.0)), 1.0)
    return np.asarray(unit[:, None] * vectors[:, kept] * np.sqrt(values[kept]))


def _parts(observations: Observations) -> Iterator[_Part]:
    """What no calibration has: error motions of its other axes, and the sides of the first moves."""
    measurement, given = observations.measurement, observations.given
    calibrated = {motion.axis for motion, _ in given.error_motions} if given else set()
    for effect, degrees in motions(measurement):
        if effect.axes[0] not in calibrated:
            keys = [(effect.axes[0], _kind(effect), _band(degree)) for degree in degrees.tolist()]
            yield _Part(effect, prior_sizes(observations, degrees), keys)
    for side in _first_sides(measurement):
        yield _Part(side, observations.priors.typical * np.array(side.typical), [(side.name, "", FIRST)])


def prior_sizes(observations: Observations, degrees: np.ndarray) -> Array:
    """Prior sizes `(m,)` of the coefficients of an error motion, um or urad, by their degrees."""
    priors = observations.priors
    return np.asarray(priors.error_motion_um / np.maximum(degrees, 1) ** priors.smoothness)


def _kind(effect: ErrorMotion) -> str:
    """The kind of an error motion: a scale or a screw positions the axis, guides and bearings keep it straight."""
    if effect.component == own_component(effect.axis):
        return "positioning"
    return "angular" if effect.angular else "straightness"


def _fall(band: int) -> float:
    """Degree of the next coarser band, as a share of that of a band; 0 for bands that have none."""
    if band < 1:
        return 0.0
    coarser, finer = (max(low, 1) for low, _ in BANDS[band - 1 : band + 1])
    return coarser / finer


def _band(degree: int) -> int:
    return next(number for number, (low, high) in enumerate(BANDS) if low <= degree <= high)


def motions(measurement: Measurement) -> list[tuple[ErrorMotion, np.ndarray]]:
    """The error motions that the instrument observes, and the degree of each of their columns `(size,)`."""
    found: list[tuple[ErrorMotion, np.ndarray]] = []
    for axis, arc in measurement.moving.items():
        own = measurement.machine.axes[measurement.machine.index(axis)]
        closed = own.turns_fully and not gap_of(arc)
        choice = BasisChoice("fourier", HARMONICS) if closed else BasisChoice("legendre", DEGREE)
        for effect in axis_motions(measurement, axis, choice):
            found.append((cast(ErrorMotion, effect), degrees_of(len(effect.parameters), closed=closed)))
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
