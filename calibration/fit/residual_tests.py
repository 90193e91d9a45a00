"""Residual tests: a dependence of the residuals on a variable is a first hint at an effect missing from the model."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from scipy import special

from calibration.fit.fit import Fit
from kinematics.transforms import Array

FALSE_HINT_PROBABILITY = 1e-3
"""Probability of a false hint in a whole report (Bonferroni over all tests)."""
CLIP = 5.0
"""Largest residual in the tests, in standard uncertainties; larger ones are reduced to it."""


class DependenceTest(NamedTuple):
    """A variable on which the residuals depend."""

    variable: str
    p_value: float
    hint: str
    """The effect to try, as an option of the fit."""


def dependences(fit: Fit) -> list[DependenceTest]:
    """Directions, time and temperatures on which the residuals depend, the most significant first.

    For each, the F-test of the whitened residuals' regression on it, component by component in the instrument's frame.
    """
    measurement = fit.measurement
    # a missing effect may have made rows outliers: they count, but CLIP limits the influence of each
    rows = ~fit.copies & ~np.isin(measurement.groups, fit.failed)
    white = np.clip(fit.white[rows], -CLIP, CLIP)
    looked_at = list(_variables(fit))
    limit = FALSE_HINT_PROBABILITY / max(len(looked_at), 1)
    found = [DependenceTest(variable, _p_value(white, values[rows]), hint) for variable, values, hint in looked_at]
    return sorted(
        (dependence for dependence in found if dependence.p_value < limit), key=lambda dependence: dependence.p_value
    )


def _variables(fit: Fit) -> Iterator[tuple[str, Array, str]]:
    """Name, values `(n,)` and hint of each variable in the data."""
    state, machine = fit.measurement.state, fit.measurement.machine
    if state.approach is not None:
        for i, axis in enumerate(machine.names):
            yield f"the direction of {axis}", state.approach[:, i], f"--effect backlash:axis={axis},width=0"
    if state.time is not None:
        hint = "--effect thermal-drift:component=Z,rate=0 or thermal-scale:axis=...,rate=0"
        if not fit.measurement.instrument.CLOCK_OF_MACHINE:  # its clock is that of the measuring machine
            hint = "--effect tracker-drift, a drift of the part on the measuring machine"
        yield "time", state.time, hint
    for name, temperature in state.temperatures.items():
        hint = (
            f"--effect thermal-scale-sensor:axis=...,sensor={name},coefficient=0 or thermal-drift-sensor:component=..."
        )
        yield f"the temperature {name}", temperature, hint


def _p_value(white: Array, values: Array) -> float:
    spread = values - values.mean()
    size = float(spread @ spread)
    n, components = white.shape
    if size <= 0.0 or n < 10:
        return 1.0
    slopes = spread @ (white - white.mean(axis=0)) / size
    explained = float(np.sum(slopes**2)) * size
    unexplained = float(np.sum((white - white.mean(axis=0)) ** 2)) - explained
    degrees_of_freedom = components * (n - 2)
    return float(
        special.fdtrc(components, degrees_of_freedom, explained / components / (unexplained / degrees_of_freedom))
    )
