"""Lines of a page."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable


def written(lines: Iterable[str]) -> str:
    """A page, its text in lines of at most 120 characters; tables, code and headings stay as they are."""
    parts = (
        [line] if line.startswith(("|", "    ", "#")) else textwrap.wrap(line, 120, break_on_hyphens=False) or [""]
        for line in lines
    )
    return "\n".join(line for part in parts for line in part)
