"""Data on a few diagonals: residuals of each line in a fit of all other lines, for a whole chunk of draws at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from calibration.design.equations import IDENTIFIABLE
from calibration.design.solver import Fits
from calibration.fit.bases.search import Scales
from calibration.fit.cross_validation import diagonals, registered
from calibration.fit.linear import Part, Posterior, column_space
from calibration.observation.outliers import refuse_lines
from calibration.observation.stops_and_lines import held_out_blocks
from kinematics.transforms import Array
from kinematics.user_error import UserError


class Line(NamedTuple):
    """One line, or another block of rows, and the other rows, which are fitted to predict it."""

    predicted: np.ndarray
    """True `(N,)` for the scalars of the line that the others can predict."""
    others: np.ndarray
    """True `(N,)` for the scalars that are fitted."""
    registration: Array
    """Orthonormal columns `(others, r)` of the effect of the registration on the other lines."""
    carried: Array
    """Effect `(predicted, r)` of the same registration on the line."""

    def split(self, columns: Array) -> tuple[Array, Array]:
        """Columns `(N, k)` at the others and at the line, without the registration of the others in both."""
        others = columns[self.others]
        along = self.registration.T @ others
        return others - self.registration @ along, columns[self.predicted] - self.carried @ along


@dataclass(frozen=True)
class HeldOutLines:
    """The lines of a measurement on a few diagonals, each predicted by fits of the others."""

    fits: Fits
    lines_held_out: Sequence[Line]
    _raw: dict[Part, Array] = field(default_factory=dict)

    @classmethod
    def of(cls, fits: Fits) -> HeldOutLines | None:
        """The blocks of `held_out_blocks`; None without such blocks, or off a few diagonals."""
        measurement, registration = fits.columns.measurement, fits.columns.registration
        if diagonals(measurement) is None:
            return None
        labels, _ = held_out_blocks(measurement)
        lines_held_out, number = [], 0
        for label in np.unique(labels):
            others, predicted = labels != label, (labels == label) & registered(measurement, labels != label)
            if not predicted.any():
                continue
            if others.sum() * measurement.components <= registration.shape[1]:
                return None
            try:
                refuse_lines(measurement.rows(np.flatnonzero(others)))
            except UserError:  # the other rows alone cannot be fitted
                return None
            lines_held_out.append(
                _line(registration, *(np.repeat(rows, measurement.components) for rows in (predicted, others)))
            )
            number += int(predicted.sum())
        return cls(fits, lines_held_out) if 2 * number >= len(measurement) else None

    def left(self, parts: Sequence[Part], scales: Scales, observed: Array) -> Array:
        """Sums of squares `(draws,)` of the whitened residuals of the lines, for observations `(N, draws)`."""
        columns = np.concatenate([self._columns(part) for part in parts], axis=1)
        columns *= self.fits.scale(parts, scales)
        total = np.zeros(observed.shape[1])
        for line in self.lines_held_out:
            (design, predicting), (fitted, left_out) = line.split(columns), line.split(observed)
            parameters = Posterior(design.T @ design, 1.0).solve(design.T @ fitted)
            total += np.sum((left_out - predicting @ parameters) ** 2, axis=0)
        return total

    def _columns(self, part: Part) -> Array:
        """Whitened derivatives `(N, k)` by the parameters of a part, registration not eliminated."""
        if part not in self._raw:
            self._raw[part] = self.fits.columns.observed(self.fits.columns.model([part]))
        return self._raw[part]


def _line(registration: Array, predicted: np.ndarray, others: np.ndarray) -> Line:
    space = column_space(registration[others], IDENTIFIABLE)
    return Line(predicted, others, space.basis, registration[predicted] @ space.back)
