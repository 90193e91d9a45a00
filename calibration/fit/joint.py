"""The parameters that several measurements determine together, each with its own registration."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, reduce
from operator import add

import numpy as np
from scipy import special

from calibration.fit.fit import Fit, fit
from calibration.fit.linear import Posterior, pseudo_inverse
from calibration.fit.problem import FIXED, Problem
from calibration.gaussian_terms.band_sizes import likeliest
from calibration.gaussian_terms.geometry import Bands
from calibration.gaussian_terms.posterior import Equations
from calibration.observation.outliers import Variance
from kinematics.error_model.model import ErrorModel
from kinematics.transforms import Array

MOST_JOINT_STEPS, LAST_JOINT_STEP_PRIORS = 8, 1e-3
"""Most steps of the fit, and the length of a step, in units of the priors, at which it ends."""
INFORMED_SHARE = 1e-8
"""Share of the largest eigenvalue of an information above which it has information on a direction."""


@dataclass(frozen=True)
class Share:
    """The information of one measurement on the parameters, linearised at a model; all in units of their priors."""

    alone: Fit
    information: Array
    """`(p, p)`, registration eliminated."""
    machine_information: Array
    """The same for an instrument whose position is known."""
    registered: int
    slope: Array
    """Slope `(p,)` of the log likelihood along the parameters."""

    @classmethod
    def of(cls, alone: Fit, model: ErrorModel, prior: Array) -> Share:
        """The share of the measurement of a fit, at the parameters of a model; prior `(p,)`."""
        problem = Problem.of(alone.measurement, model, prior)
        point = problem.point(model.parameters, registered(alone, model).registration)
        solved = problem.solve(point, alone.kept.astype(float), alone.variance_factor * alone.widening)
        step = solved.step[point.registered :] / prior
        slope = solved.information @ step + step
        return cls(alone, solved.information, solved.machine_information, solved.registered, slope)


@dataclass(frozen=True)
class Joint:
    """The parameters that several measurements determine together."""

    shares: tuple[Share, ...]
    """Linearised at the parameters of the model."""
    model: ErrorModel
    prior: Array
    """Standard deviations `(p,)` of the parameters."""
    wider: Array
    """Factors `(p,)` on them in the covariance, which contains the uncertainty of sizes that the data decide."""

    @classmethod
    def fitted(cls, alone: Sequence[Fit], model: ErrorModel, prior: Array, wider: Array | None = None) -> Joint:
        """The joint fit: Gauss-Newton steps until the parameters move no more."""
        wider = np.ones(len(prior)) if wider is None else wider
        joint = cls(tuple(Share.of(each, model, prior) for each in alone), model, prior, wider)
        for _ in range(MOST_JOINT_STEPS):
            step = joint.step(joint.shares)
            moved = joint.model.with_parameters(joint.model.parameters + prior * step)
            joint = cls(tuple(Share.of(each, moved, prior) for each in alone), moved, prior, wider)
            if np.linalg.norm(step) < LAST_JOINT_STEP_PRIORS:
                break
        return joint

    def step(self, shares: Sequence[Share]) -> Array:
        """Step `(p,)`, in units of the priors, from the model to the parameters by some of the measurements."""
        away = self.model.parameters / self.prior
        return self._posterior(shares).solve(_sum([share.slope for share in shares]) - away)

    def _posterior(self, shares: Sequence[Share]) -> Posterior:
        return Posterior(_sum([share.information for share in shares]), 1.0)

    def by(self, shares: Sequence[Share]) -> tuple[ErrorModel, Array]:
        """The model by some of the measurements, and a root `(p, p)` of its covariance."""
        information = _sum([share.information for share in shares]) * np.outer(self.wider, self.wider)
        root = (self.prior * self.wider)[:, None] * Posterior(information, 1.0).root
        moved = self.model.parameters + self.prior * self.step(shares)
        return self.model.with_parameters(moved, root @ root.T), root

    def sizes(self, bands: Bands) -> tuple[Array, Array]:
        """Likeliest sizes `(p,)` of the parameters, in units of their priors, and factors to their root mean square."""
        information = _sum([share.information for share in self.shares])
        along = _sum([share.slope for share in self.shares]) + information @ (self.model.parameters / self.prior)
        known = self.shares[0].alone.measurement.machine.priors
        found = likeliest(Equations(np.zeros(0), information, along), bands, known, 1.0, bands.first_sizes)
        return found.sizes[bands.bands], (found.root_mean_squares / found.sizes)[bands.bands]

    @cached_property
    def result(self) -> ErrorModel:
        """The model with the covariance by all measurements."""
        return self.by(self.shares)[0]

    @property
    def whole(self) -> Fit:
        """The fit of the measurement with the most observations, with the information of all."""
        largest = max((share.alone for share in self.shares), key=lambda each: each.observations)
        information = _sum([share.information for share in self.shares])
        solved = largest.solved._replace(
            information=information,
            machine_information=_sum([share.machine_information for share in self.shares]),
            registered=sum(share.registered for share in self.shares),
        )
        return replace(registered(largest, self.result), model=self.result, prior=self.prior, solved=solved)

    def p_value(self, number: int) -> float:
        """p-value of the difference of one measurement from the others, in directions that both show."""
        own, others = self.shares[number], [*self.shares[:number], *self.shares[number + 1 :]]
        information, slope = _sum([each.information for each in others]), _sum([each.slope for each in others])
        half = pseudo_inverse(own.information + information, INFORMED_SHARE, 1.0).root
        both = own.information @ half @ (half.T @ information)
        # at the estimate by all, without the prior, the slopes of both are equal and opposite
        along = own.slope - own.information @ half @ (half.T @ (own.slope + slope))
        values, vectors = np.linalg.eigh((both + both.T) / 2.0)
        shown = values > 1.0
        squares = float(np.sum((vectors[:, shown].T @ along) ** 2 / values[shown]))
        return float(special.chdtrc(np.count_nonzero(shown), squares)) if shown.any() else 1.0


def registered(own: Fit, model: ErrorModel) -> Fit:
    """The fit of the registration of a measurement to a model; own: its fit alone."""
    variance: Variance = "sheet" if own.variance_factor == 1.0 else "estimate"
    return fit(own.measurement, model, prior=np.full(len(model.parameters), FIXED), variance=variance)


def _sum(values: Sequence[Array]) -> Array:
    return np.asarray(reduce(add, values))
