"""Shared parts of the readers of tables: located refusals, numbers, and tables as the errors that they correct."""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any, cast

from kinematics.basis import BSpline
from kinematics.effects import Component, ControlTable, ErrorMotion
from kinematics.machine import Machine, Vector
from kinematics.user_error import UserError


@dataclass(frozen=True)
class Source:
    """Files of a control, by name, and the settings of the user."""

    machine: Machine
    files: Mapping[str, str]
    value_is: str
    """`error` or `correction`."""
    settings: Any
    """Those of the format, by the user."""
    searched: frozenset[str] = frozenset()
    """Names of the files that were found in a folder: not all of them need be tables."""
    used: set[str] = field(default_factory=set)
    """Names of the files that a reader has read; each reader adds its own."""
    with_unit: set[str] = field(default_factory=set)
    """Names of the files that state the unit of their lengths, by readers of formats in the unit of the control."""
    length_mm: float = 1.0
    """Unit of the lengths in the files, mm."""
    angle_deg: float = 1.0
    """Unit of the angles in the files, degrees."""

    def in_units(self, length_mm: float, angle_deg: float) -> Source:
        """These files, with numbers in other units."""
        return replace(self, length_mm=length_mm, angle_deg=angle_deg)

    def unit(self, axis: str) -> float:
        """Unit of the positions of an axis, mm or degrees."""
        return self.angle_deg if axis[0] in "ABC" else self.length_mm

    @property
    def unused(self) -> list[str]:
        """Names of the files without anything that was read."""
        return [name for name in self.files if name not in self.used]

    def table(
        self,
        axis: str,
        of: Sequence[str],
        nodes: Sequence[Sequence[float]],
        corrections: Sequence[float],
        direction: int = 0,
    ) -> ControlTable:
        """The errors that a table of corrections removes; positions and corrections are in the units of the files."""
        for name in (axis, *of):
            self.machine.index(name)
        size = (math.radians(1.0) * 1e6 if axis[0] in "ABC" else 1e3) * self.unit(axis)
        values = tuple(-float(c) * size for c in corrections)
        positions = tuple(tuple(float(x) * self.unit(name) for x in n) for name, n in zip(of, nodes, strict=True))
        if tuple(of) == (axis,):
            self._refuse_reversal(axis, nodes[0], corrections)
        try:
            return ControlTable(axis, tuple(of), positions, values, cast(Any, direction))
        except ValueError as fault:
            raise UserError(f"{', '.join(self.files)}: {fault}") from None

    def _refuse_reversal(self, axis: str, nodes: Sequence[float], corrections: Sequence[float]) -> None:
        """UserError for corrections with which the axis would stand still or go back while its command goes on."""
        for (x, before), (y, after) in pairwise(zip(nodes, corrections, strict=True)):
            if x < y and y + after <= x + before:
                raise UserError(
                    f"{', '.join(self.files)}: the corrections of {axis} change from {before:g} to {after:g} between "
                    f"{x:g} and {y:g}: the axis would go back while its command goes on; check the unit of the values"
                )

    def line(self, axis: str, of: str, slope: float, zero: float = 0.0) -> ControlTable:
        """Correction in proportion to a position, from `zero` on, over thrice its travel: it goes on outside."""
        low, high = self.machine.axes[self.machine.index(of)].travel
        ends = (2 * low - high, 2 * high - low)
        return self.table(axis, (of,), (ends,), [slope * (end - zero) for end in ends])

    def motion(self, component: str, axis: str, nodes: Sequence[float], values: Sequence[float]) -> ErrorMotion:
        """An error motion, linear between nodes; values in um or urad."""
        self.machine.index(axis)
        try:
            basis = BSpline(tuple(nodes), 1)
            return ErrorMotion(cast(Component, component), axis, basis, tuple(values), u=(0.0,) * len(values))
        except ValueError as fault:
            raise UserError(f"{', '.join(self.files)}: E_{component}{axis}: {fault}") from None

    def own(self, axis: str, rows: Sequence[Sequence[float]]) -> list[ControlTable]:
        """A table of an axis over itself, rows of position, forward and backward correction."""
        if not rows:
            raise UserError(f"{', '.join(self.files)}: the table of {axis} has no points")
        nodes, forward, backward = zip(*rows, strict=True)
        if forward == backward:
            return [self.table(axis, (axis,), (nodes,), forward)]
        return [self.table(axis, (axis,), (nodes,), forward, 1), self.table(axis, (axis,), (nodes,), backward, -1)]

    def sign(self, kind: str) -> float:
        """1 if the values of the files are of this kind, `error` or `correction`, otherwise -1."""
        return 1.0 if self.value_is == kind else -1.0

    @property
    def lettered(self) -> list[str]:
        """Names of the axes in the order X Y Z A B C U V W, in which controls number them."""
        return sorted(self.machine.names, key=lambda name: "XYZABCUVW".index(name[0]))

    def numbered(self, k: int, subject: str) -> str:
        """The axis with the number k of a control, from 1; UserError, beginning with `subject`, if there is none."""
        if not 1 <= k <= len(self.lettered):
            raise UserError(f"{subject} does not exist: the machine has {len(self.lettered)} axes")
        return self.lettered[k - 1]

    def only(self, suffix: str, control: str, content: str, but: Collection[str] = ()) -> str:
        """Name of the only file with this suffix, except those in `but`; UserError unless there is exactly one."""
        names = [name for name in self.files if name.lower().endswith(suffix) and name not in but]
        if len(names) != 1:
            found = ", ".join(names) or f"none among {', '.join(sorted(self.files)) or 'no files'}"
            raise UserError(
                f"{control} tables: expected one file *{suffix} with {content}, found {found}; name the folder or all "
                "files of the tables"
            )
        return names[0]

    def rows(self, name: str, columns: int) -> list[tuple[int, list[str]]]:
        """Line and values of each row of a CSV file after its heading; UserError for another number of columns."""
        found = [(line, row.split(",")) for line, row in enumerate(self.files[name].splitlines()[1:], 2)]
        for line, words in found:
            if len(words) != columns:
                raise refusal(name, line, ",".join(words), f"expected {columns} columns")
        return found


