"""Repeated measurement states: rows with the same commands, feed, target, station and direction of approach."""

from __future__ import annotations

import numpy as np

from calibration.measurement.measurement import Measurement

STATE_DECIMALS = 6
"""Decimals, mm or degrees, to which commanded positions are rounded; equal ones are the same state."""


def position_numbers(measurement: Measurement) -> np.ndarray:
    """Number `(n,)` from 0 of the measurement state of each row."""
    state = measurement.state
    columns = [np.round(state.positions / measurement.machine.scale, STATE_DECIMALS) + 0.0]
    if state.approach is not None:
        columns.append(state.approach)
    if measurement.feed is not None:
        columns.append(measurement.feed[:, None])
    for names in (measurement.target_number, state.station, measurement.axis_column, measurement.motions):
        if names is not None:
            columns.append(np.unique(names, return_inverse=True)[1][:, None].astype(float))
    _, number = np.unique(np.concatenate(columns, axis=1), axis=0, return_inverse=True)
    return np.asarray(number.reshape(-1))
