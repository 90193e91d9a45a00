"""Plain lines that a second process reads ahead, while this one uses those before them."""

from __future__ import annotations

import itertools
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass

from kinematics.running.child_process import ChildProcess, LostProcess
from postproc.text.plain_lines import PlainLines, whole, whole_lines
from postproc.text.plain_style import PlainStyle

PIECES_AHEAD = 3
"""Pieces of a program that are read ahead, at most: each takes some megabytes."""
PATIENCE_S = 0.02
"""Time in which the lines of about one piece are read."""


def read_ahead(pieces: Iterator[bytes], axes: str, style: PlainStyle) -> Iterator[tuple[bytes, PlainLines]]:
    """The pieces of a program, and their whole lines with their columns.

    This process reads them itself until the other one has begun, and where that one is lost.
    """
    reader = _Reader(axes, style)
    waiting: deque[_Waiting] = deque()
    process = ChildProcess(_OtherReader(axes, style))
    try:
        yield from _by(process, reader, pieces, waiting)
    except LostProcess:
        pass
    finally:
        process.end()
    for piece in itertools.chain((left.piece for left in waiting), pieces):
        yield piece, reader(piece)


class _Reader:
    """Reads the lines of pieces."""

    def __init__(self, axes: str, style: PlainStyle) -> None:
        self._axes, self._style = axes, style

    def __call__(self, piece: bytes) -> PlainLines:
        lines = whole_lines(piece, self._axes, self._style)
        if len(lines):
            _ = lines.columns, lines.vectors, lines.usual_numbers
        return lines


class _OtherReader(_Reader):
    """As _Reader, without the text of the lines, which this process has."""

    def __call__(self, piece: bytes) -> PlainLines:
        lines = super().__call__(piece)
        lines.data = b""
        return lines


@dataclass
class _Waiting:
    """A piece whose lines are not used yet."""

    piece: bytes
    given: bool = False
    """True if the other process reads its lines."""
    lines: PlainLines | None = None
    """Its lines, if this process has read them."""


def _by(
    process: ChildProcess, reader: _Reader, pieces: Iterator[bytes], waiting: deque[_Waiting]
) -> Iterator[tuple[bytes, PlainLines]]:
    """The pieces and their lines; LostProcess where the process is lost.

    waiting: becomes the next pieces; the piece in work is the first. The last one is given to nobody: this process
    reads it itself instead of waiting for the other one.
    """
    process.give(b"")  # its answer shows that the process has begun
    begun = False
    while True:
        waiting.extend(map(_Waiting, itertools.islice(pieces, PIECES_AHEAD + 2 - len(waiting))))
        if not waiting:
            return
        if not begun and process.answers_within(0.0):
            process.answer()
            begun = True
        first, last = waiting[0], waiting[-1]
        for ahead in itertools.islice(waiting, 1, PIECES_AHEAD + 1) if begun else ():
            if not ahead.given and ahead.lines is None:
                process.give(ahead.piece)
                ahead.given = True
        if first.given:
            if not (last.given or last.lines or process.answers_within(PATIENCE_S)):
                last.lines = reader(last.piece)
            first.lines = process.answer()
            first.lines.data = whole(first.piece)
        lines = first.lines or reader(first.piece)
        waiting.popleft()
        yield first.piece, lines
