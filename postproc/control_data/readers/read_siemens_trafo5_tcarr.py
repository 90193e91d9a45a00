"""Siemens SINUMERIK: machine data of the five-axis transformation, and the swivel data record."""

from __future__ import annotations

import re
from collections.abc import Iterator

import numpy as np

from kinematics.machine import Axis, Machine, Vector
from kinematics.transforms import Array
from kinematics.user_error import UserError
from postproc.control_data.readers.control_source import Source, numbers, refusal, with_lines

_DATA = re.compile(r"(?:N\d+\s+)?\$MC_TRAFO5_(?P<name>[A-Z0-9_]+?)_(?P<number>\d+)\[(?P<k>[0-2])\]$")
_CARRIER = re.compile(r"\$TC_CARR(?P<n>\d+)\[(?P<number>\d+)\]$")
_PASSED = re.compile(r"(CHANDATA\(\d+\)|M17|M30|M0?2|RET|%_N_\w+)?$")
_VECTOR_OF = {
    "T": {"PART_OFFSET": "I1", "JOINT_OFFSET": "I2", "BASE_TOOL": "I3"},
    "P": {"BASE_TOOL": "I2", "JOINT_OFFSET_PART": "I3", "PART_OFFSET": "I4"},
    "M": {"JOINT_OFFSET": "I1", "BASE_TOOL": "I2", "JOINT_OFFSET_PART": "I3", "PART_OFFSET": "I4"},
}
_FIRST_OF = {1: "I1", 4: "I2", 7: "V1", 10: "V2", 15: "I3", 18: "I4"}
CLOSED_MM = 1e-4
KIND_OF_CARRIER, FINE_OFFSETS = 23, range(41, 61)
"""$TC_CARRn of the kind of kinematics, and of the fine offsets."""
ENDS = ("M17", "M30", "RET", "M2", "M02")


def read_trafo5(source: Source, name: str, machine: Machine) -> Machine:
    """The machine with the lines by the machine data."""
    kind, axes = _kind(machine)
    wanted, names = str(source.settings.transformation), _VECTOR_OF[kind] | {"AXIS1": "V1", "AXIS2": "V2"}
    found: dict[tuple[str, int], float] = {}
    for line, text, left, value in _assignments(source, name):
        entry = _DATA.match(left)
        if entry is None or entry["name"] not in names:
            raise refusal(name, line, text, f"expected a vector of the transformation of kind {kind}")
        if entry["number"] != wanted:
            raise refusal(name, line, text, f"expected transformation {wanted}; give --set transformation=")
        _enter(found, names[entry["name"]], int(entry["k"]), value, (name, line, text))
    return _placed(machine, name, kind, axes, found)


def read_tcarr(source: Source, name: str, machine: Machine) -> Machine:
    """The machine with the lines by a swivel data record."""
    kind, axes = _kind(machine)
    wanted = str(source.settings.record)
    found: dict[tuple[str, int], float] = {}
    for line, text, left, value in _assignments(source, name):
        entry = _CARRIER.match(left)
        first = max((n for n in _FIRST_OF if entry and n <= int(entry["n"]) < n + 3), default=0)
        if entry is None or not first:
            raise refusal(name, line, text, "expected an offset or a line of a swivel data record")
        if entry["number"] != wanted:
            raise refusal(name, line, text, f"expected record {wanted}; give --set record=")
        _enter(found, _FIRST_OF[first], int(entry["n"]) - first, value, (name, line, text))
    return _placed(machine, name, kind, axes, found)


def _kind(machine: Machine) -> tuple[str, tuple[Axis, Axis]]:
    """T, P or M, and the axes by Siemens' numbers: those of the head, then of the table, from the bed on."""
    rotary = [axis for axis in machine.axes if axis.rotary]
    head = [axis for axis in rotary if axis.side == "tool"]
    table = [axis for axis in reversed(rotary) if axis.side == "workpiece"]
    if len(rotary) != 2:
        raise UserError(f"machine {machine.name} ({machine.chain}): expected two rotary axes")
    kind = "T" if not table else "P" if not head else "M"
    first, second = [*head, *table]
    return kind, (first, second)


