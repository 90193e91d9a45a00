"""Moves of a Siemens program by an interpreter of others, nc-gcode-interpreter 0.2.8.

It evaluates variables, loops, branches and TRANS; offsets, lengths and the tool point are added here. It gives the ends
of arcs, not their centres. Not asked, because it does not take them: AC(), GOTO, labels and subprograms; because it
warns that it does not follow them: G91 and polar coordinates; because it reads them otherwise than SINUMERIK's manual:
machine coordinates under a frame (`findings/nc_gcode_interpreter_suppressed_frame.sh`); ROT, SCALE and MIRROR.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Any

from tests.clients import nc_gcode
from tests.referees.moves import Move, Point

KINDS = {"G0": "rapid", "G1": "line", "G2": "arc", "G3": "arc"}


def run(text: str, offsets: Mapping[str, Point], lengths: Mapping[int, float], rotary: str) -> list[Move]:
    """All moves; T is chosen by name, as its length is."""
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
            part = re.match(r";\s*NCOMP (FROM|ARC)", str(row.get("comment", ""))) is not None
            moves.append(Move(kind, dict(at), length, tip, said, continues=part))
    return moves


def _list(value: Any) -> list[str]:
    return value if isinstance(value, list) else [str(value)]
