"""The results of one quantity over time."""

from __future__ import annotations

import datetime
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from history.entries import data_of
from kinematics.transforms import Array

if TYPE_CHECKING:
    from history.schema import Entry

YEAR_S = 365.25 * 86400.0
CHANGING = ("crash", "service", "moved", "spindle")
"""Events after which the errors of a machine may be others."""


class Event(NamedTuple):
    """An event after which a quantity may have another value."""

    time: float
    """Years since 1970."""
    kind: str


@dataclass(frozen=True)
class Series:
    """The results of a quantity, by time."""

    name: str
    """`squareness X-Y`."""
    unit: str
    """um, um/m or urad."""
    times: Array
    """Years since 1970 `(n,)`, ascending."""
    values: Array
    """`(n,)`, in the unit."""
    u: Array
    """Standard uncertainties, k = 1."""
    methods: tuple[str, ...]
    """Instrument or test of each result."""
    entries: tuple[int, ...]
    """Numbers of the entries."""
    events: tuple[Event, ...] = ()
    """Events of the machine, by time."""

    def until(self, time: float) -> Series:
        """What was known at a point of time."""
        count = int(np.searchsorted(self.times, time, side="right"))
        events = tuple(event for event in self.events if event.time <= time)
        return Series(
            self.name, self.unit, self.times[:count], self.values[:count], self.u[:count], self.methods[:count],
            self.entries[:count], events,
        )  # fmt: skip


def years_of(moment: str) -> float:
    """A point of time of the database, years since 1970."""
    return datetime.datetime.fromisoformat(moment).timestamp() / YEAR_S


def day_of(years: float) -> datetime.date:
    """The day of a point of time."""
    return datetime.datetime.fromtimestamp(years * YEAR_S, datetime.UTC).date()


def series_of(entries: Sequence[Entry]) -> list[Series]:
    """The series of all quantities of a machine by their names, from its entries by time.

    Of results from the same file, the one that was entered last counts.
    """
    counted = _latest_of_same_data(entries)
    events = tuple(Event(years_of(each.at), each.kind) for each in entries if each.kind in CHANGING)
    units: dict[str, str] = {}
    rows: dict[str, list[tuple[float, float, float, str, int]]] = {}
    for entry in counted:
        for each in entry.figures:
            units[each.name] = each.unit
            row = years_of(entry.at), each.value, each.u, entry.method or entry.kind, entry.id
            rows.setdefault(each.name, []).append(row)
    found = []
    for name, own in sorted(rows.items()):
        times, values, u, methods, numbers = zip(*own, strict=True)
        columns = np.array(times), np.array(values), np.array(u)
        found.append(Series(name, units[name], *columns, methods, numbers, events))
    return found


def _latest_of_same_data(entries: Iterable[Entry]) -> list[Entry]:
    """The entries with figures, without those whose data a later entry of the same kind has.

    Calibrations and diagnoses are of one kind.
    """
    kept: list[Entry] = []
    used: set[tuple[str, frozenset[str]]] = set()
    for entry in sorted((each for each in entries if each.figures), key=lambda each: each.id, reverse=True):
        kind = "calibration" if entry.kind == "diagnosis" else entry.kind
        data = data_of((file.path, file.fingerprint) for file in entry.files)
        if not data or (kind, data) not in used:
            kept.append(entry)
            used.add((kind, data))
    return sorted(kept, key=lambda each: (each.at, each.id))
