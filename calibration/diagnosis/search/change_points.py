"""Jumps proposed from the residual, each at its likeliest change point: moments, and angles of a tracker's circles.

All change points of a jump are compared at once: its columns are summed over all rows beyond each of them.
"""

from __future__ import annotations

from collections.abc import Iterator

import msgspec
import numpy as np

from calibration.diagnosis.search.candidates import Candidate
from calibration.diagnosis.search.causes import angle_steps, jumps
from calibration.diagnosis.search.linearised_fit import GENEROUS, LinearisedFit
from calibration.plausibility.times import pauses
from kinematics.effects import AngleStep, Effect
from kinematics.effects.instrument import CIRCLES, beam
from kinematics.transforms import Array

LEAST_ROWS = 8
"""Least number of moments, or angles, on each side of a jump."""
OPPOSITE = 180.0
"""Range of an angle, deg, from which a step over it has two sides for no row."""


def breaks(linearised: LinearisedFit, whole: LinearisedFit | None = None) -> Iterator[Candidate]:
    """Jumps, each at its likeliest moment, the change point at which it explains most, and after its likeliest pause.

    There are fewer pauses than moments, so that the same gain is the better evidence after a pause. The moment is
    refined on `whole`, the fit of all rows, between the rows beside it.
    """
    measurement = linearised.measurement
    if measurement.state.time is None:
        return
    after_pauses = measurement.state.time[pauses(measurement)]
    for effect in jumps(measurement):
        moments, gains = _change_points(linearised, effect, measurement.state.time)
        if len(moments) < 3 * LEAST_ROWS:
            continue
        inside = slice(LEAST_ROWS, len(moments) - LEAST_ROWS)
        paused = np.isin(moments[inside], after_pauses)
        for possible, trials in ((np.ones(len(paused), bool), len(moments)), (paused, np.count_nonzero(paused))):
            if possible.any():
                best = LEAST_ROWS + int(np.argmax(np.where(possible, gains[inside], -np.inf)))
                since = _refined(whole, linearised, effect, measurement.state.time, moments[best - 1 : best + 2])
                yield Candidate(msgspec.structs.replace(effect, since_s=since), 1, float(trials))


def turning_points(linearised: LinearisedFit, whole: LinearisedFit | None = None) -> Iterator[Candidate]:
    """The steps of a tracker's circles over each of them, each at its likeliest angle; `whole` as in `breaks`."""
    for effect, angle in _steps_over_angles(linearised):
        angles, gains = _change_points(linearised, effect, angle)
        if len(angles) < 3 * LEAST_ROWS:
            continue
        best = LEAST_ROWS + int(np.argmax(gains[LEAST_ROWS : len(angles) - LEAST_ROWS]))
        above = _refined(whole, linearised, effect, angle, angles[best - 1 : best + 2])
        below = float(np.max(angle[angle < above]))
        yield Candidate(msgspec.structs.replace(effect, above_deg=round((above + below) / 2, 5)), 1, float(len(angles)))


def _steps_over_angles(linearised: LinearisedFit) -> Iterator[tuple[AngleStep, Array]]:
    """Steps that act on all rows, and the angles `(n,)`, deg, of all rows of the measurement over which they begin."""
    observed = linearised.measurement.state.observed
    for effect in angle_steps(linearised.measurement):
        if observed is None:
            return
        angles = beam(observed).angles[:, CIRCLES.index(effect.over)]
        centre = np.degrees(np.angle(np.mean(np.exp(1j * angles))))
        apart = np.mod(np.degrees(angles) - centre + OPPOSITE, 2.0 * OPPOSITE) - OPPOSITE
        if np.ptp(apart) < OPPOSITE:
            yield msgspec.structs.replace(effect, above_deg=float(centre + apart.min()) - 1e-3), centre + apart


def _refined(whole: LinearisedFit | None, some: LinearisedFit, effect: Effect, along: Array, points: Array) -> float:
    """The middle one of three change points, refined between the others on the fit of all rows."""
    if whole is None or len(whole.rows) <= len(some.rows):
        return float(points[1])
    found, gains = _change_points(whole, effect, along)
    return float(found[np.argmax(np.where((found > points[0]) & (found < points[2]), gains, -np.inf))])


def _change_points(linearised: LinearisedFit, effect: Effect, along: Array) -> tuple[Array, Array]:
    """Values `(m,)` of a variable on whose rows a jump acts, and its gains `(m,)` if it begins at each of them.

    along: the variable `(n,)`, of all rows of the measurement.
    """
    values = along[linearised.rows]
    spanned = linearised.spanned.reshape(len(values), -1, linearised.spanned.shape[1])
    residual = linearised.residual.reshape(len(values), -1)
    columns = linearised.columns(effect).reshape(len(values), residual.shape[1], -1)
    own = np.flatnonzero(columns.any(axis=(1, 2)))
    points = np.unique(values[own])
    if not len(points):
        return points, np.zeros(0)
    in_order = own[np.argsort(values[own], kind="stable")]
    starts = np.searchsorted(values[in_order], points)
    # without a copy of the rows where all of them act in order
    order = slice(None) if np.array_equal(in_order, np.arange(len(values))) else in_order
    here = columns[order]
    # sums over all rows from each point on
    slopes = _from_each(np.einsum("ndk,nd->nk", here, residual[order]), starts)
    squares = _from_each(np.einsum("ndk,ndl->nkl", here, here), starts)
    through = _from_each(np.einsum("ndq,ndk->nqk", spanned[order], here), starts)
    schur = squares - np.swapaxes(through, 1, 2) @ through + np.eye(here.shape[2]) / GENEROUS**2
    return points, np.einsum("nk,nk->n", slopes, np.linalg.solve(schur, slopes[:, :, None])[:, :, 0])


def _from_each(values: Array, starts: np.ndarray) -> Array:
    """Sums `(m, ...)` of rows `(n, ...)` from each start to the end."""
    parts = values if len(starts) == len(values) else np.add.reduceat(values, starts, axis=0)
    return np.cumsum(parts[::-1], axis=0)[::-1]
