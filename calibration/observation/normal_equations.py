"""Normal equations, assembled a block of rows at a time: memory does not grow with the number of observations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations_with_replacement, pairwise
from typing import NamedTuple

import numpy as np

from calibration.measurement.estimated_noise import Decorrelation
from calibration.measurement.measurement import Measurement
from calibration.observation.products import ModelProducts, Products, between
from calibration.registration.registration import Registration
from kinematics.error_model.model import ErrorModel, Observation
from kinematics.transforms import Array, blocks


@dataclass
class NormalEquations:
    """Normal equations over whitened rows; the parameters of the registration first, then those of the model."""

    matrix: Array
    """J'J `(size, size)`."""
    right: Array
    """J'r `(size,)`."""

    @classmethod
    def zero(cls, size: int) -> NormalEquations:
        """The equations of `size` parameters without any rows."""
        return cls(np.zeros((size, size)), np.zeros(size))

    def add(self, parts: Sequence[Products], residual: Array) -> None:
        """Add rows: the whitened columns of all parts of the design, in their order, and the residual `(n, d)`."""
        ends = np.cumsum([0, *(part.width for part in parts)]).tolist()
        own = [slice(low, high) for low, high in pairwise(ends)]
        for (i, a), (j, b) in combinations_with_replacement(enumerate(parts), 2):
            block = between(a, b)
            self.matrix[own[i], own[j]] += block
            if i != j:
                self.matrix[own[j], own[i]] += block.T
        for place, part in zip(own, parts, strict=True):
            self.right[place] += part.along(residual)

    def replace(self, before: NormalEquations, after: NormalEquations) -> None:
        """Replace the equations of some rows by others of them."""
        self.matrix += after.matrix - before.matrix
        self.right += after.right - before.right

    def in_order(self, order: np.ndarray) -> NormalEquations:
        """The equations in the order of the unknowns; `order` `(size,)` is that of each column of these."""
        back = np.argsort(order)
        if np.array_equal(back, np.arange(len(back))):
            return self
        return NormalEquations(self.matrix[np.ix_(back, back)], self.right[back])

    def add_stated(self, measurement: Measurement, registration: Registration) -> None:
        """Add the stated values of the registration, a whitened row each; the registration comes first."""
        own, size = measurement.instrument.stated_design(measurement, registration), len(registration.names)
        if not len(own):
            return
        self.matrix[:size, :size] += own.T @ own
        self.right[:size] += own.T @ measurement.instrument.stated_residuals(measurement, registration)


class Derivatives(NamedTuple):
    """Derivatives of observations by the registration and the parameters of a model."""

    parts: Sequence[Products]
    order: np.ndarray
    """Number `(q,)` of the unknown of each column; those of the registration come first."""

    def rows(self, rows: slice | np.ndarray) -> Derivatives:
        """The derivatives of some of the observations."""
        return self._replace(parts=[part.rows(rows) for part in self.parts])

    def whitened(self, white: Array, decorrelation: Decorrelation) -> Derivatives:
        """The derivatives whitened by `white` `(n, d, d)` and decorrelated."""
        return self._replace(parts=[part.whitened(white, decorrelation) for part in self.parts])

    def times(self, unknowns: Array) -> Array:
        """J u `(n, d)` of unknowns `(q,)`."""
        ends = np.cumsum([part.width for part in self.parts])[:-1]
        each = np.split(unknowns[self.order], ends)
        return np.asarray(sum(part.times(own) for part, own in zip(self.parts, each, strict=True)))

    def along(self, residual: Array) -> Array:
        """J'r `(q,)` of whitened derivatives J and a residual `(n, d)`."""
        right = np.empty(len(self.order))
        right[self.order] = np.concatenate([part.along(residual) for part in self.parts])
        return right

    def normal(self, residual: Array) -> NormalEquations:
        """The normal equations of whitened derivatives and a residual `(n, d)`."""
        normal = NormalEquations.zero(len(self.order))
        normal.add(self.parts, residual)
        return normal.in_order(self.order)


def decorrelation_of(measurement: Measurement, weights: Array | None = None) -> Decorrelation:
    """The transform that makes whitened rows of one stop independent; with weights `(n,)` of the rows."""
    return Decorrelation.of(measurement.noise, measurement.whiteners, weights)


def whitened(whitener: Array, residual: Array) -> Array:
    """W r `(n, d)`."""
    return np.asarray((whitener @ residual[:, :, None])[:, :, 0])


def assemble(
    measurement: Measurement,
    model: ErrorModel,
    registration: Registration,
    whitener: Array,
    residual: Array,
    decorrelation: Decorrelation,
) -> NormalEquations:
    """The normal equations of all rows; `residual` `(n, d)` is whitened and decorrelated already."""
    scalars = len(measurement) * measurement.components
    of_model = ModelProducts(model, measurement.machine, measurement.state, scalars)
    order = _order(of_model, registration)
    normal = NormalEquations.zero(len(order))
    for rows in [slice(0, len(measurement))] if decorrelation.stops else blocks(len(measurement)):
        design = Derivatives(_parts(measurement, of_model, registration, rows), order)
        normal.add(design.whitened(whitener[rows], decorrelation).parts, residual[rows])
    return normal.in_order(order)


def derivatives(
    measurement: Measurement, model: ErrorModel, registration: Registration, most: float = np.inf
) -> Derivatives | None:
    """Derivatives of the observations of all rows, not whitened; None where more than `most` numbers describe them."""
    scalars = len(measurement) * measurement.components
    of_model = ModelProducts(model, measurement.machine, measurement.state, scalars)
    if scalars * (len(registration.names) + of_model.arms) > most:
        return None
    parts = _parts(measurement, of_model, registration, slice(0, len(measurement)))
    return Derivatives(parts, _order(of_model, registration))


def _order(of_model: ModelProducts, registration: Registration) -> np.ndarray:
    """As `Derivatives.order`."""
    size = len(registration.names)
    return np.concatenate([np.arange(size), size + of_model.order])


def _parts(
    measurement: Measurement, of_model: ModelProducts, registration: Registration, rows: slice
) -> list[Products]:
    """Derivatives at some rows, not whitened: by the registration, and by the parts of a model."""
    some = measurement.rows(rows)
    own = Products(some.instrument.registration_design(some, registration))
    if not len(of_model.order):
        return [own]
    parts = [own, *of_model.of(rows, some.instrument.transform(some, registration))]
    if all(part.functions is None for part in parts):
        return [Products(np.concatenate([part.arms for part in parts], axis=2))]
    return parts


def residuals(measurement: Measurement, model: ErrorModel, registration: Registration) -> Array:
    """Observed minus expected `(n, d)`, mm and rad, by the exact kinematics."""
    effects = model.observation(measurement.machine, measurement.state)
    result = np.empty((len(measurement), measurement.components))
    for rows in blocks(len(measurement)):
        part = measurement.rows(rows)
        own = Observation(effects.errors[rows], effects.shift[rows])
        result[rows] = part.counted - part.instrument.expected(part, registration, own)
    return result
