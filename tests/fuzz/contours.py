"""Examiner: contours of lines and arcs, the same in three dialects. No block is refused, and `verify` finds what a run claims.

Ends of arcs are rounded as a CAM rounds them, so that they lie beside their circles by the last digit of their words.
"""

from __future__ import annotations

import dataclasses
import json
import math
import random
from typing import Any, NamedTuple

from kinematics.machine import Machine
from tests.fuzz.case import Case, Outcome
from tests.fuzz.own_output import ENDINGS, examine, machine_named

BLOCKS = 60
REACHES = (30.0, 60.0, 150.0)
"""Largest coordinates, mm; the origin is the datum, where the error is 0."""
SLOPES = (3.0, 10.0, 60.0)
"""Largest slopes of error motions, um or urad per m."""
LEAST_COMPARED = 1.0
"""Share of the programs that are compared: all."""
Point = tuple[float, float]


class Step(NamedTuple):
    """One step of a contour, in units of its words."""

    form: str
    """`line`, `centre`, `radius`, `tangent`; `round` or `chamfer` of the corner between two lines; `depth`."""
    end: Point = (0.0, 0.0)
    centre: Point = (0.0, 0.0)
    size: float = 0.0
    """Signed radius, radius of a corner, length of a chamfer, or depth."""
    sense: int = 0


