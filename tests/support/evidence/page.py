"""The tables of docs/evidence.md: digits in which ncomp agrees with references of others, and figures of referees."""

from __future__ import annotations

import re
from importlib import import_module
from pathlib import Path

from support.evidence.digits import Agreement
from tests.fuzz.figures import PROGRAMS, READERS, sums

PAGE = Path(__file__).parents[3] / "docs" / "evidence.md"
SOURCES = {"least squares": "strd", "elements": "null_space", "uncertainties": "gum", "worked examples": "worked"}
"""The module of each table, by the name in its mark."""
TABLE = re.compile(r"<!-- digits: (?P<name>[a-z ]+) -->\n\n(?P<table>(?:\|.*\n)+)")
REFEREES = {
    "linuxcnc": ("LinuxCNC 2.9's interpreter", "ISO", "programs of every construct, contours, cycles, offsets"),
    "linuxcnc_files": ("LinuxCNC 2.9's interpreter", "ISO", "several files, five axes, G93, G10 in loops, cycles"),
    "play": ("LinuxCNC 2.9's interpreter", "ISO", "machines with backlash: turning points, take-up moves"),
    "simulator": ("LinuxCNC 2.9's simulator", "ISO", "its axes beside its interpreter, on which the first two rely"),
    "fanuc": ("`tests/referees/fanuc.py`", "FANUC", "macros, files, G93, five axes, G43.4, cycles, G10 in loops"),
    "klartext": (
        "`tests/referees/klartext.py`",
        "Klartext",
        "labels, files, parameters, five axes, M128, cycles, datums",
    ),
    "siemens": ("nc-gcode-interpreter 0.2.8 (CEAD)", "Siemens", "loops, files, frames, G93, five axes, TRAORI, cycles"),
    "drives": (
        "`tests/fuzz/drives.py`, `tests/virtual_machine`",
        "all three",
        "drives with play that are pushed, five axes",
    ),
    "verified": (
        "`tests/fuzz/reckoner.py`, `tests/virtual_machine`",
        "all three",
        "loops, frames, tilted planes, tool point",
    ),
}
"""Who runs a program and its correction, in which dialect, and what is drawn, by the examiner's name."""
READ = {
    "NC iso": "NC iso", "NC siemens": "NC siemens", "NC heidenhain": "NC heidenhain", "machine": "machine",
    "calibration": "calibration", "map": "map of columns", "plan": "plan", "points": "points",
    "log": "log of temperatures", "height-map": "height map", "touches": "log of touches", "study": "study",
    "continuous": "continuous runs", "etalon": "errors of Etalon", "data": "measurements", "iso230": "`ncomp iso230`",
    "import": "tables of controls", "tools": "tables of tools", "fit": "measurements, and a fit",
}  # fmt: skip
"""What a reader reads, by its name in `python -m tests.fuzz.guided`."""
RECORDED = re.compile(r"<!-- (?P<name>referees|readers) -->\n\n(?:\|.*\n)+")
HEAD = "| reference | through | figure | digits |\n|---|---|---|---|\n"


def rows_of(name: str) -> list[Agreement]:
    """The rows of a table, computed."""
    rows: list[Agreement] = import_module(f"support.evidence.{SOURCES[name]}").rows()
    return rows


def stated() -> dict[str, dict[tuple[str, str, str], int]]:
    """Digits that the page states, by table, and by reference, entrance and figure."""
    found: dict[str, dict[tuple[str, str, str], int]] = {}
    for each in TABLE.finditer(PAGE.read_text()):
        rows = [line.strip("| ").split(" | ") for line in each["table"].splitlines()[2:]]
        found[each["name"]] = {(row[0], row[1], row[2]): int(row[3]) for row in rows}
    return found


def renewed(page: str) -> str:
    """The page with tables of what ncomp computes now, and of the recorded runs of the referees."""
    page = RECORDED.sub(lambda each: f"<!-- {each['name']} -->\n\n{recorded()[each['name']]}", page)
    return TABLE.sub(lambda each: f"<!-- digits: {each['name']} -->\n\n{_table(rows_of(each['name']))}", page)


def recorded() -> dict[str, str]:
    """The tables of the recorded runs, by their marks."""
    return {"referees": _referees(), "readers": _readers()}


def _readers() -> str:
    found, lines = sums(READERS), ["| reader | inputs | read | refused in words | other |", "|---|---|---|---|---|"]
    lines += [f"| {' | '.join([text, *map(str, found[name])])} |" for name, text in READ.items() if name in found]
    return "\n".join([*lines, ""])


def _referees() -> str:
    found, lines = (
        sums(PROGRAMS),
        ["| referee | dialect | drawn | programs | compared | refused | differences | examiner |"],
    )
    lines.append("|---|---|---|---|---|---|---|---|")
    for name, (who, dialect, drawn) in REFEREES.items():
        if name in found:
            lines.append(f"| {' | '.join([who, dialect, drawn, *map(str, found[name]), f'`{name}`'])} |")
    return "\n".join([*lines, ""])


def _table(rows: list[Agreement]) -> str:
    return HEAD + "".join(f"| {' | '.join(row.key)} | {row.shown} |\n" for row in rows)
