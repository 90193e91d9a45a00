"""Siemens SINUMERIK: machine data of the five-axis transformation, and the swivel data record."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Annotated

import numpy as np
from msgspec import Meta

from kinematics.machine import Axis, Machine
from kinematics.transforms import Array
from kinematics.user_error import UserError
from postproc.control_data.format import Settings, of_control
from postproc.control_data.formats.siemens_eec_cec import CEC
from postproc.control_data.parameters.parameter_format import ParameterFormat
from postproc.control_data.parameters.parameter_numbers import Number, at_points
from postproc.control_data.parameters.rotary_lines import Freedom, across, rotary_axes
from postproc.control_data.readers.read_siemens_trafo5_tcarr import read_tcarr, read_trafo5

MM_DECIMALS, DIRECTION_DECIMALS = 6, 9
KINDS = {(2, 0): "T", (0, 2): "P", (1, 1): "M"}
"""Kind of kinematics ($TC_CARR23) by the numbers of rotary axes in the head and in the table."""
TRAFO5_VECTORS = {
    "T": {"I1": "PART_OFFSET", "I2": "JOINT_OFFSET", "I3": "BASE_TOOL"},
    "P": {"I2": "BASE_TOOL", "I3": "JOINT_OFFSET_PART", "I4": "PART_OFFSET"},
    "M": {"I1": "JOINT_OFFSET", "I2": "BASE_TOOL", "I3": "JOINT_OFFSET_PART", "I4": "PART_OFFSET"},
}
"""Machine data of the vectors, by the manual's table of swivel data and transformation."""
AXIS_VECTORS = {"V1": "AXIS1", "V2": "AXIS2"}
DATA = {
    "PART_OFFSET": 24500, "BASE_TOOL": 24550, "JOINT_OFFSET_PART": 24558, "JOINT_OFFSET": 24560, "AXIS1": 24570,
    "AXIS2": 24572,
}  # fmt: skip
"""Numbers of the machine data of transformation 1; those of transformation 2 are larger by 100."""
CARRIER = {"I1": 1, "I2": 4, "V1": 7, "V2": 10, "I3": 15, "I4": 18}
"""First number n of the three $TC_CARRn of each vector."""


