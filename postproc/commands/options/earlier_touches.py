"""Earlier logs of touches of a machine, from its history."""

from __future__ import annotations

import datetime
import io
from dataclasses import replace
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping
    from pathlib import Path

    from calibration.following.drift import Drift
    from calibration.measurement.measurement import Measurement
    from history.entries import Result
    from kinematics.machine import Machine


def earlier_touches(machine: Machine, address: str | None) -> list[Measurement]:
    """The logs that the history keeps, since the last event that may change how the machine moves; none without one."""
    from calibration.measurement.file import measurement_of
    from calibration.measurement.text_table import parse_table
    from history.touches import earlier_logs

    found = []
    for log in [] if address is None else earlier_logs(address, machine):
        measurement = measurement_of(parse_table(log.text.encode(), log.source), machine)
        start = datetime.datetime.fromisoformat(log.start) if log.start else None
        found.append(replace(measurement, start=start))
    return found


def drift_entry(found: Drift, results: Mapping[str, Any], inputs: Iterable[str | Path | None]) -> Callable[[], Result]:
    """Makes the entry of a drift, at its last reading, with the plausible readings of its log."""

    def made() -> Result:
        """The entry, with the fingerprints of the files as they are now."""
        import numpy as np

        from calibration.measurement.written_file import write_measurement
        from history.results import fingerprints, instant, of_results
        from history.touches import kept

        followed, file = found.followed, io.BytesIO()
        measurement, start = followed.measurement, followed.measurement.start
        plausible = np.delete(np.arange(len(measurement)), [each.row for each in followed.implausible])
        write_measurement(measurement.rows(plausible), file)
        content = {**results, "log": kept(file.getvalue().decode(), start)}
        at = instant(measurement.measured)
        if start is not None:
            at = start.astimezone(datetime.UTC) + datetime.timedelta(seconds=float(followed.times[-1]))
        title = f"drift, {measurement.source}: {followed.headline}"
        files = fingerprints(inputs)
        return of_results("drift", title, content, (), method=measurement.instrument.kind(), files=files, at=at)

    return made
