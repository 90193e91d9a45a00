"""Errors of the linear axes that are finer than their bases, found where visits of one position share them.

Waves between the measured positions of an axis, too fine for any basis, move all visits of one position alike. The
fit takes their mean at few positions for the axis' course, and at unseen positions they are there in full: neither is
in its covariance. Their variance along each axis is estimated by restricted maximum likelihood (Patterson and Thompson
1971) from the scatter of the positions beside that of the visits, and counts with its probability against none. A
smooth error along the axis that the bases lack, which curves follow, has a variance of its own (Matern, twice
differentiable; Rasmussen and Williams 2006, section 4.2).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from calibration.diagnosis.search.linearised_fit import LinearisedFit
from calibration.diagnosis.unseen.unseen_states import moments, squares_along
from calibration.fit.curves.between_positions import FEW
from calibration.fit.fit import Fit
from kinematics.basis import BSpline
from kinematics.effects import UM, Cyclic
from kinematics.effects.base import own_component, own_motion, unit_of
from kinematics.error_model.covariance import root_of
from kinematics.transforms import Array

DIGITS = 3
"""Decimals of positions, mm, that are one."""
SPREAD = 0.7
"""Standard deviation of the logarithm of the size of fine errors from axis to axis (Type B): a factor of two."""
WIDEST, TRIED = 3.0, 25
"""Most standard deviations, and number of sizes, that are tried."""
MOST = 200
"""Most positions of an axis, evenly spread."""
NODES, LENGTH = 25, 1.0 / 6.0
"""Positions at which a smooth error that the bases lack is represented, and its length as a share of the range."""
JITTER = 1e-9
"""Variance that is added to it, against rounding."""
RANK = 1e-9
"""Singular value, as a share of the largest, from which a direction of the registration counts."""
CERTAIN = 50.0
"""Largest logarithm of the odds."""
ENOUGH = 5
"""Fewest positions of an axis, visited at two stops or more, that show its fine errors."""
STEPS = 30
CONVERGED = 1e-3
"""Relative step of the variances at which the iteration ends."""
FARTHEST = 10.0
"""Factor by which a variance changes in one step at most."""
START, NOTHING = 1.0, 1e-6
"""Variances at the start, and from which they count, um^2."""


class _Visited(NamedTuple):
    """Positions of an axis, and the response of the residuals to an error of 1 um at each."""

    axis: str
    columns: Array
    """White, `(N, k)`."""
    smooth: Array
    """The same of independent parts of a smooth error of 1 um along the axis, `(N, NODES)`."""


class _Likelihood(NamedTuple):
    """Restricted likelihood of variances of errors, and of a factor on the noise, beside a fit."""

    groups: np.ndarray
    """Number of the variance of each error `(k,)`: at a position of an axis, or a part of its smooth error."""
    shared: Array
    """U'PU `(k, k)`: U responses of the residuals, P what the fit leaves of them."""
    along: Array
    """U'Pr `(k,)`"""
    squares: float
    """r'Pr"""
    freedom: float
    """Rank of P."""

    def of(self, factor: float, variances: Array) -> float:
        """Its logarithm, up to a constant, at a factor on the noise and variances, um^2."""
        root = np.sqrt(variances[self.groups] / factor)
        inner = np.eye(len(root)) + root[:, None] * self.shared * root
        half = np.linalg.cholesky(inner)
        explained = np.sum(np.linalg.solve(half, root * self.along) ** 2)
        volume = 2.0 * float(np.log(np.diag(half)).sum()) + self.freedom * float(np.log(factor))
        return -0.5 * (volume + (self.squares - float(explained)) / factor)

    def likeliest(self, active: Sequence[int], count: int) -> tuple[float, Array]:
        """The likeliest factor on the noise, and variances `(count,)` of the axes, um^2; those not active are zero.

        Fisher's scoring. A variance that the data do not show falls to `NOTHING`.
        """
        values = np.concatenate([[1.0], np.full(count, START)])
        free = np.array([0, *(1 + number for number in active)])
        values[np.setdiff1d(np.arange(count + 1), free)] = 0.0
        for _ in range(STEPS):
            slope, information = self._slope(float(values[0]), values[1:])
            moving = free[(values[free] > NOTHING) | (slope[free] > 0.0)]
            step = np.zeros(count + 1)
            scale = np.sqrt(np.diag(information)[moving])
            step[moving] = (
                np.linalg.solve(information[np.ix_(moving, moving)] / np.outer(scale, scale), slope[moving] / scale)
                / scale
            )
            moved = np.clip(values + step, values / FARTHEST, values * FARTHEST)
            moved[free] = np.maximum(moved[free], NOTHING)
            if np.abs(moved - values).max() < CONVERGED * values.max():
                break
            values = moved
        return float(values[0]), np.where(values[1:] > 2.0 * NOTHING, values[1:], 0.0)

    def expected(self, factor: float, variances: Array, axis: int, similar: float) -> float:
        """Mean of the variance of one axis, um^2, which before the data is similar to another one."""
        steps = np.linspace(-WIDEST, WIDEST, TRIED)
        tried = similar * np.exp(2.0 * SPREAD * steps)
        others = np.arange(len(variances)) != axis
        values = np.array([self.of(factor, np.where(others, variances, each)) for each in tried]) - 0.5 * steps**2
        weights = np.exp(values - values.max())
        return float(weights @ tried / weights.sum())

    def _slope(self, factor: float, variances: Array) -> tuple[Array, Array]:
        """Its derivatives `(1 + axes,)` by the factor and the variances, and their information."""
        # P_V is what the fit leaves of V^-1, the covariance of the noise and the positions together
        root = np.sqrt(variances[self.groups] / factor)
        inverse = root[:, None] * np.linalg.inv(np.eye(len(root)) + root[:, None] * self.shared * root) * root
        reduced = self.shared @ inverse
        own = (self.shared - reduced @ self.shared) / factor  # U' P_V U
        along = (self.along - reduced @ self.along) / factor  # U' P_V r
        twice = (own - reduced @ own) / factor  # U' P_V P_V U
        trace = float(np.trace(reduced))
        squares = self.squares - 2.0 * float(self.along @ inverse @ self.along)
        squares += float(self.along @ inverse @ self.shared @ inverse @ self.along)
        count = len(variances)
        member = np.eye(count)[self.groups]
        slope = np.zeros(count + 1)
        slope[0] = squares / factor**2 - (self.freedom - trace) / factor
        slope[1:] = member.T @ (along**2 - np.diag(own))
        information = np.zeros((count + 1, count + 1))
        information[0, 0] = (self.freedom - 2.0 * trace + float(np.sum(reduced * reduced.T))) / factor**2
        information[0, 1:] = information[1:, 0] = member.T @ np.diag(twice)
        information[1:, 1:] = member.T @ own**2 @ member
        return 0.5 * slope, 0.5 * information


