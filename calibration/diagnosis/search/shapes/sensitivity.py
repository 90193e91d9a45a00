"""Sensitivity of the observations to an error of one axis in one direction, position by position.

Error motions, waves and sawtooth functions of an axis in one direction differ only in their sizes at its positions.
Their part that model and registration cannot imitate follows from that of a unit error at each, computed once.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy import linalg

from calibration.diagnosis.search.held_out import HeldBlock
from calibration.diagnosis.search.linearised_fit import RIDGE, LinearisedFit
from calibration.diagnosis.search.score import Complement, Score
from kinematics.effects import COMPONENTS, Component, Effect
from kinematics.transforms import Array

UNSEEN = 1e-12
"""Ridge on the squares of a signal, in units of the noise variance."""


@dataclass(frozen=True)
class Response:
    """Signal of an error of 1, mm or rad, at every position of an axis, by the design of a linearised fit alone.

    Of rows at one position only their sums count: most designs have far fewer positions than rows.
    """

    arm: Array
    """Whitened derivatives `(n, d)` of the observations."""
    x: Array
    """Positions `(m,)`, ascending, mm or degrees."""
    first: np.ndarray
    """First row `(m,)` at each position."""
    number: np.ndarray
    """Number `(n,)` of the position of each row."""
    through: Array
    """`Projected.through` `(q, m)` of a unit error at each position."""

    @classmethod
    def of(cls, linearised: LinearisedFit, axis: str, component: Component) -> Response:
        """Response to an error of an axis in a direction of its error frame."""
        column = 6 * linearised.measurement.machine.index(axis) + COMPONENTS.index(component)
        arm = linearised.decorrelation.apply(linearised.transform[:, :, column])
        x, first, number = np.unique(linearised.positions(axis), return_index=True, return_inverse=True)
        number = number.reshape(-1)
        known = linearised.has_spanned
        sums = _summed(arm, linearised.spanned if known else linearised.design, number)[1]
        return cls(arm, x, first, number, sums if known else linearised.posterior.whitened(sums))

    def without(self, shared: Array, own: Array, block: HeldBlock) -> Response:
        """Response of the rows that are not in a block, in the fit of these.

        shared: J'G `(q, m)` of a unit error at each position in all rows, with the design J; own: J `(k, q)` of the
        block.
        """
        inside = block.rows.reshape(self.arm.shape)[:, 0]
        numbers, lost = _summed(self.arm[inside], own, self.number[inside])
        left = shared.copy()
        left[:, numbers] -= lost
        return replace(self, arm=np.where(inside[:, None], 0.0, self.arm), through=block.posterior.whitened(left))

    @cached_property
    def squares(self) -> Array:
        """Squares `(m,)` of the signal."""
        return self.sums(self.arm**2)

    @cached_property
    def absorbed(self) -> Array:
        """Rows `(k, m)` with the same products among each other as `through`; few where these are worth finding."""
        q, m = self.through.shape
        return self.through if q < 2 * m else np.asarray(linalg.qr(self.through, mode="r", check_finite=False)[0][:m])

    def errors(self, sizes: Array) -> Errors:
        """Errors of given sizes `(m, k)`."""
        through = self.through @ sizes
        return Errors(sizes, through, Complement.of((sizes * self.squares[:, None]).T @ sizes - through.T @ through))

    def sums(self, values: Array) -> Array:
        """Sums `(m,)` over the rows of each position, of values `(n, d)`."""
        return np.bincount(self.number, np.sum(values, axis=1), len(self.x)).astype(float)


class Errors(NamedTuple):
    """Errors of given sizes at the positions of an axis, and their part that nothing else can imitate."""

    sizes: Array
    """`(m, k)`"""
    through: Array
    """As `Projected.through` `(q, k)`."""
    complement: Complement


def _summed(arm: Array, columns: Array, number: np.ndarray) -> tuple[np.ndarray, Array]:
    """Numbers `(m,)` of the positions of some rows, and the sums `(q, m)` of columns `(n * d, q)` along `arm` there."""
    along = (arm[:, None] @ columns.reshape(*arm.shape, -1))[:, 0]
    rows = np.argsort(number, kind="stable")
    numbers, first = np.unique(number[rows], return_index=True)
    return numbers, np.add.reduceat(along[rows], first).T


@dataclass(frozen=True)
class Sensitivity:
    """Signal of an error of 1, mm or rad, at every position of an axis in a linearised fit."""

    linearised: LinearisedFit
    response: Response
    residual: Array
    """White residual `(N,)` of the fit."""

    @classmethod
    def of(cls, linearised: LinearisedFit, axis: str, component: Component) -> Sensitivity:
        """Sensitivity to an error of an axis in a direction of its error frame."""
        response = linearised.once((axis, component), lambda: Response.of(linearised, axis, component))
        return cls(linearised, response, linearised.residual)

    def without_each(self) -> Callable[[int], Sensitivity]:
        """The same in the fit of all rows but those of a held-out block, given by its number; it has no scores."""
        fit, shared = self.linearised, self.linearised.posterior.unwhitened(self.response.through)

        def without(number: int) -> Sensitivity:
            block = fit.blocks[number]
            response = self.response.without(shared, fit.design[block.rows], block)
            return replace(self, response=response, residual=fit.residual + fit.design @ block.moved)

        return without

    @property
    def x(self) -> Array:
        """Positions `(m,)`, ascending, mm or degrees."""
        return self.response.x

    @property
    def squares(self) -> Array:
        """Squares `(m,)` of the sensitivity."""
        return self.response.squares

    @cached_property
    def along(self) -> Array:
        """Residual `(m,)` along the sensitivity."""
        return self.response.sums(self.response.arm * self.residual.reshape(self.response.arm.shape))

    def signal(self, sizes: Array) -> Array:
        """White signal `(N,)` of errors of given sizes `(m,)`."""
        return (self.response.arm * sizes[self.response.number, None]).reshape(-1)

    def schur(self, sizes: Array) -> Array:
        """Schur complement `(k, k)` of errors of given sizes `(m, k)`; see `Projected.schur`."""
        through = self.response.absorbed @ sizes
        return np.asarray((sizes * self.squares[:, None]).T @ sizes - through.T @ through)

    def gains(self, sizes: Array) -> Array:
        """Reduction of the sum of squares by each of some errors `(m, k)`, alone and with its best amplitude."""
        through = self.response.absorbed @ sizes
        whole = self.squares @ sizes**2
        schur = whole - np.sum(through**2, axis=0)
        return np.where(schur > RIDGE * whole, (self.along @ sizes) ** 2 / np.maximum(schur, 1e-300), 0.0)

    def wave_gains(self, sines: Array, cosines: Array) -> Array:
        """`gains` of waves, each with the best amplitudes of its sine and cosine `(m, k)`."""
        through_sine, through_cosine = self.response.absorbed @ sines, self.response.absorbed @ cosines
        sine = self.squares @ sines**2 - np.sum(through_sine**2, axis=0)
        cosine = self.squares @ cosines**2 - np.sum(through_cosine**2, axis=0)
        both = self.squares @ (sines * cosines) - np.sum(through_sine * through_cosine, axis=0)
        ridge = RIDGE * (sine + cosine) + UNSEEN
        sine, cosine = sine + ridge, cosine + ridge
        along_sine, along_cosine = self.along @ sines, self.along @ cosines
        explained = cosine * along_sine**2 - 2.0 * both * along_sine * along_cosine + sine * along_cosine**2
        return np.asarray(explained / (sine * cosine - both**2))

    def sizes(self, effect: Effect) -> Array:
        """Sizes `(m, k)` of an effect of this axis and direction alone, by its linear parameters, in typical sizes."""
        (only,) = effect.columns(self.linearised.measurement.machine, self.linearised.state.rows(self.response.first))
        linear = np.array(effect.linear)
        typical = np.array(effect.typical)[linear]
        return np.asarray(only.values[:, linear] * np.where(np.isfinite(typical), typical, 1.0))

    def score(self, sizes: Array, shapes: int = 0) -> Score:
        """Score of an error of given sizes; see `LinearisedFit.score`."""
        return self.scored(self.response.errors(sizes), shapes)

    def scored(self, errors: Errors, shapes: int = 0) -> Score:
        """The same of errors whose part beside the model is known."""
        return self.linearised.rated(errors.complement, errors.sizes.T @ self.along, errors.through, shapes)
