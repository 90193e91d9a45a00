"""The blocks of a program in their order: runs of plain lines from its bytes, all other blocks by their dialect."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from kinematics.machine import NDArrayBool
from postproc.control.codes import AXES
from postproc.dialects import Dialect
from postproc.text.block import Block
from postproc.text.blocks import PlainRun
from postproc.text.plain_lines import PlainLines, whole_lines
from postproc.text.plain_style import PlainStyle
from postproc.text.source import ENCODING, Source

SHORTEST_RUN_LINES = 6
"""Lines of a run, at least: columns of fewer take longer than the lines one by one."""


def read_blocks(source: Source, dialect: Dialect, axes: str, *, ahead: bool = False) -> Iterator[Block | PlainRun]:
    """The blocks of a program, and runs of plain lines; `axes`: letters of the axes of the machine, empty for others.

    `ahead`: another process reads the columns of plain lines ahead. Refusal for a block that the dialect does not know;
    UserError for a line that is no text.
    """
    style = dialect.plain
    if style is None or not axes or not source.has_line_feeds:
        for number, text in dialect.join_lines(source.lines()):
            yield dialect.read_block(number, text)
        return
    for item in _items(source, dialect, axes, style, ahead=ahead):
        if isinstance(item, PlainRun):
            yield item
        else:
            yield dialect.read_block(*item)


def irregular_lines(source: Source, dialect: Dialect) -> Iterator[tuple[int, str]]:
    """The texts of all blocks that may be other than plain lines, with the numbers of their first lines."""
    if dialect.plain is None or not source.has_line_feeds:
        yield from dialect.join_lines(source.lines())
        return
    for item in _items(source, dialect, AXES, dialect.plain, regular=True):
        if not isinstance(item, PlainRun):
            yield item


def _items(
    source: Source, dialect: Dialect, axes: str, style: PlainStyle, *, regular: bool = False, ahead: bool = False
) -> Iterator[PlainRun | tuple[int, str]]:
    """Runs of plain lines, or of regular ones, and the texts of all other blocks with the numbers of their lines."""
    first = next(iter(dialect.join_lines(source.lines())), None)
    done = 0
    if first is not None:
        yield first
        done = max(1, first[1].count("\n"))
    number = source.before + 1
    waiting: list[tuple[int, str]] = []
    """Lines that the next one continues."""
    for piece, lines in _pieces(source, axes, style, ahead=ahead):
        if len(lines):
            plain = (lines.regular if regular else lines.columns.plain).copy()
            plain[:done] = False
            if style.continued:
                _leave_continued(lines.data, lines, plain, style.continued.encode())
                plain[0] &= not waiting
            for start, end, is_run in _runs(plain):
                if is_run:
                    yield PlainRun(lines, start, end, number + start, dialect.read_block)
                    continue
                singles = (_line(source, lines, line, number) for line in range(max(start, done), end))
                if style.continued:
                    joined = list(dialect.join_lines([*waiting, *singles]))
                    waiting = []
                    if end == len(plain) and joined and joined[-1][1].rstrip(" \t\r\n").endswith(style.continued):
                        waiting = [joined.pop()]
                    yield from joined
                else:
                    yield from singles
            number += len(lines)
            done = max(0, done - len(lines))
        if len(lines.data) < len(piece) and not done:
            waiting.append(_checked(source, number, piece[len(lines.data) :]))
    yield from dialect.join_lines(waiting) if style.continued else waiting


def _pieces(source: Source, axes: str, style: PlainStyle, *, ahead: bool) -> Iterator[tuple[bytes, PlainLines]]:
    """The pieces of a program, and their whole lines."""
    if ahead:
        from postproc.read_ahead import read_ahead

        yield from read_ahead(source.pieces(), axes, style)
        return
    for piece in source.pieces():
        yield piece, whole_lines(piece, axes, style)


def _line(source: Source, lines: PlainLines, line: int, number: int) -> tuple[int, str]:
    low, high = lines.starts[line : line + 2].tolist()
    return _checked(source, number + line, lines.data[low:high])


def _leave_continued(data: bytes, lines: PlainLines, plain: NDArrayBool, mark: bytes) -> None:
    """Mark the lines behind those with a mark of continuation as not plain."""
    at = data.find(mark)
    while at >= 0:
        behind = int(np.searchsorted(lines.starts, at, side="right"))
        if behind < len(plain):
            plain[behind] = False
        at = data.find(mark, at + 1)


def _checked(source: Source, number: int, data: bytes) -> tuple[int, str]:
    text = data.decode(ENCODING)
    source.check_line(number, text)
    return number, text


def _runs(plain: NDArrayBool) -> Iterator[tuple[int, int, bool]]:
    """First and last plus one of stretches of equal lines, and whether they are a run of plain lines."""
    edges = np.flatnonzero(np.diff(plain, prepend=False, append=False)).reshape(-1, 2)
    done = 0
    for start, end in edges[edges[:, 1] - edges[:, 0] >= SHORTEST_RUN_LINES].tolist():
        if done < start:
            yield done, start, False
        yield start, end, True
        done = end
    if done < len(plain):
        yield done, len(plain), False
