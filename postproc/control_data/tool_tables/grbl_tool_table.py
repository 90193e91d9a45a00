"""The answer of grbl to `$#`: `[G54:-10.000,5.000,0.000]`, one line for each work offset; other lines are not needed.

Its lengths are in mm, or in inches with `$13=1`. `G92` and the length `TLO` hold only until the next reset: a table
with one that is not zero is refused.
"""

from __future__ import annotations

import re
from pathlib import Path

from kinematics.user_error import UserError
from postproc.control.tool_table import ToolTable
from postproc.control_data.tool_tables.form import Form

_LINE = re.compile(r"\s*\[(G5[4-9](?:\.[123])?|G28|G30|G92|TLO|PRB):([^\]:]*)(?::[01])?\]\s*")
_OTHER = re.compile(r"\s*(ok|\$#|>.*|<.*>|\[(?:MSG|HLP|VER|OPT|GC|HOME|T|AXS)\b.*\])?\s*")
AXES = "XYZABC"
"""Axes in the order of the numbers."""


def read(path: Path, text: str) -> ToolTable:
    """The work offsets; UserError with the line that is not understood."""
    offsets: dict[str, dict[str, float]] = {}
    for i, line in enumerate(text.splitlines(), start=1):
        match = _LINE.fullmatch(line)
        if match is None:
            if not _OTHER.fullmatch(line):
                raise UserError(
                    f"tool table {path}:{i}: {line.strip()!r} is no line of grbl's $#: expected [G54:0,0,0]"
                )
            continue
        name, values = match[1], _numbers(path, i, match[2])
        if name in offsets:
            raise UserError(f"tool table {path}:{i}: {name} is in the table twice: delete one line")
        if name in ("G92", "TLO") and any(values):
            raise UserError(
                f"tool table {path}:{i}: {name} is not 0, and holds until the next reset only: write G92.1 or G49 "
                "before $#, or write it into the program"
            )
        if name.startswith("G5"):
            offsets[name] = dict(zip(AXES, values, strict=False))
    return ToolTable(work_offsets=offsets)


def _numbers(path: Path, i: int, text: str) -> list[float]:
    try:
        return [float(number) for number in text.split(",")]
    except ValueError:
        raise UserError(
            f"tool table {path}:{i}: {text!r} are no numbers: expected as in [G54:0.000,0.000,0.000]"
        ) from None


FORM = Form(lambda _, text: any(_LINE.fullmatch(line) for line in text.splitlines()), read)
"""A text with a line of `$#`."""
