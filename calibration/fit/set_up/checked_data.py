"""The data of a fit or of a diagnosis: checked, with the targets at their positions by the data."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calibration.fit.set_up.moved_spheres import moved_findings
from calibration.fit.set_up.target_positions import TargetPosition, at_positions, target_positions
from calibration.fit.set_up.target_positions import findings as target_findings
from calibration.measurement.measurement import Measurement
from calibration.plausibility.checks import usable
from calibration.plausibility.finding import Finding

LATE = 3.0
"""Multiple of the duration of the data: a clock that begins later counts from midnight or another epoch."""


@dataclass(frozen=True)
class CheckedData:
    """A measurement that can be used; a fit and a diagnosis begin with it."""

    measurement: Measurement
    """With the targets at their positions by the data."""
    findings: tuple[Finding, ...]
    """Anomalies of the data before any fit."""
    targets: tuple[TargetPosition, ...]
    """The targets that are not at a stated position."""

    @classmethod
    def of_fit(cls, measurement: Measurement, *, force: bool) -> CheckedData:
        """The data of a fit. UserError for data that cannot be used, and for a sphere that moved, without `force`."""
        findings = [*usable(measurement), *moved_findings(measurement, force=force)]
        found = target_positions(measurement)
        findings += target_findings(measurement, found)
        return cls(at_positions(measurement, found), tuple(findings), tuple(found))

    @classmethod
    def of_diagnosis(cls, measurement: Measurement) -> CheckedData:
        """The data of a diagnosis, without copies and with times from their first row.

        Only targets without a stated position are moved to that by the data: a target elsewhere than stated, and a
        sphere that moved, are causes, which the search compares with others. UserError for data that cannot be used.
        """
        findings = usable(measurement)
        unknown = any(target.free for target in measurement.targets.values())
        # where all rows of a target are in sequence, the search compares its offset with a knock at the instrument
        found = (
            [each for each in target_positions(measurement) if not each.at_once and not each.stated] if unknown else []
        )
        own, late = _from_its_start(_with_station(at_positions(measurement, found)))
        if late:
            text = f"time_s begins at {late:.10g}: times are counted from the first row"
            findings.append(Finding("epoch", text, False))
        return cls(own.without_copies, tuple(findings), tuple(found))


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
