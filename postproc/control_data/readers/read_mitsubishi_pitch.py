"""Mitsubishi machine error compensation, from the two tables that were typed in."""

from __future__ import annotations

from itertools import accumulate

from kinematics.effects import Effect
from kinematics.user_error import UserError
from postproc.control_data.readers.control_source import Source, numbers, refusal


def read(source: Source) -> list[Effect]:
    """Running sums of all axes, 0 at the reference point."""
    for needed in ("parameters.csv", "error_data.csv"):
        if needed not in source.files:
            raise UserError(f"Mitsubishi tables: expected {needed} among the files")
        source.used.add(needed)
    unit = source.settings.unit_um
    parameters = {words[0]: words[1:] for _, words in source.rows("parameters.csv", 4)}
    values: dict[str, list[float]] = {}
    for line, words in source.rows("error_data.csv", 4):
        point, _, value = numbers(words[1:], "error_data.csv", line, ",".join(words))
        known = values.setdefault(words[0], [])
        if point != len(known):
            raise refusal("error_data.csv", line, ",".join(words), f"expected point {len(known)}")
        if not -128 <= value <= 127:
            raise refusal("error_data.csv", line, ",".join(words), "expected a value in -128 ... 127")
        known.append(value)
    found: list[Effect] = []
    for axis, steps in values.items():
        if axis not in parameters:
            raise UserError(f"parameters.csv: the row of axis {axis} is missing")
        reference, interval, scale = numbers(parameters[axis], "parameters.csv", 1, axis)
        r = int(reference)
        if not 0 <= r < len(steps):
            raise UserError(f"parameters.csv: axis {axis}: the reference point {r} is outside 0 ... {len(steps) - 1}")
        home = source.machine.axes[source.machine.index(axis)].home
        sums = [0.0, *accumulate(steps[1:])]
        size = unit * 1e-3 * scale / 2.0
        rows = [(home + (k - r) * interval, *[size * (s - sums[r])] * 2) for k, s in enumerate(sums)]
        found += source.own(axis, rows)
    return found
