"""The same place again: rows with the same commands, feed, target, station and direction of approach."""

from __future__ import annotations

import numpy as np

from calibration.measurement.measurement import Measurement

DIGITS = 6
"""Decimals of a commanded position, mm or degrees, by which rows belong to one place."""


def place_numbers(measurement: Measurement) -> np.ndarray:
    """Numbers `(n,)` from 0 of the places of the rows."""
    state = measurement.state
    columns = [np.round(state.positions / measurement.machine.scale, DIGITS) + 0.0]
    if state.approach is not None:
        columns.append(state.approach)
    if measurement.feed is not None:
        columns.append(measurement.feed[:, None])
    for names in (measurement.target_number, state.station, measurement.axis, measurement.component):
        if names is not None:
            columns.append(np.unique(names, return_inverse=True)[1][:, None].astype(float))
    _, number = np.unique(np.concatenate(columns, axis=1), axis=0, return_inverse=True)
    return np.asarray(number.reshape(-1))
