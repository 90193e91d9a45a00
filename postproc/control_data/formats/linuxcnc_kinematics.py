"""LinuxCNC: HAL pins of xyzac-trt-kins, xyzbc-trt-kins and 5axiskins."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from kinematics.machine import Axis, Machine
from kinematics.user_error import UserError
from postproc.control_data.format import Settings, of_control
from postproc.control_data.formats.linuxcnc_comp import FORMAT as TABLES
from postproc.control_data.parameters.parameter_format import ParameterFormat
from postproc.control_data.parameters.parameter_numbers import Number, at_points, is_along
from postproc.control_data.parameters.rotary_lines import Freedom, rotary_axes
from postproc.control_data.readers.read_linuxcnc_kinematics import read, unit_beside

HAL_DECIMALS = 6
SAME_PIVOT_MM = 1e-6


class LinuxCncKinematicsSettings(Settings, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """`conventional`: the pin conventional-directions of the module is 1 (LinuxCNC after 2.9)."""

    conventional: bool = False


class _Kinematics(NamedTuple):
    """The module that fits a machine, with its rotary axes: of the table tilt and C, of the head C and tilt."""

    module: str
    tilt: Axis
    turn: Axis


def _kinematics(machine: Machine, settings: LinuxCncKinematicsSettings) -> _Kinematics:
    table, head = rotary_axes(machine, "workpiece"), rotary_axes(machine, "tool")
    if len(table) == 2 and not head:
        found = _trunnion(machine, *table)
        against = -1.0 if not settings.conventional else 1.0
        for axis, letter in ((found.tilt, "XY"["AB".index(found.tilt.name[0])]), (found.turn, "Z")):
            if is_along(axis.unit_direction, letter) != against:
                raise UserError(
                    f"machine {machine.name}: {found.module} turns {axis.name} "
                    f"{'with' if settings.conventional else 'against'} ISO 841, and the machine file the other way: "
                    "set the direction of the axis in the machine file to that of the control, or give "
                    f"--set conventional={'false' if settings.conventional else 'true'} where its pin "
                    "conventional-directions is set so"
                )
        return found
    if len(head) == 2 and not table:
        return _head(machine, *head)
    raise UserError(
        f"machine {machine.name} ({machine.chain}): LinuxCNC has kinematic parameters for C on A, and C on B, of a "
        "table (xyzac-trt-kins, xyzbc-trt-kins), and for B behind C in a head (5axiskins)"
    )


def _trunnion(machine: Machine, tilt: Axis, turn: Axis) -> _Kinematics:
    if turn.name != "C" or tilt.name not in ("A", "B"):
        raise UserError(
            f"machine {machine.name} ({machine.chain}): LinuxCNC's tables have C on A (xyzac-trt-kins) or C on B "
            "(xyzbc-trt-kins)"
        )
    letter = "XY"["AB".index(tilt.name)]
    if not is_along(tilt.unit_direction, letter) or not is_along(turn.unit_direction, "Z"):
        raise UserError(
            f"machine {machine.name}: {tilt.name} must be along {letter} and C along Z for LinuxCNC's kinematics"
        )
    return _Kinematics(f"xyz{tilt.name.lower()}c-trt-kins", tilt, turn)


def _head(machine: Machine, turn: Axis, tilt: Axis) -> _Kinematics:
    named = (turn.name, tilt.name) == ("C", "B")
    directed = is_along(turn.unit_direction, "Z") == 1.0 and is_along(tilt.unit_direction, "Y") == -1.0
    offsets = np.array([*turn.point[:2], tilt.point[0]])
    if not named or not directed or np.abs(offsets).max() > SAME_PIVOT_MM:
        raise UserError(
            f"machine {machine.name} ({machine.chain}): 5axiskins has C along Z, then B against ISO 841 (direction 0 "
            "-1 0 in the machine file), both in one point above the spindle nose"
        )
    return _Kinematics("5axiskins", tilt, turn)


def freedoms(machine: Machine, settings: LinuxCncKinematicsSettings) -> list[Freedom]:
    """C along X and Y, the tilting axis across itself; of 5axiskins only the height of B."""
    found = _kinematics(machine, settings)
    if found.module == "5axiskins":
        return [Freedom("B", (0.0, 0.0, 1.0))]
    across = (0.0, 1.0, 0.0) if found.tilt.name == "A" else (1.0, 0.0, 0.0)
    return [
        Freedom("C", (1.0, 0.0, 0.0)),
        Freedom("C", (0.0, 1.0, 0.0)),
        Freedom(found.tilt.name, across),
        Freedom(found.tilt.name, (0.0, 0.0, 1.0)),
    ]


def numbers(machine: Machine, _settings: LinuxCncKinematicsSettings) -> list[Number]:
    """Pins of the module, mm."""
    table, head = rotary_axes(machine, "workpiece"), rotary_axes(machine, "tool")
    if head:
        return [Number("5axiskins.pivot-length", head[1].point[2], "mm", HAL_DECIMALS)]
    tilt, turn = table
    module = f"xyz{tilt.name.lower()}c-trt-kins"
    offset = np.asarray(tilt.point) - np.asarray(turn.point)
    offset[0 if tilt.name == "A" else 1] = 0.0  # along the line: the module has no use for it
    points = at_points([f"{module}.{letter}-rot-point" for letter in "xyz"], turn.point, "mm", HAL_DECIMALS)
    return points + at_points([f"{module}.{letter}-offset" for letter in "xyz"], offset.tolist(), "mm", HAL_DECIMALS)


def write(found: Sequence[Number], _machine: Machine, _settings: LinuxCncKinematicsSettings, heading: str) -> str:
    """Lines `setp PIN VALUE` for a HAL file."""
    return "\n".join([f"# {heading}", *(f"setp {each.name} {each.text}" for each in found), ""])


def remark(machine: Machine) -> str:
    """How the length of the tool comes to these kinematics."""
    return _WITH_SUM if rotary_axes(machine, "tool") else "The pin tool-offset stays connected to the tool length."


_WITH_SUM = """\
LinuxCNC takes the pin as
the distance from the tool tip to these lines: it must hold the exported number plus the length of the active tool.
5axiskins has no other pin for the tool. Connect the pin to the sum of both: the exported number is in0 of a component
sum2, motion.tooloffset.z is in1, as in LinuxCNC's sample configuration bridgemill. A pin that is set to the exported
number alone moves the tip of every tool off its place as soon as B turns."""


FORMAT = ParameterFormat(
    name="linuxcnc-kinematics",
    title="LinuxCNC, HAL pins of the kinematics",
    settings=LinuxCncKinematicsSettings,
    freedoms=freedoms,
    numbers=numbers,
    write=write,
    file="kinematics.hal",
    steps=lambda _: (10.0**-HAL_DECIMALS, 1e-9),
    read=read,
    unit=of_control,
    unit_beside=unit_beside,
    remark=remark,
    tables=TABLES,
    sign="correction",
    meaning="""\
{unit} in machine coordinates, without tool. x-, y-, z-rot-point: a point on the line of C. y-offset and z-offset
(xyzac) or x-offset and z-offset (xyzbc): from this point to the line of A or B. pivot-length (5axiskins): from the
spindle nose to the lines of B and C.""",
    loading="""\
Replace the lines `setp` of these pins in the HAL file of the machine and restart LinuxCNC; or enter them with
`halcmd setp` while the machine stands with all rotary axes at 0 and LinuxCNC is off. kinematics_before.hal goes back.
Pins that are connected to a signal cannot be set: change the source of the signal. The INI file must state LINEAR_UNITS
in {unit} and ANGULAR_UNITS = degree under [TRAJ].""",
    certainty="""\
Confirmed: LinuxCNC's source, and its simulator (2.9.0~pre1): in ncomp's tests a machine with location errors is
measured in it, fitted, and measured again with these lines.""",
)
