"""HEIDENHAIN: rows Trans and MachAxis of a kinematics description, from the tool to the workpiece."""

from __future__ import annotations

import numpy as np

from kinematics.machine import ISO_DIRECTION, Machine, Vector
from kinematics.transforms import Array, rotation_about
from kinematics.user_error import UserError
from postproc.control_data.readers.control_source import Source, numbers, refusal, with_lines

COMMENTS = ("*", ";")
HEADINGS = ("BEGIN", "NR", "DOC")
FEWEST_DECIMALS, MOST_SHIFT_DECIMALS = 3, 9
"""Decimals of a shift, at least and at most."""
CANCELLED = 1e-9
"""Largest remaining rotation, rad: those before and behind a row MachAxis are the same numbers."""


def read(source: Source, name: str, machine: Machine) -> Machine:
    """The machine with the lines at the rows MachAxis; rows of linear axes do not change lines."""
    place, frame = np.zeros(3), np.eye(3)
    points: dict[str, Vector] = {}
    directions: dict[str, Vector] = {}
    decimals = MOST_SHIFT_DECIMALS
    rows = source.files[name].rstrip().splitlines()
    if not rows or rows[-1].strip() != "[END]":
        raise UserError(f"{name}: the last line must be [END]")
    for line, text in enumerate(rows[:-1], 1):
        words = text.split()
        if not words or words[0].startswith(COMMENTS):
            continue
        _refuse_mark(words, name, line, text)
        if "Trans" in words:
            rest = words[words.index("Trans") + 1 :]
            if len(rest) != 2 or rest[0] not in tuple("XYZABC"):
                raise refusal(name, line, text, "expected Trans AXIS COORD with an axis of X Y Z A B C")
            value = numbers(rest[1:], name, line, text)[0]
            decimals = min(decimals, _decimals(rest[1])) if rest[0] in tuple("XYZ") else decimals
            place, frame = _transformed(place, frame, rest[0], value)
        elif "MachAxis" in words:
            axis = words[-1]
            if axis not in machine.names:
                raise refusal(name, line, text, f"the machine ({machine.chain}) has no axis {axis}")
            if axis in points:
                raise refusal(name, line, text, f"axis {axis} has two rows MachAxis")
            if machine.axes[machine.index(axis)].rotary:
                points[axis], directions[axis] = _line(machine, axis, place, frame)
        elif "MachBase" not in words and words[0] not in HEADINGS:
            raise refusal(name, line, text, "expected a row Trans, MachAxis or MachBase")
    order = [axis.name for axis in reversed(machine.axes) if axis.rotary]
    if list(points) != order:
        raise UserError(
            f"{name}: expected MachAxis rows of {', '.join(order)} in this order, found {', '.join(points)}"
        )
    _refuse_open(place, frame, 0.51 * 10.0**-decimals * (len(points) + 1), name)
    return with_lines(machine, points, directions)


def _decimals(number: str) -> int:
    """Decimals of a shift; a number with fewer than the control shows is exact."""
    return max(len(number.partition(".")[2]), FEWEST_DECIMALS)


def _refuse_open(place: Array, frame: Array, rounding: float, name: str) -> None:
    """UserError unless the rows lead back to the origin, but for `rounding`, mm, of their numbers."""
    if np.abs(frame - np.eye(3)).max() > CANCELLED:
        raise UserError(f"{name}: the rotations of the rows Trans do not cancel at the end")
    if np.abs(place).max() > rounding:
        shift = ", ".join(f"{value:z.4f}" for value in place.tolist())
        raise UserError(
            f"{name}: the shifts of the rows Trans add up to ({shift}) mm, and must lead back to the origin: a row is "
            "missing or twice, or a number is wrong"
        )


def _refuse_mark(words: list[str], name: str, line: int, text: str) -> None:
    """UserError for a table in inches, and for a row that is marked as a comment in a way of other files."""
    if words[0] == "BEGIN" and "INCH" in words:
        raise refusal(name, line, text, "the table is in INCH: give COORD in mm, under BEGIN ... MM")
    if words[0].startswith(("#", "//", "(")) and {"Trans", "MachAxis"} & {word.strip("()") for word in words}:
        raise refusal(name, line, text, "it is unclear whether this row is a comment: begin a comment with * or ;")


def _transformed(place: Array, frame: Array, axis: str, value: float) -> tuple[Array, Array]:
    if axis in "XYZ":
        return place + frame[:, "XYZ".index(axis)] * value, frame
    unit = np.eye(3)["ABC".index(axis)]
    return place, np.asarray(frame @ rotation_about(unit, np.radians([value]))[0])


def _line(machine: Machine, name: str, place: Array, frame: Array) -> tuple[Vector, Vector]:
    direction = frame @ np.asarray(ISO_DIRECTION[name[0]], float)
    if direction @ machine.axes[machine.index(name)].unit_direction < 0.0:
        direction = -direction
    x, y, z = place.tolist()
    a, b, c = direction.tolist()
    return (x, y, z), (a, b, c)
