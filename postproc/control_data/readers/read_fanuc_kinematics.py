"""FANUC: a list of parameters 19700 ... 19714, number and value."""

from __future__ import annotations

import re

import numpy as np

from kinematics.machine import Machine, Vector
from kinematics.user_error import UserError
from postproc.control_data.readers.control_source import Source, numbers, refusal, refuse_cut, with_lines


def read(source: Source, name: str, machine: Machine) -> Machine:
    """The machine with the lines by the parameters."""
    found: dict[int, float] = {}
    refuse_cut(name, source.files[name], r"^\s*\d")
    for line, text in enumerate(source.files[name].splitlines(), 1):
        if not text.strip() or text.startswith("#") or text.strip() == "parameter,mm":
            continue
        if re.match(r"\s*N\d+\s*Q\d", text):
            why = "this is a backup of all parameters (CNC-PARA): give a list of 19700 to 19714, PARAMETER,VALUE in mm"
            raise refusal(name, line, text, why)
        words = text.split(",")
        if len(words) != 2 or not words[0].strip().isdecimal():
            raise refusal(name, line, text, "expected PARAMETER,VALUE")
        number = int(words[0])
        if number == 19680:
            _check_kind(numbers(words[1:], name, line, text)[0], (name, line, text), machine)
            continue
        if not 19700 <= number <= 19705 and not 19709 <= number <= 19714:
            raise refusal(name, line, text, "expected a parameter from 19700 to 19705 or 19709 to 19714")
        if number in found:
            raise refusal(name, line, text, "this parameter is given twice")
        found[number] = numbers(words[1:], name, line, text)[0]
    table = [axis.name for axis in reversed(machine.axes) if axis.rotary and axis.side == "workpiece"]
    head = [axis.name for axis in machine.axes if axis.rotary and axis.side == "tool"]
    points: dict[str, Vector] = {}
    place = np.zeros(3)
    for first, axis in zip((19700, 19703), table, strict=False):
        place = place + _vector(found, first, name)
        points[axis] = tuple(place.tolist())
    place = np.array([0.0, 0.0, source.settings.holder])
    for first, axis in zip((19709, 19712), reversed(head), strict=False):
        place = place + _vector(found, first, name)
        points[axis] = tuple(place.tolist())
    if found:
        raise UserError(f"{name}: the machine ({machine.chain}) has no use for parameter {min(found)}")
    return with_lines(machine, points)


def _check_kind(kind: float, where: tuple[str, int, str], machine: Machine) -> None:
    """UserError for another kind of kinematics than that of the machine."""
    sides = [axis.side for axis in machine.axes if axis.rotary]
    own = 2 if "workpiece" not in sides else 12 if "tool" not in sides else 21
    if kind != own:
        why = f"19680 = {kind:g} is another kind of kinematics than that of the machine ({machine.chain}), {own}"
        raise refusal(*where, why)


def _vector(found: dict[int, float], first: int, name: str) -> np.ndarray:
    lacking = [number for number in range(first, first + 3) if number not in found]
    if lacking:
        raise UserError(f"{name}: parameter {lacking[0]} is missing")
    return np.array([found.pop(number) for number in range(first, first + 3)])
