"""Estimate of the noise from the residuals of a fit: the instrument's factor, and the non-repeatability of each axis.

Restricted maximum likelihood (Patterson and Thompson 1971) on the linearised fit, by Fisher's scoring: the covariance
of the rows of a stop is f C + sum of s^2 a a', with C of the instrument's specification and an arm a for each axis.
Every component must differ from the specification by more than chance, so that data that follow it keep it. Where
positions recur, no component may exceed the scatter of their visits: the excess is an error that the model lacks, the
same at each visit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from calibration.fit.fit import Fit
from calibration.fit.linear import Posterior
from calibration.measurement.estimated_noise import Decorrelation, EstimatedNoise
from calibration.measurement.measurement import Measurement
from calibration.observation.normal_equations import whitened
from calibration.observation.outliers import outlying, robust_factor
from kinematics.effects.base import own_motion, unit_of
from kinematics.error_model.effect_sums import Design
from kinematics.transforms import Array, blocks

CERTAIN_STANDARD_ERRORS = 4.0
"""Standard errors by which a variance must differ from the specification: 1 in 30,000 by chance."""
ENOUGH_DEGREES_OF_FREEDOM = 20
"""Degrees of freedom from which the scatter of visits limits a variance."""
BLIND = 1e-6
"""Square of the lever of an axis at a stop, as a share of the largest, below which the stop does not see the axis."""
MOST_NOISE_ROWS = 5000
"""Largest number of rows; whole stops, evenly spread."""
MOST_OUTLIER_ROUNDS = 4
"""Most rounds in which rows that disagree under the last estimate are left out of the next."""
MOST_NOISE_STEPS = 25
ROUGH_STEP_U, LAST_NOISE_STEP_U = 0.3, 0.03
"""Step in standard errors of the variances below which the iteration ends: for one that is clearly not clear, and of
the result."""
NEVER = 0.1
"""Standard errors below which a variance does not become clear without another one."""
LARGEST_VARIANCE_FACTOR = 100.0
"""Factor by which a variance changes in one step at most."""
SHARED = 1e-6
"""Ridge on the correlations of the variances: two of them may be indistinguishable."""
FIRST_VARIANCE, LEAST_VARIANCE = 0.1, 1e-6
"""Variances of an axis at the start and at least, in units of that of `UNIT_UM`."""
RIDGE = 1e-9
UNIT_UM = 10.0
"""Unit of the standard deviations in the iteration, um or urad."""


def with_estimated_noise(found: Fit) -> Measurement:
    """The measurement of a fit with the noise that its residuals show, or as specified if they agree with it.

    The noise contains errors that the model lacks, as far as a variance of each axis describes them. Readings of an
    interferometer are not divided into instrument and axis.
    """
    return replace(found.measurement, noise=_estimated(found))


def _estimated(found: Fit) -> EstimatedNoise | None:
    """The noise that the residuals show; None where it is as specified."""
    measurement = replace(found.measurement, noise=None)
    axes = list(measurement.moving)
    if measurement.components == 1 or measurement.across is not None or not axes:
        return None
    every = _Components.of(found, measurement, axes)
    good, start = every.agreeing(None), np.append(1.0, np.full(len(axes), FIRST_VARIANCE))
    for _ in range(MOST_OUTLIER_ROUNDS):
        likeliest = None if _as_specified(every.rows(good)) else _estimate(every.rows(good), start)
        if likeliest is None or likeliest.estimate is None:
            return None
        start, estimate = likeliest.variances, likeliest.estimate
        before, good = good, every.agreeing(estimate)
        if np.array_equal(before, good):
            break
    visits = every.rows(good).repeated(estimate)
    units = UNIT_UM * np.array([unit_of(axis)[1] for axis in axes])

    def sizes(variances: Array) -> dict[str, float]:
        return {axes[k]: float(np.sqrt(variances[k]) * units[k]) for k in np.flatnonzero(variances).tolist()}

    kept = np.flatnonzero(estimate.of_axes)
    return EstimatedNoise(
        estimate.factor,
        sizes(visits.of_axes),
        measurement.stops,
        _arms(found, measurement, axes)[:, :, kept] * np.sqrt(estimate.of_axes[kept]),
        sizes(estimate.of_axes - visits.of_axes),
        visits.factor,
        every.rows(good).revisited,
    )


class _Estimate(NamedTuple):
    """Variances that differ from the specification by more than chance; 1 and zeros elsewhere."""

    factor: float
    """Variance of the instrument, in units of the specification."""
    of_axes: Array
    """`(axes,)`, in units of that of `UNIT_UM`."""


def _estimate(components: _Components, start: Array) -> _Found:
    """The variances that the rows show.

    start: variances `(1 + axes,)` at which the iteration begins. Those that are zero stay so unless the likelihood
    beside the others grows with them by more than chance.
    """
    found = _clear(components, start, start > 0.0)
    assert found is not None
    resting = start <= 0.0
    while (growing := resting & (found.moments.growth(found.active) >= CERTAIN_STANDARD_ERRORS)).any():
        resting &= ~growing
        first = np.where(growing, found.moments.first(found.active), found.variances)
        found = _clear(components, first, found.active | growing, growing) or found
    return found


class _Found(NamedTuple):
    """The likeliest variances, and their uncertainty."""

    variances: Array
    """`(1 + axes,)`: instrument, and axes; zero for one that is not clear."""
    active: np.ndarray
    """True `(1 + axes,)` for those that are clear, and for the instrument."""
    moments: _Moments
    error: Array
    """Standard errors `(1 + axes,)`."""

    @property
    def estimate(self) -> _Estimate | None:
        """The estimate; None where it agrees with the specification."""
        factor = (
            float(self.variances[0]) if abs(self.variances[0] - 1.0) > CERTAIN_STANDARD_ERRORS * self.error[0] else 1.0
        )
        return None if factor == 1.0 and not self.variances[1:].any() else _Estimate(factor, self.variances[1:])


def _clear(
    components: _Components, variances: Array, active: np.ndarray, wanted: np.ndarray | None = None
) -> _Found | None:
    """The likeliest variances of the active ones, without those that are not clear.

    variances `(1 + axes,)`: at which the iteration begins. wanted `(1 + axes,)`: once all of these have fallen, the
    result is None.
    """
    within = ROUGH_STEP_U
    while True:
        variances, moments = _likeliest(components, variances, active, within)
        error = np.zeros(len(variances))
        # two axes of a part measured in two coordinates are as uncertain as its instrument
        values, vectors = np.linalg.eigh(moments.information[np.ix_(active, active)])
        error[active] = np.sqrt(vectors**2 @ (1.0 / np.maximum(values, RIDGE * values[-1])))
        clear = np.divide(variances, error, out=np.full(len(error), np.inf), where=active & (error > 0.0))
        clear[0] = np.inf
        if clear.min() < CERTAIN_STANDARD_ERRORS - 2.0 * (within - LAST_NOISE_STEP_U):
            # two axes may explain the same: without one of them the other is clear
            dropped = active & (clear <= max(clear.min(), NEVER))
            active, within, variances = active & ~dropped, ROUGH_STEP_U, np.where(dropped, 0.0, variances)
            if wanted is not None and not (active & wanted).any():
                return None
        elif within > LAST_NOISE_STEP_U:
            within = LAST_NOISE_STEP_U
        else:
            return _Found(variances, active, moments, error)


def _as_specified(components: _Components) -> bool:
    """True where no variance differs clearly from the specification."""
    moments = components.moments(np.append(1.0, np.zeros(len(components.axes))))
    clear = (moments.observed - moments.expected) / np.maximum(moments.uncertainty, 1e-300)
    return bool(abs(clear[0]) < CERTAIN_STANDARD_ERRORS and clear[1:].max() < CERTAIN_STANDARD_ERRORS)


def _likeliest(components: _Components, variances: Array, active: np.ndarray, within: float) -> tuple[Array, _Moments]:
    """The likeliest variances `(1 + axes,)`, of the active ones, and the moments there, by Fisher's scoring.

    within: length of the last step, in standard errors of the variances. A variance whose step turns back takes the
    secant's: scoring would overshoot in turn.
    """
    steps, taken = np.zeros(len(variances)), np.zeros(len(variances))
    for _ in range(MOST_NOISE_STEPS):
        moments = components.moments(variances)
        slope = moments.slope
        shown = np.diag(moments.information) > 0.0  # not so for a table's axis, by targets on the tool from the bed
        free = np.flatnonzero(active & shown & ((variances > LEAST_VARIANCE) | (slope > 0.0)))
        if not len(free):
            break
        scale = np.sqrt(np.diag(moments.information)[free])
        scaled = moments.information[np.ix_(free, free)] / np.outer(scale, scale)
        step = np.linalg.solve(scaled + SHARED * np.eye(len(free)), slope[free] / scale)
        last, steps = steps[free], np.zeros(len(variances))
        steps[free] = step / scale
        back = (last * steps[free] < 0.0) & (last * taken[free] > 0.0)
        share = np.divide(taken[free], last - steps[free], out=np.ones(len(free)), where=back)
        moved, before, variances = variances[free] + share * steps[free], variances, variances.copy()
        variances[free] = np.clip(
            moved,
            np.maximum(variances[free] / LARGEST_VARIANCE_FACTOR, LEAST_VARIANCE),
            variances[free] * LARGEST_VARIANCE_FACTOR,
        )
        taken = variances - before
        if np.abs(step).max() < within:
            break
    return variances, moments


def _arms(found: Fit, measurement: Measurement, axes: Sequence[str]) -> Array:
    """Change of the observations `(n, d, axes)`, mm, by an error of `UNIT_UM` along each axis' own motion."""
    columns, units = [], []
    for axis in axes:
        i, component, _ = own_motion(measurement.machine, axis)
        columns.append(6 * i + component)
        units.append(UNIT_UM * unit_of(axis)[1])
    arms = [
        measurement.rows(rows).instrument.transform(measurement.rows(rows), found.registration)[:, :, columns]
        for rows in blocks(len(measurement))
    ]
    return np.asarray(np.concatenate(arms) * np.array(units))


