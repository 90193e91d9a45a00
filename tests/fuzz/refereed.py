"""Judges a correction by a reference interpreter: after it the tool is where the program says, on the machine with errors.

The interpreter runs the program and its correction. `tests/virtual_machine` makes tool points of their moves: of the
machine without errors for the program, with errors for the correction.
"""

from __future__ import annotations

import json
import math
import random
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np

from tests.fuzz.case import Case, Outcome, Verdict
from tests.fuzz.ncomp import corrected_set
from tests.fuzz.verified import MACHINES_FOLDER, _chain, _machine, _offset, _points
from tests.referees.moves import Move, Unclear, joined

MACHINES = ("gantry", "gantry", "gantry", "trunnion_bc", "trunnion_ac", "head_table", "head_head", "dmu50")
LENGTHS = {1: 80.0, 2: 55.5, 3: 102.25}
"""Tools and their lengths, mm."""
END_UM = 0.4
"""Largest distance of the tool point at the end of a move: the last digits of its words."""
AGAIN_UM = 0.5
"""More than that where one text stands for blocks that run several times."""
RADIUS_UM = 0.5
"""Largest distance of the middle of an arc by the last digit of its radius: ncomp writes its centre beyond that."""
ROUGH_UM = 12_000.0
"""Largest distance at the approaches of holes and in the middle of arcs, under errors that are slopes."""
HOLE = ("above", "hole", "back")
"""Kinds of the moves of a cycle."""
SAME_MM = 1e-7
"""Difference of two positions that is rounding."""
FEED = 2e-3
"""Largest relative difference of a feed, or of the time of a move under G93: the digits of F of its parts."""
SLOPE = 0.4
"""Largest slope of an error of position, um/mm: a position that is misread by 1 mm or more shows."""
Run = Callable[[Mapping[str, str], Case], list[Move]]
"""Interpreter of the texts of programs by file, the main one first."""


def machine_text(name: str, control: str) -> str:
    """Text of a shipped machine with entries of its control."""
    return (MACHINES_FOLDER / f"{name}.toml").read_text(encoding="utf-8") + f"\n[control]\n{control}\n"


def options_of(rng: random.Random, machine: str, names: tuple[str, ...], *, unroll: bool) -> tuple[str, ...]:
    """Command line: offsets about the middle of the travel, tools, and leave for errors of this size."""
    options = ["--no-travel-check", "--max-correction-um", "5000", "--tolerance-um", rng.choice(("1", "1", "5"))]
    options += ["--accept", "outside,insignificant,worse,stale", *(["--unroll"] if unroll else [])]
    for name in names:
        middle = _offset(_chain(machine))
        place = ",".join(str(round(middle[axis] + rng.uniform(-20, 20), 2)) for axis in "XYZ")
        options += ["--work-offset", f"{name}={place}", "--datum", f"{name}=true"]
    for number, length in LENGTHS.items():
        options += ["--tool-length", f"T{number}={length}"]
    return tuple(options)


def offsets_of(case: Case) -> dict[str, dict[str, float]]:
    """Work offsets of the command line, with rotary axes at 0."""
    found: dict[str, dict[str, float]] = {}
    for option, value in pairwise(case.options):
        if option == "--work-offset":
            name, _, places = value.partition("=")
            found[name] = dict.fromkeys("XYZABC", 0.0) | dict(zip("XYZ", map(float, places.split(",")), strict=True))
    return found


def rotary_of(machine: str) -> str:
    """Letters of the rotary axes of a shipped machine."""
    return "".join(sorted(axis.name for axis in _chain(machine).axes if axis.rotary))


def shipped(case: Case) -> str:
    """Name of the shipped machine whose text a case has."""
    return next(name for name in MACHINES if f'name = "{name}"' in case.machine)


