"""The report of the squareness of two axes from the lengths of a rectangle."""

from __future__ import annotations

import math
from typing import Any

from calibration.evaluation.rectangle import INCHES, RECTANGLE_MM, Rectangle
from kinematics.files.number_text import plus_minus
from rendering.report import Report, Section, Table


def rectangle_json(found: Rectangle) -> dict[str, Any]:
    """The results for programs."""
    return {
        "plane": found.plane,
        "effect": found.effect.name,
        "squareness_urad": found.effect.value,
        "u_urad": found.u_tangent * 1e6,
        "lean_mm_per_300_mm": found.tangent * RECTANGLE_MM,
        "u_mm_per_300_mm": found.u_tangent * RECTANGLE_MM,
        "tangent": found.tangent,
        "corner_deg": 90.0 - math.degrees(math.atan(found.tangent)),
    }


def notes_on(found: Rectangle) -> list[str]:
    """Notes for the user."""
    notes = []
    if max(found.ac, found.bd) < INCHES:
        notes.append("the diagonals are shorter than 40 mm: lengths are in mm, not in inches")
    if found.ab is None:
        notes.append("no length checks another: --ab, the other side, would")
    return notes


def rectangle_report(found: Rectangle, command: str) -> Report:
    """The result for people."""
    first, second = found.plane[0], found.plane[1]
    lean, big_u = abs(found.tangent), 2.0 * found.u_tangent
    towards = f"{'+' if found.tangent > 0.0 else '-'}{first}"
    closed, opened = ("A and C", "B and D") if found.tangent > 0.0 else ("B and D", "A and C")
    verdict = [
        f"{second} leans towards {towards} by {plus_minus(lean * RECTANGLE_MM, big_u * RECTANGLE_MM, 2)} mm in 300 mm "
        f"(U, k=2), {plus_minus(lean * 1e6, big_u * 1e6, 0)} urad.",
        f"The corners at {closed} are smaller than 90 degrees, those at {opened} are larger.",
    ]
    if not lean:
        verdict = [f"{second} is square to {first}, to {big_u * RECTANGLE_MM:.2f} mm in 300 mm (U, k=2)."]
    if lean < big_u:
        verdict.append(
            "This is less than its uncertainty: the axes may be square. Measure a larger rectangle, or with calipers"
            " (--u)."
        )
    lean_mm = plus_minus(found.tangent * RECTANGLE_MM, big_u * RECTANGLE_MM, 3)
    corner = plus_minus(90.0 - math.degrees(math.atan(found.tangent)), math.degrees(big_u), 4)
    rows = [
        (f"{found.effect.name}, {found.effect.meaning}", f"{plus_minus(found.effect.value, big_u * 1e6, 0)} urad"),
        (f"lean of {second} towards +{first}", f"{lean_mm} mm in 300 mm"),
        ("corner at A", f"{corner} degrees"),
        ("tangent of the error (skew factor of printers' firmware)", plus_minus(found.tangent, big_u, 6)),
        ("side AB", f"{found.other_side:.2f} mm, {'measured' if found.ab else 'from the other lengths'}"),
    ]
    section = Section("Squareness", table=Table(("", ""), rows))
    return Report("Squareness from a rectangle", command, [section], "\n".join(verdict))
