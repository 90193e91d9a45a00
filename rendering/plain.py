"""Text for pipes and files, in the form that Rich gives it, without the import of Rich."""

from __future__ import annotations

import itertools
import os
import textwrap
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, TextIO

if TYPE_CHECKING:
    from rich.console import Console

    from rendering.report import Table

DROPPED = {ord(character): None for character in "\a\b\v\f\r"}
"""Control characters that move the cursor of a terminal."""
PIPE_WIDTH = 100
"""Width, in characters, of a table that is printed into a pipe."""
UNBROKEN_WORD_CHARACTERS = 24
"""Length, in characters, up to which a word is not broken."""
LATIN = "\u0300"
"""Characters before this one take one column each."""


def is_plain(stream: TextIO | None) -> bool:
    """True for a pipe or a file, unless the environment states that it is shown on a terminal."""
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
        """A pipe does not show the step in work."""
        yield self

    def update(self, text: str) -> None:
        """A pipe does not show the step in work."""


def plain_table(table: Table, width: int) -> str | None:
    """A table as text, with cells over several lines where it would be wider.

    None for a table that does not fit, and for characters whose width only Rich can calculate.
    """
    rows: Sequence[Sequence[str]] = [table.head, *table.rows]
    if not all(cell.isprintable() and max(cell, default="") < LATIN for row in rows for cell in row):
        return None
    widths = _widths(list(zip(*rows, strict=True)), width - 2 * len(table.head) - 1)
    if widths is None:
        return None
    inner = sum(widths) + 2 * len(widths) - 1
    empty = " " * (inner + 2)
    head, *others = ("\n".join(_lines(row, widths)) for row in rows)
    return "\n".join([empty, head, f" {'─' * inner} ", *others, empty])


def _widths(columns: Sequence[Sequence[str]], room: int) -> list[int] | None:
    """Widths of columns that have room beside each other: the widest are made narrower.

    None if they have not, or if a word would be broken: where, depends on the width that Rich gives to its column.
    """
    full = [max(map(len, column)) for column in columns]
    words = [max((len(word) for cell in column for word in cell.split()), default=0) for column in columns]
    widths = full.copy()
    while sum(widths) > room:
        widest = max(range(len(widths)), key=lambda i: (widths[i] > min(UNBROKEN_WORD_CHARACTERS, words[i]), widths[i]))
        if widths[widest] <= min(UNBROKEN_WORD_CHARACTERS, words[widest]):
            return None
        widths[widest] -= 1
    # among equal columns Rich may make another one narrower, by one character
    broken = any(
        word > UNBROKEN_WORD_CHARACTERS and width < whole and width <= word
        for width, whole, word in zip(widths, full, words, strict=True)
    )
    return None if broken else widths


def _lines(row: Sequence[str], widths: Sequence[int]) -> Iterator[str]:
    """The lines of a row."""
    cells = [
        [cell] if len(cell) <= n else textwrap.wrap(cell, n, break_on_hyphens=False)
        for cell, n in zip(row, widths, strict=True)
    ]
    for parts in itertools.zip_longest(*cells, fillvalue=""):
        yield f" {' '.join(f'{part:<{n}} ' for part, n in zip(parts, widths, strict=True))} "
