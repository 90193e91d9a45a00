"""FANUC: pitch error data, a text of `N<number>P<value>` with the parameters of the axes; straightness as CSV."""

from __future__ import annotations

import re
from collections.abc import Mapping

from kinematics.effects import Effect
from kinematics.user_error import UserError
from postproc.control_data.readers.control_source import Source, increasing, numbers, refusal

_WORD = re.compile(r"N(\d+)(?:A(\d+))?P([+-]?[\d.]+);?")
FIRST_TEXT_POINT = 10000
"""Number that is added to a point number in the text."""
TYPED_IN = ("pitch.csv", "parameters.csv")
"""Files of `ncomp export` with the numbers of the text, for the screens of the control."""
NEEDED = (3620, 3621, 3622, 3624)


def read(source: Source) -> list[Effect]:
    """The running sums of all axes, and straightness."""
    file = source.only(".txt", "FANUC", "N...P...")
    source.used.update((file, *TYPED_IN))
    by_axis, points = _words(file, source.files[file])
    unit = source.settings.unit_um * 1e-3
    sign = source.sign("correction")
    found: list[Effect] = []
    for k, parameters in sorted(by_axis.items()):
        axis = source.numbered(k, f"{file}: axis A{k}")
        lacking = [f"N{name:05d}" for name in NEEDED if name not in parameters]
        if lacking:
            raise UserError(f"{file}: axis {axis}: {', '.join(lacking)} missing")
        step = sign * unit * parameters.get(3623, 1.0)
        reference, low, high = (int(parameters[name]) for name in NEEDED[:3])
        if not low <= reference <= high:
            raise UserError(f"{file}: axis {axis}: the reference point {reference} is outside {low} ... {high}")
        home = source.machine.axes[source.machine.index(axis)].home
        up = _sums(file, points, low, reference, high)
        down = up
        if 3626 in parameters:
            start = int(parameters[3626])
            if parameters.get(3623, 1.0) != 1.0:
                raise UserError(f"{file}: axis {axis}: the size of 3627 is unknown with a magnification (3623)")
            if start <= high and low <= start + high - low:
                raise UserError(
                    f"{file}: axis {axis}: the points of negative travel from {start} on overlap {low} ... {high}"
                )
            amount = parameters.get(3627, 0.0)
            shifted = _sums(file, points, start, start + reference - low, start + high - low)
            down = [value + amount for value in shifted]
        positions = [home + (n - reference) * parameters[3624] for n in range(low, high + 1)]
        found += source.own(axis, [(x, step * u, step * d) for x, u, d in zip(positions, up, down, strict=True)])
    return found + _straightness(source, sign * unit * source.settings.magnification)


def _words(name: str, text: str) -> tuple[dict[int, dict[int, float]], dict[int, float]]:
    """Parameters by axis number, and values by point number."""
    by_axis: dict[int, dict[int, float]] = {}
    points: dict[int, float] = {}
    for line, row in enumerate(text.splitlines(), 1):
        content = row.strip()
        if content in ("", "%"):
            continue
        match = _WORD.fullmatch(content)
        if match is None:
            raise refusal(name, line, row, "expected N...P...")
        (value,) = numbers([match[3]], name, line, row)
        number = int(match[1])
        if match[2]:
            by_axis.setdefault(int(match[2]), {})[number] = value
        elif number in points:
            raise refusal(name, line, row, "a second value of this point")
        elif value != int(value):
            raise refusal(name, line, row, "an increment must be a whole number")
        else:
            points[number] = value
    return by_axis, points


def _sums(name: str, points: Mapping[int, float], low: int, reference: int, high: int) -> list[float]:
    """Amounts at the points low ... high: running sums, 0 at the reference."""
    lacking = next((n for n in range(low + 1, high + 1) if FIRST_TEXT_POINT + n not in points), None)
    if lacking is not None:
        raise UserError(f"{name}: the value of point {lacking} (N{FIRST_TEXT_POINT + lacking}) is missing")
    found = {reference: 0.0}
    for n in range(reference + 1, high + 1):
        found[n] = found[n - 1] + points[FIRST_TEXT_POINT + n]
    for n in range(reference, low, -1):
        found[n - 1] = found[n] - points[FIRST_TEXT_POINT + n]
    return [found[n] for n in range(low, high + 1)]


def _straightness(source: Source, step: float) -> list[Effect]:
    found: list[Effect] = []
    for name in (name for name in source.files if "straight" in name.lower()):
        source.used.add(name)
        rows: dict[tuple[str, str], list[tuple[int, list[float]]]] = {}
        for line, words in source.rows(name, 4):
            row = numbers(words[2:], name, line, ",".join(words))
            rows.setdefault((words[0], words[1]), []).append((line, row))
        for (moving, compensated), points in rows.items():
            if len(points) > 4:
                raise refusal(name, points[4][0], compensated, "a straightness compensation has at most four points")
            increasing(points, name)
            nodes, amounts = zip(*(row for _, row in points), strict=True)
            found.append(source.table(compensated, (moving,), (nodes,), [step * a for a in amounts]))
    return found
