"""The head of a report: the entries by which a shop files it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields, replace
from datetime import date, time
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec

from kinematics.files.mistaken import did_you_mean
from kinematics.user_error import UserError

if TYPE_CHECKING:
    from kinematics.error_model.model import ErrorModel

TABLE = "report"
"""Name of the table of the head in machine files, job files and files of `--report-head`."""
UNITS = {"temperature": "°C"}
"""Units of entries that may be numbers."""


@dataclass(frozen=True, kw_only=True)
class ReportHead:
    """Entries of the head as text; an empty one is a line to write on."""

    company: str = ""
    machine: str = ""
    serial_number: str = ""
    control: str = ""
    operator: str = ""
    place: str = ""
    temperature: str = ""
    """Temperature of the place, °C."""
    instrument: str = ""
    instrument_number: str = ""
    measured: str = ""
    """Date of the measurement."""
    order: str = ""
    made: str = ""
    """Date and time at which the report was made."""
    approved_by: str = ""
    """Name of the person who signs the page."""
    remarks: str = ""
    calibration: str = ""
    """Identifier of the calibration, and the date at which it was made."""
    command: str = ""

    def filled(self, **known: str) -> ReportHead:
        """The head with these entries where it has none."""
        return replace(self, **{name: text for name, text in known.items() if text and not getattr(self, name)})

    def under(self, other: ReportHead) -> ReportHead:
        """The head below another one, whose entries come first."""
        return other.filled(**self.by_name())

    def by_name(self) -> dict[str, str]:
        """The entries by name."""
        return {field.name: getattr(self, field.name) for field in fields(self)}

    @staticmethod
    def of_table(table: Mapping[str, object]) -> ReportHead:
        """The head of a TOML table; UserError for an unknown entry, and for one that is no text, number or date."""
        return ReportHead(**dict(_entries(table)))


GIVEN = [field.name for field in fields(ReportHead) if field.name not in ("made", "command")]
"""Entries that a file may have."""


def read_head(path: Path) -> ReportHead:
    """The head in the table `[report]` of a TOML file, which may be a job or machine file."""
    from kinematics.files import read_input
    from kinematics.files.toml_entries import at_line, read_table, utf8_text

    where = f"report head {path}"
    text = utf8_text(read_input(path, "report head"), where)
    entries = read_table(text, where)
    table = entries.get(TABLE)
    if not isinstance(table, dict):
        raise UserError(f"report head {path}: the file has no table [{TABLE}]; write [{TABLE}] above its entries")
    try:
        return ReportHead.of_table(table)
    except UserError as fault:
        raise at_line(text, where, fault) from None


def calibration_text(model: ErrorModel) -> str:
    """Identifier and date of a calibration; `none` for one without effects."""
    if not model.effects:
        return "none"
    demonstration = ", a demonstration" if model.demonstration else ", from simulated data" if model.invented else ""
    measured = model.provenance.measured_on
    dated = "" if measured is msgspec.UNSET else f", measured {measured}"
    return f"{model.id}, made {model.provenance.made_at:%Y-%m-%d}{dated}{demonstration}"


def _entries(table: Mapping[str, object]) -> Iterator[tuple[str, str]]:
    for name, value in table.items():
        if name not in GIVEN:
            raise UserError(f"{TABLE}.{name} is not known{did_you_mean(name, GIVEN)}; known are {', '.join(GIVEN)}")
        if isinstance(value, bool) or not isinstance(value, (str, int, float, date, time)):
            raise UserError(f"{TABLE}.{name}: expected a text, a number or a date")
        number = isinstance(value, (int, float))
        if isinstance(value, float) and not math.isfinite(value):
            raise UserError(f"{TABLE}.{name}: {value} is not finite: write a number, or delete the entry")
        yield name, f"{value} {UNITS[name]}" if number and name in UNITS else str(value).strip()
