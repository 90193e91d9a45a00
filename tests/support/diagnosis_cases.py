"""Virtual measurements with causes in them, and fits that lack these, for the tests of the diagnosis."""

from dataclasses import replace

import msgspec
import numpy as np

import machines
from calibration.fit.fit import fit
from calibration.observation.full_model import BasisChoice, priors, rigid_model
from kinematics.error_model.model import no_errors
from support.virtual_measurements import THREE, measured, positions

CFRAME = machines.load("cframe")
GENEROUS = 5.0
"""Prior standard deviation of the parameters of an effect, in typical sizes."""
LEGENDRE = dict.fromkeys("XYZ", BasisChoice("legendre", 3))
WIDE = 5.0
"""Prior standard deviation of the parameters of effects, in typical sizes."""


def data_with(*effects, n=100, seed=3, stations=1, **columns):
    """Random positions of the C-frame, its errors just these effects; further columns of the state."""
    rng = np.random.default_rng(seed)
    model = msgspec.structs.replace(no_errors(CFRAME), effects=effects)
    return measured(CFRAME, positions(CFRAME, n, rng), THREE, model, rng, stations=stations, **columns)


def fitted(data, *effects, prior=None):
    """Error motions of all axes, and these effects with wide priors of their own."""
    base = rigid_model(data, LEGENDRE)
    own = [WIDE * quantity.typical for effect in effects for quantity in effect.parameter_table]
    model = msgspec.structs.replace(base, effects=(*base.effects, *effects))
    return fit(data, model, prior=np.concatenate([priors(base), own]) if prior is None else prior)


def with_stops(rows_of_a_stop, sizes, seed=3):
    """A measurement of a C-frame with several rows at each stop, its axes off by random amounts from stop to stop."""
    rng = np.random.default_rng(seed)
    data = data_with(n=200, seed=seed)
    exact = fitted(data)
    data = replace(data, observed=data.observed - exact.residual).rows(np.repeat(np.arange(len(data)), rows_of_a_stop))
    noise = rng.standard_normal((len(data), 3))
    observed = data.observed + np.einsum("nij,nj->ni", np.linalg.cholesky(data.specified_covariances), noise)
    rotation = exact.registration.rotations(data)
    for k, size in sizes.items():
        observed += rotation[:, :, k] * (size * rng.standard_normal(int(data.stops.max()) + 1))[data.stops, None]
    return replace(data, observed=observed, state=replace(data.state, observed=observed))