def draw(seed: int) -> Case:
    """A contour; three seeds in a row write the same one in three dialects."""
    rng = random.Random(seed // 3)
    dialect = list(ENDINGS)[seed % 3]
    inch, decimals = rng.random() < 0.3, rng.choice((3, 4))
    kind = rng.choice(("slope", "play", "both"))
    plan = {
        "dialect": dialect,
        "kind": kind,
        "klartext_arcs": rng.choice(("helix", "plane", "axes")),
        "tolerance": rng.choice((1.0, 1.0, 5.0)),
    }
    effects = json.dumps(_effects(kind, rng))
    steps = Contour(rng, 25.4 if inch else 1.0, decimals).steps()
    text = "\n".join([*WRITERS[dialect](steps, inch, decimals), ""])
    return Case(text, f"part{ENDINGS[dialect]}", "gantry", effects, (json.dumps(plan),))


class Contour:
    """Draws the steps of a contour."""

    def __init__(self, rng: random.Random, unit: float, decimals: int) -> None:
        self.rng, self.unit, self.decimals, self.reach = rng, unit, decimals, rng.choice(REACHES)
        self.at: Point = (0.0, 0.0)
        self.heading: float | None = None
        """Direction in which the last step ended, rad; None after a corner or a move of Z."""

    def steps(self) -> list[Step]:
        """All steps; the first is a line."""
        found = [self._line()]
        while len(found) < BLOCKS:
            found += self._some(found[-1].form)
        return found

    def _some(self, last: str) -> list[Step]:
        draw = self.rng.random()
        if draw < 0.25:
            return [self._line()]
        if draw < 0.32:
            self.heading = None
            return [Step("depth", size=self._rounded(self.rng.uniform(-9.0, 0.0) / self.unit))]
        if draw < 0.45 and last == "line":
            form = self.rng.choice(("round", "chamfer"))
            corner = Step(form, size=self._rounded(self.rng.uniform(0.3, 1.0) / self.unit))
            return [corner, self._line()]
        if draw < 0.55 and self.heading is not None:
            return [self._tangent()]
        return [self._arc("radius" if draw > 0.8 else "centre")]

    def _line(self) -> Step:
        """A line of at least 5 mm, so that the corners at both ends have room."""
        while True:
            end = self._point(
                self.rng.uniform(-self.reach, self.reach) / self.unit,
                self.rng.uniform(-self.reach, self.reach) / self.unit,
            )
            if math.dist(end, self.at) * self.unit > 5.0:
                self.heading = math.atan2(end[1] - self.at[1], end[0] - self.at[0])
                self.at = end
                return Step("line", end)

    def _arc(self, form: str) -> Step:
        while True:
            radius, first = self.rng.uniform(1.0, self.reach / 3) / self.unit, self.rng.uniform(0.0, math.tau)
            sense, turn = self.rng.choice((1, -1)), self.rng.uniform(0.05, 2.9 if form == "radius" else 6.0)
            x, y = self.at
            centre = self._point(x - radius * math.cos(first), y - radius * math.sin(first))
            radius, first = math.dist(self.at, centre), math.atan2(y - centre[1], x - centre[0])
            last = first + sense * turn
            end = self._point(centre[0] + radius * math.cos(last), centre[1] + radius * math.sin(last))
            if max(map(abs, end)) * self.unit < self.reach and math.dist(end, self.at) * self.unit > 0.05:
                self.at, self.heading = end, last + sense * math.pi / 2
                return Step(form, end, centre, self._rounded(radius), sense)

    def _tangent(self) -> Step:
        """An arc that continues the direction of the step before, by up to two thirds of a turn."""
        assert self.heading is not None
        while True:
            half, chord = (
                self.rng.uniform(0.05, 1.0) * self.rng.choice((1, -1)),
                self.rng.uniform(2.0, self.reach / 3) / self.unit,
            )
            way = self.heading + half
            end = self._point(self.at[0] + chord * math.cos(way), self.at[1] + chord * math.sin(way))
            if max(map(abs, end)) * self.unit < self.reach:
                sense, radius = (1 if half > 0 else -1), chord / 2 / abs(math.sin(half))
                side = self.heading + sense * math.pi / 2
                centre = self._point(self.at[0] + radius * math.cos(side), self.at[1] + radius * math.sin(side))
                self.at, self.heading = end, self.heading + 2 * half
                return Step("tangent", end, centre, self._rounded(radius), sense)
            self.heading += 0.3  # a corner, and then on: the step before need not be tangential for the others

    def _point(self, x: float, y: float) -> Point:
        return self._rounded(x), self._rounded(y)

    def _rounded(self, number: float) -> float:
        return round(number, self.decimals)


def _klartext(steps: list[Step], inch: bool, decimals: int) -> list[str]:
    def word(letter: str, number: float) -> str:
        return f"{letter}{number + 0.0:+.{decimals}f}"

    def point(at: Point, letters: str = "XY") -> str:
        return " ".join(map(word, letters, at))

    lines = [f"BEGIN PGM PART {'INCH' if inch else 'MM'}", "TOOL CALL 1 Z S1000", "L X+0 Y+0 Z+0 R0 FMAX", "L Z+0 F500"]
    for step in steps:
        turn = "DR+" if step.sense > 0 else "DR-"
        match step.form:
            case "line":
                lines.append(f"L {point(step.end)}")
            case "depth":
                lines.append(f"L {word('Z', step.size)}")
            case "centre":
                lines += [f"CC {point(step.centre)}", f"C {point(step.end)} {turn}"]
            case "radius":
                lines.append(f"CR {point(step.end)} {word('R', step.size)} {turn}")
            case "tangent":
                lines.append(f"CT {point(step.end)}")
            case "round":
                lines.append(f"RND R{step.size:.{decimals}f}")
            case _:
                lines.append(f"CHF {step.size:.{decimals}f}")
    return [*lines, "L Z+2 FMAX M30", lines[0].replace("BEGIN", "END")]


def _iso(steps: list[Step], inch: bool, decimals: int) -> list[str]:
    lines = [f"{'G20' if inch else 'G21'} G90 G17 G94 G54", "T1 M6", "G43 H1", "G0 X0. Y0. Z0.", "G1 Z0. F500"]
    return [*lines, *_g_code(steps, decimals, siemens=False), "G0 Z2.", "M30"]


def _siemens(steps: list[Step], inch: bool, decimals: int) -> list[str]:
    lines = [f"G17 G90 {'G700' if inch else 'G710'} G94 G54", "T1 M6 D1", "G0 X0 Y0 Z0", "G1 Z0 F500"]
    return [*lines, *_g_code(steps, decimals, siemens=True), "G0 Z2", "M30"]


def _g_code(steps: list[Step], decimals: int, *, siemens: bool) -> list[str]:
    lines: list[str] = []
    at: Point = (0.0, 0.0)
    for step in steps:
        end = f"X{step.end[0]:.{decimals}f} Y{step.end[1]:.{decimals}f}"
        code = "G3" if step.sense > 0 else "G2"
        i, j = (c - a for c, a in zip(step.centre, at, strict=True))
        match step.form:
            case "line":
                lines.append(f"G1 {end}")
            case "depth":
                lines.append(f"G1 Z{step.size:.{decimals}f}")
            case "radius":
                lines.append(f"{code} {end} {'CR=' if siemens else 'R'}{step.size:.{decimals}f}")
            case "tangent" if siemens:
                lines.append(f"CT {end}")
            case "round" | "chamfer" if siemens:
                lines[-1] += f" {'RND' if step.form == 'round' else 'CHF'}={step.size:.{decimals}f}"
            case "round" | "chamfer":
                pass
            case "centre":
                lines.append(f"{code} {end} I{i:.{decimals}f} J{j:.{decimals}f}")
            case _:  # ISO has no tangential arc
                lines.append(f"G1 {end}")
        at = step.end if step.sense or step.form == "line" else at
    return lines


WRITERS = {"heidenhain": _klartext, "iso": _iso, "siemens": _siemens}


def _effects(kind: str, rng: random.Random) -> list[dict[str, Any]]:
    """Slopes of some error motions of the linear axes, play of these axes, or both."""
    found: list[dict[str, Any]] = []
    slope, motions = rng.choice(SLOPES), [(axis, component) for axis in "XYZ" for component in "XYZABC"]
    chosen = [(rng.choice("XY"), "Z")] if rng.random() < 0.5 else rng.sample(motions, rng.choice((2, 6, 18)))
    for axis, component in chosen if kind != "play" else ():
        basis = {"kind": "polynomial", "interval": [0.0, 5000.0], "degree": 1}
        units = {"parameters": "um" if component in "XYZ" else "urad"}
        found.append({"kind": "error-motion", "component": component, "axis": axis, "basis": basis,
                      "parameters": [0.0, 5.0 * rng.uniform(-slope, slope)], "units": units, "u": [], "note": ""})  # fmt: skip
    for axis in "XYZ" if kind != "slope" else "":
        found.append({"kind": "backlash", "axis": axis, "width": rng.uniform(3, 20), "units": {"width": "um"}})
    return found


def judge(case: Case) -> Outcome:
    """Correct and verify."""
    return examine(case, _machine_of(json.loads(case.options[0])["klartext_arcs"]))


def _machine_of(arcs: str) -> Machine:
    """The gantry, with this way of correcting Klartext arcs across their plane."""
    machine = machine_named("gantry")
    return dataclasses.replace(machine, control=dataclasses.replace(machine.control, klartext_arcs=arcs))
