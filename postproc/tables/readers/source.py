"""Shared parts of the readers of tables: located refusals, numbers, and tables as the errors that they correct."""

from __future__ import annotations

import configparser
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, cast

from kinematics.basis import BSpline
from kinematics.effects import Component, ControlTable, ErrorMotion
from kinematics.machine import Machine
from kinematics.user_error import UserError


@dataclass(frozen=True)
class Source:
    """Files of a control, by name, and the settings of the user."""

    machine: Machine
    files: Mapping[str, str]
    value_is: str
    """`error` or `correction`."""
    settings: Mapping[str, str] = field(default_factory=dict)

    def table(
        self,
        axis: str,
        of: Sequence[str],
        nodes: Sequence[Sequence[float]],
        corrections: Sequence[float],
        direction: int = 0,
    ) -> ControlTable:
        """The errors that a table of corrections, mm or degrees, removes."""
        for name in (axis, *of):
            self.machine.index(name)
        size = math.radians(1.0) * 1e6 if axis[0] in "ABC" else 1e3
        values = tuple(-float(c) * size for c in corrections)
        try:
            return ControlTable(
                axis, tuple(of), tuple(tuple(map(float, n)) for n in nodes), values, cast(Any, direction)
            )
        except ValueError as fault:
            raise UserError(f"{', '.join(self.files)}: {fault}") from None

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

    def setting(self, name: str, default: str) -> str:
        """The settings of the user by --set."""
        return self.settings.get(name, default)

    def number(self, name: str, default: str) -> float:
        """A setting of the user that is a number."""
        return numbers([self.setting(name, default)], "--set", 1, name)[0]

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

    def only(self, suffix: str, control: str, content: str) -> str:
        """Name of the only file with this suffix; UserError unless there is exactly one."""
        names = [name for name in self.files if name.lower().endswith(suffix)]
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


def refusal(name: str, line: int, text: str, why: str) -> UserError:
    """A refusal with its location."""
    return UserError(f"{name}:{line}: {text.strip()!r}: {why}")


LARGEST = 1e18
"""Largest number of a table that is read, so that no unit makes it infinite."""


def numbers(words: Sequence[str], name: str, line: int, text: str) -> list[float]:
    """Numbers of a table; a located UserError at the first that is none or is beyond LARGEST."""
    try:
        if any("_" in word for word in words):
            raise ValueError(f"{' '.join(words)!r} is no number: '_' is no digit")
        found = [float(word) for word in words]
    except ValueError as fault:
        raise refusal(name, line, text, str(fault)) from None
    if not all(abs(number) <= LARGEST for number in found):
        raise refusal(name, line, text, f"a number is not finite, or beyond {LARGEST:g}")
    return found


def refuse_cut(name: str, text: str, row: str) -> None:
    """UserError where the last line, a row by this pattern, has no end: its last number may be cut off."""
    last = text.rpartition("\n")[2]
    if not text.endswith("\r") and re.search(row, last):
        why = "the last line has no end, so that its number may be cut off: copy the file again, or end the line"
        raise refusal(name, len(text.splitlines()), last, why)


def read_ini(name: str, text: str, **options: Any) -> configparser.ConfigParser:
    """The sections of a configuration file; UserError for a text that is not one."""
    ini = configparser.ConfigParser(strict=False, interpolation=None, **options)
    try:
        ini.read_string(text)
    except configparser.Error as fault:
        raise UserError(f"{name}: {fault}") from None
    return ini


def increasing(rows: Sequence[tuple[int, Sequence[float]]], name: str) -> None:
    """UserError, located, where the first number of a row is not above that of the row before."""
    for (_, before), (line, row) in pairwise(rows):
        if row[0] <= before[0]:
            raise refusal(name, line, f"{row[0]:g}", f"positions must increase, and the one before is {before[0]:g}")
