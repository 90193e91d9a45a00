"""Plain lines that a second process reads ahead, while this one uses those before them."""

from __future__ import annotations

import itertools
from collections import deque
from collections.abc import Iterator

from postproc.second_process import LostProcess, SecondProcess
from postproc.text.plain_lines import PlainLines, PlainStyle, whole, whole_lines

AHEAD = 3
"""Pieces of a program that are read ahead, at most: each takes some megabytes."""


def read_ahead(pieces: Iterator[bytes], axes: str, style: PlainStyle) -> Iterator[tuple[bytes, PlainLines]]:
    """The pieces of a program, and their whole lines with their columns.

    This process reads them itself until the other one has begun, and where that one is lost.
    """
    reader = _Reader(axes, style)
    waiting: deque[bytes] = deque()
    process = SecondProcess(_OtherReader(axes, style))
    try:
        yield from _by(process, reader, pieces, waiting)
    except LostProcess:
        pass
    finally:
        process.end()
    for piece in itertools.chain(waiting, pieces):
        yield piece, reader(piece)


class _Reader:
    """Reads the lines of pieces."""

    def __init__(self, axes: str, style: PlainStyle) -> None:
        self._axes, self._style = axes, style

    def __call__(self, piece: bytes) -> PlainLines:
        lines = whole_lines(piece, self._axes, self._style)
        if len(lines):
            _ = lines.columns, lines.usual_numbers
        return lines


class _OtherReader(_Reader):
    """As _Reader, without the text of the lines, which this process has."""

    def __call__(self, piece: bytes) -> PlainLines:
        lines = super().__call__(piece)
        lines.data = b""
        return lines


def _by(
    process: SecondProcess, reader: _Reader, pieces: Iterator[bytes], waiting: deque[bytes]
) -> Iterator[tuple[bytes, PlainLines]]:
    """The pieces and their lines; LostProcess where the process is lost.

    waiting: becomes the next pieces; the piece in work is the first.
    """
    process.give(b"")  # its answer shows that the process has begun
    begun, given = False, 0
    while True:
        waiting.extend(itertools.islice(pieces, AHEAD + 1 - len(waiting)))
        if not waiting:
            return
        if not begun and process.has_answer:
            process.answer()
            begun = True
        if begun:
            for piece in itertools.islice(waiting, max(given, 1), None):
                process.give(piece)
        piece = waiting[0]
        if given:
            lines = process.answer()
            lines.data = whole(piece)
        else:
            lines = reader(piece)
        waiting.popleft()
        given = len(waiting) if begun else 0
        yield piece, lines
