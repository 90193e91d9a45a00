"""The model of a fit beside a smooth function of recorded variables, which is an unexplained error.

An error of the measurement, or one that changes with time, is none that a calibration can hold: beside the function
the model learns no more of it than noise and design force it to.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from calibration.diagnosis.residual.absorber import Absorbing, absorbing
from calibration.diagnosis.residual.dependence import Unexplained
from calibration.diagnosis.search.linearised_fit import LinearisedFit
from calibration.fit.fit import Fit
from calibration.fit.linear import Posterior
from kinematics.effects import Effect
from kinematics.error_model.model import ErrorModel
from kinematics.transforms import Array

LEAST_NOISE = 1e-6
"""Least factor on the variances of the noise."""


@dataclass(frozen=True)
class BesideFunction:
    """A fit, and the solution beside a function."""

    plain: LinearisedFit
    """The fit without the function."""
    function: Absorbing

    @classmethod
    def of(cls, linearised: LinearisedFit, dependence: Unexplained) -> BesideFunction:
        """The solution beside the whole function, also beside the terms that the model and the registration imitate."""
        return cls(linearised, absorbing(linearised, dependence, whole=True))

    @property
    def solved(self) -> LinearisedFit:
        """The linearised fit with the function."""
        return self.function.linearised

    @cached_property
    def noise(self) -> float:
        """Factor on the variances of the noise, by the residuals beside the function."""
        return max(self.solved.squares / self.solved.degrees_of_freedom, LEAST_NOISE)

    @cached_property
    def _root(self) -> Array:
        return Posterior(self.solved.information / self.noise, self.solved.limited).root

    @property
    def _model(self) -> slice:
        first = len(self.plain.fit.registration.names)
        return slice(first, first + len(self.plain.fit.model.parameters))

    @cached_property
    def moved(self) -> Array:
        """Distances `(p,)` of the model's parameters beside the function from those without it."""
        return scaled(self.plain.fit.prior, self.solved.away[self._model] - self.plain.fit.away)

    @property
    def coefficients(self) -> Array:
        """Coefficients `(k,)` of the function in the directions of the tool, in units of their priors."""
        return self.solved.away[len(self.solved.away) - len(self.function.prior) :]

    @property
    def values(self) -> Array:
        """The function, with its random walk, at all rows `(n, d)`, mm and rad in the frame of the observations.

        0 at rows that the linearised fit lacks.
        """
        return self.values_of(None)

    def values_of(self, first: int | None) -> Array:
        """The same for the first of its coefficients, all for None."""
        plain, begin = self.plain, self.plain.design.shape[1]
        own = slice(begin, None if first is None else begin + first)
        found = np.zeros_like(plain.fit.residual)
        found[plain.rows] = plain.in_lengths(self.solved.design[:, own] @ self.solved.away[own])
        return found

    @property
    def free(self) -> LinearisedFit:
        """The fit of observations without the function."""
        return self.plain.less(self.values)

    @cached_property
    def root(self) -> Array:
        """Root `(p + k, q)` of the covariance of the model's parameters and of the coefficients, as above.

        A random walk, which shifts all poses alike, is no part of it.
        """
        model = scaled(self.plain.fit.prior, self._root[self._model])
        return np.concatenate([model, self._root[len(self._root) - len(self.function.prior) :]])

    @cached_property
    def fit(self) -> Fit:
        """The fit with the parameters of the model, and their covariance, beside the function."""
        given = self.plain.fit
        root = self.root[: len(given.model.parameters)]
        model = given.model.with_parameters(np.array(given.model.parameters) + self.moved, root @ root.T)
        return replace(given, model=model, away=self.solved.away[self._model])

    def information(self, model: ErrorModel) -> tuple[Array, Array]:
        """Information on the parameters of a model `(q, q)` and slope `(q,)` at the residuals without the function.

        Registration and function are eliminated. The model is that of `fit`, with some effects in other bases that hold
        the same errors.
        """
        fitted, plain, solved = self.fit.model, self.plain, self.solved
        own = [
            self._columns(part) if other is effect else plain.columns(other) / _typical(other)
            for effect, part, other in zip(fitted.effects, fitted.slices, model.effects, strict=True)
        ]
        residual = plain.residual + plain.design[:, self._model] @ (plain.away[self._model] - solved.away[self._model])
        known = np.column_stack([*own, residual])
        nuisance = np.delete(solved.design, self._model, axis=1)
        inner = nuisance.T @ nuisance + np.diag(np.delete(solved.limited, self._model))
        shared = nuisance.T @ known
        whole = (known.T @ known - shared.T @ np.linalg.solve(inner, shared)) / self.noise
        return whole[:-1, :-1], whole[:-1, -1]

    def _columns(self, part: slice) -> Array:
        """White derivatives `(N, k)` by parameters of the model, in their units."""
        prior = self.plain.fit.prior[part]
        return np.asarray(self.plain.design[:, self._model][:, part] / np.where(np.isfinite(prior), prior, 1.0))


def _typical(effect: Effect) -> Array:
    """Units `(k,)` of the derivatives by the parameters of an effect."""
    typical = np.array([quantity.typical for quantity in effect.parameter_table])
    return np.where(np.isfinite(typical), typical, 1.0)


def scaled(prior: Array, values: Array) -> Array:
    """Values `(p, ...)` in units of a prior, in those of the parameters."""
    if prior.ndim == 2:
        return np.asarray(prior @ values)
    return np.asarray((np.where(np.isfinite(prior), prior, 1.0) * values.T).T)
