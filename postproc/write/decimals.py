"""Decimals of coordinates, and columns of numbers that are rounded to them as by the editor of single blocks."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from kinematics.machine import Machine, NDArrayBool
from kinematics.transforms import Array, read_only
from postproc.text.number_style import decimals_for
from postproc.text.plain_columns import POWERS

NEAR_HALF = 1e-6
"""Distance from a half, in units of the last decimal, within which a number is rounded by its exact digits."""
_UNITS = read_only(np.array([10.0**-decimals for decimals in range(23)]))
"""One unit of the last decimal."""


def decimals_of_axis(machine: Machine, axis: int, unit: float) -> int:
    """Decimals of a coordinate, by the resolution of its axis; unit: mm or degrees per unit of the words."""
    return decimals_for(machine.axes[axis].resolution / unit)


class Present(NamedTuple):
    """The words of an axis in the program; columns `(k,)`."""

    named: NDArrayBool
    """True where there is a word."""
    value: Array
    own: np.ndarray
    """Its decimals; -1 for a number without a point."""
    least: int
    """Decimals that are written at least."""

    def to_write(self, wanted: Array) -> tuple[Array, Array, np.ndarray]:
        """Numbers to write `(k,)`, in units of their last decimals and as floats, and their decimals.

        A number of the program stays if it is `wanted` `(k,)`, rounded.
        """
        decimals = np.maximum(np.where(self.named, self.own, 0), self.least)
        counts, number = rounded(wanted, decimals)
        stays = self.named & (np.abs(number - self.value) < 0.5 * _UNITS[decimals])
        return counts, np.where(stays, self.value, number), decimals


class Increments(NamedTuple):
    """Increments as they are written; columns `(k,)`."""

    counts: Array
    """In units of their last decimals."""
    number: Array
    decimals: np.ndarray
    ends: Array
    """Positions on the control after them, mm or degrees."""


def increments(present: Present, corrected: Array, active: NDArrayBool, held: float, unit: float) -> Increments:
    """Increments from one position on the control to the next, the first from `held`, to `corrected` ends `(k,)`.

    active `(k,)`: lines that may move the axis. unit: mm or degrees per unit of the words.
    """
    scale = POWERS[max(present.least, int(present.own[present.named].max(initial=0)))]
    steps = np.zeros(len(active))
    steps[active] = np.diff(np.rint((corrected[active] - held) / unit * scale), prepend=0.0) / scale
    for found in (steps, None):
        steps = _one_by_one(present, corrected, active, held, unit) if found is None else found
        positions = np.cumsum(np.concatenate([[held], steps * unit]))
        counts, number, decimals = present.to_write((corrected - positions[:-1]) / unit)
        if (number == steps)[active].all():
            break
    return Increments(counts, number, decimals, positions[1:])


def _one_by_one(present: Present, corrected: Array, active: NDArrayBool, held: float, unit: float) -> Array:
    """The increments `(k,)`, where their numbers of decimals differ or one of them is next to a half."""
    steps = np.zeros(len(active))
    for row in np.flatnonzero(active).tolist():
        named, value = bool(present.named[row]), float(present.value[row])
        decimals = max(int(present.own[row]), present.least) if named else present.least
        number = round((float(corrected[row]) - held) / unit, decimals)
        steps[row] = value if named and abs(number - value) < 0.5 * _UNITS[decimals] else number
        held += float(steps[row]) * unit
    return steps


def rounded(values: Array, decimals: np.ndarray) -> tuple[Array, Array]:
    """Numbers that are rounded like by the built-in `round`: in units of the last decimal, and as floats."""
    scale = POWERS[decimals]
    scaled = values * scale
    counts = np.rint(scaled)
    doubtful = np.abs(np.abs(scaled - counts) - 0.5) < NEAR_HALF + np.abs(scaled) * 1e-15
    for i in np.flatnonzero(doubtful).tolist():
        counts[i] = round(round(float(values[i]), int(decimals[i])) * scale[i])
    return counts, counts / scale
