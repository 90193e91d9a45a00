"""The probe table: zero but for one node of a harmless size, to find out on the machine what a control's sign is."""

from __future__ import annotations

import numpy as np

from kinematics.effects.base import own_component
from kinematics.errors import UserError
from kinematics.machine import Axis, Machine
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
    nodes = _nodes(axis, format.limits(settings))
    values = np.array([0.0, SIZE, 0.0])
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
    return {**format.write(content), "probe.md": _instructions(axis, nodes, format)}


def _nodes(axis: Axis, limits: Limits) -> np.ndarray:
    low, high = bounds(axis)
    apart = limits.interval or max(round((high - low) * SHARE / limits.spacing_step), 1) * limits.spacing_step
    middle = max(1, round(((low + high) / 2 - axis.home) / apart), key=abs)
    return np.round(axis.home + apart * (middle + np.arange(-1, 2)), 9)


def _instructions(axis: Axis, nodes: np.ndarray, format: Format) -> str:
    unit = axis.unit
    return f"""# Probe of {format.title}, axis {axis.name}

The table holds one value, +{SIZE:g} {unit} at {axis.name} {nodes[1]:g}, and 0 at {nodes[0]:g} and {nodes[2]:g}.

1. Back up the control's compensation data. Without any table, set a dial indicator on {axis.name} at {nodes[1]:g},
   coming from {nodes[0]:g}; note the reading; come from {nodes[2]:g}, and note it again.
2. Load the table ({format.loading.splitlines()[0]} ...), home the axis, and repeat both readings.
3. The axis stands {SIZE:g} {unit} farther in its positive direction than without the table: values are corrections;
   use --sign correction. In its negative direction: values are errors; use --sign error. Anything else, as another
   size, or a change at {nodes[0]:g} and {nodes[2]:g}: load no table, and find out why first.
4. Take the table out again.
"""
