"""Parameters that follow temperatures beside their walk: the terms, their coefficients and their evidence."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.special import logsumexp

from calibration.diagnosis.library.causes import LAGS
from calibration.following.parameters import Touches
from calibration.following.walk import Sizes, Walked, walked
from calibration.gaussian_terms.gains import log_gains
from calibration.gaussian_terms.posterior import Equations, Posterior
from kinematics.effects.base import UM
from kinematics.effects.combined.when import lagged
from kinematics.error_model.priors import OUTLIER_SIZES, SIZES_IN_TYPICAL
from kinematics.transforms import Array

UNKNOWN_ZERO_UM = 1e4
"""Prior size of the zero of a place, um: nothing is known of it."""
DAY = 86400.0
"""Heat of a machine lags by hours, not by days, s."""


class Follows(NamedTuple):
    """A parameter follows a sensor."""

    parameter: int
    sensor: str
    lag_s: float
    """Time constant of a first-order lag, s; 0 for none."""
    size: float = 1.0
    """Prior size of the coefficient, in typical sizes."""
    log_odds: float = 0.0
    """Of its presence, when it was found."""


@dataclass(frozen=True)
class Structure:
    """The terms that are present, beside walk and scatter."""

    touches: Touches
    sizes: Sizes
    """Of one case."""
    terms: tuple[Follows, ...] = ()

    def course(self, term: Follows, temperatures: Mapping[str, float] | None = None, until: float = 0.0) -> Array:
        """Temperatures `(n,)` of a term's sensor behind its lag, K, from the median; with that at another time last."""
        state = self.touches.measurement.state
        assert state.time is not None
        kelvin, time = state.temperatures[term.sensor], state.time
        middle = np.median(kelvin)
        if temperatures is not None:
            kelvin, time = np.append(kelvin, temperatures[term.sensor]), np.append(time, until)
        return np.asarray((lagged(kelvin, time, term.lag_s)[0] if term.lag_s else kelvin) - middle)

    def column(self, term: Follows) -> Array:
        """The deviations `(n, 3)` by a coefficient of 1, um."""
        return self.touches.jacobian[:, :, term.parameter] * self.course(term)[:, None]

    @cached_property
    def columns(self) -> Array:
        """The readings, the zeros of the places, and the terms `(n, 3, 1 + places + terms)`."""
        touches = self.touches
        one = touches.places[:, None] == np.arange(touches.places.max() + 1)
        of_places = np.einsum("nk,ij->nikj", one, np.eye(3)).reshape(len(touches), 3, -1)
        own = [self.column(term)[:, :, None] for term in self.terms]
        return np.concatenate([touches.values[:, :, None], of_places, *own], axis=2)

    @property
    def prior(self) -> Array:
        """Prior sizes of the coefficients of all columns behind the first."""
        places, typical = 3 * (int(self.touches.places.max()) + 1), self.touches.typical
        return np.array([*[UNKNOWN_ZERO_UM] * places, *(term.size * typical[term.parameter] for term in self.terms)])

    def walked(self, columns: Array, sizes: Sizes | None = None) -> Walked:
        """Columns, made white, up to the last reading."""
        time = self.touches.measurement.state.time
        assert time is not None
        return walked(self.touches, columns, sizes or self.sizes, float(time[0]), float(time[-1]))

    def log_evidences(self, sizes: Sizes) -> Array:
        """Log densities `(g,)` of the readings for some sizes of walk and scatter."""
        white = self.walked(self.columns, sizes)
        found = [Posterior.of(Equations.of(w[:, 1:], w[:, 0]), self.prior, 1.0) for w in white.columns]
        return np.array([-0.5 * (p.misfit + p.log_determinant) for p in found]) - 0.5 * white.log_volume

    @cached_property
    def white(self) -> Walked:
        """The columns, made white, up to the last reading."""
        return self.walked(self.columns)

    @property
    def log_likely(self) -> float:
        """Log density of the readings, with the prior odds of the terms: each sensor with each lag is as likely."""
        each = float(np.log(max(len(self.sensors), 1) * (1 + len(self.lags))))
        return float(self.log_evidences(self.sizes)[0]) - len(self.terms) * each

    @cached_property
    def log_evidence(self) -> float:
        """Log density of the readings, less what does not depend on the terms."""
        columns, prior = self.white.columns[0], self.prior
        found = Posterior.of(Equations.of(columns[:, 1:], columns[:, 0]), prior, 1.0)
        return -0.5 * (found.misfit + found.log_determinant)

    def gains(self, groups: Array, prior: Array, cases: Sizes) -> Array:
        """Log evidence `(b,)` by groups of columns `(n, 3, b, w)` of equally likely prior sizes, by all cases."""
        b, width = groups.shape[2:]
        evidences, gained = [], []
        for evidence, others, rest, along in self._beyond(groups.reshape(*groups.shape[:2], -1), cases):
            each, less = (columns.reshape(-1, b, width).swapaxes(0, 1) for columns in (others, rest))
            gained.append(log_gains(each.swapaxes(1, 2) @ less, along.reshape(b, width), prior, 1.0))
            evidences.append(evidence)
        return _by_all(evidences, gained)

    def _beyond(self, columns: Array, cases: Sizes) -> Iterator[tuple[float, Array, Array, Array]]:
        """By cases: log evidence of what is present; columns, made white; what of them is unexplained; along readings.

        The last are the products of the columns with what is unexplained of the readings.
        """
        white, count = self.walked(np.concatenate([self.columns, columns], axis=2), cases), self.columns.shape[2]
        for log_volume, each in zip(white.log_volume.tolist(), white.columns, strict=True):
            own, others = each[:, 1:count], each[:, count:]
            posterior = Posterior.of(Equations.of(own, each[:, 0]), self.prior, 1.0)
            evidence = -0.5 * (posterior.misfit + posterior.log_determinant + log_volume)
            rest = others - own @ (posterior.covariance @ (own.T @ others))
            yield evidence, others, rest, others.T @ (each[:, 0] - own @ posterior.mean)

    def of_candidates(self, parameter: int, candidates: Sequence[Follows]) -> Array:
        """Log evidence by terms of a parameter, for all sizes of its walk: a sensor may take the place of a walk."""
        groups = [self.column(each) * self.touches.typical[parameter] for each in candidates]
        return self.gains(np.stack(groups, axis=2)[:, :, :, None], SIZES_IN_TYPICAL, self._walks_of(parameter))

    def _walks_of(self, parameter: int) -> Sizes:
        """The sizes with all sizes of the walk of one parameter."""
        grid = self._grid
        walk = np.tile(self.sizes.walk, (len(grid), 1))
        walk[:, parameter] = grid
        return Sizes(walk, np.tile(self.sizes.scatter, len(grid)))

    @property
    def _grid(self) -> Array:
        """Variances of walk and scatter that are tried: none, and sizes about what axes repeat to."""
        unit = self.touches.measurement.machine.priors.non_repeatability_um
        return np.append(0.0, (unit * SIZES_IN_TYPICAL) ** 2)

    def of_outliers(self) -> Array:
        """Log odds `(n,)` that a reading, of no earlier log, has a shift of its own."""
        n, prior = len(self.touches), self.touches.measurement.machine.priors.outlier
        groups = np.einsum("nm,ij->nimj", np.eye(n)[:, self.touches.before :], np.eye(3))
        return self.gains(groups, OUTLIER_SIZES / UM, self._quieter) + float(np.log(prior))

    def of_jumps(self) -> Array:
        """Log odds `(n - 2,)` that all parameters jump between a reading and the next, the last one left out.

        The last reading alone may as well be an outlier. The readings are those of no earlier log.
        """
        priors = self.touches.measurement.machine.priors
        jumps = self.touches.jacobian * np.array([each.quantities()[0].typical for each in self.touches.effects])
        behind = self._behind
        groups = behind[:, None, :, None] * jumps[:, :, None, :]
        return self.gains(groups, SIZES_IN_TYPICAL, self._quieter) + float(np.log(priors.rare / behind.shape[1]))

    @property
    def _behind(self) -> np.ndarray:
        """Readings `(all, n - 2)` that are behind each of those between which something may jump."""
        rows = np.arange(len(self.touches))
        return np.asarray(rows[:, None] > rows[self.touches.before : -2])

    def of_masked_jumps(self, parameter: int) -> Array:
        """Log odds `(n - 2,)` that a parameter jumps between a reading and the next, and follows a sensor.

        A walk that is large enough for a jump hides the sensor, and without the sensor the walk hides the jump.
        """
        priors, candidates, behind = self.touches.measurement.machine.priors, self.candidates(parameter), self._behind
        n = behind.shape[1]
        if not candidates:
            return np.full(n, -np.inf)
        size = self.touches.effects[parameter].quantities()[0].typical
        jumps = self.touches.jacobian[:, :, parameter, None] * size * behind[:, None]
        follows = np.stack([self.column(each) * self.touches.typical[parameter] for each in candidates], axis=2)
        pairs = np.array([(k, n + j) for k in range(n) for j in range(len(candidates))])
        evidences, gained = [], []
        for evidence, others, rest, along in self._beyond(
            np.concatenate([jumps, follows], axis=2), self._walks_of(parameter)
        ):
            products = (others.T @ rest)[pairs[:, :, None], pairs[:, None]]
            each = log_gains(products, along[pairs], SIZES_IN_TYPICAL, 1.0).reshape(n, -1)
            gained.append(logsumexp(each, axis=1))
            evidences.append(evidence)
        prior = priors.rare / n / len(self.touches.effects) / (len(self.sensors) * (1 + len(self.lags)))
        return _by_all(evidences, gained) + float(np.log(prior))

    @property
    def _quieter(self) -> Sizes:
        """Walk and scatter, and equal ones of each size, because what is off may have made the present ones large."""
        grid, p = self._grid, self.sizes.walk.shape[1]
        walk = np.concatenate([self.sizes.walk, np.tile(grid[:, None], (1, p))])
        return Sizes(walk, np.append(self.sizes.scatter, grid))

    @property
    def sensors(self) -> list[str]:
        """The sensors whose temperature changes."""
        temperatures = self.touches.measurement.state.temperatures.items()
        return [name for name, kelvin in temperatures if np.isfinite(kelvin).all() and np.ptp(kelvin) > 0.0]

    def candidates(self, parameter: int) -> list[Follows]:
        """Terms of a parameter that may be there besides: each sensor, with and without a lag."""
        present = [(each.sensor, each.lag_s) for each in self.terms if each.parameter == parameter]
        lags = 0.0, *self.lags
        every = [Follows(parameter, sensor, lag) for sensor in self.sensors for lag in lags]
        return [each for each in every if (each.sensor, each.lag_s) not in present]

    @property
    def lags(self) -> list[float]:
        """Lags that are tried, s: a share of a day, or of a shorter run, and halves of it down to one return."""
        time, run = self.touches.measurement.state.time, self.touches.measurement.run
        assert time is not None
        names = np.zeros(len(time)) if run is None else run
        own = max((names == name for name in np.unique(names)), key=lambda rows: float(np.ptp(time[rows])))
        span = float(np.ptp(time[own]))
        returns = span / int(np.bincount(self.touches.places[own]).max())
        longest = max(LAGS) * min(span, DAY)
        return [longest / 2.0**k for k in range(1 + int(max(np.log2(longest / max(returns, 1.0)), 0.0)))]

    def with_likeliest(self, term: Follows) -> Structure:
        """The structure with another term, in its likeliest size."""
        forms = [replace(self, terms=(*self.terms, term._replace(size=size))) for size in SIZES_IN_TYPICAL.tolist()]
        for form in forms:
            form.__dict__["white"] = forms[0].white
        return max(forms, key=lambda each: each.log_evidence)

    def without(self, place: int) -> Structure:
        """The structure without a term, by its place."""
        rest = replace(self, terms=(*self.terms[:place], *self.terms[place + 1 :]))
        column = self.columns.shape[2] - len(self.terms) + place
        white, states = (np.delete(each, column, axis=2) for each in (self.white.columns, self.white.state))
        rest.__dict__["white"] = replace(self.white, columns=white, state=states)
        return rest

    def with_sizes(self, sweeps: int = 2) -> Structure:
        """The structure with the expected variances of walk and scatter, each size being equally likely before."""
        grid, walk, scatter = self._grid, self.sizes.walk[0].copy(), float(self.sizes.scatter[0])
        p = len(walk)
        for _ in range(sweeps):
            variances = np.tile(np.append(walk, scatter), (p + 1, len(grid), 1))
            variances[np.arange(p + 1), :, np.arange(p + 1)] = grid
            flat = variances.reshape(-1, p + 1)
            log_evidences = self.log_evidences(Sizes(flat[:, :p], flat[:, p])).reshape(p + 1, -1)
            weights = np.exp(log_evidences - logsumexp(log_evidences, axis=1, keepdims=True))
            walk, scatter = (weights @ grid)[:p], float((weights @ grid)[p])
        return replace(self, sizes=Sizes(walk[None], np.array([scatter])))


def _by_all(evidences: Sequence[float], gained: Sequence[Array]) -> Array:
    """Log evidence gained `(b,)` by all cases together, from that of each without and the gains."""
    before = np.array(evidences)
    return np.asarray(logsumexp(before[:, None] + gained, axis=0) - logsumexp(before))
