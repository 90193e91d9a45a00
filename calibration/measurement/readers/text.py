"""Common functions of readers of foreign formats: text of any old encoding, numbers with a decimal comma, units."""

from __future__ import annotations

import codecs
from collections.abc import Mapping

from calibration.measurement.text_table import Entry, number_of
from kinematics.machine import Machine
from kinematics.user_error import UserError

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


def number_at(cell: str, where: str, decimal: str = ".") -> float:
    """The finite number in a cell; UserError, naming `where`, for other text."""
    text = cell.strip()
    if decimal == ",":
        text = text.replace(",", ".") if "." not in text else "?"
    value = number_of(text)
    if value is None:
        raise UserError(f"{where}: {cell.strip()!r} is no number" if cell.strip() else f"{where}: empty")
    return value


def unit_size(units: Mapping[str, float], unit: str, where: str) -> float:
    """Size of a unit; UserError for an unknown one."""
    if unit not in units:
        raise UserError(f"{where}: unit {unit!r} is none of {', '.join(units)}")
    return units[unit]


def axis_named(name: str, machine: Machine) -> str:
    """The axis of the machine with this name, in large or small letters; the name itself for none."""
    by_large_letters = {each.upper(): each for each in machine.names}
    return by_large_letters.get(name.strip().upper(), name)


def axis_of(name: str, machine: Machine, source: str) -> str:
    """The axis given for a file that names none, or the only axis of the machine; UserError for another."""
    if not name and len(machine.names) == 1:
        return machine.names[0]
    name = axis_named(name, machine)
    if name not in machine.names:
        fault = f"axis {name!r} is none of machine {machine.name} ({machine.chain})" if name else "the axis is missing"
        raise UserError(f"{source}: {fault}: state --header axis=NAME, one of {', '.join(machine.names)}")
    return name


def given_entries(header: Mapping[str, str], own: Mapping[str, str]) -> dict[str, Entry]:
    """Header of the contract: entries of the format itself, and entries given in addition to the file."""
    return {key: Entry(value) for key, value in {**own, **header}.items()}
