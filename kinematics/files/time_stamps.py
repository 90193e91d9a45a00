"""Time stamps as seconds: dates with a time of day in ISO 8601, in one zone, in the order of time.

A stamp states its zone (`2026-11-30 09:12:05+01:00`), or the file does (`Europe/Berlin`, `+01:00`, `UTC`); otherwise
all stamps are those of one clock without summer time, and a step back or a step of one hour is refused.
"""

from __future__ import annotations

import datetime
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from kinematics.transforms import Array
from kinematics.user_error import UserError

ISO = "iso"
"""Form of time stamps in ISO 8601."""
ZONE = "zone"
"""Header key of the zone of the time stamps of a file."""
SUMMER_TIME_STEP_S = 3600.0
"""Step of the clock to and from summer time, s."""
_CURE = f"state the zone of the clock ('# {ZONE}: Europe/Berlin' in the file, or in [header] of its column map)"


class Times(NamedTuple):
    """Times `(n,)`, s, from `start`; without a start from an unknown zero."""

    seconds: Array
    start: datetime.datetime | None = None


def moment(text: str, where: str, zone: str = "") -> datetime.datetime:
    """The time stamp in a text; UserError, beginning with `where`, for another text and for an unknown zone."""
    try:
        found = datetime.datetime.fromisoformat(text.strip()) if ":" in text else None
    except ValueError:
        found = None
    if found is None:
        raise UserError(
            f"{where}: {text.strip()!r} is no date with a time of day: write it as 2026-11-30 09:12:05, or state its "
            "form in a column map ([units] time = '%d.%m.%Y %H:%M:%S'); a time in s is a column time_s"
        )
    return found.replace(tzinfo=zone_of(zone, where)) if zone and found.tzinfo is None else found


def read_times(stamps: Sequence[str], where: Callable[[int], str], zone: str = "") -> Times:
    """Times from time stamps in ISO 8601; `where` says the place of each, and `zone` is that of stamps without one."""
    moments = [moment(stamp, where(row), zone) for row, stamp in enumerate(stamps)]
    first = moments[0]
    for row, each in enumerate(moments):
        if (each.tzinfo is None) != (first.tzinfo is None):
            raise UserError(f"{where(row)}: of this time stamp and the first only one states its zone: {_CURE}")
    seconds = np.array([seconds_between(first, each) for each in moments])
    if zone:
        _resolve(moments, seconds, where)
    _check_steps(seconds, where, first.tzinfo is None)
    return Times(seconds, first)


def seconds_between(first: datetime.datetime, last: datetime.datetime) -> float:
    """Time from one moment to the other, s; both state their zone, or neither does."""
    if first.tzinfo is not None:
        first, last = first.astimezone(datetime.UTC), last.astimezone(datetime.UTC)
    return (last - first).total_seconds()


def _resolve(moments: list[datetime.datetime], seconds: Array, where: Callable[[int], str]) -> None:
    """Set the second of the two meanings of an hour at the end of summer time where the first would go back in time."""
    for row, each in enumerate(moments):
        if each.tzinfo is not None and each.astimezone(datetime.UTC).astimezone(each.tzinfo) != each:
            raise UserError(
                f"{where(row)}: the clock of {each.tzinfo} skips this hour, the begin of summer time: a clock that "
                f"does not, has a fixed zone ('# {ZONE}: +01:00')"
            )
        if row and seconds[row] < seconds[row - 1]:
            seconds[row] = seconds_between(moments[0], each.replace(fold=1))


def _check_steps(seconds: Array, where: Callable[[int], str], of_unknown_zone: bool) -> None:
    """UserError where the clock goes back, and where that of an unknown zone steps by an hour, as to summer time."""
    steps = np.diff(seconds)
    if np.any(steps < 0.0):
        row = int(np.argmax(steps < 0.0))
        raise UserError(
            f"{where(row + 1)}: the time is before that of the last row, by {-steps[row] / 60.0:g} min: sort the rows "
            f"by time; at the end of summer time {_CURE}"
        )
    usual = float(np.median(steps)) if len(steps) else 0.0
    jumps = np.flatnonzero(np.abs(steps - usual - SUMMER_TIME_STEP_S) <= usual)
    if len(jumps) and of_unknown_zone and usual < SUMMER_TIME_STEP_S / 2.0:
        row = int(jumps[0])
        raise UserError(
            f"{where(row + 1)}: the time steps by {steps[row] / 60.0:g} min, one hour more than from row to row, as to "
            f"summer time: {_CURE}"
        )


def zone_of(name: str, where: str) -> datetime.tzinfo:
    """The zone of a name or of an offset; UserError, beginning with `where`, for one that is not known."""
    try:
        fixed = datetime.datetime.strptime(name, "%z").tzinfo
    except ValueError:
        fixed = None
    if fixed is not None:
        return fixed
    import zoneinfo

    try:
        return zoneinfo.ZoneInfo(name)
    except (zoneinfo.ZoneInfoNotFoundError, ValueError, OSError):
        raise UserError(
            f"{where}: the zone {name!r} is not known on this computer: write it as Europe/Berlin, UTC or +01:00"
        ) from None