class _Response(NamedTuple):
    """What a fit takes up of errors at the visited positions of its axes, in units of their columns."""

    axes: tuple[str, ...]
    groups: np.ndarray
    """Number of the axis of each position `(k,)`."""
    likelihood: _Likelihood
    learned: Array
    """Change of the parameters `(p, k)` by an error of 1 um at each position."""
    scalars: int
    named: Mapping[str, float]
    """Variance, um^2, by axis, of the waves along it that the model has."""

    @classmethod
    def of(cls, linearised: LinearisedFit) -> _Response | None:
        """The response of a fit; None without such positions.

        With the registration projected out, and R the root of the covariance of the parameters, the noise keeps
        P = 1 - (J R)(J R)' of an error, and the parameters take R (J R)' of it.
        """
        found, visited = linearised.fit, _visited(linearised)
        if not visited or found.model.covariance is None:
            return None
        count = len(visited)
        groups = np.repeat(np.arange(count), [own.columns.shape[1] for own in visited])
        kinds = np.concatenate([groups, np.repeat(np.arange(count, 2 * count), NODES)])
        first = len(found.registration.names)
        free = np.linalg.svd(linearised.design[:, :first], full_matrices=False)
        posed = free.U[:, RANK * free.S.max(initial=0.0) < free.S]
        columns = np.concatenate([own.columns for own in visited] + [own.smooth for own in visited], axis=1)
        apart, residual, design = (
            each - posed @ (posed.T @ each) for each in (columns, linearised.residual, linearised.design[:, first:])
        )
        root = root_of(np.array(found.model.covariance)) / found.widening**0.5
        spanned = design @ _in_priors(found.prior, root)
        # uncertainties with other noise than that of these rows may span more than there is
        values, turned = np.linalg.eigh(spanned.T @ spanned)
        spanned = spanned @ (turned / np.sqrt(np.maximum(values, 1.0))) @ turned.T
        through = spanned.T @ apart
        freedom = len(residual) - posed.shape[1] - float(np.sum(spanned**2))
        likelihood = _Likelihood(
            kinds, apart.T @ apart - through.T @ through, apart.T @ residual, float(residual @ residual), freedom
        )
        axes, learned = tuple(own.axis for own in visited), root @ through[:, : len(groups)]
        return cls(axes, groups, likelihood, learned, linearised.scalars, _named_waves(found))

    def variances(self) -> Array:
        """Expected variances `(axes,)`, um^2, by the probability that there are any.

        A machine that has them along one axis, also as waves that the model has, has them along the others too, of
        similar size as far as the data allow.
        """
        likelihood, count = self.likelihood, len(self.axes)
        every = range(2 * count)
        factor, variances = likelihood.likeliest(every, 2 * count)
        most = likelihood.of(factor, variances)
        probable = np.zeros(count)
        for k in np.flatnonzero(variances[:count]).tolist():
            without = likelihood.of(*likelihood.likeliest([other for other in every if other != k], 2 * count))
            odds = np.exp(min(most - without - 0.5 * np.log(self.scalars), CERTAIN))
            probable[k] = odds / (1.0 + odds)
        found = probable * variances[:count]
        clearest = int(np.argmax(probable))
        sure, similar = float(probable[clearest]), float(variances[clearest])
        if self.named:
            sure, similar = 1.0, float(np.mean(list(self.named.values())))
        for k, axis in enumerate(self.axes):
            if axis not in self.named and (self.named or k != clearest) and similar:
                shared = (1.0 - probable[k]) * sure
                found[k] += shared * likelihood.expected(factor, variances, k, similar)
        return np.asarray(found)


