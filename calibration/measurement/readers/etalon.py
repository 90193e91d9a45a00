"""Etalon Exchange Format, "Vendor" variant (TRAC-CAL): error motions and location errors, read as an ErrorModel.

Documented by ISG and Beckhoff (TF5280, "Etalon Exchange Format"): `//` begins a comment; a block begins with the name
of a parameter by ISO 230-1 in brackets and has one number, or positions with values.

    [C0B]
    VALUE = 0.000022355737
    [EXY]
    Gridpoints = {
        -280.0 -0.001358635132
        -270.0 -0.000240680764
    }

The units, the sign, and the convention for axes that carry the workpiece are not published (the documented numbers
would be mm and rad); the user gives them as a `Convention`. Values are interpolated between grid points.
"""

from __future__ import annotations

import datetime
import re
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Literal, cast

from calibration.measurement.readers.text import number_at, numbered_lines, unit_size
from kinematics.basis import BSpline
from kinematics.effects import COMPONENTS, Component, Effect, ErrorMotion, LocationError
from kinematics.error_model.model import ErrorModel, Provenance, reference
from kinematics.files import fingerprint, read_input
from kinematics.machine import Machine
from kinematics.user_error import UserError

_BLOCK = re.compile(r"\[\s*(\w+)\s*\]")
_MOTION = re.compile(r"E([XYZABC])([XYZABCUVW]\d?)")
_LOCATION = re.compile(r"E?([XYZABC])0([XYZABCUVW]\d?)")
_LENGTHS = {"mm": 1e3, "um": 1.0, "m": 1e6}
"""Size of each unit of length, um."""
_ANGLES = {"rad": 1e6, "urad": 1.0, "deg": 17453.292519943295}
"""Size of each unit of angle, urad."""
_TURNS = {"deg": 1.0, "rad": 57.29577951308232}
"""Size of each unit of rotary positions, degrees."""


@dataclass(frozen=True)
class Convention:
    """Sign and units, which the format does not define."""

    value_is: Literal["error", "correction"]
    """Meaning of a value: the error of the machine, tool relative to workpiece, or its correction."""
    length: str
    """Unit of linear errors: mm, um or m."""
    angle: str
    """Unit of angular errors: rad, urad or deg."""
    rotary_positions: str = "deg"
    """Unit of positions of rotary axes: deg or rad; those of linear axes are mm."""


@dataclass
class _Block:
    name: str
    line: int
    value: float | None = None
    points: list[tuple[float, float]] = field(default_factory=list)


def recognises(head: str) -> bool:
    """True for the beginning of such a file."""
    return any(_BLOCK.fullmatch(line.split("//")[0].strip()) for line in head.splitlines()) and (
        "Gridpoints" in head or "VALUE" in head
    )


def read_etalon(path: Path, machine: Machine, convention: Convention) -> ErrorModel:
    """The errors in a file, without uncertainties, which the format does not contain."""
    data = read_input(path, "Etalon exchange file")
    effects = tuple(_effect(block, machine, convention, str(path)) for block in _blocks(data, str(path)))
    if not effects:
        raise UserError(f"{path}: there are no blocks [EXX], [C0Y], ... of the Etalon exchange format")
    names = [effect.name for effect in effects]
    for name in names:
        if names.count(name) > 1:
            raise UserError(f"{path}: {name} is given twice")
    made = Provenance(
        "ncomp", datetime.datetime.now(datetime.UTC), "Etalon exchange file", {path.name: fingerprint(data)}
    )
    return ErrorModel(machine=reference(machine), provenance=made, effects=effects)


def _blocks(data: bytes, source: str) -> list[_Block]:
    blocks: list[_Block] = []
    inside = False
    for number, line in numbered_lines(data):
        text, where = line.split("//")[0].strip(), f"{source}:{number}"
        start = _BLOCK.fullmatch(text)
        if start and not inside:
            blocks.append(_Block(start[1], number))
        elif not text:
            continue
        elif not blocks:
            raise UserError(f"{where}: {text!r} comes before the first block [name]")
        elif text.startswith("}") and inside:
            inside = False
        elif inside:
            cells = text.split()
            if len(cells) != 2:
                raise UserError(f"{where}: {text!r} is not 'position value'")
            blocks[-1].points.append((number_at(cells[0], where), number_at(cells[1], where)))
        elif re.fullmatch(r"Gridpoints\s*=\s*\{", text):
            inside = True
        elif (value := re.fullmatch(r"VALUE\s*=\s*(\S+)", text)) is not None:
            blocks[-1].value = number_at(value[1], where)
        else:
            raise UserError(f"{where}: {text!r} is neither VALUE = nor Gridpoints = {{")
    if inside:
        raise UserError(f"{source}: the grid points of [{blocks[-1].name}] have no end '}}'")
    return blocks


def _effect(block: _Block, machine: Machine, convention: Convention, source: str) -> Effect:
    where = f"{source}:{block.line} [{block.name}]"
    motion, location = _MOTION.fullmatch(block.name), _LOCATION.fullmatch(block.name)
    found = location or motion
    if found is None:
        raise UserError(f"{where}: no error motion (EXY) and no location error (C0B) of ISO 230-1")
    if found[2] not in machine.names:
        raise UserError(f"{where}: machine {machine.name} ({machine.chain}) has no axis {found[2]}")
    component = cast(Component, found[1])
    units, unit = (_ANGLES, convention.angle) if COMPONENTS.index(component) > 2 else (_LENGTHS, convention.length)
    size = unit_size(units, unit, source) * (1.0 if convention.value_is == "error" else -1.0)
    note = f"Etalon exchange file, values as {convention.value_is}s in {unit}; no uncertainty given"
    if location:
        if block.value is None or block.points:
            raise UserError(f"{where}: a location error needs one number, VALUE = ...")
        return LocationError(component=component, axis=found[2], value=size * block.value, note=note)
    if block.value is not None or len(block.points) < 2:
        raise UserError(f"{where}: an error motion needs at least two grid points")
    rotary = machine.axes[machine.index(found[2])].rotary
    step = unit_size(_TURNS, convention.rotary_positions, source) if rotary else 1.0
    nodes = tuple(step * position for position, _ in block.points)
    if any(later <= earlier for earlier, later in pairwise(nodes)):
        raise UserError(f"{where}: the positions of the grid points must ascend")
    values = tuple(size * value for _, value in block.points)
    return ErrorMotion(component=component, axis=found[2], basis=BSpline(nodes, 1), parameters=values, note=note)
