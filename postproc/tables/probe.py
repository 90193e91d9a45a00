"""The probe table: zero but for one node of a harmless size, to find out on the machine what a control's sign is."""

from __future__ import annotations

import math

import numpy as np

from kinematics.effects.base import own_component
from kinematics.errors import UserError
from kinematics.machine import Axis, Machine
from kinematics.transforms import Array
from postproc.tables.format import Content, Format, Settings
from postproc.tables.limits import Limits
from postproc.tables.motion_tables import MotionTable
from postproc.tables.target import bounds
from postproc.tables.terms import Curve, Term

SIZE = 0.02
"""mm or degrees."""
SHARE = 0.05
"""Of the travel: from the node to the zeros beside it."""


def probe(machine: Machine, axis_name: str, format: Format, settings: Settings) -> dict[str, str]:
    """The files of a probe of one axis, and what to do with them; UserError when the format has no table for it."""
    axis = machine.axes[machine.index(axis_name)]
    limits = format.limits(settings)
    beside = max(1, math.ceil(SIZE / limits.steepest - 1e-9))
    nodes, shares = _nodes(axis, limits, beside)
    values = np.round(np.round(SIZE * shares / limits.resolution) * limits.resolution, 12)
    if format.carries is None:
        size = values if not axis.rotary else np.radians(values)
        table = MotionTable(own_component(axis.name), axis.name, nodes, size, size)
        content = Content(machine, settings, "error", motions=(table,))
    else:
        carries = format.carries(settings)
        if not carries.own or axis.name[0] not in carries.outputs:
            raise UserError(f"--probe {axis.name}: {format.name} has no table of {axis.name} over itself")
        term = Term(axis.name, (Curve(axis.name, nodes, values),))
        content = Content(machine, settings, "correction", terms=(term,))
    return {**format.write(content), "probe.md": _instructions(axis, nodes, int(np.argmax(shares)), beside, format)}


def _nodes(axis: Axis, limits: Limits, beside: int) -> tuple[Array, Array]:
    """Nodes, and the share of the size at each; the peak is in the middle of the travel, never at the reference.

    Where that must be 0, the table reaches to it.
    """
    low, high = bounds(axis)
    apart = limits.interval or max(round((high - low) * SHARE / beside / limits.spacing_step), 1) * limits.spacing_step
    middle = max(beside, round(((low + high) / 2 - axis.home) / apart), key=abs)
    first, last = middle - beside, middle + beside
    if limits.zero_at_home:
        first, last = min(first, 0), max(last, 0)
    k = np.arange(first, last + 1)
    return np.asarray(np.round(axis.home + apart * k, 9)), np.maximum(0.0, 1.0 - np.abs(k - middle) / beside)


def _instructions(axis: Axis, nodes: Array, peak: int, beside: int, format: Format) -> str:
    unit, at = axis.unit, f"{nodes[peak]:g}"
    low, high = f"{nodes[peak - beside]:g}", f"{nodes[peak + beside]:g}"
    return f"""# Probe of {format.title}, axis {axis.name}

The table rises to one value, +{SIZE:g} {unit} at {axis.name} {at}, and is 0 from {low} and {high} on.

1. Back up the control's compensation data. Without any table, set a dial indicator on {axis.name} at {at},
   coming from {low}; note the reading; come from {high}, and note it again.
2. Load the table ({format.loading.splitlines()[0]} ...), home the axis, and repeat both readings.
3. The axis stands {SIZE:g} {unit} farther in its positive direction than without the table: values are corrections;
   use --sign correction. In its negative direction: values are errors; use --sign error. Anything else, as another
   size, or a change at {low} and {high}: load no table, and find out why first.
4. Take the table out again.
"""
