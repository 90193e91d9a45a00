"""Decimals of coordinates, by the resolutions of the axes."""

from __future__ import annotations

from kinematics.machine import Machine
from postproc.text.number_style import decimals_for


def decimals_of_axis(machine: Machine, axis: int, unit: float) -> int:
    """Decimals of a coordinate, by the resolution of its axis; unit: mm or degrees per unit of the words."""
    return decimals_for(machine.axes[axis].resolution / unit)
