"""Instruments: one class each, with the facts of its kind, and the table of them by their names in files."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from calibration.instruments.ballbar import Ballbar
from calibration.instruments.base import InstrumentBase
from calibration.instruments.interferometer import Interferometer
from calibration.instruments.laser_tracker import LaserTracker
from calibration.instruments.lengths.lengths import Lengths
from calibration.instruments.level import Level
from calibration.instruments.part import Part
from calibration.instruments.ranging.ranging import Ranging
from calibration.instruments.touch_probe import TouchProbe

if TYPE_CHECKING:
    from calibration.measurement.text_table import Table

Instrument = LaserTracker | Interferometer | Part | TouchProbe | Ballbar | Level | Lengths | Ranging
"""The union by which files are decoded."""
KINDS: Mapping[str, type[Instrument]] = {
    each.kind(): each for each in (LaserTracker, Interferometer, Part, TouchProbe, Ballbar, Level, Lengths, Ranging)
}
"""The classes by their kinds, the names in files."""


def instrument_in(table: Table) -> type[InstrumentBase]:
    """The class of the instrument of a table; the base for an unknown one, and for positions without an instrument."""
    if "instrument" in table.entries:
        return KINDS.get(table.entries["instrument"].value, InstrumentBase)
    known = (each for each in KINDS.values() if each.RECOGNISED_BY and each.RECOGNISED_BY in table.entries)
    return next(known, InstrumentBase)


__all__ = [
    "KINDS",
    "Ballbar",
    "Instrument",
    "InstrumentBase",
    "Interferometer",
    "LaserTracker",
    "Lengths",
    "Level",
    "Part",
    "Ranging",
    "TouchProbe",
    "instrument_in",
]
