"""Times of the rows: pauses, after which the thermal state is unknown, and times that several rows share."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from calibration.measurement.measurement import Measurement
from calibration.plausibility.finding import Finding

LEAST_S = 600.0
"""Least duration of a pause, s: a machine tool's time constants begin at some minutes."""
LONGER = 10.0
"""Least duration of a pause, as a multiple of the time that most steps between stops do not exceed."""
USUAL_QUANTILE = 0.9
"""Quantile of the steps between stops that are usual."""
LISTED_TIMES = 3
REPEATED_TIME_SHARE = 0.1
"""Share of the stops with the time of the stop before above which the clock is too coarse."""


def pauses(measurement: Measurement) -> np.ndarray:
    """Numbers of the rows that follow a pause; none without times."""
    time = measurement.state.time
    if time is None or len(time) < 3:
        return np.zeros(0, int)
    steps = np.diff(time)
    moved = np.diff(measurement.stops) > 0
    usual = float(np.quantile(steps[moved], USUAL_QUANTILE)) if moved.any() else np.inf
    return np.flatnonzero(steps > max(LEAST_S, LONGER * usual)) + 1


def repeated_times(measurement: Measurement) -> Iterator[Finding]:
    """Finding, without a full stop, on stops with the time of the stop before; none where they are few."""
    time = measurement.state.time
    if time is None or len(time) < 3:
        return
    if not np.ptp(time):
        yield Finding("times", f"time_s is {time[0]:.10g} in all rows: they show no drift with time", False)
        return
    first = np.unique(measurement.stops, return_index=True)[1]
    same = int(np.count_nonzero(np.diff(time[first]) == 0.0))
    if same > REPEATED_TIME_SHARE * len(first):
        step = float(np.median(np.diff(np.unique(time))))
        yield Finding(
            "times",
            f"{same} of {len(first)} stops have the time of the stop before: time_s is in steps of {step:.4g} s, or "
            "stands for several positions. Faster changes are not visible, and moments of jumps are uncertain by a "
            "step",
            False,
        )


def paused(measurement: Measurement) -> Iterator[Finding]:
    """Finding on pauses, without a full stop."""
    time, rows = measurement.state.time, pauses(measurement)
    if time is None or not len(rows):
        return
    lengths = [
        f"{(time[row] - time[row - 1]) / 60.0:.3g} min before {measurement.where(int(row))}"
        for row in rows[:LISTED_TIMES]
    ]
    more = f" and {len(rows) - LISTED_TIMES} more" if len(rows) > LISTED_TIMES else ""
    yield Finding(
        "times",
        f"the measurement paused for {', '.join(lengths)}{more}: the thermal state of the machine, and the pose of the "
        "instrument, may differ afterwards from a course with time. Measure some positions of before once more after a "
        "pause",
        False,
    )
