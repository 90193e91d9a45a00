"""Writes the table of the configuration of controls into docs/machines.md, and that of statements into docs/flow.md.

    python docs/make/configuration.py

The rows are those of `postproc/code_tables/configuration.py` and `postproc/code_tables/statements.py`.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable
from pathlib import Path

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT))

from postproc.code_tables.configuration import CONFIGURATION  # noqa: E402
from postproc.code_tables.statements import STATEMENTS  # noqa: E402

DOCS = ROOT / "docs"
CONFIGURATION_HEAD = "| on the control | here | reading and correcting | export and import |\n|---|---|---|---|\n"
STATEMENTS_HEAD = "| statement | sets | afterwards |\n|---|---|---|\n"


def _row(cells: Iterable[str]) -> str:
    return f"| {' | '.join(cells)} |\n"


def _with_table(text: str, head: str, rows: Iterable[str]) -> str:
    """The page with the rows of one of its tables renewed."""
    before, _, behind = text.partition(head)
    rest = behind.splitlines(keepends=True)
    last = next(i for i, line in enumerate(rest) if not line.startswith("|"))
    return "".join([before, head, *rows, *rest[last:]])


def pages() -> dict[str, str]:
    """The texts of both pages, by name."""
    configuration = (_row((each.control, each.shown, each.reading, each.export)) for each in CONFIGURATION)
    statements = (_row((each.shown, each.sets, each.afterwards)) for each in STATEMENTS)
    return {
        "machines.md": _with_table((DOCS / "machines.md").read_text(), CONFIGURATION_HEAD, configuration),
        "flow.md": _with_table((DOCS / "flow.md").read_text(), STATEMENTS_HEAD, statements),
    }


if __name__ == "__main__":
    for name, text in pages().items():
        (DOCS / name).write_text(text)
