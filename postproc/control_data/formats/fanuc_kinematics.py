"""FANUC: parameters 19700 ... 19714 of tool center point control for five-axis machining."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Literal

import numpy as np
from msgspec import Meta

from kinematics.machine import Axis, Machine
from kinematics.user_error import UserError
from postproc.control_data.format import Settings, of_machine
from postproc.control_data.formats.fanuc_pitch import FORMAT as TABLES
from postproc.control_data.parameters.parameter_format import ParameterFormat
from postproc.control_data.parameters.parameter_numbers import Number, at_points
from postproc.control_data.parameters.rotary_lines import Freedom, across, rotary_axes
from postproc.control_data.readers.read_fanuc_kinematics import read

TABLE, BETWEEN_TABLE, TO_TOOL, BETWEEN_TOOL = 19700, 19703, 19709, 19712
"""First parameters of the vectors."""


class FanucKinematicsSettings(Settings, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Decimals of the parameters (IS-B 3, IS-C 4), the tool holder offset (19666), mm, and the unit of the machine."""

    decimals: Annotated[int, Meta(ge=3, le=5)] = 4
    holder: float = 0.0
    machine_unit: Literal["", "mm"] = ""


def _axes(machine: Machine) -> tuple[int, Axis, Axis]:
    """Mechanical unit type (19680), first and second rotary axis."""
    head, table = rotary_axes(machine, "tool"), rotary_axes(machine, "workpiece")
    if len(head) == 2 and not table:
        return 2, head[0], head[1]
    if len(table) == 2 and not head:
        return 12, table[0], table[1]
    if len(table) == len(head) == 1:
        return 21, head[0], table[0]
    raise UserError(
        f"machine {machine.name} ({machine.chain}): parameter 19680 has types for two rotary axes, in the head (2), "
        "in the table (12), or one in each (21)"
    )


def freedoms(machine: Machine, _settings: FanucKinematicsSettings) -> list[Freedom]:
    """Both lines across themselves."""
    _, *axes = _axes(machine)
    return [freedom for axis in axes for freedom in across(axis, tilts=False)]


def numbers(machine: Machine, settings: FanucKinematicsSettings) -> list[Number]:
    """Parameters by number, mm."""
    kind, first, second = _axes(machine)
    one, two = np.asarray(first.point, float), np.asarray(second.point, float)
    nose = np.array([0.0, 0.0, settings.holder])
    vectors = {
        2: {TO_TOOL: two - nose, BETWEEN_TOOL: one - two},
        12: {TABLE: one, BETWEEN_TABLE: two - one},
        21: {TABLE: two, TO_TOOL: one - nose},
    }[kind]
    found: list[Number] = []
    for number, vector in vectors.items():
        found += at_points([str(number + k) for k in range(3)], vector.tolist(), "mm", settings.decimals)
    return found


def write(found: Sequence[Number], machine: Machine, _settings: FanucKinematicsSettings, heading: str) -> str:
    """A list for typing in: parameter, value."""
    kind, *_ = _axes(machine)
    rows = [f"{each.name},{each.text}" for each in found]
    return "\n".join([f"# {heading}", f"# 19680 = {kind}", "parameter,mm", *rows, ""])


FORMAT = ParameterFormat(
    name="fanuc-kinematics",
    title="FANUC, parameters 19700 ... 19714 of the five-axis kinematics",
    settings=FanucKinematicsSettings,
    freedoms=freedoms,
    numbers=numbers,
    write=write,
    file="parameters.csv",
    steps=lambda settings: (10.0**-settings.decimals, 1e-9),
    read=read,
    unit=of_machine,
    tables=TABLES,
    sign="correction",
    meaning="""\
mm, machine coordinates, all rotary axes at 0. 19700-19702: a point on the first rotary axis of the table (of the only
one, type 21). 19703-19705: from it to a point on the second rotary axis of the table. 19709-19711: from the spindle
nose (with the tool holder offset 19666) to the (second) rotary axis of the head. 19712-19714: from there to the first
one. The axes are numbered from the bed on. The control has no small tilts of the lines.""",
    loading="""\
Write down the present values of the control and compare them with parameters_before.csv: they must agree, up to a
shift along the line of an axis. Otherwise change the present values by the differences under Parameters instead.
Enter the new ones by hand under parameter write enable; power off may be required. Machine coordinates of the
machine file must be those of the control: its zeros are the reference positions.""",
    certainty="""\
Numbers, points and directions: FANUC Series 30i tool center point control manual (A-79348E); 19700-19702 by common
knowledge. Nothing was tried on a control.""",
)
