"""Text for pipes and files: what Rich writes there, without the import of Rich."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, TextIO

if TYPE_CHECKING:
    from rich.console import Console

    from rendering.report import Table

DROPPED = {ord(character): None for character in "\a\b\v\f\r"}
"""Control characters that move the cursor of a terminal."""
LATIN = "\u0300"
"""Characters before this one take one column each."""


def is_plain(stream: TextIO | None) -> bool:
    """True for a pipe or a file, unless the environment says that it is shown on a terminal."""
    forced = os.environ.get("FORCE_COLOR") or os.environ.get("TTY_COMPATIBLE")
    return stream is None or not (stream.isatty() or forced)


class PlainText:
    """A pipe or a file, with the functions of a Rich console that reports need."""

    is_terminal = False

    def __init__(self, stream: TextIO | None) -> None:
        self.file = stream

    @property
    def in_unicode(self) -> bool:
        """True where lines of tables can be written."""
        return (getattr(self.file, "encoding", None) or "utf-8").lower().startswith("utf")

    @property
    def rich(self) -> Console:
        """A console of Rich, for tables that have to be fitted into the width."""
        from rich.console import Console

        return Console(file=self.file, highlight=False, markup=False, soft_wrap=True)

    def print(self, text: str = "", style: str = "") -> None:  # noqa: ARG002
        """Write lines of text; a pipe has no styles."""
        if self.file is not None:
            self.file.write(text.translate(DROPPED).expandtabs(8) + "\n")
            self.file.flush()

    @contextmanager
    def status(self, text: str) -> Iterator[PlainText]:  # noqa: ARG002
        """A pipe does not show what a command is doing."""
        yield self

    def update(self, text: str) -> None:
        """A pipe does not show what a command is doing."""


def plain_table(table: Table, width: int) -> str | None:
    """A table as text; None for one that is wider, and for text of which Rich has to find the width."""
    rows: Sequence[Sequence[str]] = [table.head, *table.rows]
    if not all(cell.isprintable() and max(cell, default="") < LATIN for row in rows for cell in row):
        return None
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    inner = sum(widths) + 2 * len(widths) - 1
    if inner + 2 > width:
        return None
    empty = " " * (inner + 2)
    head, *others = (f" {' '.join(f'{cell:<{n}} ' for cell, n in zip(row, widths, strict=True))} " for row in rows)
    return "\n".join([empty, head, f" {'─' * inner} ", *others, empty])
