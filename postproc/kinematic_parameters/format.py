"""A control's kinematic parameters: their freedoms, their numbers, and the certainty of their description."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from kinematics.machine import Machine
from postproc.kinematic_parameters.lines import Freedom
from postproc.tables.format import Settings, Sign
from postproc.tables.readers.source import Source


class Number(NamedTuple):
    """One number in the control."""

    name: str
    value: float
    unit: str
    decimals: int

    @property
    def text(self) -> str:
        """Its value, without a minus before zero."""
        return f"{self.value:z.{self.decimals}f}"


@dataclass(frozen=True)
class ParameterFormat:
    """The kinematic parameters of one control."""

    name: str
    title: str
    settings: type[Settings]
    freedoms: Callable[[Machine, Any], list[Freedom]]
    """Changes of lines that the control can hold, by the user's settings; UserError for a machine that it cannot."""
    numbers: Callable[[Machine, Any], list[Number]]
    """All numbers for a machine with these lines."""
    write: Callable[[Sequence[Number], Machine, Any, str], str]
    """Text of a file with these numbers, under a heading."""
    file: str
    """Name of the file; that of the present values has `_before` in front of its suffix."""
    steps: Callable[[Any], tuple[float, float]]
    """mm and rad, by the user's settings: steps of the values that the control holds."""
    read: Callable[[Source, str, Machine], Machine]
    """The machine with the lines of a file, by its name; shares no code with the writer."""
    tables: str
    """Format of the same control's tables, for the remaining error with both."""
    meaning: str
    """For sheet.md: meaning, unit, sign."""
    loading: str
    certainty: str
    sign: Sign | None = None
    """`correction`: the changes have the documented direction; None if no source states it."""

    @property
    def file_before(self) -> str:
        """Name of the file with the values by the machine file."""
        stem, dot, suffix = self.file.rpartition(".")
        return f"{stem}_before{dot}{suffix}"


def signed(before: Sequence[Number], after: Sequence[Number], sign: str) -> list[Number]:
    """The numbers after, or with their changes reversed for `error`."""
    if sign == "correction":
        return list(after)
    return [old._replace(value=2.0 * old.value - new.value) for old, new in zip(before, after, strict=True)]


def at_points(names: Sequence[str], values: Sequence[float], unit: str, decimals: int) -> list[Number]:
    """Numbers of one vector."""
    return [Number(name, float(value), unit, decimals) for name, value in zip(names, values, strict=True)]


def is_along(direction: object, letter: str) -> float:
    """1 or -1 for a direction along a letter's axis or against it, otherwise 0."""
    part = float(np.asarray(direction)["XYZ".index(letter)])
    return float(np.sign(part)) if abs(part) > 1.0 - 1e-6 else 0.0
