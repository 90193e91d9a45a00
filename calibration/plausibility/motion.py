"""Checks whether axes and observations follow the commands: a lag between two clocks, and the read-back."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from calibration.measurement.measurement import Measurement
from calibration.plausibility.finding import Finding
from calibration.plausibility.misfit import centred, misfit
from calibration.plausibility.mistakes import FALLS, PLAUSIBLE, TIED
from kinematics.transforms import Array

LEAST_ROWS_OF_RELATION = 10
"""Least number of rows for the search for a relation between columns."""
RELATED = 0.7
"""Correlation above which two columns are related."""
NOTICED_MM, NOTICED_RAD = 1e-3, 1e-5
"""RMS difference of read-back and command below which it is ignored: linear axes, rotary axes.

Rounding to 0.001 deg gives 5e-6 rad. 1e-5 rad is 3 um at a distance of 300 mm."""


def clock_lag(measurement: Measurement) -> Iterator[Finding]:
    """Findings: rows in motion that are observed before or after their positions."""
    velocity = measurement.state.velocity
    if velocity is None:
        return
    moving = np.flatnonzero(velocity.any(axis=1))
    if len(moving) < LEAST_ROWS_OF_RELATION:
        return
    part = measurement.rows(moving)
    residual, registration = misfit(part)
    residual, along = centred(part, residual), part.instrument.by_axes(part, registration)
    swept = centred(part, (along @ velocity[moving][:, :, None])[:, :, 0])
    size = float(np.sum(swept**2))
    if size <= 0.0:
        return
    lag = float(np.sum(swept * residual)) / size
    before, after = (float(np.sqrt(np.mean(rows**2))) for rows in (residual, residual - lag * swept))
    with_backlash = _misfit_with_backlash(part, residual, along * np.sign(velocity[moving])[:, None, :])
    if after < before / FALLS and after < TIED * with_backlash:
        ahead = "later" if lag > 0 else "earlier"
        follows = with_backlash > TIED * after
        causes = "two clocks, or following error" if follows else "two clocks, following error or backlash"
        micro = float(part.per_micro.max())
        unit = "um" if micro < 1e6 else "urad"
        yield Finding(
            "clock",
            f"rows in motion were observed {abs(lag) * 1e3:.3g} ms {ahead} than their positions were noted: with that "
            f"lag their residual falls from {before * micro:.4g} to {after * micro:.3g} {unit} RMS ({causes})",
            before > PLAUSIBLE,
        )


def _misfit_with_backlash(measurement: Measurement, residual: Array, behind: Array) -> float:
    """RMS of residuals `(n, d)` after a fit of a backlash of each axis, with derivatives `(n, d, axes)`."""
    design = np.stack([centred(measurement, behind[:, :, i]).reshape(-1) for i in range(behind.shape[2])], axis=1)
    size, *_ = np.linalg.lstsq(design, residual.reshape(-1), rcond=None)
    return float(np.sqrt(np.mean((residual.reshape(-1) - design @ size) ** 2)))


def read_back(measurement: Measurement) -> Iterator[Finding]:
    """Findings: read-backs that differ from the commands, and related variables."""
    if measurement.actual is None:
        return
    machine, state = measurement.machine, measurement.state
    residual, registration = misfit(measurement)
    along = measurement.instrument.by_axes(measurement, registration)
    for i, axis in enumerate(machine.axes):
        apart = measurement.actual[:, i] - state.positions[:, i]
        rows = np.isfinite(apart) & along[:, :, i].any(axis=1)
        rms = float(np.sqrt(np.mean(apart[rows] ** 2))) if rows.any() else 0.0
        if rows.sum() < LEAST_ROWS_OF_RELATION or rms < (NOTICED_RAD if axis.rotary else NOTICED_MM):
            continue
        small, unit = (1e6, "urad") if axis.rotary else (1e3, "um")
        own = np.einsum("nd,nd->n", residual, along[:, :, i])[rows] / np.sum(along[rows, :, i] ** 2, axis=1)
        message = [f"read-back and command of {axis.name} differ by {rms * small:.3g} {unit} RMS"]
        slope, r = _related(apart[rows], own)
        if r > RELATED and 0.5 < slope < 1.5:
            message.append(
                f"the observed deviation follows with slope {slope:.2f}: the axis did not reach its commanded position"
            )
        if state.last_move is not None:
            slope, r = _related(state.last_move[rows, i], apart[rows])
            if abs(r) > RELATED:
                message.append(f"by {slope * 1e6:.3g} ppm of the last move: the axis had not settled (r = {r:.2f})")
        if state.velocity is not None and state.velocity[rows, i].any():
            slope, r = _related(state.velocity[rows, i], apart[rows])
            if abs(r) > RELATED:
                message.append(f"by {slope * 1e3:.3g} ms of the velocity: following error, or two clocks (r = {r:.2f})")
        yield Finding("read-back", "; ".join(message), False)


def _related(one: Array, other: Array) -> tuple[float, float]:
    """Slope of `other` against `one`, both `(n,)`, and their correlation; zeros if one of them is constant."""
    one, other = one - one.mean(), other - other.mean()
    sizes = float(one @ one), float(other @ other)
    if min(sizes) <= 0.0:
        return 0.0, 0.0
    product = float(one @ other)
    return product / sizes[0], product / float(np.sqrt(sizes[0] * sizes[1]))
