"""Sensitivity of the observations to an error of one axis in one direction, row by row.

Error motions, waves and sawtooth functions of an axis in one direction differ only in their sizes at the rows. Their
part that model and registration cannot imitate follows from that of a unit error at each row, computed once.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from calibration.diagnosis.search.linearised_fit import RIDGE, LinearisedFit
from calibration.diagnosis.search.score import Score
from kinematics.effects import COMPONENTS, Component, Effect
from kinematics.transforms import Array

UNSEEN = 1e-12
"""Ridge on the squares of a signal, in units of the noise variance."""


@dataclass(frozen=True)
class Sensitivity:
    """Signal of an error of 1, mm or rad, at every row of a linearised fit."""

    linearised: LinearisedFit
    arm: Array
    """Whitened derivatives `(n, d)` of the observations."""

    @classmethod
    def of(cls, linearised: LinearisedFit, axis: str, component: Component) -> Sensitivity:
        """Sensitivity to an error of an axis in a direction of its error frame."""
        column = 6 * linearised.measurement.machine.index(axis) + COMPONENTS.index(component)
        return cls(linearised, linearised.decorrelation.apply(linearised.transform[:, :, column]))

    @cached_property
    def along(self) -> Array:
        """Residual `(n,)` along the sensitivity."""
        return np.asarray(np.sum(self.arm * self.linearised.residual.reshape(self.arm.shape), axis=1))

    @cached_property
    def squares(self) -> Array:
        """Squares `(n,)` of the sensitivity."""
        return np.asarray(np.sum(self.arm**2, axis=1))

    @cached_property
    def _through(self) -> Array:
        """`Projected.through` `(q, n)` of a unit error at each row."""
        n, d = self.arm.shape
        along = self.arm[:, None] @ self.linearised.spanned.reshape(n, d, -1)
        return np.asarray(along[:, 0].T)

    def schur(self, sizes: Array) -> Array:
        """Schur complement `(k, k)` of errors of given sizes `(n, k)`; see `Projected.schur`."""
        through = self._through @ sizes
        return np.asarray((sizes * self.squares[:, None]).T @ sizes - through.T @ through)

    def gains(self, sizes: Array) -> Array:
        """Reduction of the sum of squares by each of some errors `(n, k)`, alone and with its best amplitude."""
        through = self._through @ sizes
        whole = self.squares @ sizes**2
        schur = whole - np.sum(through**2, axis=0)
        return np.where(schur > RIDGE * whole, (self.along @ sizes) ** 2 / np.maximum(schur, 1e-300), 0.0)

    def wave_gains(self, sines: Array, cosines: Array) -> Array:
        """`gains` of waves, each with the best amplitudes of its sine and cosine `(n, k)`."""
        through_sine, through_cosine = self._through @ sines, self._through @ cosines
        sine = self.squares @ sines**2 - np.sum(through_sine**2, axis=0)
        cosine = self.squares @ cosines**2 - np.sum(through_cosine**2, axis=0)
        both = self.squares @ (sines * cosines) - np.sum(through_sine * through_cosine, axis=0)
        ridge = RIDGE * (sine + cosine) + UNSEEN
        sine, cosine = sine + ridge, cosine + ridge
        along_sine, along_cosine = self.along @ sines, self.along @ cosines
        explained = cosine * along_sine**2 - 2.0 * both * along_sine * along_cosine + sine * along_cosine**2
        return np.asarray(explained / (sine * cosine - both**2))

    def sizes(self, effect: Effect) -> Array:
        """Sizes `(n, k)` of an effect of this axis and direction alone, by its linear parameters, in typical sizes."""
        (only,) = effect.columns(self.linearised.measurement.machine, self.linearised.state)
        linear = np.array(effect.linear)
        typical = np.array(effect.typical)[linear]
        return np.asarray(only.values[:, linear] * np.where(np.isfinite(typical), typical, 1.0))

    def score(self, sizes: Array, shapes: int = 0) -> Score:
        """Score of an error of given sizes; see `LinearisedFit.score`."""
        through = self._through @ sizes
        schur = (sizes * self.squares[:, None]).T @ sizes - through.T @ through
        return self.linearised.rated(schur, sizes.T @ self.along, through, shapes)
