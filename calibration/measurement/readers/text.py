"""What readers of foreign formats share: text of any old encoding, numbers with a decimal comma, units."""

from __future__ import annotations

import codecs
from collections.abc import Mapping

from calibration.measurement.text_table import Entry, number_of
from kinematics.user_error import UserError

LENGTHS: Mapping[str, float] = {"mm": 1.0, "m": 1e3, "inch": 25.4, "um": 1e-3}
"""In mm."""
ANGLES: Mapping[str, float] = {"deg": 1.0, "rad": 57.29577951308232}
"""In degrees."""
LENGTH_DEVIATIONS: Mapping[str, float] = {"um": 1.0, "mm": 1e3, "inch": 25.4e3}
"""In um."""
ANGLE_DEVIATIONS: Mapping[str, float] = {
    "urad": 1.0,
    "arcsec": 4.84813681109536,
    "mrad": 1e3,
    "deg": 17453.292519943295,
}
"""In urad."""
TIMES: Mapping[str, float] = {"s": 1.0, "ms": 1e-3, "min": 60.0}
"""In s."""


def old_text(data: bytes) -> str:
    """The text; what is not UTF-8 is read byte by byte, which leaves the ASCII of keys and numbers as it is."""
    data = data.removeprefix(codecs.BOM_UTF8)
    try:
        return data.decode()
    except UnicodeDecodeError:
        return data.decode("latin-1")


def numbered_lines(data: bytes) -> list[tuple[int, str]]:
    """The lines with their numbers, whatever ends them."""
    text = old_text(data).replace("\r\n", "\n").replace("\r", "\n")
    return list(enumerate(text.split("\n"), start=1))


def number_at(cell: str, where: str, decimal: str = ".") -> float:
    """A finite number; UserError naming the place."""
    text = cell.strip()
    if decimal == ",":
        text = text.replace(",", ".") if "." not in text else "?"
    value = number_of(text)
    if value is None:
        raise UserError(f"{where}: {cell.strip()!r} is no number" if cell.strip() else f"{where}: empty")
    return value


def unit_size(units: Mapping[str, float], unit: str, where: str) -> float:
    """Size of a unit; UserError when it is none of these."""
    if unit not in units:
        raise UserError(f"{where}: unit {unit!r} is none of {', '.join(units)}")
    return units[unit]


def given_entries(header: Mapping[str, str], own: Mapping[str, str]) -> dict[str, Entry]:
    """Header of the contract: what the format itself says, and what was given along with the file."""
    return {key: Entry(value) for key, value in {**own, **header}.items()}
