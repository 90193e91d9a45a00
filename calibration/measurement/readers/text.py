"""Common functions of readers of foreign formats: the axis that is meant, and header entries that a file lacks."""

from __future__ import annotations

from collections.abc import Mapping

from calibration.measurement.text_table import Entry
from kinematics.machine import Machine
from kinematics.user_error import UserError


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
