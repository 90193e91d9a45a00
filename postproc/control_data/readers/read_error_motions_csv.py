"""CSV: rows of error, axis, position, forward, backward, unit."""

from __future__ import annotations

from typing import Any, cast

from kinematics.effects import ControlTable, Effect
from kinematics.user_error import UserError
from postproc.control_data.readers.control_source import Source, increasing, numbers, refusal

COLUMNS = ["error", "axis", "position", "forward", "backward", "unit"]
OWN = {"U": "X", "V": "Y", "W": "Z"}


def read(source: Source) -> list[Effect]:
    """All error motions."""
    found: list[Effect] = []
    for name, text in source.files.items():
        source.used.add(name)
        tables: dict[tuple[str, str], list[tuple[int, list[float]]]] = {}
        lines = [(k, row) for k, row in enumerate(text.splitlines(), 1) if row.strip() and not row.startswith("#")]
        if not lines or lines[0][1].split(",") != COLUMNS:
            raise UserError(f"{name}: the first row must be {','.join(COLUMNS)}")
        for line, row in lines[1:]:
            words = row.split(",")
            if len(words) != len(COLUMNS):
                raise refusal(name, line, row, f"{len(words)} columns; expected {len(COLUMNS)}")
            error, axis, unit = words[0], words[1], words[5].strip()
            component = error[2:3]
            if error != f"E_{component}{axis}" or component not in tuple("XYZABC"):
                raise refusal(name, line, row, f"{error} is not an error motion of the axis {axis}")
            if unit != ("urad" if component in "ABC" else "um"):
                raise refusal(
                    name, line, row, f"{error} in {unit}: expected urad for rotations and um for translations"
                )
            tables.setdefault((component, axis), []).append((line, numbers(words[2:5], name, line, row)))
        for (component, axis), rows in tables.items():
            increasing(rows, name)
            found += _effects(source, component, axis, [row for _, row in rows])
    return found


def _effects(source: Source, component: str, axis: str, rows: list[list[float]]) -> list[Effect]:
    moved = source.machine.axes[source.machine.index(axis)]
    nodes, forward, backward = (tuple(column) for column in zip(*rows, strict=True))
    if forward == backward:
        if len(nodes) < 2:
            raise UserError(f"E_{component}{axis}: an error motion needs at least two positions")
        return [source.motion(component, axis, nodes, forward)]
    if component != OWN.get(axis[0], axis[0]):
        raise UserError(f"E_{component}{axis}: only positioning errors can depend on the direction")
    along = moved.error_frame[:, "XYZABC".index(component) % 3] @ moved.unit_direction
    directions = ((1, forward), (-1, backward))
    return [
        ControlTable(axis, (axis,), (nodes,), tuple(v if along > 0 else -v for v in values), cast(Any, direction))
        for direction, values in directions
    ]
