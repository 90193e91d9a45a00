"""Etalon Exchange Format: error motions by ISO 230-1, mm and rad."""

from __future__ import annotations

import re

from kinematics.effects import Effect, LocationError
from kinematics.user_error import UserError
from postproc.tables.readers.source import Source, increasing, numbers, refusal

_TOKEN = re.compile(r"\[\s*E?(?P<component>[XYZABC])(?P<zero>0?)(?P<axis>[XYZABCUVW]\d?)\s*\]$")


Block = tuple[re.Match[str], int, list[tuple[int, list[float]]], list[float]]
"""Name, line, grid points with their lines, scalar values."""


def read(source: Source) -> list[Effect]:
    """All blocks of all files."""
    sign = source.sign("error")
    found: list[Effect] = []
    for name, text in source.files.items():
        for block in _blocks(name, text):
            if block[0]["axis"] not in source.machine.names:
                raise refusal(name, block[1], block[0][0], f"the machine {source.machine.name} has no such axis")
            found.append(_effect(source, name, block, sign))
    return found


def _blocks(name: str, text: str) -> list[Block]:
    blocks: list[Block] = []
    inside = False
    for line, row in enumerate(text.splitlines(), 1):
        content = row.partition("//")[0].strip()
        head = _TOKEN.match(content)
        if not content:
            continue
        if inside and content == "}":
            inside = False
        elif inside:
            point = numbers(content.split(), name, line, row)
            if len(point) != 2:
                raise refusal(name, line, row, "expected a grid point: position and value")
            blocks[-1][2].append((line, point))
        elif head is not None:
            blocks.append((head, line, [], []))
        elif blocks and re.fullmatch(r"Gridpoints\s*=\s*\{", content):
            inside = True
        elif blocks and re.match(r"VALUE\s*=", content):
            blocks[-1][3].extend(numbers([content.partition("=")[2]], name, line, row))
        else:
            raise refusal(name, line, row, "expected [EXX], [C0Y], VALUE = or Gridpoints = {")
    if inside:
        raise UserError(f"{name}: the '}}' after the last grid points is missing")
    return blocks


def _effect(source: Source, name: str, block: Block, sign: float) -> Effect:
    head, line, points, values = block
    component, axis = head["component"], head["axis"]
    size = sign * (1e6 if component in "ABC" else 1e3)
    if head["zero"]:
        if len(values) != 1 or points:
            raise refusal(name, line, head[0], "expected one VALUE for a location error, and no grid points")
        return LocationError(component, axis, size * values[0])  # type: ignore[arg-type]
    if len(points) < 2 or values:
        raise refusal(name, line, head[0], "expected at least two grid points for an error motion, and no VALUE")
    increasing(points, name)
    nodes, errors = zip(*(point for _, point in points), strict=True)
    return source.motion(component, axis, nodes, [size * v for v in errors])
