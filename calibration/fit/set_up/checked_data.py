"""The data of a diagnosis: checked, with times from their first row, and targets at their positions by the data."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calibration.fit.set_up.target_positions import TargetPosition, at_positions, target_positions
from calibration.measurement.measurement import Measurement
from calibration.plausibility.checks import usable
from calibration.plausibility.finding import Finding

LATE = 3.0
"""Multiple of the duration of the data: a clock that begins later counts from midnight or another epoch."""


def checked_data(
    measurement: Measurement, *, misplaced: bool = True
) -> tuple[Measurement, list[Finding], list[TargetPosition]]:
    """The measurement with times from its first row, and targets at their positions by the data, which come with it.

    In between the findings about it. misplaced: targets that are not at their stated positions are moved too, not only
    those without one. UserError where the measurement cannot be used.
    """
    findings = usable(measurement)
    unknown = any(target.free for target in measurement.targets.values())
    # where all rows of a target are in sequence, the search compares its offset with a knock at the instrument
    found = [each for each in target_positions(measurement) if not each.at_once] if misplaced or unknown else []
    found = [each for each in found if misplaced or not each.stated]
    measurement = at_positions(measurement, found)
    measurement, late = _from_its_start(_with_station(measurement))
    if late:
        text = f"time_s begins at {late:.10g}: times are counted from the first row"
        findings.append(Finding("epoch", text, False))
    return measurement, findings, found


def _with_station(measurement: Measurement) -> Measurement:
    """The measurement; where it names no station of a tracker, all rows are of one, which may have been knocked."""
    if measurement.state.station is not None or not measurement.instrument.STATIONED:
        return measurement
    return replace(measurement, state=replace(measurement.state, station=measurement.groups))


def _from_its_start(measurement: Measurement) -> tuple[Measurement, float]:
    """The measurement, with times from its first row where its clock counts from an epoch.

    Also the time that was subtracted, s; 0 where the clock is kept.
    """
    time = measurement.state.time
    if time is None or time.min() <= LATE * np.ptp(time):
        return measurement, 0.0
    late = float(time.min())
    return replace(measurement, state=replace(measurement.state, time=time - late)), late
