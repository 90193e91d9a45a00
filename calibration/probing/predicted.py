"""Prediction for a planned measurement on spheres: errors that it cannot show, and uncertainties of location errors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from calibration.fit.calibrate import in_datum
from calibration.fit.fit import Fit, fit
from calibration.fit.identifiability import Unidentifiable, identifiability
from calibration.instruments import TouchProbe
from calibration.measurement.measurement import Distance, Measurement, with_moves
from calibration.measurement.plan import Plan
from calibration.observation.full_model import parse_basis, with_effects

GOOD_AXIS_SHARE = 0.1
"""Error motions of good linear axes as a share of the typical size, 30 um and urad; their squareness keeps its size."""
LINEAR, ROTARY = "legendre:1", "fourier:1"
"""Bases of the prediction: constants and slopes of linear axes, constants and first harmonics of rotary axes."""


@dataclass(frozen=True)
class Predicted:
    """Prediction for a plan, before it is measured."""

    uncertainty: Mapping[str, float]
    """Expanded uncertainties (k = 2) of the location errors, um or urad, by name."""
    uncertainty_small: Mapping[str, float]
    """The same where errors of linear axes are within `GOOD_AXIS_SHARE` of the typical size."""
    unidentifiable: tuple[Unidentifiable, ...]
    """Errors that this measurement cannot show, with reason and remedy."""
    parameters: int
    rank: int
    """Number of parameters that the measurement determines, of all."""


def predicted(plan: Plan, u_um: float, distances_u_mm: Mapping[tuple[str, str], float]) -> Predicted:
    """The prediction by a fit of the planned rows on a machine without errors.

    distances_u_mm: standard uncertainties of calibrated distances between two spheres.
    """
    n, at_rest = len(plan), np.zeros_like(plan.positions)
    state = replace(plan.state, velocity=at_rest, acceleration=at_rest, observed=np.zeros((n, 3)))
    distances = tuple(
        Distance(one, other, float(np.linalg.norm(np.subtract(plan.spheres[one], plan.spheres[other]))), u)
        for (one, other), u in distances_u_mm.items()
    )
    measured = Measurement(
        plan.machine, TouchProbe(u_um=u_um), with_moves(state), np.zeros((n, 3)), plan.targets, run=plan.run,
        spheres=plan.spheres, distances=distances,
    )  # fmt: skip
    rotary = {axis.name for axis in plan.machine.axes if axis.rotary}
    bases = {name: parse_basis(ROTARY if name in rotary else LINEAR) for name in measured.moving}
    model, prior = with_effects(measured, bases, (), 1.0)
    found = fit(measured, model, prior=prior)
    identified = identifiability(found)
    small = fit(measured, model, prior=with_effects(measured, bases, (), GOOD_AXIS_SHARE, 1.0)[1])
    return Predicted(
        _location_U(found), _location_U(small), identified.unidentifiable, identified.parameters,
        identified.rank_registered,
    )  # fmt: skip


def _location_U(found: Fit) -> dict[str, float]:
    """Expanded uncertainties (k = 2) of location errors by name."""
    return {effect.name: 2.0 * float(effect.uncertainties[0]) for effect, _ in in_datum(found).location_errors}
