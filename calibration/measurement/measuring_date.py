"""The date of a measurement: an entry of the header, or a date that a file of another format states.

Only dates of one meaning are read: 03/04/2003 is a day in March or in April, and a date of calibration is none of the
measurement.
"""

from __future__ import annotations

import datetime
import re

from calibration.measurement.text_table import Table
from kinematics.files.time_stamps import ZONE, moment, zone_of

MEASURED = "measured"
"""Header key of the measuring date."""
_DAY = r"(?:mon|tue|tues|wed|wednes|thu|thur|thurs|fri|sat|satur|sun)(?:day)?|mo|di|mi|do|fr|sa|so"
_KEY = (
    r"(?:date|datum)(?: (?:of|der) (?:the )?(?:measurement|messung|test)| and time)?|measured(?: on)?"
    r"|starttime of export"
)
_STAMP = re.compile(r"\S+\s+(\d{4}-\d\d-\d\d\s+\d\d:\d\d:.*)")
_MONTHS = ("jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec")
_MONTH = rf"(?P<month>(?:{'|'.join(_MONTHS)})[a-z]*)"
_WORDS = "|".join((_DAY, *(f"{month}[a-z]*" for month in _MONTHS)))
_LINE = re.compile(rf"[\W_]*(?:{_KEY})\b((?:[\W_]|\b(?:{_WORDS})\b)*\d.*)", re.I)
"""A key, and no words of another meaning before the number of the day or of the year."""
_FORMS = (
    re.compile(r"\b(?P<year>\d{4})-(?P<month>\d\d)-(?P<day>\d\d)\b"),
    re.compile(r"\b(?P<day>\d{1,2})\.(?P<month>\d{1,2})\.(?P<year>\d{4})\b"),
    re.compile(rf"\b{_MONTH}\.?\s+(?P<day>\d{{1,2}})\b.*?\b(?P<year>\d{{4}})\b", re.I),
    re.compile(rf"\b(?P<day>\d{{1,2}})\.?[\s-]+{_MONTH}\.?[\s,-]+(?P<year>\d{{4}})\b", re.I),
)


def date_in(text: str) -> datetime.date | None:
    """The date in a line `Date ...` of a text, or of its first time stamp; None where there is none of one meaning."""
    for line in text.splitlines():
        found = _LINE.fullmatch(line) or _STAMP.fullmatch(line)
        date = None if found is None else _date(found[1])
        if date is not None:
            return date
    return None


def measuring_date(table: Table) -> datetime.date | None:
    """The date in the header of a measurement file; None without one. UserError for another text, or the future."""
    if MEASURED not in table.entries:
        return None
    text = table.entries[MEASURED].value.strip()
    try:
        date = datetime.datetime.fromisoformat(text).date()
    except ValueError:
        table.header_fault(
            MEASURED, f"{text!r} is no date: write it as 2003-10-17, with the time of second 0 behind it"
        )
    if date > datetime.datetime.now(datetime.UTC).date() + datetime.timedelta(days=1):
        table.header_fault(MEASURED, f"{date} lies in the future: write the date of the measurement")
    return date


def measuring_start(table: Table) -> datetime.datetime | None:
    """The time of second 0, in the zone that the file states; None where the header has no time of day."""
    if MEASURED not in table.entries or ":" not in table.entries[MEASURED].value:
        return None
    zone, source = table.entries[ZONE].value if ZONE in table.entries else "", f"{table.source} {MEASURED}"
    start = moment(table.entries[MEASURED].value, source, zone)
    return start.astimezone(zone_of(zone, source)) if zone else start


def _date(text: str) -> datetime.date | None:
    for form in _FORMS:
        if found := form.search(text):
            month = found["month"].lower()
            number = int(month) if month.isdigit() else 1 + _MONTHS.index(month[:3])
            try:
                return datetime.date(int(found["year"]), number, int(found["day"]))
            except ValueError:
                return None
    return None
