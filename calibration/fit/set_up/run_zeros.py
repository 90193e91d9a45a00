"""Zeros of the runs of an interferometer: each fit estimates them, so that the errors do not contain them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from scipy import special

from calibration.measurement.measurement import Measurement
from calibration.observation.mean_lines import mean_line
from calibration.plausibility.finding import Finding
from calibration.registration.registration import Registration
from kinematics.effects.base import own_component
from kinematics.error_model.model import ErrorModel
from kinematics.transforms import Array

FALSE_SPREAD_PROBABILITY = 1e-3
"""Chance that zeros which differ by noise alone count as spread."""


class Registered(Protocol):
    """A fit as its zeros need it."""

    @property
    def measurement(self) -> Measurement:
        """The n rows."""

    @property
    def model(self) -> ErrorModel:
        """The errors of the machine beside which it was found."""

    @property
    def registration(self) -> Registration:
        """The registration that was found."""

    @property
    def residual(self) -> Array:
        """Residuals `(n, d)`, mm and rad."""

    @property
    def kept(self) -> np.ndarray:
        """Mask `(n,)` of the rows that are not left out."""


@dataclass(frozen=True)
class RunZero:
    """Reading of one run for an axis without error."""

    run: str
    """Axis and run, and the error motion if one is named."""
    axis: str
    value: float
    """Zero, um or urad."""
    u: float
    """Standard uncertainty relative to the other runs of the axis, um or urad."""
    unit: str
    positioning: bool
    """False for straightness and angles, whose zero is the alignment of the optics."""
    direction: float
    """Direction of approach of all its rows: 1 or -1; 0 where both occur, or it is unknown."""

    def json(self) -> dict[str, Any]:
        """The zero for programs."""
        return {"run": self.run, f"zero_{self.unit}": self.value, f"u_{self.unit}": self.u}


def run_zeros(found: Registered) -> list[RunZero]:
    """The zeros of the runs of an interferometer, in the order of the runs; none for other instruments.

    They are those beside error motions whose mean is zero.
    """
    measurement = found.measurement
    if not measurement.axis_rows:
        return []
    groups, per_micro = measurement.groups, measurement.per_micro[:, 0]
    specified = np.sqrt(measurement.specified_covariances[:, 0, 0])
    motions = (motion for motion, _ in found.model.error_motions)
    means: dict[tuple[str, str], float] = {
        (own.component, own.axis): float(mean_line(own.basis).mean @ own.parameters) for own in motions
    }
    result = []
    for name, first in sorted(zip(*_first(groups), strict=True), key=lambda each: each[1]):
        rows = np.flatnonzero((groups == name) & found.kept)
        if name not in found.registration.zeros or not len(rows):
            continue
        axis, factor = _axis_of(measurement, first), float(per_micro[first])
        # the scatter of all runs of an axis is the better known
        of_axis = measurement.axis_rows[axis]
        alike = of_axis[((per_micro == factor) & found.kept)[of_axis]]
        noise = max(float(specified[rows].mean()), float(np.sqrt(np.mean(found.residual[alike] ** 2))))
        result.append(
            RunZero(
                name,
                axis,
                factor * found.registration.zeros[name] + means.get((_observed(measurement, axis, first), axis), 0.0),
                factor * noise / len(rows) ** 0.5,
                "um" if factor < 1e6 else "urad",
                bool(measurement.positioning[first]),
                _direction(measurement.state.approach, rows, measurement.machine.index(axis)),
            )
        )
    return result


def zero_findings(zeros: Sequence[RunZero]) -> Iterator[Finding]:
    """A finding for each axis whose runs have zeros that differ by more than noise allows."""
    for axis in dict.fromkeys(zero.axis for zero in zeros):
        own = [zero for zero in zeros if zero.axis == axis and zero.positioning]
        value, u = (np.array([getattr(zero, field) for zero in own]) for field in ("value", "u"))
        if len(own) < 2:
            continue
        chi2 = float(np.sum(((value - np.average(value, weights=u**-2)) / u) ** 2))
        p_value = float(special.chdtrc(len(own) - 1, chi2))
        if p_value < FALSE_SPREAD_PROBABILITY:
            one_way = " Each run has one direction, so that its zero also holds the backlash." * all(
                zero.direction for zero in own
            )
            yield Finding(
                "zeros",
                f"the zeros of the {len(own)} runs of {axis} spread from {value.min():.3g} to {value.max():.3g} "
                f"{own[0].unit}, more than noise allows ({u.mean():.2g} {own[0].unit}, p = {p_value:.1g}): the zero of "
                "the instrument, or the axis, drifted between the runs, or the display was zeroed anew. The fit "
                f"removes these zeros, and with them a drift of the axis from run to run.{one_way}",
                False,
            )


def _observed(measurement: Measurement, axis: str, row: int) -> str:
    """The component of the error motion of an axis that a row observed."""
    return str(measurement.motions[row]) or own_component(axis)


def _axis_of(measurement: Measurement, row: int) -> str:
    """The axis that a row observed by itself."""
    return next(axis for axis, rows in measurement.axis_rows.items() if row in rows)


def _first(groups: np.ndarray) -> tuple[list[str], list[int]]:
    """Names of the groups, and the first row of each."""
    names, first = np.unique(groups, return_index=True)
    return names.tolist(), first.tolist()


def _direction(approach: Array | None, rows: np.ndarray, column: int) -> float:
    """The direction -1 or 1 in which an axis approaches all these rows; 0 where it differs, or is unknown."""
    if approach is None:
        return 0.0
    own = np.unique(approach[rows, column])
    return float(own[0]) if len(own) == 1 else 0.0
