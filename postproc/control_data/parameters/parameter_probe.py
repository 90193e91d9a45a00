"""A probe of kinematic parameters: one line shifted by a harmless amount, to determine a control's sign."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from kinematics.machine import Axis, Machine
from kinematics.user_error import UserError
from postproc.control_data.format import Settings, in_words
from postproc.control_data.parameters.rotary_lines import moved_lines
from postproc.control_data.tables.table_probe import PROBED

if TYPE_CHECKING:
    from postproc.control_data.parameters.parameter_format import ParameterFormat


def probe(machine: Machine, axis_name: str, form: ParameterFormat, settings: Settings) -> dict[str, str]:
    """The files of a probe of a rotary axis, with instructions; UserError where no parameter moves its line."""
    axis = machine.axes[machine.index(axis_name)]
    shifts = [each for each in form.freedoms(machine, settings) if each.axis == axis_name and not each.tilt]
    if not shifts:
        raise UserError(f"--probe {axis_name}: {form.name} has no parameter that shifts the line of {axis_name}")
    shift = shifts[0]
    moved = moved_lines(machine, [shift], np.array([PROBED]))
    before, after = (form.numbers_of(each, settings) for each in (machine, moved))
    changed = ", ".join(
        f"{new.name} {new.value - old.value:+z.{new.decimals}f}"
        for old, new in zip(before, after, strict=True)
        if new.text != old.text
    )
    half, apart = _turn(axis)
    table = axis.side == "workpiece"
    text = f"""# Probe of {form.title}, {axis_name}

{form.file} shifts the line of {axis_name} by +{PROBED:g} mm along ({", ".join(f"{v:g}" for v in shift.vector)}) of the
machine: {changed}. {form.file_before} has the values by the machine file.

1. Back up the parameters of the control, and compare them with {form.file_before}.
2. All rotary axes at 0, TCP on (tool center point control). Set an indicator in the spindle on a ball on the table, off
   the line of {axis_name}, and set it to zero. Turn {axis_name} by {half:g} degrees under TCP, note the reading along
   ({", ".join(f"{v:g}" for v in shift.vector)}) of the machine, and turn back.
3. Set the parameters of {form.file} in the way described below, all rotary axes at 0, set the indicator to zero again,
   and repeat.
4. After the turn the tool is {apart:g} mm farther in the {"positive" if table else "negative"} direction than in step
   2: the changes have the described direction; use --sign correction. In the opposite direction: use --sign error.
   Anything else, or another size: set no parameters, and find out why first.
5. Set the parameters back.

{in_words(form.loading, form.unit(settings, machine.control))}
"""
    heading = f"probe of {axis_name}, machine {machine.name}"
    return {**form.files(machine, settings, (after, before), (heading, heading)), "probe.md": text}


def _turn(axis: Axis) -> tuple[float, float]:
    """Turn from 0 that the axis can make, degrees, and the shift, mm, by which a tool that follows it is apart."""
    low, high = axis.travel
    for angle in (180.0, -180.0):
        if low <= angle <= high:
            return angle, 2.0 * PROBED
    return (90.0 if high >= 90.0 else -90.0), PROBED