def with_lines(machine: Machine, points: Mapping[str, Vector], directions: Mapping[str, Vector] = {}) -> Machine:
    """The machine with other points, mm, and directions of its axes, by their names; those not named stay."""
    axes = (
        replace(axis, point=points.get(axis.name, axis.point), direction=directions.get(axis.name, axis.direction))
        for axis in machine.axes
    )
    return replace(machine, axes=tuple(axes))


def refusal(name: str, line: int, text: str, why: str) -> UserError:
    """A refusal with its location."""
    return UserError(f"{name}:{line}: {text.strip()!r}: {why}")


LARGEST_TABLE_NUMBER = 1e18
"""Largest number of a table that is read, so that no unit makes it infinite."""


def numbers(words: Sequence[str], name: str, line: int, text: str) -> list[float]:
    """Numbers of a table; a located UserError at the first that is none or is beyond `LARGEST_TABLE_NUMBER`."""
    try:
        if any("_" in word for word in words):
            raise ValueError(f"{' '.join(words)!r} is no number: '_' is no digit")
        found = [float(word) for word in words]
    except ValueError as fault:
        raise refusal(name, line, text, str(fault)) from None
    if not all(abs(number) <= LARGEST_TABLE_NUMBER for number in found):
        raise refusal(name, line, text, f"a number is not finite, or beyond {LARGEST_TABLE_NUMBER:g}")
    return found


def refuse_cut(name: str, text: str, row: str) -> None:
    """UserError where the last line, a row by this pattern, has no end: its last number may be cut off."""
    last = text.rpartition("\n")[2]
    if not text.endswith("\r") and re.search(row, last):
        why = "the last line has no end, so that its number may be cut off: copy the file again, or end the line"
        raise refusal(name, len(text.splitlines()), last, why)


def increasing(rows: Sequence[tuple[int, Sequence[float]]], name: str) -> None:
    """UserError, located, where the first number of a row is not above that of the row before."""
    for (_, before), (line, row) in pairwise(rows):
        if row[0] <= before[0]:
            raise refusal(name, line, f"{row[0]:g}", f"positions must increase, and the one before is {before[0]:g}")
