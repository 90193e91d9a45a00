"""Corrected places written in polar coordinates."""

from __future__ import annotations

import math

from postproc.motion.moves import Polar
from postproc.text.editing import WordEditor
from postproc.text.number_style import decimals_for

Place = tuple[float, float]


class PolarWriter:
    """Says radius and angle of places in a plane; both hold from block to block where a block leaves them out."""

    def __init__(self) -> None:
        self._held: Place = (math.nan, math.nan)
        """Radius, mm, and angle, degrees, as last written."""

    def write(
        self, editor: WordEditor, polar: Polar, names: tuple[str, str], wanted: Place, unit: float, resolution: float
    ) -> Place:
        """Make a block say the place `wanted`, mm; where it then is.

        resolution: mm; the angle has as many decimals as it takes to hold it at that radius.
        """
        sign = math.copysign(1.0, polar.radius)
        radius = sign * math.hypot(*wanted)
        angle = math.degrees(math.atan2(sign * wanted[1], sign * wanted[0]))
        angle += 360.0 * round((polar.angle - angle) / 360.0)
        if radius == 0.0:
            angle = polar.angle
        fine = math.degrees(resolution / max(abs(radius), 1.0))
        radius = self._say(editor, polar.words[0], names[0], (radius, self._held[0]), (unit, resolution))
        angle = self._say(editor, polar.words[1], names[1], (angle, self._held[1]), (1.0, fine))
        self._held = radius, angle
        return radius * math.cos(math.radians(angle)), radius * math.sin(math.radians(angle))

    @staticmethod
    def _say(
        editor: WordEditor, index: int | None, name: str, values: tuple[float, float], steps: tuple[float, float]
    ) -> float:
        """One word: its value and what holds, counted in a unit, at a resolution."""
        (wanted, held), (unit, resolution) = values, steps
        decimals = decimals_for(resolution / unit)
        if index is not None:
            return editor.set(index, wanted / unit, decimals) * unit
        if abs(wanted - held) < 0.5 * resolution:
            return held
        number = round(wanted / unit, decimals)
        editor.insert(name, number, decimals)
        return number * unit
