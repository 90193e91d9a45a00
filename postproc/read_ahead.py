"""Plain lines that a second process reads ahead, while this one uses those before them."""

from __future__ import annotations

import itertools
from collections import deque
from collections.abc import Iterator

from postproc.second_process import LostProcess, SecondProcess
from postproc.text.plain_lines import PlainLines, PlainStyle, whole_lines

AHEAD = 3
"""Pieces of a program that are read ahead, at most: each takes some megabytes."""


def read_ahead(pieces: Iterator[bytes], axes: str, style: PlainStyle) -> Iterator[tuple[bytes, PlainLines]]:
    """The pieces of a program, and their whole lines with their columns.

    This process reads them itself until the other one has begun, and where that one is lost.
    """
    reader = _Reader(axes, style)
    waiting: deque[tuple[bytes, bool]] = deque()
    process = SecondProcess(reader)
    try:
        yield from _by(process, reader, pieces, waiting)
    except LostProcess:
        pass
    finally:
        process.end()
    for piece in itertools.chain((piece for piece, _ in waiting), pieces):
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


def _by(
    process: SecondProcess, reader: _Reader, pieces: Iterator[bytes], waiting: deque[tuple[bytes, bool]]
) -> Iterator[tuple[bytes, PlainLines]]:
    """The pieces and their lines; LostProcess where the process is lost.

    waiting: becomes the next pieces, with true for those that the process has got; the piece in work is the first.
    """
    open_answers = unused_answers = 0
    begun = False
    while True:
        for piece in itertools.islice(pieces, AHEAD + 1 - len(waiting)):
            given = open_answers <= AHEAD
            waiting.append((piece, given))
            if given:
                process.give(piece)
                open_answers += 1
        if not waiting:
            return
        piece, given = waiting[0]
        begun = begun or process.has_answer
        if given and begun:
            for _ in range(unused_answers):
                process.answer()
            lines = process.answer()
            open_answers -= unused_answers + 1
            unused_answers = 0
        else:
            lines = reader(piece)
            unused_answers += given
        waiting.popleft()
        yield piece, lines
