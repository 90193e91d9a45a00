"""Corrected positions written in polar coordinates."""

from __future__ import annotations

import math

from postproc.motion.moves import Polar
from postproc.text.editing import WordEditor
from postproc.text.number_style import decimals_for

Position = tuple[float, float]


class PolarWriter:
    """Writes radius and angle of positions in a plane; both remain in force in blocks that omit them."""

    def __init__(self) -> None:
        self._held: Position = (math.nan, math.nan)
        """Last written radius, mm, and angle, degrees."""

    def write(
        self, editor: WordEditor, polar: Polar, names: tuple[str, str], target: Position, unit: float, resolution: float
    ) -> Position:
        """Write the position `target`, mm, in the plane; returns the written position, mm.

        resolution: of the position, mm; the angle gets the decimals that this requires at the radius.
        """
        sign = math.copysign(1.0, polar.radius)
        radius = sign * math.hypot(*target)
        angle = math.degrees(math.atan2(sign * target[1], sign * target[0]))
        angle += 360.0 * round((polar.angle - angle) / 360.0)
        if radius == 0.0:
            angle = polar.angle
        fine = math.degrees(resolution / max(abs(radius), 1.0))
        radius = self._write_word(editor, polar.words[0], names[0], (radius, self._held[0]), (unit, resolution))
        angle = self._write_word(editor, polar.words[1], names[1], (angle, self._held[1]), (1.0, fine))
        self._held = radius, angle
        return radius * math.cos(math.radians(angle)), radius * math.sin(math.radians(angle))

    @staticmethod
    def _write_word(
        editor: WordEditor, index: int | None, name: str, values: tuple[float, float], steps: tuple[float, float]
    ) -> float:
        """Write one word; returns its value. `values`: target and present value; `steps`: unit and resolution."""
        (target, held), (unit, resolution) = values, steps
        decimals = decimals_for(resolution / unit)
        if index is not None:
            return editor.set(index, target / unit, decimals) * unit
        if abs(target - held) < 0.5 * resolution:
            return held
        number = round(target / unit, decimals)
        editor.insert(name, number, decimals)
        return number * unit
