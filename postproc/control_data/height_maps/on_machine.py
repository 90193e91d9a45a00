"""A height map on a machine: the surface of a workpiece at a work offset."""

from __future__ import annotations

from pathlib import Path

import msgspec
import numpy as np

from kinematics.effects import UM
from kinematics.effects.control import WorkpieceSurface
from kinematics.machine import Machine
from kinematics.user_error import UserError
from postproc.control.setup import Setup, parse_height_map
from postproc.control_data.height_maps.height_map import HeightMap
from postproc.control_data.height_maps.read_map import read_map


def with_height_map(setup: Setup, given: str, unit: str) -> Setup:
    """The set-up with the surface of a workpiece, from the height map FILE or FILE@G55.

    unit: `mm` or `inch`, of a file that states none; empty for mm. UserError for a map that cannot be used.
    """
    file, named = parse_height_map(given)
    read = read_map(file, unit)
    _refuse_turned(setup.machine, file)
    offset = "" if read.of_machine and not named else named or setup.usual_offset
    x, y, z = _zero(setup, offset) if offset else (0.0, 0.0, 0.0)
    surface = surface_of(read, (x, y), f"{file.name} ({read.title}) at {offset or 'machine zero'}")
    if offset and setup.turned.get(offset):
        raise UserError(f"height map {file}: work offset {offset} turns the coordinates, and the map does not turn")
    return msgspec.structs.replace(setup, surface=surface, surface_offset=offset, surface_zero=z)


def surface_of(read: HeightMap, zero: tuple[float, float], note: str) -> WorkpieceSurface:
    """The surface of a map whose zero is at a machine position, mm."""
    nodes = tuple(tuple((each + at).tolist()) for each, at in zip((read.x, read.y), zero, strict=True))
    values = tuple((np.asarray(read.heights).ravel() / UM).tolist())
    try:
        return WorkpieceSurface("Z", read.axes, nodes, values, interpolation=read.interpolation, note=note)
    except ValueError as fault:
        raise UserError(f"height map {note}: {fault}") from None


def _refuse_turned(machine: Machine, file: Path) -> None:
    """UserError for a machine that can turn the workpiece under its map."""
    if set(machine.names) != set("XYZ"):
        raise UserError(
            f"height map {file}: machine {machine.name} ({machine.chain}) has other axes than X, Y and Z, which may "
            "turn or shift the workpiece: a height map serves machines of these three axes"
        )


def _zero(setup: Setup, name: str) -> tuple[float, float, float]:
    """X, Y and Z of a work offset, mm; UserError where it is not given."""
    given = setup.work_offset(name)
    if given is None:
        raise UserError(
            f"the height map lies in the coordinates of {name}, which is not given: give --work-offset {name}=x,y,z, "
            "or --set-up-zero if program and map have the same zero and the place on the machine does not matter"
        )
    x, y, z = (given.value.get(axis, 0.0) for axis in "XYZ")
    return x, y, z
