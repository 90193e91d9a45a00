"""Where the holes of the pattern cycles 220 (on a circle) and 221 (in lines) are."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

from postproc.motion.circles import Point


def places(number: int, values: Mapping[str, float]) -> Iterator[Point]:
    """The position in the cycle, then the others, in units of the program: holes, or first the centre of a circle."""
    return _on_circle(values) if number == 220 else _in_lines(values)


def _on_circle(values: Mapping[str, float]) -> Iterator[Point]:
    """Q216, Q217 centre, Q244 diameter, Q245 first angle, Q246 last angle, Q247 step, Q241 number of holes."""
    count = round(values["Q241"])
    whole = values["Q246"] - values["Q245"]
    step = values["Q247"] or whole / (count if abs(whole) == 360.0 else max(count - 1, 1))
    yield values["Q216"], values["Q217"]
    for i in range(count):
        angle = math.radians(values["Q245"] + i * step)
        radius = values["Q244"] / 2.0
        yield values["Q216"] + radius * math.cos(angle), values["Q217"] + radius * math.sin(angle)


def _in_lines(values: Mapping[str, float]) -> Iterator[Point]:
    """Q225, Q226 first hole, Q237, Q238 spacing, Q242 columns, Q243 lines, Q224 rotation about the first hole.

    Every second line is run backwards.
    """
    c, s = math.cos(math.radians(values["Q224"])), math.sin(math.radians(values["Q224"]))
    columns = range(round(values["Q242"]))
    for j in range(round(values["Q243"])):
        for i in columns if j % 2 == 0 else reversed(columns):
            x, y = i * values["Q237"], j * values["Q238"]
            yield values["Q225"] + c * x - s * y, values["Q226"] + s * x + c * y
