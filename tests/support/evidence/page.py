"""The tables of docs/evidence.md: digits in which ncomp agrees with references of others."""

from __future__ import annotations

import re
from importlib import import_module
from pathlib import Path

from support.evidence.digits import Agreement

PAGE = Path(__file__).parents[3] / "docs" / "evidence.md"
SOURCES = {"least squares": "strd", "elements": "null_space", "uncertainties": "gum", "worked examples": "worked"}
"""The module of each table, by the name in its mark."""
TABLE = re.compile(r"<!-- digits: (?P<name>[a-z ]+) -->\n\n(?P<table>(?:\|.*\n)+)")
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
    """The page with tables of what ncomp computes now."""
    return TABLE.sub(lambda each: f"<!-- digits: {each['name']} -->\n\n{_table(rows_of(each['name']))}", page)


def _table(rows: list[Agreement]) -> str:
    return HEAD + "".join(f"| {' | '.join(row.key)} | {row.shown} |\n" for row in rows)
