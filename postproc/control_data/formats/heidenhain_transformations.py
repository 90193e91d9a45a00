"""HEIDENHAIN: rows Trans of a kinematics description, from the tool to the workpiece."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import numpy as np
from msgspec import Meta

from kinematics.machine import Axis, Machine
from kinematics.user_error import UserError
from postproc.control_data.format import Settings
from postproc.control_data.formats.heidenhain_com import COM
from postproc.control_data.parameters.parameter_format import ParameterFormat
from postproc.control_data.parameters.parameter_numbers import Number
from postproc.control_data.parameters.rotary_lines import Freedom, across, rotary_axes
from postproc.control_data.readers.read_heidenhain_transformations import read

END = "end"
"""Name of the rows behind the last rotary axis, which go back to the origin of the machine."""


class TransSettings(Settings, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Decimals of COORD for shifts (mm) and for rotations (degrees)."""

    decimals: Annotated[int, Meta(ge=3, le=7)] = 4
    angle_decimals: Annotated[int, Meta(ge=3, le=7)] = 5


def _from_tool(machine: Machine) -> list[Axis]:
    """The rotary axes from the tool on; UserError without any."""
    found = [*reversed(rotary_axes(machine, "tool")), *rotary_axes(machine, "workpiece")]
    if not found:
        raise UserError(f"machine {machine.name} ({machine.chain}) has no rotary axis: it has no such parameters")
    return found


def freedoms(machine: Machine, _settings: TransSettings) -> list[Freedom]:
    """All lines across themselves, and their tilts."""
    return [freedom for axis in _from_tool(machine) for freedom in across(axis, tilts=True)]


def turns(axis: Axis) -> dict[str, float]:
    """Rotations, deg, one after the other, that lay the direction of the axis' letter, or its opposite, on its line."""
    letter = "ABC".index(axis.name[0])
    x, y, z = (axis.unit_direction * (1.0 if axis.unit_direction[letter] > 0 else -1.0)).tolist()
    if letter == 0:
        angles = {"B": np.arctan2(-z, x), "C": np.arcsin(y)}
    elif letter == 1:
        angles = {"A": np.arctan2(z, y), "C": -np.arcsin(x)}
    else:
        angles = {"A": np.arctan2(-y, z), "B": np.arcsin(x)}
    return {name: float(np.degrees(angle)) for name, angle in angles.items()}


def numbers(machine: Machine, settings: TransSettings) -> list[Number]:
    """COORD of the rows Trans before each MachAxis of a rotary axis: `C Trans X`."""
    found: list[Number] = []
    place = np.zeros(3)
    for axis in _from_tool(machine):
        point = np.asarray(axis.point, float)
        for letter, value in zip("XYZ", (point - place).tolist(), strict=True):
            found.append(Number(f"{axis.name} Trans {letter}", value, "mm", settings.decimals))
        for letter, value in turns(axis).items():
            found.append(Number(f"{axis.name} Trans {letter}", value, "deg", settings.angle_decimals))
        place = point
    back = [Number(f"{END} Trans {letter}", -place[k], "mm", settings.decimals) for k, letter in enumerate("XYZ")]
    return found + back


def write(found: Sequence[Number], _machine: Machine, _settings: TransSettings, heading: str) -> str:
    """The rows of the rotary axes; those of the linear axes stay where they are."""
    lines = [f"* {heading}", f"{'DOC':<14}{'KEY':<10}{'AXIS':<6}COORD"]
    for name in dict.fromkeys(each.name.split()[0] for each in found):
        own = [(each.name.split()[-1], each) for each in found if each.name.startswith(f"{name} ")]
        lines += [_row(f"line of {name}" if name != END else "origin", letter, each.text) for letter, each in own]
        if name != END:
            lines.append(f"{'':<14}{'MachAxis':<10}{name}")
            tilts = [(letter, each) for letter, each in own if letter in "ABC"]
            lines += [
                _row(f"back of {name}", letter, each._replace(value=-each.value).text)
                for letter, each in reversed(tilts)
            ]
    return "\n".join([*lines, "[END]", ""])


def _row(doc: str, letter: str, text: str) -> str:
    return f"{doc:<14}{'Trans':<10}{letter:<6}{text}"


FORMAT = ParameterFormat(
    name="heidenhain-transformations",
    title="HEIDENHAIN, rows Trans of the kinematics description",
    settings=TransSettings,
    freedoms=freedoms,
    numbers=numbers,
    write=write,
    file="kinematics.txt",
    steps=lambda settings: (10.0**-settings.decimals, np.radians(10.0**-settings.angle_decimals)),
    read=read,
    tables=COM,
    meaning="""\
COORD of the rows Trans, mm and degrees, from the tool reference point to the workpiece: before each MachAxis of a
rotary axis the shift from the line before to its line, and the rotations that lay its letter's axis on the line; behind
it the rotations back. With --sign correction COORD is the position of the next line seen from the one before, in
machine coordinates at rotary positions 0.""",
    loading="""\
Do not replace the kinematics description of the machine with these rows: it has other rows too (linear axes, collision
objects, MachBase). Find the rows Trans before each MachAxis and change COORD by the differences under Parameters;
cycle 450 saves the present kinematics first. By the machine builder. Controls with NCK software have the same
transformations in their configuration data.""",
    certainty="""\
Keys, columns and the order from the tool: iTNC 530 HSCI technical manual. The sign and the decimals of COORD, and
rotations behind MachAxis: no source; nothing was tried on a control: experimental. The sign is as given by --sign.""",
)
