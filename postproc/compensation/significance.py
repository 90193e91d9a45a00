"""How sure the predicted improvement is: what of it stands above the uncertainty of the calibration."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kinematics.deviation import exact_deviation
from kinematics.error_model.model import ErrorModel
from kinematics.error_transform import place_transform
from kinematics.machine import Machine
from kinematics.state import State
from kinematics.transforms import Array
from postproc.compensation.datum import DatumPrediction

COVERAGE = 2.0
"""k: an improvement, or a deviation, counts as significant above so many standard uncertainties."""


@dataclass
class Significance:
    """Gathers the improvement at block ends, um, and the part of it that is significant."""

    tolerance_um: float = 0.0
    """A move with a smaller error before is not worth correcting."""
    improvement: float = 0.0
    significant: float = 0.0
    uncertain: bool = False
    """True once any uncertainty was met: a calibration without any says nothing of significance."""
    worthwhile: int = 0
    """Moves with an error before above the tolerance, as many as were looked at."""
    unsure: int = 0
    """Number of these moves whose improvement is not significant."""

    def add(self, before: Array, after: Array, u: Array) -> None:
        """Predicted errors before and after `(n,)`, and standard uncertainties of the former, um."""
        gained = before - after
        self.improvement += float(gained.sum())
        self.significant += float(gained[gained > COVERAGE * u].sum())
        self.uncertain |= bool(np.any(u > 0.0))
        worthwhile = before > self.tolerance_um
        self.worthwhile += int(worthwhile.sum())
        self.unsure += int((worthwhile & (u > 0.0) & (gained <= COVERAGE * u)).sum())

    @property
    def share(self) -> float | None:
        """Of the improvement, what is significant; None where there is nothing to be sure of, or no uncertainty."""
        if not self.uncertain or self.improvement <= 0.0:
            return None
        return min(max(self.significant / self.improvement, 0.0), 1.0)

    def text(self) -> str:
        """Text with the number of moves that are not significant."""
        return (
            f"for {self.unsure} of {self.worthwhile} moves with a predicted error above {self.tolerance_um:g} um the "
            f"predicted improvement is below {COVERAGE:g} times its standard uncertainty: "
            "the calibration is not certain enough for this program"
        )


def uncertainties_um(
    machine: Machine, model: ErrorModel, state: State, tool: Array, datum: DatumPrediction | None = None
) -> tuple[Array, Array]:
    """Standard uncertainties `(n,)`, um, of the predicted deviation of the tool point, tool `(n, 3)`, mm.

    First the root sum of squares over x, y and z; then that of its length, along its own direction. With a datum, of
    the error relative to it, e(q) - e(W): both are predicted by the same parameters, and their common part cancels.
    """
    transform = place_transform(machine, state.positions, tool)[:, :3]
    design = model.design(machine, state, transform)
    deviation = exact_deviation(machine, state.positions, model.errors(machine, state), tool).position
    if datum is not None:
        design, deviation = design - datum.sensitivity, deviation - datum.shift
    length = np.linalg.norm(deviation, axis=1, keepdims=True)
    # where nothing deviates any direction is as good as another
    unit = np.where(length > 0.0, deviation / np.where(length > 0.0, length, 1.0), [1.0, 0.0, 0.0])
    along = np.einsum("nk,nkp->np", unit, design)[:, None]
    transform = np.concatenate([transform, np.einsum("nk,nkp->np", unit, transform)[:, None]], axis=1)
    unmeasured = model.unmeasured_variance(machine, state, transform)
    both = model.propagated(np.concatenate([design, along], axis=1), unmeasured) * 1e3
    return np.asarray(np.linalg.norm(both[:, :3], axis=1)), np.asarray(both[:, 3])
