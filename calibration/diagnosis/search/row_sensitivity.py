"""Sensitivity of every row of a linearised fit to an error in one direction that changes from row to row.

Functions of time, of positions or of readings in one direction differ only in their values at the rows. Their part that
model and registration cannot imitate follows from that of a unit error in each row, computed once.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from calibration.diagnosis.search.linearised_fit import LinearisedFit
from kinematics.effects import Effect
from kinematics.effects.base import COMPONENTS
from kinematics.transforms import Array


class RowSensitivity(NamedTuple):
    """Signal of an error of 1 in each row."""

    linearised: LinearisedFit
    arm: Array
    """Whitened derivatives `(n, d)`, the rows of a stop not decorrelated."""
    through: Array
    """`Projected.through` `(q, n)`."""
    residual: Array
    """Residual `(n,)` along it."""
    length: Array
    """Lengths `(n,)` of the signals of rows that are independent of all others; 0 of other rows."""
    of_stops: tuple[tuple[np.ndarray, Array], ...]
    """Rows `(stops, m)` of stops of m dependent rows, and roots `(stops, m, m)` of the products of their signals."""

    @classmethod
    def of(cls, linearised: LinearisedFit, arm: Array) -> RowSensitivity:
        """Sensitivity to an error with whitened derivatives `(n, d)`, the rows of a stop not decorrelated."""
        known = np.column_stack([linearised.design, linearised.residual]).reshape(*arm.shape, -1)
        along, length, of_stops = (arm[:, None] @ known)[:, 0], np.linalg.norm(arm, axis=1), []
        for rows, matrices in linearised.decorrelation.stops:
            stops, m = rows.shape
            signals = np.einsum("skmd,smd->smk", matrices.reshape(stops, -1, m, arm.shape[1]), arm[rows])
            along[rows] = signals @ known[rows].reshape(stops, signals.shape[2], -1)
            values, vectors = np.linalg.eigh(signals @ np.swapaxes(signals, 1, 2))
            of_stops.append((rows, np.sqrt(np.maximum(values, 0.0))[:, :, None] * np.swapaxes(vectors, 1, 2)))
            length[rows] = 0.0
        through = linearised.posterior.whitened(along[:, :-1].T)
        return cls(linearised, arm, through, along[:, -1], length, tuple(of_stops))

    @classmethod
    def of_tool(cls, linearised: LinearisedFit, component: str) -> RowSensitivity:
        """Sensitivity to a shift of the tool in one of its directions, mm."""
        column = 6 * len(linearised.measurement.machine.axes) + COMPONENTS.index(component)
        return cls.of(linearised, linearised.transform[:, :, column])

    def values(self, effect: Effect) -> Array:
        """Values `(n, k)` of an effect that acts in this direction alone, by its parameters in typical sizes."""
        (only,) = effect.columns(self.linearised.measurement.machine, self.linearised.state)
        return np.asarray(only.values * effect.typical)

    def columns(self, values: Array) -> Array:
        """White columns `(N, k)` of errors of these values `(n, k)`."""
        columns = self.linearised.decorrelation.apply(self.arm[:, :, None] * values[:, None, :])
        return np.asarray(columns.reshape(self.linearised.scalars, -1))

    def parts(self, values: Array) -> tuple[Array, Array]:
        """Schur complement `(k, k)` of errors of these values `(n, k)`, and the residual along them `(k,)`."""
        white, through = values * self.length[:, None], self.through @ values
        for rows, roots in self.of_stops:
            white[rows] = roots @ values[rows]
        return white.T @ white - through.T @ through, values.T @ self.residual
