"""The numbers of a control's kinematic parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from kinematics.machine import Machine


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


def with_lengths(machine: Machine, factor: float) -> Machine:
    """The machine with the points of its axes times a factor: its lines in another unit of lengths."""
    if factor == 1.0:
        return machine
    points = (tuple(factor * value for value in axis.point) for axis in machine.axes)
    pairs = zip(machine.axes, points, strict=True)
    return replace(machine, axes=tuple(replace(axis, point=(x, y, z)) for axis, (x, y, z) in pairs))


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
