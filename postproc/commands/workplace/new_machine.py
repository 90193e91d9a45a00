"""The text of a new machine file, from answers."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import get_args

import numpy as np

from kinematics.machine import Family, Machine, split_chain
from kinematics.running.given_texts import numbers
from kinematics.user_error import UserError
from postproc.commands.workplace.answers import Answers, by_name

CHAINS = {
    "1": ("w b X Y Z t", "three axes, all of them carry the tool (gantry)"),
    "2": ("w X Y b Z t", "three axes, cross table"),
    "3": ("w C B b X Y Z t", "five axes, table on a trunnion B"),
    "4": ("w C A b X Y Z t", "five axes, table on a trunnion A"),
    "5": ("w C A X Y b Z t", "five axes, table on a trunnion A on a cross table"),
    "6": ("w C b X Y Z B t", "five axes, rotary table and swivelling head"),
    "7": ("w b X Y Z C B t", "five axes, fork head"),
}
"""Usual chains by number, each with its machines."""
FAMILIES: tuple[str, ...] = get_args(Family)


@dataclass(frozen=True)
class GivenAxes:
    """Answers about axes that are given as options, `NAME=VALUE`."""

    travel: Sequence[str]
    point: Sequence[str]
    direction: Sequence[str]
    home: Sequence[str]


def read_name(text: str) -> str:
    """The name of a machine; UserError for one that is no name of a file, and for that of a shipped machine."""
    import machines

    if not re.fullmatch(r"[\w-]+", text):
        raise UserError(f"{text!r}: expected a name of letters, digits, - and _")
    if text in machines.names():
        raise UserError(f"{text!r} is a shipped machine: expected another name")
    return text


def read_chain(text: str) -> str:
    """A chain, or one of the usual ones by its number."""
    chain = CHAINS[text][0] if text in CHAINS else " ".join(text.split())
    split_chain(chain)
    return chain


def read_travel(text: str) -> tuple[float, float]:
    """`-250:250` or `-250..250` as the ends of a travel."""
    text = text.replace("..", ":")
    low, high = numbers(text, 2, "travel", ":") if "inf" not in text else _endless(text)
    if not low < high:
        raise UserError(f"travel {text}: expected the lower end first, -250:250")
    return low, high


def _endless(text: str) -> tuple[float, float]:
    if text.replace(" ", "") != "-inf:inf":
        raise UserError(f"travel {text}: expected -inf:inf for an axis without ends")
    return -math.inf, math.inf


def read_vector(text: str) -> tuple[float, ...]:
    """`0,0,155` as three numbers."""
    return numbers(text, 3, "point or direction")


def number(value: float) -> str:
    """A number for a file."""
    return f"{value:.12g}"


def machine_text(name: str, description: str, chain: str, family: str, given: GivenAxes, answers: Answers) -> str:
    """The machine file of a chain; asks for the travel of each axis and the point of each rotary axis."""
    names = [axis for axis, _ in split_chain(chain)]
    travels, points = by_name(given.travel, "--travel", names), by_name(given.point, "--point", names)
    directions, homes = by_name(given.direction, "--direction", names), by_name(given.home, "--home", names)
    lines = [f"name = {json.dumps(name)}", f"description = {json.dumps(description, ensure_ascii=False)}"]
    lines += [f"chain = {json.dumps(chain)}"]
    for axis in names:
        rotary = axis[0] in "ABC"
        unit = "degrees" if rotary else "mm"
        question = f"Travel of {axis}, {unit}, low:high{' (-inf:inf without ends)' if rotary else ''}"
        low, high = answers.one(travels.get(axis), f"--travel {axis}=", question, read_travel, None)
        lines += ["", f"[axes.{axis}]", f"travel = [{number(low)}, {number(high)}]"]
        if rotary:
            question = f"A point on the line of {axis}, mm from the spindle nose with all axes at 0, x,y,z"
            point = answers.one(points.get(axis), f"--point {axis}=", question, read_vector, None)
            lines.append(f"point = [{', '.join(map(number, point))}]")
        if axis in directions:
            lines.append(f"direction = [{', '.join(map(number, read_vector(directions[axis])))}]")
        if axis in homes:
            lines.append(f"home = {number(numbers(homes[axis], 1, f'--home {axis}')[0])}")
        elif axis.startswith("Z") and math.isfinite(high):
            lines.append(f"home = {number(high)}")
    if family != "any":
        lines += ["", "[control]", f"family = {json.dumps(family)}"]
    return "\n".join(lines) + "\n"


def lines_below_the_spindle(machine: Machine) -> Iterator[str]:
    """For each rotary axis of a table, the positions of X and Y at which its line is below the spindle, in words.

    They follow from its point; a line that is not along X, Y or Z of the machine has none.
    """
    linear = [axis for axis in machine.axes if axis.name in ("X", "Y")]
    for table in machine.axes:
        if not table.rotary or table.side != "workpiece" or sum(map(bool, table.direction)) != 1:
            continue
        crossed = [axis for axis in linear if not np.dot(axis.direction, table.direction)]
        below = [float(np.dot(table.point, axis.unit_direction)) for axis in crossed]
        where = ", ".join(f"{axis.name} {number(value)}" for axis, value in zip(crossed, below, strict=True))
        beyond = [
            axis.name
            for axis, value in zip(crossed, below, strict=True)
            if not axis.travel[0] <= value <= axis.travel[1]
        ]
        outside = f" (outside the travel of {' and '.join(beyond)})" if beyond else ""
        yield f"the line of {table.name} is below the spindle at {where}{outside}"
