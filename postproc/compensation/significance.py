"""Significance of the predicted improvement: its part above the uncertainty of the calibration."""

from __future__ import annotations

import msgspec
import numpy as np
from numpy.typing import ArrayLike

from kinematics.deviation import exact_deviation
from kinematics.error_model.covariance import COVERAGE_FACTOR
from kinematics.error_model.model import ErrorModel
from kinematics.error_transform import error_transform_with_tool
from kinematics.machine import Machine
from kinematics.state import State
from kinematics.transforms import Array
from postproc.compensation.datum import DatumPrediction


class Significance(msgspec.Struct):
    """Sum of the improvements at block ends, um, and the significant part of it."""

    tolerance_um: float = 0.0
    """Error before correction, um, below which a move is not worth correcting."""
    improvement: float = 0.0
    significant: float = 0.0
    uncertain: bool = False
    """True if any standard uncertainty was above 0: without uncertainties there is no significance."""
    worthwhile: int = 0
    """Number of evaluated moves with an error before correction above the tolerance."""
    unsure: int = 0
    """Number of these moves whose improvement is not significant."""

    def add(self, before: Array, after: Array, u: Array, moves: ArrayLike = 1) -> None:
        """Add predicted errors before and after `(n,)`, and standard uncertainties `(n,)` of those before, um.

        moves `(n,)`: number of moves that each represents.
        """
        gained, moves = before - after, np.broadcast_to(moves, before.shape)
        self.improvement += float((moves * gained).sum())
        self.significant += float((moves * gained)[gained > COVERAGE_FACTOR * u].sum())
        self.uncertain |= bool(np.any(u > 0.0))
        worthwhile = before > self.tolerance_um
        self.worthwhile += int(moves[worthwhile].sum())
        self.unsure += int(moves[worthwhile & (u > 0.0) & (gained <= COVERAGE_FACTOR * u)].sum())

    @property
    def share(self) -> float | None:
        """Significant share of the improvement; None without an improvement or without uncertainties."""
        if not self.uncertain or self.improvement <= 0.0:
            return None
        return min(max(self.significant / self.improvement, 0.0), 1.0)

    def text(self) -> str:
        """Text with the number of moves that are not significant."""
        return (
            f"for {self.unsure} of {self.worthwhile} moves with a predicted error above {self.tolerance_um:g} um the "
            f"predicted improvement is below {COVERAGE_FACTOR:g} times its standard uncertainty: "
            "the calibration is not certain enough for this program"
        )


def uncertainties_um(
    machine: Machine, model: ErrorModel, state: State, tool: Array, datum: DatumPrediction | None = None
) -> tuple[Array, Array]:
    """Standard uncertainties `(n,)`, um, of the predicted deviation of the tool point, tool `(n, 3)`, mm.

    First the root sum of squares over x, y and z; then the uncertainty of the length of the deviation, along its own
    direction. With a datum, both are of the error relative to it, e(q) - e(W): the same parameters predict e(q) and
    e(W), so that their common part cancels.
    """
    transform = error_transform_with_tool(machine, state.positions, tool)[:, :3]
    design = model.design(machine, state, transform)
    deviation = exact_deviation(machine, state.positions, model.errors(machine, state), tool).position
    if datum is not None:
        design, deviation = design - datum.sensitivity, deviation - datum.shift
    length = np.linalg.norm(deviation, axis=1, keepdims=True)
    # a deviation of 0 has no direction: any will do
    unit = np.where(length > 0.0, deviation / np.where(length > 0.0, length, 1.0), [1.0, 0.0, 0.0])
    along = np.einsum("nk,nkp->np", unit, design)[:, None]
    transform = np.concatenate([transform, np.einsum("nk,nkp->np", unit, transform)[:, None]], axis=1)
    unmeasured = model.unmeasured_variance(machine, state, transform)
    both = model.propagated(np.concatenate([design, along], axis=1), unmeasured) * 1e3
    return np.asarray(np.linalg.norm(both[:, :3], axis=1)), np.asarray(both[:, 3])
