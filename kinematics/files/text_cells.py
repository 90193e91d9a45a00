"""Cells of foreign text files: text of any old encoding, numbers with a decimal comma, units."""

from __future__ import annotations

import codecs
import math
from collections.abc import Mapping

from kinematics.files.mistaken import number_hint
from kinematics.user_error import UserError

LARGEST_NUMBER = 1e12
"""Largest accepted number, so that the squares of mistyped numbers stay finite."""
LENGTHS: Mapping[str, float] = {"mm": 1.0, "m": 1e3, "inch": 25.4, "um": 1e-3}
"""Size of each unit, mm."""
ANGLES: Mapping[str, float] = {"deg": 1.0, "rad": 57.29577951308232}
"""Size of each unit, degrees."""
LENGTH_DEVIATIONS: Mapping[str, float] = {"um": 1.0, "mm": 1e3, "inch": 25.4e3}
"""Size of each unit, um."""
ANGLE_DEVIATIONS: Mapping[str, float] = {
    "urad": 1.0,
    "arcsec": 4.84813681109536,
    "mrad": 1e3,
    "deg": 17453.292519943295,
}
"""Size of each unit, urad."""
TIMES: Mapping[str, float] = {"s": 1.0, "ms": 1e-3, "min": 60.0}
"""Size of each unit, s."""
TEMPERATURES: Mapping[str, float] = {"degC": 1.0, "K": 1.0, "degF": 5.0 / 9.0}
"""Size of each unit, K."""
ZERO_DEGC: Mapping[str, float] = {"degC": 0.0, "K": 273.15, "degF": 32.0 * 5.0 / 9.0}
"""Temperature of 0 degC, K above the zero of each unit."""

ABSOLUTE_ZERO = -273.15
"""Absolute zero, degC."""
WRONG_UNIT_DEGC = 200.0
"""Temperature, degC, above which a number is in another unit: kelvin, or hundredths."""


def old_text(data: bytes) -> str:
    """The text; other encodings than UTF-8 are read byte by byte, which preserves the ASCII of keys and numbers."""
    data = data.removeprefix(codecs.BOM_UTF8)
    try:
        return data.decode()
    except UnicodeDecodeError:
        return data.decode("latin-1")


def numbered_lines(data: bytes) -> list[tuple[int, str]]:
    """The lines with their numbers, for any line ends."""
    text = old_text(data).replace("\r\n", "\n").replace("\r", "\n")
    return list(enumerate(text.split("\n"), start=1))


def number_of(cell: str) -> float | None:
    """The number in a cell; None for other text and for numbers beyond `LARGEST_NUMBER`."""
    try:
        value = float(cell) if cell.isascii() and "_" not in cell else math.nan
    except ValueError:
        return None
    return value if abs(value) <= LARGEST_NUMBER else None


def number_at(cell: str, where: str, decimal: str = ".") -> float:
    """The finite number in a cell; UserError, naming `where`, for other text."""
    text = cell.strip()
    if decimal == ",":
        text = text.replace(",", ".") if "." not in text else "?"
    value = number_of(text)
    if value is None:
        hint = number_hint(cell) or "; write a finite number, such as 20.5"
        raise UserError(f"{where}: {cell.strip()!r} is no number{hint}" if cell.strip() else f"{where}: empty")
    return value


def unit_size(units: Mapping[str, float], unit: str, where: str) -> float:
    """Size of a unit; UserError for an unknown one."""
    if unit not in units:
        raise UserError(f"{where}: unit {unit!r} is none of {', '.join(units)}")
    return units[unit]


def checked_degrees(value: float, where: str) -> float:
    """A temperature, degC; UserError, beginning with `where`, if it is not that of a machine."""
    if value < ABSOLUTE_ZERO:
        raise UserError(f"{where}: {value:g} degC is below absolute zero ({ABSOLUTE_ZERO:g})")
    if value > WRONG_UNIT_DEGC:
        raise UserError(f"{where}: {value:g} degC is no temperature of a machine: write degC (is this kelvin?)")
    return value
