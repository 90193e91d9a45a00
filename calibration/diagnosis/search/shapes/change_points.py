"""Jumps proposed from the residual, each at its likeliest change point: moments, and angles of a tracker's circles.

All change points of a jump are compared at once: its columns are summed over all rows beyond each of them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import msgspec
import numpy as np

from calibration.diagnosis.search.candidates import Candidate
from calibration.diagnosis.search.causes import angle_steps, jumps
from calibration.diagnosis.search.linearised_fit import LinearisedFit
from calibration.diagnosis.search.score import GENEROUS
from calibration.plausibility.times import pauses
from kinematics.effects import AngleStep, Effect, GrowthWithDuty, GrowthWithSensor, GrowthWithTime, LocationJump
from kinematics.effects.combined.where import beam
from kinematics.effects.tracker import CIRCLES
from kinematics.transforms import Array

APART = 1e3
"""Factor on the difference of two effects whose fixed points are 1 mm apart, so that it is of the size of an effect."""
LEAST_ROWS = 8
"""Least number of moments, or angles, on each side of a jump."""
Fixed = GrowthWithSensor | GrowthWithTime | GrowthWithDuty | LocationJump
"""Effects that leave a position of their axis where it is."""
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
                jump = msgspec.structs.replace(effect, since_s=since)
                yield Candidate(jump, 1, float(trials))
                turned = about_fixed_point(linearised, jump) if isinstance(jump, LocationJump) else None
                if turned is not None:
                    yield Candidate(turned, 2, float(trials))


def about_fixed_point(linearised: LinearisedFit, effect: Fixed) -> Effect | None:
    """A growth, or the turn of a linear axis, about the position of its axis that the data show; None without one.

    The position is rounded to 0.1 mm, and at most as far outside the travel as this is long.
    """
    columns = _about_any_point(linearised, effect)
    size = linearised.score(linearised.projected(columns)).size
    if len(size) != 2 or not size[0]:
        return None
    point = effect.fixed_point - APART * float(size[1] / size[0])
    low, high = linearised.measurement.moving[effect.axis]
    if not 2 * low - high < point < 2 * high - low:
        return None
    return msgspec.structs.replace(effect, fixed_point=round(point, 1))


def about_another_point(linearised: LinearisedFit, candidate: Candidate) -> list[Candidate]:
    """A cause about the fixed point that the data show beside all others; empty for causes without such a point."""
    effect = candidate.effect
    moved = about_fixed_point(linearised, effect) if isinstance(effect, Fixed) else None
    if not isinstance(effect, Fixed) or moved is None or moved == effect:
        return []
    searched = candidate.shapes + (effect.fixed_point == 0.0)
    return [replace(candidate, effect=moved, shapes=searched)]


def _about_any_point(linearised: LinearisedFit, effect: Effect) -> Array:
    """White columns `(N, k)` of an effect; where it has a fixed point, also of its change by another point."""
    if not isinstance(effect, Fixed) or (isinstance(effect, LocationJump) and not effect.turns):
        return linearised.columns(effect)
    moved = msgspec.structs.replace(effect, fixed_point=effect.fixed_point + 1.0)
    here, there = np.split(linearised.columns(effect, moved), 2, axis=1)
    return np.concatenate([here, (here - there) * APART], axis=1)


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
    columns = _about_any_point(linearised, effect).reshape(len(values), residual.shape[1], -1)
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
    through = _from_each(np.swapaxes(here, 1, 2) @ spanned[order], starts)
    schur = squares - through @ np.swapaxes(through, 1, 2) + np.eye(here.shape[2]) / GENEROUS**2
    return points, np.einsum("nk,nk->n", slopes, np.linalg.solve(schur, slopes[:, :, None])[:, :, 0])


def _from_each(values: Array, starts: np.ndarray) -> Array:
    """Sums `(m, ...)` of rows `(n, ...)` from each start to the end."""
    parts = values if len(starts) == len(values) else np.add.reduceat(values, starts, axis=0)
    return np.cumsum(parts[::-1], axis=0)[::-1]