def calibration(machine: str, rng: random.Random, *, slopes: bool) -> str:
    """Errors that are constant, or slopes over the travel of an axis, as the text of a calibration file."""
    chain, effects = _chain(machine), []
    for axis in chain.axes:
        low, high = axis.travel
        if axis.rotary and high - low >= 360.0:
            low, high = -180.0, 180.0
        if axis.rotary and slopes:
            continue  # of a whole turn an error repeats, and is no slope
        for component in "XYZABC" if slopes else "XYZ":
            size = SLOPE * (high - low) if component in "XYZ" else 100.0
            values = [rng.uniform(-100, 100), *([rng.uniform(-size, size)] if slopes else [])]
            basis = {"kind": "polynomial", "interval": [low, high], "degree": len(values) - 1}
            unit = "um" if component in "XYZ" else "urad"
            effects.append({"kind": "error-motion", "component": component, "axis": axis.name, "basis": basis,
                            "parameters": values, "units": {"parameters": unit}, "u": [], "note": ""})  # fmt: skip
    return json.dumps(_empty(machine) | {"effects": effects}, indent=1) + "\n"


@cache
def _empty(machine: str) -> dict[str, Any]:
    from kinematics.error_model.model import encode_model, no_errors

    return dict(json.loads(encode_model(no_errors(_machine(machine)))))


def examine(case: Case, run: Run, *, depths: bool = True, between: bool = False) -> Outcome:
    """Correct by the command line, and run both by the interpreter.

    depths: blocks of holes have words of their depth, which are corrected; otherwise the holes stay as deep as they are,
    and with `between` the rapids from hole to hole as high as they are.
    """
    texts = {case.name: case.program} | dict(case.files)
    try:
        before = run(texts, case)
    except (Unclear, StopIteration, KeyError) as fault:
        return Outcome(Verdict.REFUSED, f"referee: {fault!r}")
    done, written = corrected_set(case)
    if done.status == 2:
        return Outcome(Verdict.DIFFERS if done.text else Verdict.REFUSED, done.refusal)
    if done.status or done.text is None:
        return Outcome(Verdict.DIFFERS, f"exit status {done.status}: {done.shown}")
    try:
        after = joined(run(texts | written, case))
    except (Unclear, StopIteration, KeyError) as fault:
        return Outcome(Verdict.DIFFERS, f"unclear: {fault!r}\n{_shown(written)}")
    fault = _fault(case, before, after, depths=depths, between=between)
    return Outcome(Verdict.DIFFERS, f"{fault}\n{_shown(written)}") if fault else Outcome(Verdict.COMPARED)


def _shown(written: Mapping[str, str]) -> str:
    return "\n".join(f"--- {name}\n{text}" for name, text in written.items())


def _fault(case: Case, before: list[Move], after: list[Move], *, depths: bool, between: bool) -> str:
    if [move.kind for move in before] != [move.kind for move in after]:
        return f"order of moves: {len(before)} moves, {len(after)} of the correction"
    chain, effects = _chain(shipped(case)), json.loads(case.calibration)["effects"]
    constant = all(effect["basis"]["degree"] == 0 for effect in effects)
    tolerance = float(case.options[case.options.index("--tolerance-um") + 1])
    limit = END_UM + (0.0 if "--unroll" in case.options else AGAIN_UM)
    start, start_off = Move("rapid", {}, 0.0), 0.0
    for i, (programmed, written) in enumerate(zip(before, after, strict=True), 1):
        if programmed.kind == "machine":
            if any(abs(programmed.end[axis] - written.end[axis]) > 1e-9 for axis in programmed.named):
                return f"machine coordinates: move {i} goes to {written.end} instead of {programmed.end}"
            continue
        if any(math.isnan(value) for value in programmed.end.values()):
            continue  # an axis that the program has not placed
        hole = _at_a_hole(before, i - 1) if depths or between else programmed.kind in HOLE
        if hole and not depths and programmed.end["Z"] != written.end["Z"]:
            return f"depth: move {i} ends at Z {written.end['Z']} instead of {programmed.end['Z']}"
        end_off = _off(chain, effects, programmed, written, flat=hole and not depths)
        rough = (hole and not (depths and programmed.kind == "hole")) or programmed.repeated
        most = limit + (tolerance if programmed.whole_turn else 0.0)  # in one block it ends where it begins
        if not end_off <= (ROUGH_UM if (rough and not constant) or _rotary_alone(before, i - 1) else most):
            return f"end of {programmed.kind}: move {i} is off by {end_off:.3f} um at {programmed.end}: {written.end}"
        if programmed.middle and written.middle:
            middles = [move.end | move.middle for move in (programmed, written)]
            off = _off(chain, effects, replace(programmed, end=middles[0]), replace(written, end=middles[1]))
            ends_um = max(start_off, end_off)
            if not off <= (_middle_um(start, programmed, ends_um) if constant else ROUGH_UM):
                return f"middle of an arc: move {i} is off by {off:.3f} um at {middles}"
        start, start_off = programmed, end_off
        if (
            programmed.feed[0] != written.feed[0]
            or abs(programmed.feed[1] - written.feed[1]) > FEED * programmed.feed[1]
        ):
            return f"feed: of move {i}: {programmed.feed} has become {written.feed}"
    return ""


