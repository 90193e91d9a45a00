"""Height maps that are lists of points: rows of X, Y and Z, and the log of a probing program of LinuxCNC."""

from __future__ import annotations

import re

from postproc.control_data.height_maps.height_map import HeightMap, Point, grid
from postproc.control_data.readers.control_source import numbers, refusal

LOGGED_NUMBERS = 9
"""Numbers in a row of LinuxCNC's log."""
EXPECTED = (
    "expected X, Y and Z in the coordinates of the work offset, with the decimal point '.', or the "
    f"{LOGGED_NUMBERS} numbers of LinuxCNC's log"
)
REMARK = re.compile(r"[#;%].*|\(.*?\)")
OTHER_UNITS = ("um", "µm", "μm", "cm", "m", "in", "inch", "inches", "mil", "mils", "thou")
NAME_AND_UNIT = re.compile(r"\b([xyz])(?:\s*[(\[_]\s*(\w+))?")
WORD = re.compile(r"^[Gg]0*1\s|[XYZxyz]\s*=?\s*(?=[-+.\d])")


def read_list(name: str, text: str) -> HeightMap:
    """Rows of x, y and z with blanks, commas, semicolons or tabs between them, or of `G1 X.. Y.. Z..`.

    LinuxCNC: `(PROBEOPEN probe-results.txt)` logs nine numbers X Y Z A B C U V W for each contact, in program units and
    in the coordinates of the work offset (`emccanon.cc`, LinuxCNC 2.8, GET_EXTERNAL_PROBE_POSITION); `smartprobe.ngc`
    logs G1 blocks. No program states an interpolation for such lists: bilinear.
    """
    where, points, logged, order = f"height map {name}", list[Point](), False, [0, 1, 2]
    for line, row in enumerate(text.splitlines(), 1):
        words = re.split(r"[\s,;]+", WORD.sub(" ", REMARK.sub("", row.replace(";", ","))).strip(" \t,"))
        if words == [""] or (not points and not re.search(r"\d", row)):
            order = _order(row, where, line) or order  # a remark or the heading
            continue
        if len(words) not in (3, LOGGED_NUMBERS) or row.startswith("["):
            raise refusal(where, line, row, EXPECTED)
        logged = len(words) == LOGGED_NUMBERS
        x, y, z = (numbers(words, where, line, row)[column] for column in order)
        points.append(Point(line, row, x, y, z))
    return HeightMap(*grid(name, points), "LinuxCNC" if logged else "a list of points")


def _order(heading: str, where: str, line: int) -> list[int] | None:
    """Columns of x, y and z by a heading of their names; None for other words. UserError for a unit other than mm."""
    found = NAME_AND_UNIT.findall(heading.lower())
    names = [name for name, _ in found]
    if sorted(names) != ["x", "y", "z"]:
        return None
    if any(unit in OTHER_UNITS for _, unit in found):
        raise refusal(
            where, line, heading, "a list is in mm, or all of it in inches: write it so, without this heading"
        )
    return [names.index(name) for name in "xyz"]
