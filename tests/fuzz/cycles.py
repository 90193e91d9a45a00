"""Examiner: holes of canned cycles at random positions and levels, in three dialects, read again from the output."""

from __future__ import annotations

import dataclasses
import json
import random
from typing import Any

from tests.fuzz.case import Case, Outcome
from tests.fuzz.own_output import ENDINGS, examine, machine_named

LEVELS = (0.0, 0.0, 0.5, 3.0)
"""Distances of R below the level before the cycle, mm: often none."""
REACH = 150.0
"""Largest coordinate, mm."""
LEAST_COMPARED = 1.0
"""Share of the programs that are compared: all."""


def draw(seed: int) -> Case:
    """Some cycles; three seeds in a row draw for the three dialects."""
    rng, dialect = random.Random(seed), list(ENDINGS)[seed % 3]
    family = rng.choice(("", "fanuc", "linuxcnc"))
    plan = {"dialect": dialect, "family": family, "tolerance": 1.0}
    lines = WRITERS[dialect](rng)
    return Case("\n".join([*lines, ""]), f"part{ENDINGS[dialect]}", "gantry", json.dumps(_effects(rng)), (json.dumps(plan),))  # fmt: skip


def judge(case: Case) -> Outcome:
    """Correct and verify."""
    machine, family = machine_named("gantry"), json.loads(case.options[0])["family"]
    control = dataclasses.replace(machine.control, family=family or machine.control.family)
    return examine(case, dataclasses.replace(machine, control=control))


def _place(rng: random.Random) -> tuple[float, float]:
    return round(rng.uniform(-REACH, REACH), 3), round(rng.uniform(-REACH, REACH), 3)


def _iso(rng: random.Random) -> list[str]:
    lines = ["G21 G90 G17 G54 G94", "T1 M6", "G43 H1"]
    for _ in range(rng.randint(1, 4)):
        level = round(rng.uniform(2.0, 60.0), rng.choice((0, 3)))
        clear, depth = round(level - rng.choice(LEVELS), 3), round(rng.uniform(-20.0, -1.0), 3)
        x, y = _place(rng)
        counted = rng.random() < 0.25
        lines += [f"G0 X{x:.3f} Y{y:.3f} Z{level:.3f}"]
        code = rng.choice(("G81", "G82", "G83", "G73", "G85", "G89"))
        more = {"G83": " Q2.", "G73": " Q1.5", "G82": " P0.5", "G89": " P0.5"}.get(code, "")
        back = "G98" if counted else rng.choice(("G98", "G99", ""))
        x, y = _place(rng)
        if counted:
            lines += [f"G91 {back} {code} X1. Y2. Z{depth - clear:.3f} R{clear - level:.3f}{more} F100"]
            lines += [f"X{rng.uniform(-9, 9):.3f}" for _ in range(rng.randint(0, 3))]
        else:
            lines += [f"{back} {code} X{x:.3f} Y{y:.3f} Z{depth:.3f} R{clear:.3f}{more} F100".strip()]
            lines += ["X{:.3f} Y{:.3f}".format(*_place(rng)) for _ in range(rng.randint(0, 3))]
        lines += ["G80", *(["G90"] if counted else [])]
    return [*lines, "M30"]


def _siemens(rng: random.Random) -> list[str]:
    lines = ["G17 G90 G71 G94 G54", "T1 M6 D1"]
    for _ in range(rng.randint(1, 4)):
        level, depth = round(rng.uniform(2.0, 60.0), 3), round(rng.uniform(-20.0, -1.0), 3)
        x, y = _place(rng)
        lines += [
            f"G0 X{x:.3f} Y{y:.3f} Z{level:.3f}",
            f"MCALL CYCLE81({level:.3f},0,{rng.choice((0, 2))},{depth:.3f})",
        ]
        lines += ["X{:.3f} Y{:.3f}".format(*_place(rng)) for _ in range(rng.randint(1, 3))]
        lines += ["MCALL"]
    return [*lines, "M30"]


def _klartext(rng: random.Random) -> list[str]:
    lines = ["BEGIN PGM PART MM", "TOOL CALL 1 Z S1000"]
    for _ in range(rng.randint(1, 4)):
        level, depth = round(rng.uniform(2.0, 60.0), 3), round(rng.uniform(-20.0, -1.0), 3)
        x, y = _place(rng)
        lines += [f"L X{x:+.3f} Y{y:+.3f} Z{level:+.3f} R0 FMAX", "CYCL DEF 200 DRILLING ~"]
        lines += [f"  Q200={level:.3f} ;A ~", f"  Q201={depth:.3f} ;B ~", "  Q203=+0 ;C ~", f"  Q204={level:.3f} ;D"]
        lines += ["L X{:+.3f} Y{:+.3f} FMAX M99".format(*_place(rng)) for _ in range(rng.randint(1, 3))]
    return [*lines, "M30", "END PGM PART MM"]


WRITERS = {"iso": _iso, "siemens": _siemens, "heidenhain": _klartext}


def _effects(rng: random.Random) -> list[dict[str, Any]]:
    """Straightness and scale, so that the correction of Z differs from hole to hole, and play of Z in some cases."""
    found: list[dict[str, Any]] = []
    for axis, component in (("X", "Z"), ("Y", "Z"), ("Z", "Z"), ("Y", "X")):
        basis = {"kind": "polynomial", "interval": [0.0, 5000.0], "degree": 1}
        found.append({"kind": "error-motion", "component": component, "axis": axis, "basis": basis,
                      "parameters": [0.0, rng.uniform(-250.0, 250.0)], "units": {"parameters": "um"}, "u": [], "note": ""})  # fmt: skip
    if rng.random() < 0.3:
        found.append({"kind": "backlash", "axis": "Z", "width": rng.uniform(3, 20), "units": {"width": "um"}})
    return found
