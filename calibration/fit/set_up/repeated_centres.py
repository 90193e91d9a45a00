"""Centres of spheres that were measured again at the same rotary positions: did spindle, table or spheres drift?"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy import special

from calibration.fit.fit import Fit
from calibration.plausibility.finding import Finding
from kinematics.files.number_text import uncertainty
from kinematics.transforms import Array

SIGNIFICANCE = 0.01
"""Chance that the repeated centres of a machine without drift count as shifted."""
SAME = 1e-5
"""Largest difference, rad, of rotary positions that are the same."""
COVERAGE = 2.0
FAR_UM = 500.0
"""Shift, um, from which a row is wrong: no machine drifts so far. Other checks name such rows."""


def repeat_findings(found: Fit, rows: np.ndarray | None = None, chi2: float | None = None) -> Iterator[Finding]:
    """A finding for the centre that is farthest from where it was found first, if this is more than noise allows.

    rows: mask `(n,)` of the rows that are compared; all when None. chi2: chi2/dof of the noise, by the instrument
    specification; that of the residuals, which a drift makes larger, when None.

    Both have the same errors of the machine, so that their residuals differ by noise and drift alone. The noise is
    at least that of the specification.
    """
    measurement = found.measurement
    if measurement.instrument.OBSERVES != "offset":
        return
    first, again = _repeats(measurement.groups, measurement.state.positions[:, measurement.machine.rotary])
    shift = -1e3 * (found.residual[again] - found.residual[first])
    near = np.linalg.norm(shift, axis=1) < FAR_UM
    if rows is not None:
        near &= rows[first] & rows[again]
    first, again, shift = first[near], again[near], shift[near]
    if not len(again):
        return
    u = measurement.instrument.u_um * (2.0 * max(found.chi2_reduced if chi2 is None else chi2, 1.0)) ** 0.5
    k = int(np.argmax(np.linalg.norm(shift, axis=1)))
    if np.abs(shift[k]).max() <= u * -special.ndtri(SIGNIFICANCE / (2.0 * shift.size)):
        return
    moved = ", ".join(f"{value:+.1f}" for value in shift[k])
    times = "" if measurement.state.time is not None else ", with a column time_s,"
    yield Finding(
        "drift",
        f"{measurement.where(int(again[k]))}: the centre of sphere {measurement.groups[again[k]]} is ({moved}) um +- "
        f"{uncertainty(COVERAGE * u, 1)} um (k=2) from where {measurement.where(int(first[k]))} found it at the same "
        "rotary positions: spindle, table or sphere moved or warmed up in between, or one of both rows is off. Measure "
        f"again in a warm machine; ncomp diagnose{times} separates a drift (thermal-drift) from a knock "
        "(station-shift)",
        False,
    )


def _repeats(groups: np.ndarray, rotary: Array) -> tuple[np.ndarray, np.ndarray]:
    """Rows `(k,)` that repeat a sphere at the rotary positions `(n, axes)` of an earlier row: that row, and they."""
    keys = np.concatenate([np.unique(groups, return_inverse=True)[1][:, None], np.round(rotary / SAME)], axis=1)
    _, first, number = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    earlier = first[number.reshape(-1)]
    again = np.flatnonzero(earlier != np.arange(len(groups)))
    return earlier[again], again
