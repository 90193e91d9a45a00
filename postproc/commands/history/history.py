"""`ncomp history`: The life of the machines of a shop in one database: results, events, and the trends of their errors.

Without `--db` it is the `history` of the machine file, `$NCOMP_HISTORY`, or a file of SQLite in the user's data folder:
nothing has to be set up. docs/history.md describes it.
"""

from __future__ import annotations

from collections.abc import Sequence

from kinematics.files.mistaken import none_of
from kinematics.user_error import UserError

NAMES = ("add", "list", "show", "event", "export", "verify")
EPILOG = (
    "Examples:\n\n"
    "`ncomp history add mill.toml march.json june.json`\n\n"
    "`ncomp fit tracker.csv --machine mill.toml -o july.json --history`  enters the result of a command\n\n"
    "`ncomp history event mill.toml crash --at 2026-04-02`\n\n"
    "`ncomp history show mill.toml --report mill.html`"
)


def named(words: Sequence[str]) -> tuple[str, list[str]]:
    """UserError: none of the words after `history` is a command."""
    first = words[0] if words else ""
    raise UserError(f"history {none_of(first, NAMES)}; 'ncomp history --help' lists them")