class TrafoSettings(Settings, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Number of the transformation (1 or 2) in the names of the machine data."""

    transformation: Annotated[int, Meta(ge=1, le=2)] = 1


class CarrierSettings(Settings, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Number of the swivel data record."""

    record: Annotated[int, Meta(ge=1)] = 1


def chain_of(machine: Machine) -> tuple[str, Axis, Axis]:
    """Kind of kinematics, first and second rotary axis; UserError unless the machine has two."""
    head, table = rotary_axes(machine, "tool"), rotary_axes(machine, "workpiece")
    kind = KINDS.get((len(head), len(table)))
    if kind is None:
        raise UserError(
            f"machine {machine.name} ({machine.chain}): the transformation has two rotary axes, and the machine "
            f"{len(head)} in the head and {len(table)} in the table"
        )
    first, second = (head[0], table[0]) if kind == "M" else head or table
    return kind, first, second


def vectors(machine: Machine) -> dict[str, Array]:
    """Offsets I1 ... I4, mm, and lines V1, V2 of the kinematics, by name, of a closed chain."""
    kind, first, second = chain_of(machine)
    p1, p2 = np.asarray(first.point, float), np.asarray(second.point, float)
    offsets = {
        "T": {"I1": p1, "I2": p2 - p1, "I3": -p2},
        "P": {"I2": p1, "I3": p2 - p1, "I4": -p2},
        "M": {"I1": p1, "I2": -p1, "I3": p2, "I4": -p2},
    }[kind]
    lines = {"V1": first, "V2": second}
    return offsets | {name: _turning(axis) for name, axis in lines.items()}


def _turning(axis: Axis) -> Array:
    """The direction about which the part that the axis carries turns for a positive command."""
    return axis.unit_direction if axis.side == "tool" else np.asarray(-axis.unit_direction)


def freedoms(machine: Machine, _settings: object) -> list[Freedom]:
    """Both lines across themselves, and their tilts."""
    _, *axes = chain_of(machine)
    return [freedom for axis in axes for freedom in across(axis, tilts=True)]


def trafo5_numbers(machine: Machine, settings: TrafoSettings) -> list[Number]:
    """Machine data by name, with index."""
    kind, *_ = chain_of(machine)
    names = TRAFO5_VECTORS[kind] | AXIS_VECTORS
    found: list[Number] = []
    for vector, values in vectors(machine).items():
        shown = [f"$MC_TRAFO5_{names[vector]}_{settings.transformation}[{k}]" for k in range(3)]
        found += _of_vector(vector, shown, values)
    return found


def carrier_numbers(machine: Machine, settings: CarrierSettings) -> list[Number]:
    """Elements of the swivel data record."""
    found: list[Number] = []
    for vector, values in vectors(machine).items():
        found += _of_vector(vector, [f"$TC_CARR{CARRIER[vector] + k}[{settings.record}]" for k in range(3)], values)
    return found


def _of_vector(vector: str, names: Sequence[str], values: Array) -> list[Number]:
    if vector.startswith("V"):
        return at_points(names, values.tolist(), "1", DIRECTION_DECIMALS)
    return at_points(names, values.tolist(), "mm", MM_DECIMALS)


def write_trafo5(found: Sequence[Number], _machine: Machine, settings: TrafoSettings, heading: str) -> str:
    """Lines of machine data for an archive."""
    further = 100 * (settings.transformation - 1)
    lines = []
    for each in found:
        data = each.name.removeprefix("$MC_TRAFO5_").rpartition("_")[0]
        lines.append(f"N{DATA[data] + further} {each.name}={each.text}")
    return "\n".join([f"; {heading}", "CHANDATA(1)", *lines, "M17", ""])


def write_carrier(found: Sequence[Number], machine: Machine, settings: CarrierSettings, heading: str) -> str:
    """Assignments of a program that sets the swivel data record."""
    kind, *_ = chain_of(machine)
    lines = [f"{each.name}={each.text}" for each in found]
    return "\n".join([f"; {heading}", f'; kinematics $TC_CARR23[{settings.record}]="{kind}"', *lines, "M17", ""])


MEANING = """\
Vectors in {unit} at the basic position of the machine (rotary axes at 0), axes of the machine. T (head): I1 from the
spindle nose to the first rotary axis, I2 from there to the second, I3 back to the nose. P (table): I2 from the origin
of the machine to the first rotary axis, I3 from there to the second, I4 back to the origin. M: I1 to the axis of the
head and I2 back, I3 to the axis of the table and I4 back. The chain is closed. V1, V2: the directions about which the
head or the table turns for a positive command; for a table it is opposite to ISO 841. Tilts of the lines are in V1
and V2."""
CERTAINTY = """\
Names and their order: SINUMERIK Operate commissioning manual, table of swivel data and five-axis transformation, and
its closure of the chain. Where each vector begins, and the sign of V, is general knowledge; nothing was tried on a
control: experimental. --sign correction has the vectors as described above."""
LOADING = """\
First compare the file of the present values (kinematics_before) with the control: they must agree, up to the sign of
whole vectors and to a shift of their beginning along a line. Otherwise do not load these values: change the present
values of the control by the differences under Parameters instead. Keep an archive of the control. The values are in
{unit}, the basic system of units of the control."""

TRAFO5 = ParameterFormat(
    name="siemens-trafo5",
    title="Siemens SINUMERIK, machine data of the five-axis transformation (types 24, 40, 56)",
    settings=TrafoSettings,
    freedoms=freedoms,
    numbers=trafo5_numbers,
    write=write_trafo5,
    file="kinematics.ini",
    steps=lambda _: (10.0**-MM_DECIMALS, 10.0**-DIRECTION_DECIMALS),
    read=read_trafo5,
    unit=of_control,
    tables=CEC,
    meaning=MEANING,
    loading=f"{LOADING} By the machine builder; active after the machine data are set active (NEWCONF or reset).",
    certainty=CERTAINTY,
)
TCARR = replace(
    TRAFO5,
    name="siemens-tcarr",
    title="Siemens SINUMERIK, swivel data record ($TC_CARR), for CYCLE800 and transformation type 72",
    settings=CarrierSettings,
    numbers=carrier_numbers,
    write=write_carrier,
    file="kinematics.spf",
    read=read_tcarr,
    loading=f"{LOADING} The fine offsets $TC_CARR41 ... 60 must be 0, or be subtracted. Run the file as a subprogram.",
)
