"""What a plan cannot show, by a fit of its rows on a machine without errors."""

from __future__ import annotations

from calibration.design.layout import laid_out
from calibration.fit.fit import fit
from calibration.fit.identifiability import Unidentifiable, identifiability
from calibration.instruments import Instrument
from calibration.measurement.plan import Plan
from calibration.observation.full_model import parse_basis, with_effects

LINEAR, ROTARY = "legendre:3", "fourier:1"
"""Bases of the fit: a constant, a slope and a bend of linear axes, the constant and first harmonic of rotary axes."""


def hidden_from(plan: Plan, instrument: Instrument) -> tuple[Unidentifiable, ...]:
    """The errors that no data of this plan determine, with reason and remedy."""
    measured = laid_out(plan, instrument).measurement
    rotary = {axis.name for axis in plan.machine.axes if axis.rotary}
    bases = {name: parse_basis(ROTARY if name in rotary else LINEAR) for name in measured.moving}
    model, prior = with_effects(measured, bases, (), 1.0)
    return identifiability(fit(measured, model, prior=prior)).unidentifiable
