"""Columns of a design that are products of arms and functions, and normal matrices of them.

The error motions of an axis are functions of its position, all in one basis: each of their columns is an arm (the
derivative of the observation by the error motion) times a basis function. The block of two axes in a normal matrix sums
products of their arms times products of their functions over the rows. The products of arms are the same for all bases,
and only a few functions of a spline differ from zero in a row.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy import sparse

from calibration.measurement.estimated_noise import Decorrelation
from kinematics.basis import Basis
from kinematics.effects import COMPONENTS, ErrorMotion
from kinematics.effects.base import unit_of
from kinematics.error_model.effect_sums import Design
from kinematics.error_model.model import ErrorModel
from kinematics.machine import Machine
from kinematics.state import State
from kinematics.transforms import Array, read_only

SPARSE = 2.5
"""Ratio of all products of functions to those that are not zero from which a sparse product is faster than BLAS."""
FEW_DERIVATIVES = 1_000_000
"""Most derivatives of a model whose columns are multiplied as they are."""
FEW_EFFECT_PARAMETERS = 5
"""Parameters of an effect, on the average, up to which this is faster for any number of rows."""
ENTRIES = 1_000_000
"""Most products of arms at a time."""


class Functions(NamedTuple):
    """Values of functions `(n, size)`: in each row, only some neighbouring functions differ from zero."""

    first: np.ndarray
    """Number `(n,)` of the first of them."""
    values: Array
    """`(n, k)`"""
    size: int

    @classmethod
    def of(cls, table: Array) -> Functions:
        """The functions with these values `(n, size)`."""
        size = table.shape[1]
        used = table != 0.0
        first = used.argmax(axis=1)
        behind = size - used[:, ::-1].argmax(axis=1)
        # a row of zeros
        behind = np.where(used.any(axis=1), behind, 0)
        width = int((behind - first).max(initial=0))
        first = np.minimum(first, size - width)
        values = np.take_along_axis(table, first[:, None] + np.arange(width), axis=1)
        return cls(first.astype(np.int32), read_only(values), size)

    @property
    def table(self) -> Array:
        """All values `(n, size)`."""
        table = np.zeros((len(self.values), self.size))
        np.put_along_axis(table, self._columns, self.values, axis=1)
        return table

    def rows(self, rows: slice | np.ndarray) -> Functions:
        """The functions in some of the rows."""
        return self._replace(first=self.first[rows], values=self.values[rows])

    def sums(self, coefficients: Array) -> Array:
        """Sums `(n, m)` of the functions with coefficients `(m, size)`."""
        return np.asarray(np.sum(coefficients[:, self._columns] * self.values, axis=2).T)

    def summed(self, other: Functions, table: Array) -> Array:
        """Sums `(size, size of the other, k)` over the rows of products with functions of the other and `(n, k)`."""
        n, width = len(self.values), self.values.shape[1] * other.values.shape[1]
        values = self.values[:, :, None] * other.values[:, None, :]
        if width * SPARSE > self.size * other.size:
            if width < self.size * other.size:
                values = self.table[:, :, None] * other.table[:, None, :]
            # the table is narrow: BLAS is faster in this order
            summed = (table.T @ values.reshape(n, -1)).T
        else:
            columns = self._columns[:, :, None] * np.int32(other.size) + other._columns[:, None, :]
            ends = width * np.arange(n + 1, dtype=np.int32)
            shape = n, self.size * other.size
            summed = sparse.csr_array((values.reshape(-1), columns.reshape(-1), ends), shape=shape).T @ table
        return np.asarray(summed).reshape(self.size, other.size, table.shape[1])

    @property
    def _columns(self) -> np.ndarray:
        """Numbers `(n, k)` of the stored functions."""
        return np.asarray(self.first[:, None] + np.arange(self.values.shape[1], dtype=np.int32))


@dataclass(frozen=True)
class Products:
    """Columns of a design, in the order of the arms: each arm times each function, or the arms themselves."""

    arms: Array
    """`(n, d, m)`"""
    functions: Functions | None = None

    @property
    def width(self) -> int:
        """Number of columns."""
        return int(self.arms.shape[2]) * (1 if self.functions is None else self.functions.size)

    @property
    def columns(self) -> Array:
        """All columns `(n, d, m * size)`."""
        if self.functions is None:
            return self.arms
        n, d, _ = self.arms.shape
        return (self.arms[:, :, :, None] * self.functions.table[:, None, None, :]).reshape(n, d, -1)

    def whitened(self, white: Array, decorrelation: Decorrelation) -> Products:
        """The columns whitened by `white` `(n, d, d)` and decorrelated."""
        return replace(self, arms=white @ self.arms).decorrelated(decorrelation)

    def decorrelated(self, decorrelation: Decorrelation) -> Products:
        """The whitened columns, decorrelated; no products where functions differ within a stop."""
        if self.functions is not None and not all(_alike(self.functions, each.rows) for each in decorrelation.stops):
            return Products(decorrelation.apply(self.columns))
        return replace(self, arms=decorrelation.apply(self.arms))

    def rows(self, rows: slice | np.ndarray) -> Products:
        """The columns in some of the rows."""
        return Products(self.arms[rows], None if self.functions is None else self.functions.rows(rows))

    def times(self, parameters: Array) -> Array:
        """J p `(n, d)`: the columns J times parameters `(m * size,)`."""
        n, d, m = self.arms.shape
        if self.functions is None:
            return np.asarray((self.arms.reshape(n * d, m) @ parameters).reshape(n, d))
        sums = self.functions.sums(parameters.reshape(m, self.functions.size))
        return np.asarray((self.arms @ sums[:, :, None])[:, :, 0])

    def along(self, residual: Array) -> Array:
        """J'r `(m * size,)`: products of the columns J with a residual `(n, d)`."""
        return between(self, Products(residual[:, :, None]))[:, 0]


