"""The unexplained residual in a follow-up design: as it recurs with the position, and as it recurs with the time."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from calibration.diagnosis.residual.dependence import Unexplained
from calibration.diagnosis.residual.unexplained import in_lengths
from calibration.diagnosis.search.linearised_fit import LinearisedFit
from calibration.follow_up.design import FollowUpDesign
from calibration.observation.normal_equations import whitened
from kinematics.transforms import Array


@dataclass(frozen=True)
class UnexplainedShape:
    """The smooth function of known variables in the residuals of a linearised fit."""

    linearised: LinearisedFit
    dependence: Unexplained

    @cached_property
    def _lengths(self) -> Array:
        """The function `(rows, d)` at all rows of the data, mm and rad; zero at rows without a residual."""
        linearised = self.linearised
        values = np.zeros_like(linearised.fit.residual)
        values[linearised.rows] = in_lengths(linearised, self.dependence)
        return values

    def now(self, linearised: LinearisedFit) -> Array:
        """Its two columns `(N, 2)` in the data: they are the same."""
        column = whitened(linearised.white, self._lengths[linearised.rows]).reshape(-1, 1)
        return np.concatenate([column, column], axis=1)

    def after(self, follow_up: FollowUpDesign, white: Array) -> Array:
        """Its two columns `(n d, 2)` in a follow-up design, by the position and by the time since the start.

        Zero in a design that does not repeat rows of the data. white: `(n, d, d)`.
        """
        n, d = white.shape[:2]
        if follow_up.again is None:
            return np.zeros((n * d, 2))
        by_position = self._lengths[follow_up.again]
        by_time = self._lengths[self._at_the_same_time(follow_up)]
        return np.stack([whitened(white, column).reshape(-1) for column in (by_position, by_time)], axis=1)

    def _at_the_same_time(self, follow_up: FollowUpDesign) -> np.ndarray:
        """Rows of the data at the times since the start of the rows of a follow-up design; without times in order."""
        assert follow_up.again is not None
        repeated = np.sort(follow_up.again)
        before, after = self.linearised.measurement.state.time, follow_up.measurement.state.time
        if before is None or after is None:
            return repeated
        rows = np.arange(repeated[0], repeated[-1] + 1)
        since, elapsed = before[rows] - before[rows[0]], after - after.min()
        nearest = np.searchsorted((since[1:] + since[:-1]) / 2.0, elapsed)
        return np.asarray(rows[nearest])