def _at_a_hole(moves: list[Move], i: int) -> bool:
    """True of the moves of a cycle, and of those from hole to hole at the height at which it has left the tool."""
    while i and moves[i].kind == "rapid" and _same(moves[i], moves[i - 1], "Z"):
        i -= 1
    return moves[i].kind in HOLE


def _same(move: Move, other: Move, axes: str) -> bool:
    return all(abs(move.end[axis] - other.end[axis]) < SAME_MM for axis in axes)


def _rotary_alone(moves: list[Move], i: int) -> bool:
    """True of a feed move of rotary axes alone, in which the linear axes stay: with them F would be another speed."""
    move, last = moves[i], moves[max(i - 1, 0)]
    return move.kind == "line" and move.feed[0] == "minute" and _same(move, last, "XYZ")


def _middle_um(start: Move, arc: Move, ends_um: float) -> float:
    """Largest distance, um, of the middle of an arc under a constant error, whose ends are off by up to `ends_um`.

    It moves as they do, and an arc by its radius gets lower where they go apart, the faster the nearer it is to half a
    turn: its height over the chord c is r - sqrt(r^2 - c^2 / 4).
    """
    plane = list(arc.middle)[:2]
    first, last, middle = (np.array([at[axis] for axis in plane]) for at in (start.end, arc.end, arc.middle))
    half, over = math.dist(first, last) / 2, math.dist(middle, (first + last) / 2)
    apart = ends_um / 1e3
    radius = (over + half * half / over) / 2
    heights = [math.sqrt(max(radius * radius - each * each, 0.0)) for each in (half - apart, half, half + apart)]
    return RADIUS_UM + ends_um + 1e3 * (heights[0] - heights[2])


def _off(chain: Any, effects: list[dict[str, Any]], programmed: Move, written: Move, *, flat: bool = False) -> float:
    """Distance, um, of the tool point of the machine with errors from that of the machine without; `flat`: across Z."""
    if programmed.length != written.length or programmed.tip != written.tip:
        return float("nan")
    tool = (0.0, 0.0, -programmed.length)
    wanted = _points(chain, _axes(chain, programmed)[None], [], tool)
    reached = _points(chain, _axes(chain, written)[None], effects, tool)
    off = (reached - wanted)[0]
    if flat:
        deeper = replace(programmed, end=programmed.end | {"Z": programmed.end["Z"] + 1.0})
        along = (_points(chain, _axes(chain, deeper)[None], [], tool) - wanted)[0]
        off = off - off @ along * along
    return float(1e3 * np.linalg.norm(off))


def _axes(chain: Any, move: Move) -> Any:
    """Axis positions (axes,), mm and rad, at the end of a move."""
    q = np.array(
        [move.end.get(name, 0.0) * axis.per_file_unit for name, axis in zip(chain.names, chain.axes, strict=True)]
    )
    linear = [chain.index(axis) for axis in "XYZ"]
    wanted = q[linear]
    q[linear] = wanted + np.array([0.0, 0.0, move.length])
    if move.tip:  # the tool point is affine in X, Y and Z
        rows = np.repeat(q[None], 4, axis=0)
        rows[1:, linear] += np.eye(3)
        points = _points(chain, rows, [], (0.0, 0.0, -move.length))
        q[linear] += np.linalg.solve((points[1:] - points[0]).T, wanted - points[0])
    return q
