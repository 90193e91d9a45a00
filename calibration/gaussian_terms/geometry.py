"""What every measurement contains: the error motions of each axis that moves, and the unknown side of its first move.

Error motions are Legendre polynomials of a high degree, or harmonics of a whole turn. No basis is chosen: the
coefficients of a band of degrees share one size, which the data decide. Where a calibration is given, its parameters
take the place of the error motions of its axes, with their covariance as prior. A user may state further effects, which
are then present too, and other bases.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple, cast

import msgspec
import numpy as np
from scipy.linalg import block_diag

from calibration.gaussian_terms.observations import Observations
from calibration.gaussian_terms.posterior import Equations, Posterior
from calibration.measurement.measurement import Measurement
from calibration.observation.full_model import BasisChoice, axis_motions, least_priors, with_effects
from kinematics.basis import Basis, Fourier, Harmonics
from kinematics.effects import Effect, ErrorMotion, UnknownApproach
from kinematics.effects.base import own_component
from kinematics.error_model.model import ErrorModel, no_errors
from kinematics.error_model.priors import BANDS, Priors
from kinematics.transforms import Array
from kinematics.turn import gap_of

ERROR_DEGREE, TURN_HARMONICS = 20, 8
"""Largest degree of an error motion over an interval, and its harmonics over a whole turn."""
TRAVEL_WAVES = 10
"""Waves of an error motion over an interval in a fit: the shortest one is an eighth of the travel."""
FIT_BANDS = ((0, 0), (1, 1), *BANDS[1:])
"""First and last degree of each band in a fit: constants and slopes are of assembly, with a size of their own."""

SETTLED_SIZE = 0.05
"""Largest relative change of a size in a step after which the sizes are found."""
KNOWN = 1e-12
"""Share of the largest variance of a calibration, in squares of its uncertainties, below which one is rounding."""
Key = tuple[str, str, int]
"""Band: axis, kind of error motion, and number; numbers below 0 are of sizes that are not fitted."""
WAVY = 2
"""Number of the coarsest band that may contain a periodic error."""
FIRST_BAND = -1
"""Number of the band of an error before the first move of an axis."""
CALIBRATED: Key = ("", "", -2)
"""Band of the parameters of a given calibration: their covariance is their size."""
STATED_BAND = -3
"""Number of the band of what a user states: its size is its prior."""
UNLIMITED = 1e4
"""Prior size, in the unit of a parameter, where nothing limits it."""


@dataclass(frozen=True)
class Asked:
    """What a user states of a fit; nothing by default."""

    effects: tuple[Effect, ...] = ()
    """Effects that are present beside the error motions."""
    bases: Mapping[str, BasisChoice] | None = None
    """Bases of the error motions, of all axes that move; None for those of this module."""
    scale: float | None = None
    """Size of the error motions in prior sizes; None where the data decide. Of stated bases 1 by default."""
    of_fit: bool = False
    """True for a fit: parameters that the instrument leaves to assembly have their least prior sizes."""
    first_sides: bool = True
    """True for errors of axes before their first move. Without a backlash there are none, and they would hide the drift
    from the first row to its repeat."""

    def sizes(self, degrees: np.ndarray, priors: Priors) -> Array:
        """Prior sizes `(m,)` of the coefficients of an error motion, um or urad, by their degrees."""
        return (self.scale or 1.0) * prior_sizes(degrees, priors)

    def keys(self, effect: ErrorMotion, degrees: np.ndarray) -> list[Key]:
        """The band of each coefficient of an error motion, by their degrees."""
        if self.scale is not None:
            return [(effect.axis, "", STATED_BAND)] * len(degrees)
        return keys_of(effect, degrees, FIT_BANDS if self.of_fit else BANDS)


NOTHING = Asked()
"""Error motions alone, which is what a diagnosis begins with."""


@dataclass(frozen=True)
class Bands:
    """Columns, in units of their prior sizes, that share sizes in bands."""

    keys: tuple[Key, ...]
    """Of each band."""
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
    def of(cls, keys: Sequence[Key], priors: Priors) -> Bands:
        """The bands of columns with these keys."""
        known = list(dict.fromkeys(keys))
        coarser = [known.index((*key[:2], key[2] - 1)) if (*key[:2], key[2] - 1) in known else -1 for key in known]
        return Bands(
            tuple(known),
            np.array([known.index(key) for key in keys], int),
            np.array(coarser, int),
            np.array([_fall(key[2]) ** priors.smoothness for key in known]),
            np.array([key[2] < 0 for key in known], bool),
            np.array([priors.first_side if key[2] == FIRST_BAND else 1.0 for key in known]),
            np.array([key[2] >= WAVY for key in known], bool),
        )

    @property
    def width(self) -> int:
        """Number p of columns."""
        return len(self.bands)

    def expected_squares(self, sizes: Array) -> Array:
        """Expected squares of the sizes of the bands: those of neighbours that have these sizes, if they are larger.

        A finer band is expected to go on falling as its prior sizes do, a coarser one to have no smaller coefficients.
        """
        finer = np.flatnonzero(self.coarser >= 0)
        expected = np.where(self.coarser >= 0, sizes[self.coarser] ** 2, 0.0)
        by_finer = (self.falls[finer] * sizes[finer]) ** 2
        expected[self.coarser[finer]] = np.maximum(expected[self.coarser[finer]], by_finer)
        return np.asarray(expected)

    def wider(self, determined: Array, priors: Priors) -> Array:
        """Root mean squares of the sizes of the bands, as multiples of the likeliest ones.

        A squared size with m `determined` coefficients, and those of its prior, has an inverse gamma distribution.
        """
        freedom = np.maximum(determined, 0.0) + priors.band_weight
        return np.where(self.fixed, 1.0, np.sqrt(freedom / (freedom - 2.0)))

    def likeliest_sizes(self, equations: Equations, priors: Priors, steps: int) -> Array:
        """The likeliest sizes of the bands for white observations of unit variance, after at most so many steps."""
        sizes, counted = self.first_sizes, len(self.first_sizes)
        for _ in range(steps):
            of_columns, before = sizes[self.bands], sizes
            posterior = Posterior.of(equations, of_columns, 1.0)
            determined = summed(self.bands, posterior.determined, counted)
            squares = summed(self.bands, posterior.mean**2, counted)
            expected = np.maximum(self.expected_squares(sizes), priors.least_share**2)
            new = stepped(determined, squares, expected, np.full(counted, priors.band_weight))
            sizes = np.where(self.fixed, before, new)
            if np.abs(np.log(sizes / before)).max(initial=0.0) < SETTLED_SIZE:
                break
        return np.asarray(sizes)


def summed(groups: np.ndarray, values: Array, count: int) -> Array:
    """Sums `(count,)` of values `(p,)` by their groups `(p,)`."""
    return np.asarray(np.bincount(groups, values, minlength=count), float)


def stepped(determined: Array, squares: Array, expected: Array, weight: Array) -> Array:
    """Sizes `(k,)` after a fixed-point step (MacKay 1992).

    determined, squares: numbers of coefficients that the data determine, and sums of their squares. expected: squares
    of the sizes by their prior, with their weight in coefficients.
    """
    return np.asarray(np.sqrt((squares + weight * expected) / (np.maximum(determined, 0.0) + weight)))


@dataclass(frozen=True)
class Geometry(Bands):
    """Columns that are always present."""

    effects: tuple[Effect, ...]
    """Those of a given calibration first."""
    columns: Array
    """`(n, d, p)`"""
    parameters: Array
    """Parameters of the effects, one after the other, by the coefficients of the columns `(P, p)`."""
    before: Array
    """Parameters `(P,)` without any data: those of a given calibration, else 0."""

    @classmethod
    def none(cls, observations: Observations) -> Geometry:
        """No columns: all that may be in the observations is a term."""
        columns = np.zeros((*observations.residual.shape, 0))
        return cls(
            **vars(Bands.of([], observations.priors)),
            effects=(),
            columns=columns,
            parameters=np.zeros((0, 0)),
            before=np.zeros(0),
        )

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


def geometry(observations: Observations, asked: Asked = NOTHING) -> Geometry:
    """The geometry of the axes that move in the observations."""
    given, parts = observations.given, list(_parts(observations, asked))
    effects = (*(given.effects if given else ()), *(part.effect for part in parts))
    root = root_of(given) if given else np.zeros((0, 0))
    sizes = np.concatenate([np.zeros(0), *(part.scales for part in parts)])
    keys = [CALIBRATED] * root.shape[1] + [key for part in parts for key in part.keys]
    columns = observations.columns(effects)
    columns[:, :, len(root) :] *= sizes
    if len(root):
        columns = np.concatenate([columns[:, :, : len(root)] @ root, columns[:, :, len(root) :]], axis=2)
    return Geometry(
        **vars(Bands.of(keys, observations.priors)),
        effects=effects,
        columns=columns,
        parameters=block_diag(root, np.diag(sizes)),
        before=np.concatenate([given.parameters if given else np.zeros(0), *(_shapes(part.effect) for part in parts)]),
    )


def _shapes(effect: Effect) -> Array:
    """Periods and time constants of an effect, and 0 for its linear parameters `(p,)`."""
    return np.where(np.array(effect.linear, bool), 0.0, effect.parameters)


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


def _parts(observations: Observations, asked: Asked) -> Iterator[_Part]:
    """What no calibration has: error motions of other axes, what a user states, and the sides of the first moves."""
    measurement, given = observations.measurement, observations.given
    calibrated = {motion.axis for motion, _ in given.error_motions} if given else set()
    if asked.bases is not None:
        yield from _of_stated_bases(measurement, asked.bases, asked.scale or 1.0)
    for effect, degrees in [] if asked.bases is not None else motions(measurement, of_fit=asked.of_fit):
        if effect.axes[0] not in calibrated:
            part = _Part(effect, asked.sizes(degrees, observations.priors), asked.keys(effect, degrees))
            yield _at_least(part, _least(measurement, effect)) if asked.of_fit else part
    for other in asked.effects:
        sizes = np.array(other.typical)
        part = _Part(
            other, np.where(np.isfinite(sizes), sizes, UNLIMITED), [(other.name, "", STATED_BAND)] * len(sizes)
        )
        yield _at_least(part, _least(measurement, other))
    for side in _first_sides(measurement) if asked.first_sides else ():
        yield _Part(side, observations.priors.typical * np.array(side.typical), [(side.name, "", FIRST_BAND)])


def _least(measurement: Measurement, effect: Effect) -> Array:
    """Least prior sizes `(m,)` of the parameters of an effect, 0 where there are none."""
    return least_priors(measurement, msgspec.structs.replace(no_errors(measurement.machine), effects=(effect,)))


def _at_least(part: _Part, least: Array) -> _Part:
    """A part whose parameters with a least prior size keep this size, or their larger one."""
    stated = (part.effect.name, "", STATED_BAND)
    keys = [stated if some else key for key, some in zip(part.keys, (least > 0.0).tolist(), strict=True)]
    return part._replace(scales=np.maximum(part.scales, least), keys=keys)


def keys_of(effect: ErrorMotion, degrees: np.ndarray, bands: Sequence[tuple[int, int]] = BANDS) -> list[Key]:
    """The band of each coefficient of an error motion, by their degrees, among bands of these degrees."""
    return [(effect.axis, kind_of(effect), _band(degree, bands)) for degree in degrees.tolist()]


def _of_stated_bases(measurement: Measurement, bases: Mapping[str, BasisChoice], scale: float) -> Iterator[_Part]:
    """Error motions in bases that a user states."""
    model, prior = with_effects(measurement, bases, (), scale)
    for effect, part in zip(model.effects, model.slices, strict=True):
        yield _Part(effect, prior[part], [(effect.name, "", STATED_BAND)] * (part.stop - part.start))


def prior_sizes(degrees: np.ndarray, priors: Priors) -> Array:
    """Prior sizes `(m,)` of the coefficients of an error motion, um or urad, by their degrees."""
    return np.asarray(priors.error_motion_um / np.maximum(degrees, 1) ** priors.smoothness)


def bands_of(model: ErrorModel, asked: Asked, priors: Priors, least: Array) -> tuple[Bands, Array]:
    """The bands of the parameters of a model of automatic bases, and their prior sizes `(p,)`.

    least `(p,)`: their least sizes, 0 where there are none.
    """
    motions = {part.start: motion for motion, part in model.error_motions}
    parts = []
    for effect, own in zip(model.effects, model.slices, strict=True):
        motion = motions.get(own.start)
        if motion is None:
            part = _Part(effect, np.array(effect.typical), [(effect.name, "", STATED_BAND)] * len(effect.parameters))
        else:
            degrees = degrees_of(motion.basis)
            part = _Part(effect, asked.sizes(degrees, priors), asked.keys(motion, degrees))
        parts.append(_at_least(part, least[own]))
    prior = np.concatenate([np.zeros(0), *(part.scales for part in parts)])
    return Bands.of([key for part in parts for key in part.keys], priors), np.where(
        np.isfinite(prior), prior, UNLIMITED
    )


def kind_of(effect: ErrorMotion) -> str:
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


def _band(degree: float, bands: Sequence[tuple[int, int]]) -> int:
    return next(number for number, (low, high) in enumerate(bands) if low <= round(degree) <= high)


def motions(measurement: Measurement, *, of_fit: bool = False) -> list[tuple[ErrorMotion, np.ndarray]]:
    """The error motions that the instrument observes, and the degree of each of their columns `(size,)`."""
    found: list[tuple[ErrorMotion, np.ndarray]] = []
    for axis, choice in automatic_bases(measurement, of_fit=of_fit).items():
        for effect in axis_motions(measurement, axis, choice):
            motion = cast(ErrorMotion, effect)
            found.append((motion, degrees_of(motion.basis)))
    return found


def automatic_bases(measurement: Measurement, *, of_fit: bool = False) -> dict[str, BasisChoice]:
    """The basis of the error motions of each axis that moves."""
    return {axis: _automatic(measurement, axis, of_fit=of_fit) for axis in measurement.moving}


def _automatic(measurement: Measurement, axis: str, *, of_fit: bool) -> BasisChoice:
    own = measurement.machine.axes[measurement.machine.index(axis)]
    if own.turns_fully and not gap_of(measurement.moving[axis]):
        return BasisChoice("fourier", TURN_HARMONICS)
    if of_fit and measurement.instrument.MAY_BE_FEW:  # what lies between few positions is no concern of their owner
        return BasisChoice("legendre", min(ERROR_DEGREE, max(1, measurement.distinct_positions[axis] - 1)))
    return BasisChoice("waves", TRAVEL_WAVES) if of_fit else BasisChoice("legendre", ERROR_DEGREE)


def degrees_of(basis: Basis) -> np.ndarray:
    """Degree of each function `(size,)` of a basis: order of a harmonic of a turn, half waves over an interval."""
    if isinstance(basis, Fourier):
        return np.array([0.0, 1.0, *np.repeat(np.maximum(basis.harmonics, 1.0), 2)])
    return (np.arange(basis.size) + 1) // 2 if isinstance(basis, Harmonics) else np.arange(basis.size)


def _first_sides(measurement: Measurement) -> list[UnknownApproach]:
    """Errors of the axes that had not moved before the first rows."""
    approach = measurement.state.approach
    if approach is None:
        return []
    unknown = [axis for axis in measurement.moving if np.any(approach[:, measurement.machine.index(axis)] == 0.0)]
    return [UnknownApproach(axis=axis, offset=0.0) for axis in unknown]
