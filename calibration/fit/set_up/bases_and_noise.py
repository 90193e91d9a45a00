"""Bases of the error motions and the noise of the data, which depend on each other.

An axis that does not repeat looks like an error motion of many parameters, and a fine error motion like an axis that
does not repeat: where both explain the data, the more probable one is taken.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from calibration.fit.acceptance import too_few
from calibration.fit.bases.search import AUTO, MOST_LINEAR_PARAMETERS, ROTARY_KIND, Choice
from calibration.fit.bases.selection import choose, coarse_choice, finer, fitted
from calibration.fit.cross_validation import cross_validate, diagonals
from calibration.fit.fit import Fit
from calibration.fit.identifiability import identifiability
from calibration.fit.noise import with_estimated_noise
from calibration.measurement.measurement import Measurement
from calibration.observation.full_model import stated_bases, with_effects
from calibration.observation.outliers import Variance
from kinematics.effects import Effect
from kinematics.running.progress import Progress
from kinematics.transforms import Array

LEAST_BASIS_SIZE = 6
"""Least size of a basis under the noise of axes that do not repeat."""
MOST_REPEATING_PARAMETERS = 8
"""Most parameters of an error motion that cannot imitate an axis which does not repeat."""


@dataclass(frozen=True)
class Wanted:
    """Request for a fit; fields as the arguments of `calibration.fit.calibrate.calibrate`."""

    basis: str
    margin: int
    effects: tuple[Effect, ...]
    prior_scale: float | None
    variance: Variance
    progress: Progress

    @property
    def automatic(self) -> bool:
        """True where the evidence selects the bases."""
        return self.basis == AUTO or self.basis.startswith(f"{AUTO}:")

    def choice(self, measurement: Measurement, finest: int = MOST_LINEAR_PARAMETERS) -> Choice:
        """The bases of all axes under the noise of the measurement, of at most so many parameters on linear axes."""
        if not self.automatic:
            return Choice(stated_bases(self.basis, list(measurement.moving)), self.prior_scale or 1.0)
        found = choose(
            measurement,
            measurement.instrument.BASES if self.basis == AUTO else (self.basis.removeprefix(f"{AUTO}:"),),
            rotary_kind=ROTARY_KIND if self.basis == AUTO else None,
            effects=self.effects,
            prior_scale=self.prior_scale,
            finest=finest,
            unexplained=None if diagonals(measurement) is None else partial(_unexplained, measurement, self.effects),
            progress=self.progress,
        )
        return finer(found, measurement, self.margin)

    def fit(self, measurement: Measurement, choice: Choice, near: Fit | None = None) -> Fit:
        """The fit with these bases; estimated noise holds the variance factor. near: the fit with another noise."""
        variance = self.variance if measurement.noise is None else "sheet"
        return fitted(measurement, choice, self.effects, variance, near, self.progress)

    def noisy(self, found: Fit) -> Measurement:
        """The measurement of a fit, with the noise that the residuals show where they contradict the specification."""
        self.progress("estimating the noise")
        return with_estimated_noise(found)


def with_bases_and_noise(measurement: Measurement, wanted: Wanted) -> tuple[Choice, Fit]:
    """The bases and the fit, with the noise that the residuals show where they contradict the specification."""
    choice = wanted.choice(measurement)
    first = wanted.fit(measurement, choice)
    found = [_noisy(first, choice, wanted)]
    if wanted.automatic and any(basis.size > MOST_REPEATING_PARAMETERS for basis in choice.bases.values()):
        coarse = wanted.noisy(wanted.fit(measurement, wanted.choice(measurement, MOST_REPEATING_PARAMETERS)))
        if coarse.noise is not None and coarse.noise.arms.shape[2]:
            found.append(_again(coarse, wanted))
    best = max(found, key=lambda each: each[1].log_probability)
    if wanted.automatic and measurement.instrument.OBSERVES == "offset":
        return _determined(*best, wanted)
    return best


def _determined(choice: Choice, found: Fit, wanted: Wanted) -> tuple[Choice, Fit]:
    """The fit; where the rows are too few for it, one of coarse bases, whose noise contains the remaining errors."""
    if not too_few([found], identifiability(found)):
        return choice, found
    measurement = replace(found.measurement, noise=None)
    coarse = coarse_choice(measurement, wanted.effects, wanted.prior_scale)
    first = wanted.fit(measurement, coarse)
    noisy = wanted.noisy(first)
    return coarse, first if noisy.noise is None else wanted.fit(noisy, coarse, first)


def _noisy(found: Fit, choice: Choice, wanted: Wanted) -> tuple[Choice, Fit]:
    """A fit by the specification, or one with the noise that it shows; for axes that do not repeat with other bases."""
    noisy = wanted.noisy(found)
    if noisy.noise is None:
        return choice, found
    if noisy.noise.arms.shape[2] and wanted.automatic:
        return _again(noisy, wanted)
    return choice, wanted.fit(noisy, choice, found)


def _again(noisy: Measurement, wanted: Wanted) -> tuple[Choice, Fit]:
    """Bases selected under estimated noise, and the fit with the noise that is estimated beside these."""
    choice = _resolving(wanted.choice(noisy), noisy)
    first = wanted.fit(noisy, choice)
    return choice, wanted.fit(wanted.noisy(first), choice, first)


def _resolving(choice: Choice, noisy: Measurement) -> Choice:
    """The choice, with `LEAST_BASIS_SIZE` or more sizes of the bases of linear axes, where the positions permit.

    The evidence tolerates a misfit of the order of the uncertainty, which is large where an axis does not repeat, and
    does not contain this misfit. The prior limits the parameters that the data do not determine.
    """
    bases = {
        axis: replace(basis, size=max(basis.size, min(LEAST_BASIS_SIZE, noisy.distinct_positions[axis] - 1)))
        if axis[0] not in "ABC"
        else basis
        for axis, basis in choice.bases.items()
    }
    return replace(choice, bases=bases)


def _unexplained(measurement: Measurement, effects: Sequence[Effect], choice: Choice, _: np.ndarray) -> Array:
    """Mean squared residual `(1,)` of held-out lines under fits of a choice, minus that of the nominal machine.

    In units of the instrument's variance; infinite where no line can be held out.
    """
    model, prior = with_effects(measurement, choice.bases, effects, *choice.scales)
    held_out = cross_validate(measurement.without_copies, model, prior)
    return np.array([np.inf if held_out is None else -held_out.improvement])
