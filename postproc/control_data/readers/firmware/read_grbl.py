"""grbl: `$100=250.000`, lines to be sent to it or its answer to `$$`."""

from __future__ import annotations

import re

from kinematics.effects import Effect
from kinematics.user_error import UserError
from postproc.control_data.readers.control_source import Source, numbers, refusal

AXES = {"X": 100, "Y": 101, "Z": 102}
"""Number of the setting of each axis."""
MOST_STEPS_PER_MM = 1e7
"""Steps per mm: grbl reads 8 digits of a number."""
_SETTING = re.compile(r"\s*\$(\d+)\s*=\s*([^\s(;]*)")


def steps_of(text: str) -> dict[str, float]:
    """Present steps per mm by axis, of `X:250,Y:250,Z:400`; UserError for anything else."""
    said = f"--set steps={text}: expected the present steps per mm of each axis, as X:250,Y:250,Z:400"
    found = {}
    for part in text.split(","):
        axis, _, value = part.partition(":")
        (steps,) = numbers([value or "0"], "--set steps", 1, part)
        if axis not in AXES or axis in found or not 0.0 < steps < MOST_STEPS_PER_MM:
            raise UserError(said)
        found[axis] = steps
    return {axis: found[axis] for axis in AXES if axis in found}


def read(source: Source) -> list[Effect]:
    """The scale of each axis: its steps per mm by the files against the present ones."""
    present = steps_of(source.settings.steps)
    found: dict[str, Effect | None] = {}
    for name, text in source.files.items():
        for line, row in enumerate(text.splitlines(), 1):
            setting = _SETTING.match(row)
            axis = next((a for a, number in AXES.items() if setting and int(setting[1]) == number), None)
            if setting is None or axis is None:
                continue
            source.used.add(name)
            (steps,) = numbers([setting[2]], name, line, row)
            if steps <= 0.0:
                raise refusal(name, line, row, "expected a number of steps per mm above 0")
            if axis in found:
                raise refusal(name, line, row, f"a second value of {axis}")
            if axis not in present:
                raise refusal(name, line, row, f"give the present steps per mm of {axis} as well: --set steps=")
            home = source.machine.axes[source.machine.index(axis)].home
            slope = steps / present[axis] - 1.0
            found[axis] = source.line(axis, axis, slope, home) if slope else None
    return [effect for effect in found.values() if effect is not None]