def fine_variances(linearised: LinearisedFit) -> dict[str, float]:
    """Expected variance, um^2, of the fine errors along each linear axis."""
    response = _Response.of(linearised)
    return {} if response is None else dict(zip(response.axes, response.variances().tolist(), strict=True))


def squares_by_fine_errors(linearised: LinearisedFit) -> Array:
    """Mean squares `(3,)`, um^2, of the errors of a model at unseen states by fine errors along the axes.

    Those at the unseen positions, and those of the measured ones that the model has learned. Where no position was
    measured again, those that the shifts from stop to stop may be: as noise, they are in the covariance of the model.
    """
    response, noise, measurement = _Response.of(linearised), linearised.measurement.noise, linearised.measurement
    variances = np.zeros(0) if response is None else response.variances()
    along = {} if response is None else dict(zip(response.axes, variances.tolist(), strict=True))
    for axis, off in ({} if noise is None else noise.recurring).items():
        along[axis] = max(along.get(axis, 0.0), (off / unit_of(axis)[1]) ** 2)
    squares = squares_along(measurement, along)
    if response is None:
        return squares
    learned = response.learned * np.sqrt(variances[response.groups])
    taken = (moment.design(linearised.fit.model) @ learned for moment in moments(measurement))
    return np.asarray(squares + np.mean([np.mean(np.sum(each**2, axis=2), axis=0) for each in taken], axis=0))


def _visited(linearised: LinearisedFit) -> list[_Visited]:
    """The linear axes with positions that several stops share."""
    measurement = linearised.measurement
    machine, stop = measurement.machine, measurement.stops[linearised.rows]
    found = []
    for axis in measurement.moving:
        if axis[0] in "ABC" or measurement.axis is not None or measurement.across is not None:
            continue
        number = np.unique(np.round(linearised.positions(axis), DIGITS), return_inverse=True)[1].reshape(-1)
        pairs = np.unique(np.stack([number, stop]), axis=1)[0]
        often = np.flatnonzero(np.bincount(pairs) > 1)
        # the curves of an axis with few positions have uncertainties between them already
        if number.max() >= FEW and len(often) >= ENOUGH:
            often = often[np.linspace(0, len(often) - 1, min(len(often), MOST)).astype(int)]
            i, component, _ = own_motion(machine, axis)
            arms = linearised.transform[:, :, [6 * i + component]] * UM
            member = (number[:, None] == often).astype(float)
            columns = linearised.decorrelation.apply(arms * member[:, None, :])
            smooth = linearised.decorrelation.apply(arms * _smooth(linearised.positions(axis))[:, None, :])
            found.append(_Visited(axis, columns.reshape(-1, len(often)), smooth.reshape(-1, NODES)))
    return found


def _named_waves(found: Fit) -> dict[str, float]:
    """Variance, um^2, by linear axis, of the cyclic positioning errors of a model."""
    variances: dict[str, float] = {}
    for effect in found.model.effects:
        if (
            isinstance(effect, Cyclic)
            and effect.component == own_component(effect.axis)
            and effect.axis[0] not in "ABC"
        ):
            power = 0.5 * float(np.sum(np.square([*effect.sine, *effect.cosine])))
            variances[effect.axis] = variances.get(effect.axis, 0.0) + power
    return variances


def _smooth(x: Array) -> Array:
    """Independent parts `(n, NODES)` of a smooth error at positions `(n,)`, of unit variance together."""
    nodes = np.linspace(x.min(), x.max(), NODES)
    distance = np.abs(nodes[:, None] - nodes) / (LENGTH * np.ptp(x))
    correlation = (1.0 + 5**0.5 * distance + 5.0 * distance**2 / 3.0) * np.exp(-(5**0.5) * distance)
    root = np.linalg.cholesky(correlation + JITTER * np.eye(NODES))
    return np.asarray(BSpline(tuple(nodes.tolist()), 1).columns(x) @ root)


def _in_priors(prior: Array, values: Array) -> Array:
    """Values of the parameters `(p, k)` in units of their priors."""
    if prior.ndim == 2:
        return np.asarray(np.linalg.solve(prior, values))
    return np.asarray(values / np.where(np.isfinite(prior), prior, 1.0)[:, None])
