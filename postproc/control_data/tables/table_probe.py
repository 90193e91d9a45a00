"""The probe table: zero but for one node of a harmless size, to determine a control's sign on the machine."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from kinematics.effects.base import own_component
from kinematics.machine import Axis, Machine
from kinematics.transforms import Array
from kinematics.user_error import UserError
from postproc.control_data.format import Settings, in_words
from postproc.control_data.tables.content import Content
from postproc.control_data.tables.limits import Limits
from postproc.control_data.tables.motion_tables import MotionTable
from postproc.control_data.tables.target import bounds
from postproc.control_data.tables.terms import Curve, Surface, Term, to_steps

if TYPE_CHECKING:
    from postproc.control_data.tables.table_format import TableFormat

PROBED = 0.02
"""mm or degrees."""
PROBE_DISTANCE_MM = 25.0
"""mm: from the node to the zeros beside it, over other axes."""
PROBE_SHARE_OF_TRAVEL = 0.05
"""Share of the travel from the node to the zeros beside it."""


def probe(machine: Machine, axis_name: str, form: TableFormat, settings: Settings) -> dict[str, str]:
    """The files of a probe of one axis, with instructions; UserError when the format has no table for it."""
    axis = machine.axes[machine.index(axis_name)]
    unit = form.unit(settings, machine.control)
    limits = form.limits_mm(settings, machine).of(axis, axis)
    beside = max(1, math.ceil(PROBED / limits.steepest - 1e-9))
    nodes, shares = _nodes(axis, limits, beside)
    values = to_steps(PROBED * shares, limits.resolution)
    if form.capabilities is None:
        size = values if not axis.rotary else np.radians(values)
        table = MotionTable(own_component(axis.name), axis.name, nodes, size, size)
        content = Content(machine, settings, "error", motions=(table,))
    else:
        capabilities = form.capabilities(settings)
        if (
            axis.name[0] not in capabilities.outputs
            or limits.degree is not None
            or (not capabilities.own and (form.sign is not None or axis.rotary))
        ):
            raise UserError(f"--probe {axis.name}: {form.name} has no table that shows the sign of {axis.name}")
        if not capabilities.own:
            return _across(machine, axis, form, settings)
        term = Term(axis.name, (Curve(axis.name, nodes, values),))
        content = Content(machine, settings, "correction", terms=(term,))
    text = _instructions(axis, nodes, int(np.argmax(shares)), beside, form)
    return {**form.write(content.in_unit(unit)), "probe.md": in_words(text, unit)}


def _across(machine: Machine, axis: Axis, form: TableFormat, settings: Settings) -> dict[str, str]:
    """A probe of a format that has tables over other axes only: one node over one of them, or over two."""
    others = [other for other in machine.axes if not other.rotary and other is not axis][:2]
    limits = form.limits(settings)
    positions = []
    for other in others:
        low, high = bounds(other)
        middle = round((low + high) / 2 / limits.spacing_step) * limits.spacing_step
        positions.append(np.round(middle + PROBE_DISTANCE_MM * np.array([-1.0, 0.0, 1.0]), 9))
    peak = np.array([0.0, PROBED, 0.0])
    assert form.capabilities is not None
    if form.capabilities(settings).surfaces:
        surface = Surface((others[0].name, others[1].name), (positions[0], positions[1]), np.outer(peak, peak) / PROBED)
        term = Term(axis.name, (surface,))
    else:
        positions, others = positions[:1], others[:1]
        term = Term(axis.name, (Curve(others[0].name, positions[0], peak),))
    content = Content(machine, settings, "correction", terms=(term,))
    peak_at = ", ".join(f"{other.name} {at[1]:g}" for other, at in zip(others, positions, strict=True))
    away = ", ".join(f"{other.name} {at[0]:g}" for other, at in zip(others, positions, strict=True))
    text = _text(axis, f"at {peak_at}", f"at {away}", f"{peak_at}", form)
    unit = form.unit(settings, machine.control)
    return {**form.write(content.in_unit(unit)), "probe.md": in_words(text, unit)}


def _nodes(axis: Axis, limits: Limits, beside: int) -> tuple[Array, Array]:
    """Nodes, and the share of the size at each; the peak is in the middle of the travel, never at the reference.

    Where that must be 0, the table reaches to it.
    """
    low, high = bounds(axis)
    apart = (
        limits.interval
        or max(round((high - low) * PROBE_SHARE_OF_TRAVEL / beside / limits.spacing_step), 1) * limits.spacing_step
    )
    middle = max(beside, round(((low + high) / 2 - axis.home) / apart), key=abs)
    first, last = middle - beside, middle + beside
    if limits.zero_at_home:
        first, last = min(first, 0), max(last, 0)
    k = np.arange(first, last + 1)
    return np.asarray(np.round(axis.home + apart * k, 9)), np.maximum(0.0, 1.0 - np.abs(k - middle) / beside)


def _instructions(axis: Axis, nodes: Array, peak: int, beside: int, form: TableFormat) -> str:
    at = f"{axis.name} {nodes[peak]:g}"
    low, high = (f"{axis.name} {nodes[k]:g}" for k in (peak - beside, peak + beside))
    return _text(axis, f"at {at}", f"from {low} and {high} on", f"{at}, coming from either side,", form)


def _text(axis: Axis, at: str, away: str, where: str, form: TableFormat) -> str:
    unit = axis.unit
    return f"""# Probe of {form.title}, axis {axis.name}

The table holds one value, +{PROBED:g} {unit} {at}, and 0 {away}.

1. Back up the control's compensation data. Without any table, set a dial indicator on {axis.name} at
   {where} and note the reading.
2. Load the table as described below, home the axes, go to the same position again, and note the reading.
3. {axis.name} is {PROBED:g} {unit} farther in its positive direction than without the table: values are corrections;
   use --sign correction. In its negative direction: values are errors; use --sign error. Anything else, another size,
   or a change where the table is 0: load no table, and find out why first.
4. Take the table out again.

{form.loading}
"""
