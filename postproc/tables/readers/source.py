"""Shared parts of the readers of tables: located refusals, numbers, and tables as the errors that they correct."""

from __future__ import annotations

import math
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


def refusal(name: str, line: int, text: str, why: str) -> UserError:
    """A refusal with its location."""
    return UserError(f"{name}:{line}: {text.strip()!r}: {why}")


LARGEST = 1e18
"""Largest number of a table that is read, so that no unit makes it infinite."""


def numbers(words: Sequence[str], name: str, line: int, text: str) -> list[float]:
    """Numbers of a table; a located UserError at the first that is none or is beyond LARGEST."""
    try:
        found = [float(word) for word in words]
    except ValueError as fault:
        raise refusal(name, line, text, str(fault)) from None
    if not all(abs(number) <= LARGEST for number in found):
        raise refusal(name, line, text, f"a number is not finite, or beyond {LARGEST:g}")
    return found


def increasing(rows: Sequence[tuple[int, Sequence[float]]], name: str) -> None:
    """UserError, located, where the first number of a row is not above that of the row before."""
    for (_, before), (line, row) in pairwise(rows):
        if row[0] <= before[0]:
            raise refusal(name, line, f"{row[0]:g}", f"positions must increase, and the one before is {before[0]:g}")
