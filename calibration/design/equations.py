"""The linear equations of one case: derivatives of observations and volume by true and by fitted parameters.

They are first order in the errors, about the nominal machine; `calibration.study.exact` compares them with fits by the
exact kinematics.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import msgspec
import numpy as np

from calibration.design.layout import Setup
from calibration.design.random_machines import TrueModels
from calibration.design.volume import Volume
from calibration.fit.linear import Part, column_space
from calibration.measurement.measurement import Measurement
from calibration.observation.full_model import axis_effects, least_priors, parse_basis, priors
from kinematics.effects import Effect
from kinematics.error_model.effect_sums import Design
from kinematics.error_model.model import ErrorModel
from kinematics.transforms import Array

IDENTIFIABLE = 1e-10
"""Share of the largest singular value below which a direction of the registration counts as none."""
ROUNDING_OF_COLUMN = 1e-7
"""Share of a column below which its part outside the registration is rounding."""
OTHER_EFFECTS = ""
"""Entry of a part instead of its axis, for the effects that are fitted in addition to the error motions."""


class Made(NamedTuple):
    """Columns of the parameters of a part."""

    observed: Array
    """Whitened derivatives `(N, k)` of the observations, registration eliminated."""
    volume: Array
    """Derivatives `(G, k)`, um, of the aligned deviations in all volumes."""
    prior: Array
    """Typical sizes `(k,)` of the parameters."""
    least_prior: Array
    """Smallest priors `(k,)`, whatever the size of the errors."""


class Columns:
    """Whitened derivatives of the observations, registration eliminated, and aligned derivatives of the volumes."""

    def __init__(self, setup: Setup, volumes: Sequence[Volume], other_effects: Sequence[Effect]) -> None:
        self.measurement, self.volumes, self.other_effects = setup.measurement, tuple(volumes), tuple(other_effects)
        self._transform = setup.white @ setup.measurement.instrument.transform(setup.measurement, setup.registration)
        own = setup.white @ setup.measurement.instrument.registration_design(setup.measurement, setup.registration)
        self._stated = setup.stated
        flat = np.concatenate([own.reshape(-1, own.shape[2]), setup.stated])
        self._units = np.linalg.norm(flat, axis=0)
        self.registration = flat / self._units
        """Whitened derivatives `(N, r)` by the registration, of unit length."""
        self._registration = column_space(self.registration, IDENTIFIABLE)

    def of_true_models(self, true_models: TrueModels) -> tuple[Array, Array]:
        """Derivatives by the coefficients of true models, as of `observed` `(N, t)` and of `evaluated` `(G, t)`."""
        design = self.observed(true_models.model)
        return design * true_models.linear, self.evaluated(true_models.model) * true_models.linear

    def of_part(self, part: Part) -> Made:
        """Columns of one axis' error motions, or of the additional effects, per unit of parameters."""
        model = self.model([part])
        whole = self.observed(model)
        before, observed = np.linalg.norm(whole, axis=0), self._registration.removed(whole)
        # a column that the registration absorbs leaves only rounding, which is no information
        observed[:, np.linalg.norm(observed, axis=0) < ROUNDING_OF_COLUMN * before] = 0.0
        return Made(observed, self.evaluated(model), priors(model), least_priors(self.measurement, model))

    def model(self, parts: Sequence[Part]) -> ErrorModel:
        """The model of these parts, all zero."""
        return model_of(self.measurement, parts, self.other_effects)

    def registered(self, parts: Sequence[Part], left: Array, step: Array) -> Array:
        """The step of the registration for residuals `(N,)`, with the step `(p,)` of the parameters."""
        unexplained = left - self.observed(self.model(parts)) @ step
        return np.asarray(self._registration.back @ (self._registration.basis.T @ unexplained) / self._units)

    def evaluated(self, model: ErrorModel) -> Array:
        """Derivatives `(G, p)`, um, of the aligned deviations in all volumes."""
        return np.concatenate([volume.columns(model) for volume in self.volumes])

    def observed(self, model: ErrorModel) -> Array:
        """Whitened derivatives `(N, p)` of the observations by model parameters, registration not eliminated.

        Behind the observations: those of the stated values of the registration, which are zero.
        """
        design = Design(model.effects, self.measurement.machine, self.measurement.state, with_instrument=True)
        own = design.of(slice(None), self._transform).reshape(self._transform[:, :, 0].size, -1)
        return np.concatenate([own, np.zeros((len(self._stated), own.shape[1]))])


def model_of(measurement: Measurement, parts: Sequence[Part], other_effects: Sequence[Effect]) -> ErrorModel:
    """The fitted model: the error motions of axes in their bases, and additional effects."""
    effects: list[Effect] = []
    for axis, basis in parts:
        effects += other_effects if axis == OTHER_EFFECTS else axis_effects(measurement, axis, parse_basis(basis))
    return msgspec.structs.replace(measurement.nominal_model, effects=tuple(effects))


@dataclass(frozen=True)
class Sample:
    """A chunk of draws of one case."""

    coefficients: Array
    """Coefficients `(t, draws)` of the true models."""
    observed: Array
    """Whitened deviations with noise `(N, draws)`, registration not eliminated."""
    noise: Array
    """Noise `(draws, n, d)` in `observed`."""
    stated: Array
    """Errors `(draws, k)` of the stated values of the registration, in standard uncertainties."""


def sample(setup: Setup, observed_columns: Array, coefficients: Array, rng: np.random.Generator) -> Sample:
    """The observations of true models by the instrument; `observed_columns` `(N, t)`: as `Columns.of_true_models`."""
    n, d, _ = setup.noise.shape
    # one draw after the other: the first draws do not depend on their number
    normal = rng.standard_normal((coefficients.shape[1], n * d + len(setup.stated)))
    noise, stated = (setup.noise @ normal[:, : n * d].reshape(-1, n, d, 1))[..., 0], normal[:, n * d :]
    errors = np.concatenate([noise.reshape(len(noise), -1), stated], axis=1)
    return Sample(coefficients, observed_columns @ coefficients + errors.T, noise, stated)