def _limited(variance: float, least: float, values: Array, own: Array, same: np.ndarray) -> float:
    """A variance, limited to the scatter of values `(m, d)` of the same label `(m,)`.

    least: the result where this scatter is not significant. own `(m,)`: variances of the values without the component;
    the component itself where `least` is 1 is a factor on them.
    """
    count, degrees = np.bincount(same), _degrees(values, same)
    if degrees < ENOUGH_DEGREES_OF_FREEDOM:
        return variance
    means = np.stack([np.bincount(same, column) for column in values.T], axis=1) / np.maximum(count, 1)[:, None]
    repeated = count[same] > 1
    scatter = float(np.sum((values - means[same])[repeated] ** 2)) / degrees
    chance = CERTAIN_STANDARD_ERRORS * np.sqrt(2.0 / degrees) * scatter
    without = 0.0 if least else float(own[repeated].mean())
    if variance <= scatter + chance - without:
        return variance
    repeated_only = max(scatter - without, 0.0)
    return repeated_only if abs(repeated_only - least) > chance else least


def _degrees(values: Array, same: np.ndarray) -> float:
    """Degrees of freedom of the scatter of values `(m, d)` of the same label `(m,)`."""
    return float(values.shape[1] * np.sum(np.maximum(np.bincount(same) - 1, 0)))