def _assignments(source: Source, name: str) -> Iterator[tuple[int, str, str, float]]:
    codes = [text.partition(";")[0].strip() for text in source.files[name].splitlines()]
    if next((code for code in reversed(codes) if code), "") not in ENDS:
        raise UserError(f"{name}: the last line must be M17 (or M30, RET): without it the file may be cut off")
    for line, text in enumerate(source.files[name].splitlines(), 1):
        code = text.partition(";")[0].strip()
        if _PASSED.match(code):
            continue
        left, equals, right = code.partition("=")
        if _passed(left.strip(), right.strip(), (name, line, text), source.machine):
            continue
        if not equals:
            raise refusal(name, line, text, "expected NAME=VALUE")
        value = right.split("'")[0].strip()
        yield line, text, left.strip(), numbers([value], name, line, text)[0]


def _passed(left: str, right: str, where: tuple[str, int, str], machine: Machine) -> bool:
    """True for data beside the vectors that agree with them: the kind of kinematics, and fine offsets of zero."""
    entry = _CARRIER.match(left)
    number = int(entry["n"]) if entry else 0
    if number == KIND_OF_CARRIER:
        kind, _ = _kind(machine)
        stated = right.strip('"').upper()
        if stated != kind:
            raise refusal(*where, f"a record of kinematics {stated}, and the machine has kinematics {kind}")
    elif number in FINE_OFFSETS and numbers([right], *where)[0]:
        raise refusal(*where, "the fine offset is added to the vector: add it, and set this element to 0")
    return number == KIND_OF_CARRIER or number in FINE_OFFSETS


def _enter(found: dict[tuple[str, int], float], vector: str, k: int, value: float, where: tuple[str, int, str]) -> None:
    if (vector, k) in found:
        raise refusal(*where, "this element is set twice")
    found[vector, k] = value


def _placed(
    machine: Machine, name: str, kind: str, axes: tuple[Axis, Axis], found: dict[tuple[str, int], float]
) -> Machine:
    vectors: dict[str, Array] = {}
    for vector in (*_VECTOR_OF[kind].values(), "V1", "V2"):
        lacking = [k for k in range(3) if (vector, k) not in found]
        if lacking:
            raise UserError(f"{name}: element {lacking[0]} of {vector} is missing")
        vectors[vector] = np.array([found[vector, k] for k in range(3)])
    extra = {vector for vector, _ in found} - set(vectors)
    if extra:
        raise UserError(f"{name}: {', '.join(sorted(extra))} does not belong to kinematics of kind {kind}")
    gaps: list[tuple[str, ...]]
    if kind == "M":
        gaps, points = [("I1", "I2"), ("I3", "I4")], (vectors["I1"], vectors["I3"])
    elif kind == "P":
        gaps, points = [("I2", "I3", "I4")], (vectors["I2"], vectors["I2"] + vectors["I3"])
    else:
        gaps, points = [("I1", "I2", "I3")], (vectors["I1"], vectors["I1"] + vectors["I2"])
    for chain in gaps:
        gap = np.abs(sum(vectors[vector] for vector in chain)).max()
        if gap > CLOSED_MM:
            raise UserError(f"{name}: {' + '.join(chain)} must be 0, and differs by {gap:.6f} mm: the chain is open")
    places: dict[str, Vector] = {}
    directions: dict[str, Vector] = {}
    for axis, point, vector in zip(axes, points, ("V1", "V2"), strict=True):
        turning = vectors[vector] if axis.side == "tool" else -vectors[vector]
        if np.linalg.norm(turning) == 0.0 or turning @ axis.unit_direction <= 0.0:
            raise UserError(f"{name}: {vector} does not point where {axis.name} of the machine file turns")
        places[axis.name] = tuple(point.tolist())
        directions[axis.name] = tuple((turning / np.linalg.norm(turning)).tolist())
    return with_lines(machine, places, directions)
