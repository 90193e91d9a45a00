"""Parameters that walk at random between readings: a Kalman filter, which makes readings and columns white.

state(t + dt) = state(t) + N(0, variance dt)        reading = jacobian state + columns coefficients + N(0, covariance)

The filter is linear in the readings. It therefore makes the columns of all other terms (places, temperatures, outliers)
white by the same steps, and their coefficients follow as those of `calibration.gaussian_terms` do. The effort grows
with the number of readings alone. Several sizes of the walk are calculated together.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.following.parameters import Touches
from kinematics.effects.base import HOUR
from kinematics.transforms import Array

LEAST_READING_VARIANCE_UM2 = 1e-9
"""Variance, um2, added to that of a reading, so that exact readings have a finite one."""


@dataclass(frozen=True)
class Sizes:
    """Sizes of the walk and of the scatter, of g cases together."""

    walk: Array
    """Variances `(g, p)` of the parameters in one hour, in their units squared."""
    scatter: Array
    """Variances `(g,)` of a reading beyond that of the probing, um2: what the axes do not repeat."""


@dataclass(frozen=True)
class Walked:
    """White columns, and the state after the last reading."""

    columns: Array
    """`(g, 3 n, c)`"""
    log_volume: Array
    """Log determinants `(g,)` of the covariances of the readings."""
    state: Array
    """Parameters since the reference `(g, p, c)`, by each column as the readings."""
    covariance: Array
    """Their covariance `(g, p, p)`, for known coefficients."""


def walked(touches: Touches, columns: Array, sizes: Sizes, since: float, until: float) -> Walked:
    """Columns `(n, 3, c)`, made white, and the walk from the time `since`, s, to `until`, not before the last reading.

    From the reference on, the state has a second part, its value at the reference.
    """
    n, _, p = touches.jacobian.shape
    cases, time = len(sizes.walk), touches.measurement.state.time
    assert time is not None
    state, covariance = np.zeros((cases, p, columns.shape[2])), np.zeros((cases, p, p))
    white, log_volume = np.empty((cases, n, 3, columns.shape[2])), np.zeros(cases)
    variance = (sizes.scatter[:, None, None] + LEAST_READING_VARIANCE_UM2) * np.eye(3)
    now, referred = float(time[0]), since <= time[0]
    walk = sizes.walk / HOUR
    for k in (*range(n), None):
        then = until if k is None else float(time[k])
        if not referred and since <= then:
            covariance[:, range(p), range(p)] += (since - now) * walk
            state, covariance = np.tile(state, (1, 2, 1)), np.tile(covariance, (1, 2, 2))
            now, referred = since, True
        covariance[:, range(p), range(p)] += (then - now) * walk
        now = then
        if k is None:
            break
        across = covariance[:, :, :p] @ touches.jacobian[k].T
        low = np.linalg.cholesky(touches.jacobian[k] @ across[:, :p] + touches.covariances[k] + variance)
        log_volume += 2.0 * np.log(np.diagonal(low, axis1=1, axis2=2)).sum(axis=1)
        inverse = np.linalg.inv(low)
        white[:, k] = inverse @ (columns[k] - touches.jacobian[k] @ state[:, :p])
        gain = across @ inverse.swapaxes(1, 2)
        state += gain @ white[:, k]
        covariance -= gain @ gain.swapaxes(1, 2)
    turn = np.hstack([np.eye(p), -np.eye(p)][: covariance.shape[1] // p])
    return Walked(white.reshape(cases, 3 * n, -1), log_volume, turn @ state, turn @ covariance @ turn.T)