class _Moments(NamedTuple):
    """Squares of white residuals along the components, instrument first, and their likelihood's curvature."""

    observed: Array
    """`(1 + axes,)`"""
    expected: Array
    """`(1 + axes,)`, where the variances are right."""
    information: Array
    """Fisher information of the restricted likelihood on the variances `(1 + axes, 1 + axes)`."""

    @property
    def uncertainty(self) -> Array:
        """Standard deviation of the observed ones by chance."""
        return np.asarray(2.0 * np.sqrt(np.diag(self.information)))

    def growth(self, active: np.ndarray) -> Array:
        """Slope `(1 + axes,)` of the likelihood along each variance, in standard deviations beside the active ones.

        Rao's score: at a variance of zero it is at least the estimate in units of its standard deviation.
        """
        left = self._beside(active)
        return np.divide(self.slope, np.sqrt(np.maximum(left, 0.0)), out=np.zeros(len(left)), where=left > 0.0)

    def first(self, active: np.ndarray) -> Array:
        """First estimate `(1 + axes,)` of each variance beside the active ones, from a variance of zero."""
        left = self._beside(active)
        return np.divide(self.slope, left, out=np.zeros(len(left)), where=left > 0.0)

    @property
    def slope(self) -> Array:
        """Slope `(1 + axes,)` of the log likelihood along each variance."""
        return np.asarray(0.5 * (self.observed - self.expected))

    def _beside(self, active: np.ndarray) -> Array:
        """Information `(1 + axes,)` on each variance with the active ones unknown."""
        shared, own = self.information[active], self.information[np.ix_(active, active)]
        known = np.sum(shared * (np.linalg.pinv(own, SHARED, hermitian=True) @ shared), axis=0)
        return np.asarray(np.diag(self.information) - known)


