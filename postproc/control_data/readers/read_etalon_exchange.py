"""Etalon Exchange Format, "Vendor" variant (TRAC-CAL): error motions and location errors by ISO 230-1.

Documented by ISG and Beckhoff (TF5280, "Etalon Exchange Format"). The units, the sign, and the convention for axes that
carry the workpiece are not published: the user gives the sign, and the settings length (mm), angle (rad) and rotary
(deg, the unit of positions of rotary axes) where they differ from the documented numbers.
"""

from __future__ import annotations

import math
import re
from typing import NamedTuple

from kinematics.effects import COMPONENTS, Effect, LocationError
from kinematics.user_error import UserError
from postproc.control_data.readers.control_source import Source, increasing, numbers, refusal

_TOKEN = re.compile(r"\[\s*E?(?P<component>[XYZABC])(?P<zero>0?)(?P<axis>[XYZABCUVW]\d?)\s*\]")
_UNITS = {
    "length": {"mm": 1e3, "um": 1.0, "m": 1e6},
    "angle": {"rad": 1e6, "urad": 1.0, "deg": math.radians(1.0) * 1e6},
    "rotary": {"deg": 1.0, "rad": math.degrees(1.0)},
}
"""Size of each unit in um, urad and degrees, by setting."""


class Block(NamedTuple):
    """Token and line of its name, grid points with their lines, scalar values."""

    head: re.Match[str]
    line: int
    points: list[tuple[int, list[float]]]
    values: list[float]


def read(source: Source) -> list[Effect]:
    """All blocks of all files; UserError for a block that is given twice."""
    found: dict[str, Effect] = {}
    for name, text in source.files.items():
        source.used.add(name)
        for block in _blocks(name, text):
            effect = _effect(name, block, source)
            if effect.name in found:
                raise refusal(name, block.line, block.head[0], f"{effect.name} is given twice")
            found[effect.name] = effect
    return list(found.values())


def _blocks(name: str, text: str) -> list[Block]:
    blocks: list[Block] = []
    inside = False
    for line, row in enumerate(text.splitlines(), 1):
        content = row.partition("//")[0].strip()
        head = _TOKEN.fullmatch(content)
        if not content:
            continue
        if inside and content == "}":
            inside = False
        elif inside:
            point = numbers(content.split(), name, line, row)
            if len(point) != 2:
                raise refusal(name, line, row, "expected a grid point: position and value")
            blocks[-1].points.append((line, point))
        elif head is not None:
            blocks.append(Block(head, line, [], []))
        elif blocks and re.fullmatch(r"Gridpoints\s*=\s*\{", content):
            inside = True
        elif blocks and re.match(r"VALUE\s*=", content):
            blocks[-1].values.extend(numbers([content.partition("=")[2]], name, line, row))
        else:
            raise refusal(name, line, row, "expected [EXX], [C0Y], VALUE = or Gridpoints = {")
    if inside:
        raise UserError(f"{name}: the '}}' after the last grid points is missing")
    return blocks


def _effect(name: str, block: Block, source: Source) -> Effect:
    head, line, points, values = block
    component, axis = head["component"], head["axis"]
    if axis not in source.machine.names:
        raise refusal(name, line, head[0], f"the machine {source.machine.name} has no such axis")
    kind = "angle" if COMPONENTS.index(component) > 2 else "length"
    size = source.sign("error") * _UNITS[kind][getattr(source.settings, kind)]
    if head["zero"]:
        if len(values) != 1 or points:
            raise refusal(name, line, head[0], "expected one VALUE for a location error, and no grid points")
        return LocationError(component, axis, size * values[0])  # type: ignore[arg-type]
    if len(points) < 2 or values:
        raise refusal(name, line, head[0], "expected at least two grid points for an error motion, and no VALUE")
    increasing(points, name)
    step = _UNITS["rotary"][source.settings.rotary] if axis[0] in "ABC" else 1.0
    nodes, errors = zip(*(point for _, point in points), strict=True)
    return source.motion(component, axis, [step * node for node in nodes], [size * v for v in errors])
