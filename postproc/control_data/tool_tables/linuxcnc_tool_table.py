"""LinuxCNC's `tool.tbl`: `T1 P1 D10 Z120.5 ;mill`, lengths in the unit of the machine (its INI file, LINEAR_UNITS).

Read as LinuxCNC 2.9 does (`tooldata_common.cc`, tried with rs274): words are separated by spaces alone, a word that is
missing is 0, and a line with anything else is skipped or read in part. A line that names no tool is skipped here too;
one that names a tool and is not read whole is refused.
"""

from __future__ import annotations

import re
from pathlib import Path

from kinematics.user_error import UserError
from postproc.control.tool_table import ToolTable
from postproc.control_data.tool_tables.form import Form

_WORD = re.compile(
    r"(?:(?P<whole>[TP])(\d+)|(?P<number>[XYZABCUVWDIJQ])([+-]?(?:\d+\.?\d*|\.\d+)(?:E[+-]?\d+)?))", re.I
)
_NAMES_TOOL = re.compile(r"(?:^|\s)T\s*[-+]?\d", re.I)
"""Something that may be the number of a tool."""
_SIDEWAYS = "XYABCUVW"


def read(path: Path, text: str) -> ToolTable:
    """Lengths and radii; UserError with the line that is not understood, or has an offset sideways."""
    lengths, radii, without_pocket, skipped = {}, {}, 0, (0, "")
    for i, line in enumerate(text.split("\n"), start=1):
        if not line.partition(";")[0].strip():
            continue
        if not _NAMES_TOOL.search(line.partition(";")[0]):
            skipped = skipped if skipped[0] else (i, line)
            continue
        words = _words(path, i, line)
        sideways = next((letter for letter in _SIDEWAYS if words.get(letter)), "")
        if sideways:
            raise UserError(f"tool table {path}:{i}: an offset in {sideways} is not supported: expected Z and D only")
        tool = str(int(words["T"]))
        if tool in lengths:
            raise UserError(f"tool table {path}:{i}: T{tool} is in the table twice: delete one line")
        if "P" not in words and without_pocket:
            raise UserError(
                f"tool table {path}:{i}: {line.strip()!r} has no pocket P, as line {without_pocket}: LinuxCNC keeps "
                "only the last of such tools; give each its own P"
            )
        without_pocket = without_pocket if "P" in words else i
        lengths[tool] = words.get("Z", 0.0)
        if "D" in words:
            radii[tool] = words["D"] / 2.0
    if skipped[0] and not lengths:
        _words(path, *skipped)
    return ToolTable(lengths, radii=radii)


def _words(path: Path, i: int, line: str) -> dict[str, float]:
    """The words of a line by their letters; UserError for a word that LinuxCNC does not read whole."""
    found: dict[str, float] = {}
    content = line.partition(";")[0]
    for word in content.removesuffix("\r").split(" "):
        match = _WORD.fullmatch(word)
        if word and match is None:
            raise UserError(f"tool table {path}:{i}: {line.strip()!r} {_why(content)}")
        if match is not None:
            letter = (match["whole"] or match["number"]).upper()
            if letter in found:
                raise UserError(
                    f"tool table {path}:{i}: {line.strip()!r} has {letter} twice, of which LinuxCNC takes the last: "
                    "delete one"
                )
            found[letter] = float(word[1:])
    if "T" not in found:
        raise UserError(f"tool table {path}:{i}: {line.strip()!r} {_why(content)}")
    if content.endswith(" \r"):
        raise UserError(
            f"tool table {path}:{i}: {line.strip()!r} has a space before its end CR LF: LinuxCNC skips the line; "
            "save the file with LF ends"
        )
    return found


def _why(content: str) -> str:
    """Why a line is no entry, and what is expected."""
    comma = "; write the decimal point as '.'" if re.search(r"\d,\d", content) else ""
    tab = "; LinuxCNC separates words by spaces, and ignores the words behind a tab" if "\t" in content else ""
    return f"is not a tool entry of LinuxCNC; expected T1 P1 Z120.5{comma}{tab}"


FORM = Form(lambda _, __: True, read)
"""A table of no other form is read as this one; lengths in the unit of the machine's INI file."""