@dataclass(frozen=True)
class _Components:
    """Rows of a fit with the derivatives of its linearisation, not whitened."""

    measurement: Measurement
    residual: Array
    """`(n, d)`"""
    design: Array
    """`(n, d, q)`; the registration in columns of unit length, parameters in units of their priors."""
    limited: Array
    away: Array
    axes: Sequence[str]
    arms: Array
    stop: np.ndarray
    specified: Array
    """Covariances `(n, d, d)` by the instrument's specification."""

    @classmethod
    def of(cls, found: Fit, measurement: Measurement, axes: Sequence[str]) -> _Components:
        """The rows of a fit, outliers too."""
        numbers = measurement.stops
        rows = np.flatnonzero(~found.copies & ~np.isin(measurement.groups, found.failed))
        if len(rows) > MOST_NOISE_ROWS:
            chosen = np.unique(numbers[rows])
            chosen = chosen[np.linspace(0, len(chosen) - 1, len(chosen) * MOST_NOISE_ROWS // len(rows)).astype(int)]
            rows = rows[np.isin(numbers[rows], chosen)]
        some = measurement.rows(rows)
        own = some.instrument.registration_design(some, found.registration)
        own = own / np.maximum(np.linalg.norm(own.reshape(-1, own.shape[2]), axis=0), 1e-300)
        transform = some.instrument.transform(some, found.registration)
        model = Design(found.model.effects, some.machine, measurement.state, with_instrument=True).of(rows, transform)
        finite = np.isfinite(found.prior)
        return cls(
            some,
            found.residual[rows],
            np.concatenate([own, model * np.where(finite, found.prior, 1.0)], axis=2),
            np.concatenate([np.full(own.shape[2], RIDGE), finite + RIDGE]),
            np.concatenate([np.zeros(own.shape[2]), found.away]),
            axes,
            _arms(found, some, axes),
            numbers[rows],
            some.specified_covariances,
        )

    @cached_property
    def stops_alike(self) -> list[np.ndarray]:
        """Rows `(stops, m)` of the stops of m rows, for each m."""
        starts = np.flatnonzero(np.append(True, np.diff(self.stop) != 0))
        counts = np.diff(np.append(starts, len(self.stop)))
        return [starts[counts == m][:, None] + np.arange(m) for m in np.unique(counts).tolist()]

    def rows(self, index: np.ndarray) -> _Components:
        """The same for some of the rows."""
        some = replace(self, measurement=self.measurement.rows(index), residual=self.residual[index])
        some = replace(some, design=self.design[index], arms=self.arms[index], stop=self.stop[index])
        return replace(some, specified=self.specified[index])

    def agreeing(self, estimate: _Estimate | None) -> np.ndarray:
        """Indices of the rows that agree with the others under an estimate of the noise; first with any factor."""
        noise = None
        if estimate is not None:
            noise = EstimatedNoise(estimate.factor, {}, self.stop, self.arms * np.sqrt(estimate.of_axes))
        white = replace(self.measurement, noise=noise).whiteners
        distances = np.sum(whitened(white, self.residual) ** 2, axis=1)
        d = self.residual.shape[1]
        return np.flatnonzero(~outlying(distances, d, robust_factor(distances, d, 0.0, 1.0, self.stop)))

    @cached_property
    def _position(self) -> np.ndarray:
        """Number `(n,)` of the position of each row."""
        places = np.round(self.measurement.state.positions, 6)
        return np.unique(places, axis=0, return_inverse=True)[1].reshape(-1)

    @cached_property
    def _same(self) -> np.ndarray:
        """Label `(n,)` of the position, target and set-up of each row."""
        groups = np.unique(self.measurement.groups, return_inverse=True)[1].reshape(-1)
        names = np.stack([self._position, self.measurement.target_number, groups], axis=1)
        return np.unique(names, axis=0, return_inverse=True)[1].reshape(-1)

    @property
    def revisited(self) -> bool:
        """True where the scatter of visits of the same positions limits the variances."""
        return _degrees(self.residual, self._same) >= ENOUGH_DEGREES_OF_FREEDOM

    def repeated(self, estimate: _Estimate) -> _Estimate:
        """The estimate, each variance limited to the scatter of visits of the same positions, where these suffice."""
        position, same = self._position, self._same
        white = replace(self.measurement, noise=None).whiteners
        readings = (white @ self.residual[:, :, None])[:, :, 0]
        factor = _limited(estimate.factor, 1.0, readings, np.ones(len(readings)), same)
        white = white / np.sqrt(factor)
        starts = np.flatnonzero(np.append(True, np.diff(self.stop) != 0))
        arms = white @ self.arms
        size = np.add.reduceat(np.sum(arms**2, axis=1), starts, axis=0)
        along = np.add.reduceat(np.einsum("ndk,nd->nk", arms, readings / np.sqrt(factor)), starts, axis=0)
        seen = size > BLIND * size.max(axis=0, initial=0.0)
        of_axes = [
            _limited(variance, 0.0, (along[own, k] / size[own, k])[:, None], 1.0 / size[own, k], position[starts][own])
            if variance
            else 0.0
            for k, (variance, own) in enumerate(zip(estimate.of_axes.tolist(), seen.T, strict=True))
        ]
        return _Estimate(factor, np.array(of_axes))

    def moments(self, variances: Array) -> _Moments:
        """The moments of the residuals in each component at these variances `(1 + axes,)`."""
        used = np.sqrt(variances[1:])
        noise = EstimatedNoise(
            float(variances[0]), dict(zip(self.axes, used, strict=True)), self.stop, self.arms * used
        )
        white = np.linalg.inv(np.linalg.cholesky(noise.covariance(self.specified)))
        decorrelation = Decorrelation.of(noise if used.any() else None, white)
        n, d, q = self.design.shape
        design = decorrelation.apply(white @ self.design).reshape(n * d, q)
        whole = decorrelation.apply(whitened(white, self.residual)).reshape(-1)
        posterior = Posterior(design.T @ design, self.limited)
        whole = whole - design @ posterior.solve(design.T @ whole - self.limited * self.away)
        spanned, residual = posterior.spanned(design, in_place=True).reshape(n, d, -1), whole.reshape(n, d)
        arms, roots = decorrelation.apply(white @ self.arms), white @ np.linalg.cholesky(self.specified)
        k = len(variances)
        observed, expected, information = np.zeros(k), np.zeros(k), np.zeros((k, k))
        shared = {some.rows.shape[1]: some.matrices for some in decorrelation.stops}
        for rows in self.stops_alike:
            count, m = rows.shape
            absorbing = (spanned if rows.size == n else spanned[rows]).reshape(count, m * d, q)
            free = np.eye(m * d) - absorbing @ np.swapaxes(absorbing, 1, 2)
            # the errors of the instrument are independent in the rows of a stop, those of an axis are the same
            own = np.zeros((count, m, d, m, d))
            own[:, np.arange(m), :, np.arange(m)] = np.swapaxes(roots[rows], 0, 1)
            instrument = own.reshape(count, m * d, m * d)
            instrument = shared[m] @ instrument if m in shared else instrument
            along = np.concatenate([instrument, arms[rows].reshape(count, m * d, k - 1)], axis=2)
            squares = np.sum((np.swapaxes(along, 1, 2) @ residual[rows].reshape(count, m * d, 1)) ** 2, axis=(0, 2))
            products = np.swapaxes(along, 1, 2) @ (free @ along)
            traces, both = np.einsum("skk->k", products), np.sum(products**2, axis=0)
            first = m * d
            observed += np.append(np.sum(squares[:first]), squares[first:])
            expected += np.append(np.sum(traces[:first]), traces[first:])
            information[0, 0] += np.sum(both[:first, :first])
            information[0, 1:] += np.sum(both[:first, first:], axis=0)
            information[1:, 1:] += both[first:, first:]
        information[1:, 0] = information[0, 1:]
        return _Moments(observed, expected, 0.5 * information)
