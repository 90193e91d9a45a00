"""Earlier logs of touches of the same machine, of which a new one is the continuation.

Each log is a run with zeros of its own; what follows the temperatures, and the sizes of walk and scatter, are shared.
Their posterior by the earlier logs is therefore the prior of the new one, without an approximation.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from calibration.measurement.joining import by_instrument, joined
from calibration.measurement.measurement import Measurement
from kinematics.files.time_stamps import seconds_between
from kinematics.user_error import UserError

MOST_EARLIER_READINGS = 400
"""Most readings of earlier logs, the newest ones: those of a month with a dozen a day. The time of a run grows with
their square."""


class Learned(NamedTuple):
    """An earlier log that a new one was learned with, or could not be."""

    source: str
    readings: int
    """That count; 0 with a reason."""
    reason: str = ""
    """Why none of them counts."""


@dataclass(frozen=True)
class Continued:
    """A log behind the earlier ones."""

    measurement: Measurement
    """All readings; times from the first reading of the log, those of earlier ones are negative."""
    before: int
    """Readings of earlier logs, which are its first rows."""
    learned: tuple[Learned, ...]

    def alone(self, reason: str) -> tuple[Learned, ...]:
        """The earlier logs, none of which counts."""
        return tuple(each._replace(readings=0, reason=each.reason or reason) for each in self.learned)


def continued(measurement: Measurement, earlier: Sequence[Measurement]) -> Continued:
    """A log behind those of the earlier ones that belong to it; rows of the same time count once."""
    used, learned = list[Measurement](), list[Learned]()
    count, end = 0, float("inf") if measurement.state.time is None else float(measurement.state.time[0])
    dated = [(_begin(measurement, each), each) for each in earlier]
    for begin, each in sorted(dated, key=lambda pair: pair[0] or 0.0, reverse=True):
        if reason := _reason(measurement, each, begin):
            learned.append(Learned(each.source, 0, reason))
            continue
        assert begin is not None
        assert each.state.time is not None
        time = each.state.time + begin
        rows = np.flatnonzero(time < end)[-(MOST_EARLIER_READINGS - count) or len(time) :]
        if count >= MOST_EARLIER_READINGS or not len(rows):
            same = "it has the same readings as a later one, or as this log"
            learned.append(
                Learned(each.source, 0, same if count < MOST_EARLIER_READINGS else "later ones have enough readings")
            )
            continue
        used.append(replace(each, state=replace(each.state, time=time)).rows(rows))
        learned.append(Learned(each.source, len(rows)))
        count, end = count + len(rows), float(time[rows[0]])
    return Continued(_whole([*reversed(used), measurement]), count, tuple(learned))


def _whole(logs: Sequence[Measurement]) -> Measurement:
    """The logs as runs of the last one, each with its own names of spheres: places of another run are others."""
    if len(logs) == 1:
        return logs[0]
    whole, last = joined(logs), logs[-1]
    own = [log.state.station for log in logs]
    station = np.concatenate([names.astype(str) for names in own if names is not None])
    return replace(whole, state=replace(whole.state, station=station), spheres=last.spheres, start=last.start)


def _begin(measurement: Measurement, earlier: Measurement) -> float | None:
    """The start of an earlier log by the clock of a log, s; None where one of them has no date, or no zone."""
    starts = measurement.start, earlier.start
    if any(start is None or start.tzinfo is None for start in starts):
        return None
    return seconds_between(*starts)  # type: ignore[arg-type]


def _reason(measurement: Measurement, earlier: Measurement, begin: float | None) -> str:
    """Why an earlier log does not belong to a log; empty where it does."""
    if begin is None:
        return "one of both logs has no time stamps with a zone"
    if missing := measurement.state.temperatures.keys() - earlier.state.temperatures.keys():
        return f"it has no temperature {', '.join(sorted(missing))}"
    try:
        together = len(by_instrument([earlier, measurement])) == 1
    except UserError:  # the same file: its rows are known by their times
        together = True
    return "" if together else "its machine or the uncertainty of its probe is another one"