def _alike(functions: Functions, rows: np.ndarray) -> bool:
    """True where functions have the same values in all rows of each stop; rows `(stops, rows of a stop)`."""
    table = functions.values[rows], functions.first[rows]
    return all(bool((each == each[:, :1]).all()) for each in table)


def arm_products(a: Products, b: Products) -> Array:
    """Products `(n, m, m of the other)` of the arms of two parts of a design, summed over the components."""
    return np.asarray(np.swapaxes(a.arms, 1, 2) @ b.arms)


def between(a: Products, b: Products, of_arms: Array | None = None) -> Array:
    """Ja'Jb `(columns of a, columns of b)`; of_arms: as `arm_products`, for those who have them."""
    (n, d, m), k = a.arms.shape, b.arms.shape[2]
    if a.functions is None and b.functions is None:
        return np.asarray(a.arms.reshape(n * d, m).T @ b.arms.reshape(n * d, k))
    if not a.width or not b.width:
        return np.zeros((a.width, b.width))
    first, second = _functions(a), _functions(b)
    total = np.zeros((first.size, second.size, m * k))
    step = max(ENTRIES // (m * k), 1)
    for rows in (slice(start, start + step) for start in range(0, n, step)):
        arms = arm_products(a.rows(rows), b.rows(rows)) if of_arms is None else of_arms[rows]
        total += first.rows(rows).summed(second.rows(rows), arms.reshape(-1, m * k))
    return total.reshape(first.size, second.size, m, k).transpose(2, 0, 3, 1).reshape(a.width, b.width)


def _functions(part: Products) -> Functions:
    """The functions of a part; 1 for arms without functions."""
    n = len(part.arms)
    return Functions(np.zeros(n, np.int32), np.ones((n, 1)), 1) if part.functions is None else part.functions


class ModelProducts:
    """The columns of a model by its parameters, at any rows; those of the instrument's effects too.

    Products where error motions share a basis, unless the columns are so few that one matrix product of all is faster.
    """

    def __init__(self, model: ErrorModel, machine: Machine, state: State, scalars: int) -> None:
        """scalars: number of scalars that the rows observe in all."""
        parameters = len(model.parameters)
        few = scalars * parameters <= FEW_DERIVATIVES or parameters <= FEW_EFFECT_PARAMETERS * len(model.effects)
        self._machine, self._state = machine, state
        motions: dict[tuple[str, Basis], list[ErrorMotion]] = defaultdict(list)
        places: dict[tuple[str, Basis], list[np.ndarray]] = defaultdict(list)
        others, other_places = [], []
        for effect, part in zip(model.effects, model.slices, strict=True):
            place = np.arange(part.start, part.stop)
            if isinstance(effect, ErrorMotion) and not few:
                motions[effect.axis, effect.basis].append(effect)
                places[effect.axis, effect.basis].append(place)
            else:
                others.append(effect)
                other_places.append(place)
        self._motions = list(motions.values())
        self._others = Design(others, machine, state, with_instrument=True)
        order = [*(place for of_basis in places.values() for place in of_basis), *other_places]
        self.order = np.concatenate(order) if order else np.zeros(0, int)
        """Number `(parameters,)` of the parameter of each column."""
        self.arms = sum(map(len, self._motions)) + sum(map(len, other_places))
        """Number of arms that describe all columns in a row and component."""

    def of(self, rows: slice | np.ndarray, transform: Array) -> list[Products]:
        """The columns at some rows; `transform` as `ErrorModel.observation_design` takes it there."""
        state = self._state.rows(rows)
        of_motions = [error_motions(motions, self._machine, state, transform) for motions in self._motions]
        return [*of_motions, Products(self._others.of(rows, transform))]


def factored(model: ErrorModel, machine: Machine, state: State, transform: Array) -> Products:
    """All columns of a model, in the order of its parameters; products where all effects share a basis of an axis."""
    motions = [motion for motion, _ in model.error_motions]
    if len(motions) == len(model.effects) and len({(motion.axis, motion.basis) for motion in motions}) == 1:
        return error_motions(motions, machine, state, transform)
    return Products(Design(model.effects, machine, state, with_instrument=True).of(slice(None), transform))


def error_motions(motions: Sequence[ErrorMotion], machine: Machine, state: State, transform: Array) -> Products:
    """The columns of error motions of one axis in one basis, at the rows of a state."""
    axis = motions[0].axis
    columns = [6 * machine.index(axis) + COMPONENTS.index(motion.component) for motion in motions]
    units = np.array([unit_of(motion.component)[1] for motion in motions])
    functions = Functions.of(state.basis_columns(machine, axis, motions[0].basis))
    arms = transform[:, :, columns]
    for number, motion in enumerate(motions):
        if motion.shift.any():
            own = slice(6 * machine.index(axis), 6 * machine.index(axis) + 3)
            arms[:, :, number] += transform[:, :, own] @ motion.shift
    return Products(arms * units, functions)
