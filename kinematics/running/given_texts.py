"""Options of the form NAME=VALUE: texts as on the command line, or a mapping from names to values as in Python."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping

from kinematics.files.mistaken import number_hint
from kinematics.files.text_cells import checked_degrees
from kinematics.user_error import UserError

Texts = str | Iterable[str] | Mapping[str, object]
"""One text, several, or values by name: `"G54=1,2,3"`, `["G54=1,2,3", "G55=4,5,6"]`, `{"G54": (1, 2, 3)}`."""


def texts(given: Texts) -> list[str]:
    """The texts NAME=VALUE of an option.

    >>> texts({"G54": (-30, -20.5, 150), "G55": {"X": 10}, "T1": 80})
    ['G54=-30,-20.5,150', 'G55=X=10', 'T1=80']
    """
    if isinstance(given, str):
        return [given]
    if isinstance(given, Mapping):
        return [f"{name}={_value(value)}" for name, value in given.items()]
    return [str(each) for each in given]


def numbers(text: str, count: int, where: str, separator: str = ",") -> tuple[float, ...]:
    """`count` finite numbers in a text; UserError, with the option's name in `where`, for any other text."""
    try:
        values = tuple(float(entry) for entry in text.split(separator))
    except ValueError:
        values = ()
    if len(values) != count or not all(map(math.isfinite, values)):
        expected = "a number" if count == 1 else f"{count} numbers with {separator!r} between them"
        raise UserError(f"{where}: {text!r} is not {expected}{number_hint(text) if count == 1 else ''}")
    return values


def temperatures_of(given: Texts) -> dict[str, float]:
    """Temperatures `SENSOR=degC` by sensor; UserError for another form, and for a sensor that is given twice."""
    found: dict[str, float] = {}
    for text in texts(given):
        name, _, value = (part.strip() for part in text.partition("="))
        if not name or not value or name in found:
            raise UserError(f"--temperature {text}: expected each SENSOR=degC once, for example spindle=31.5")
        where = f"--temperature {text}"
        found[name] = checked_degrees(numbers(value, 1, where)[0], where)
    return found


def header_of(given: Texts) -> dict[str, str]:
    """Entries `KEY=VALUE` as a header; UserError for another form, and for a key that is given twice."""
    header: dict[str, str] = {}
    for line in texts(given):
        key, equals, value = (part.strip() for part in line.partition("="))
        if not (key and equals and value):
            raise UserError(f"--header {line}: expected KEY=VALUE, as in u_um=0.3")
        if key in header:
            raise UserError(f"--header {line}: {key} is given twice: give it once")
        header[key] = value
    return header


def _value(value: object) -> str:
    if isinstance(value, Mapping):
        return ",".join(f"{name}={_value(each)}" for name, each in value.items())
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str) or not isinstance(value, Iterable):
        return str(value)
    return ",".join(map(_value, value))
