"""Moves of a Siemens program by an interpreter of others, nc-gcode-interpreter 0.2.8.

It evaluates variables, loops, branches and TRANS; offsets, lengths and the tool point are added here. It gives the ends
of arcs, not their centres. It takes neither subprograms nor cycles: `written_out` puts the blocks of a subprogram
(without parameters) in the place of its call, and behind each position of MCALL CYCLE81, 82, 83, 85 and 86 the rapid to
the safety clearance over the reference plane, the feed to the depth, and the rapid to the retraction plane.
Not asked, because it does not take them: AC(), GOTO and labels; because it
warns that it does not follow them: G91 and polar coordinates; because it reads them otherwise than SINUMERIK's manual:
machine coordinates under a frame (`findings/nc_gcode_interpreter_suppressed_frame.sh`); ROT, SCALE and MIRROR.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from pathlib import PurePath
from typing import Any

from tests.clients import nc_gcode
from tests.referees.moves import Move, Point, Unclear

DEEPEST = 9
"""Calls within calls."""
KINDS = {"G0": "rapid", "G1": "line", "G2": "arc", "G3": "arc"}


CALL = re.compile(r"(?:CALL )?\"?(?P<name>[A-Z]\w+?)(?:_SPF)?\"?(?: P(?P<times>\d+))?")
HOLES = {"above", "hole", "back"}


def written_out(texts: Mapping[str, str], main: str, nested: int = 0) -> list[str]:
    """The blocks of a program with those of its subprograms and cycles; `nested` counts the calls around it."""
    if nested > DEEPEST:
        raise Unclear("a program that calls itself")
    programs = {PurePath(name).stem.upper(): name for name in texts}
    found, cycle = list[str](), list[str]()
    for line in texts[main].splitlines():
        code = line.partition(";")[0].strip()
        called = CALL.fullmatch(code)
        if code in {"M17", "RET"} or code.startswith("PROC "):
            continue
        if code.startswith("MCALL"):
            cycle = _cycle(code)
        elif called is not None and called["name"] in programs:
            if cycle:
                raise Unclear("a call under MCALL")
            found += written_out(texts, programs[called["name"]], nested + 1) * int(called["times"] or 1)
        else:
            found += [line, *(cycle if re.search(r"(?<![A-Z])[XY]=?[-\d(]", code) else [])]
    return found


def _cycle(code: str) -> list[str]:
    """Blocks behind each position; none for MCALL alone, which ends the cycle."""
    if code == "MCALL":
        return []
    called = re.fullmatch(r"MCALL CYCLE8[12356]\(([-+.\d, ]*)\)", code)
    if called is None:
        raise Unclear(code)
    retraction, reference, clearance, depth = map(float, called[1].split(",")[:4])
    return [f"G0 Z{reference + abs(clearance)} ;above", f"G1 Z{depth} ;hole", f"G0 Z{retraction} ;back"]


def run(
    texts: Mapping[str, str], main: str, offsets: Mapping[str, Point], lengths: Mapping[int, float], rotary: str
) -> list[Move]:
    """All moves of the main program; T is chosen by name, as its length is, so that no loop has one."""
    text = "\n".join([*written_out(texts, main), ""])
    axes, moves = "XYZ" + rotary, list[Move]()
    at: Point = dict.fromkeys(axes, math.nan)
    work, kind, mode, feed, length, tip = "G54", "rapid", "minute", 0.0, 0.0, False
    tools = iter(int(number) for number in re.findall(r"^T(\d+)", text, re.MULTILINE))
    for row in nc_gcode.rows(text):
        work, kind = row.get("gg08_work_offset", work), KINDS.get(row.get("gg01_motion", ""), kind)
        mode = {"G93": "inverse", "G94": "minute"}.get(row.get("gg15_feed_type", ""), mode)
        feed = row.get("F", feed)
        if "M6" in _list(row.get("M")):
            length = lengths[next(tools)]
        calls = _list(row.get("non_returning_function_call"))
        if {"TRAORI", "TRAFOOF"} & set(calls):
            tip = "TRAORI" in calls
            at |= dict.fromkeys("XYZ", math.nan)
        named = {axis: row[axis] + offsets[work][axis] for axis in axes if axis in row}
        if named:
            at = at | named
            said = (mode, feed) if kind in {"line", "arc"} else ("", 0.0)
            comment = str(row.get("comment", "")).strip("; ")
            part = re.match(r"NCOMP (FROM|ARC)", comment) is not None
            moves.append(Move(comment if comment in HOLES else kind, dict(at), length, tip, said, continues=part))
    return moves


def _list(value: Any) -> list[str]:
    return value if isinstance(value, list) else [str(value)]
