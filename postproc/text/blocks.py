"""The blocks of a chunk of a program: those that were read one by one, and runs of plain lines as columns."""

from __future__ import annotations

import bisect
import itertools
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import cached_property
from typing import overload

import msgspec
import numpy as np
from msgspec.structs import replace

from kinematics.machine import NDArrayBool
from kinematics.transforms import Array
from postproc.text.block import Block
from postproc.text.plain_columns import PlainColumns, PlainVectors
from postproc.text.plain_lines import PlainLines
from postproc.text.source import ENCODING


class PlainRun(msgspec.Struct, frozen=True, eq=False, dict=True):
    """Consecutive plain lines of a piece of a program; each is one block that moves at least one axis."""

    lines: PlainLines
    first: int
    last: int
    """Numbers of its first line in the piece, and of the line behind it."""
    number: int
    """Number of its first line in the file."""
    read_block: Callable[[int, str], Block]
    incremental: bool = False
    """Its words are increments, once the modal state that it is read in is known."""
    no_insertion: bool = False
    """No block may be added before or behind its lines, as of `Block`."""

    def __len__(self) -> int:
        return self.last - self.first

    def part(self, first: int, last: int) -> PlainRun:
        """The lines from `first` to before `last` of the run."""
        return replace(self, first=self.first + first, last=self.first + last, number=self.number + first)

    def kept_block(self, index: int) -> Block:
        """The block of a line, which is kept for the next use."""
        known, at = self.lines.blocks, self.first + index
        found: Block | None = known.get(at)
        if found is None or found.no_insertion != self.no_insertion:
            found = known[at] = self.block(index)
        return found

    def block(self, index: int) -> Block:
        """The block of a line, as the reader of the dialect gives it."""
        block = self.read_block(self.number + index, self.data(index, index + 1).decode(ENCODING))
        return block._replace(no_insertion=True) if self.no_insertion else block

    def data(self, first: int, last: int) -> bytes:
        """The text of the lines from `first` to before `last`."""
        low, high = self.lines.starts[[self.first + first, self.first + last]].tolist()
        return self.lines.data[low:high]

    @property
    def vectors(self) -> PlainVectors | None:
        """The vectors of the lines; None if no line of their piece has one."""
        found, rows = self.lines.vectors, slice(self.first, self.last)
        return None if found is None else PlainVectors(found.tool[rows], found.normal[rows])

    @cached_property
    def columns(self) -> PlainColumns:
        """The words of the lines; positions are those in the piece."""
        return self._of_lines(self.lines.columns)

    @cached_property
    def feeds(self) -> Array:
        """Values of the F words `(lines,)`; nan where a line has none."""
        columns = self.with_feeds
        return np.where(columns.end[-2] > 0, columns.value[-2], np.nan)

    @cached_property
    def with_feeds(self) -> PlainColumns:
        """The words, and those of F and the last words, as of `PlainLines.with_feeds`."""
        return self._of_lines(self.lines.with_feeds)

    def _of_lines(self, columns: PlainColumns) -> PlainColumns:
        rows = slice(self.first, self.last)
        return PlainColumns(*(column[..., rows] for column in msgspec.structs.astuple(columns)))


class Blocks(Sequence[Block]):
    """The blocks of a chunk in their order; the block of a plain line is made on demand."""

    def __init__(self, items: Iterable[Block | PlainRun]) -> None:
        self.parts: list[list[Block] | PlainRun] = []
        """Runs of plain lines, and lists of the blocks between them."""
        for item in items:
            if isinstance(item, PlainRun):
                self.parts.append(item)
            elif self.parts and isinstance(self.parts[-1], list):
                self.parts[-1].append(item)
            else:
                self.parts.append([item])
        self.firsts = [0, *itertools.accumulate(map(len, self.parts))]
        """Index of the first block of each part, and the number of blocks."""
        self._last: tuple[int, Block] | None = None
        """The block that was taken last, and its index: the rows of one block follow one another."""

    def __len__(self) -> int:
        return self.firsts[-1]

    @overload
    def __getitem__(self, index: int) -> Block: ...
    @overload
    def __getitem__(self, index: slice) -> list[Block]: ...
    def __getitem__(self, index: int | slice) -> Block | list[Block]:
        if isinstance(index, slice):
            return [self[i] for i in range(*index.indices(len(self)))]
        if self._last is not None and self._last[0] == index:
            return self._last[1]
        index = int(index) + (len(self) if index < 0 else 0)
        if not 0 <= index < len(self):
            raise IndexError(index)
        number = bisect.bisect_right(self.firsts, index) - 1
        part, at = self.parts[number], index - self.firsts[number]
        block = part[at] if isinstance(part, list) else part.kept_block(at)
        self._last = index, block
        return block

    def __iter__(self) -> Iterator[Block]:
        for part in self.parts:
            yield from part if isinstance(part, list) else map(part.block, range(len(part)))

    @property
    def numbered(self) -> Iterator[tuple[int, Block]]:
        """The blocks that are no plain lines of a run, with their indices."""
        for part, first in zip(self.parts, self.firsts, strict=False):
            if isinstance(part, list):
                yield from enumerate(part, start=first)

    @property
    def read_singly(self) -> Iterator[Block]:
        """The blocks that are no plain lines of a run."""
        return itertools.chain.from_iterable(part for part in self.parts if isinstance(part, list))

    @property
    def size(self) -> int:
        """Number of characters."""
        return sum(
            sum(len(block.text) for block in part) if isinstance(part, list) else len(part.data(0, len(part)))
            for part in self.parts
        )

    @cached_property
    def line_numbers(self) -> np.ndarray:
        """Number of the first line of each block in the file `(blocks,)`."""
        numbers = [
            np.array([block.line for block in part])
            if isinstance(part, list)
            else np.arange(part.number, part.number + len(part))
            for part in self.parts
        ]
        return np.concatenate(numbers) if numbers else np.zeros(0, int)

    @cached_property
    def no_insertion(self) -> NDArrayBool:
        """True `(blocks,)` for the blocks next to which no block may be added."""
        marked = self.marked(lambda block: block.no_insertion)
        for part, first in zip(self.parts, self.firsts, strict=False):
            if isinstance(part, PlainRun) and part.no_insertion:
                marked[first : first + len(part)] = True
        return marked

    @cached_property
    def in_lists(self) -> NDArrayBool:
        """True `(blocks,)` for the blocks that are no plain lines of a run."""
        return self.marked(lambda _: True)

    def marked(self, mark: Callable[[Block], bool]) -> NDArrayBool:
        """True `(blocks,)` for the blocks that `mark` marks; it marks no plain line."""
        marked = np.zeros(len(self), bool)
        for part, first in zip(self.parts, self.firsts, strict=False):
            if isinstance(part, list):
                marked[first : first + len(part)] = list(map(mark, part))
        return marked


def joined(chunks: Iterable[Blocks]) -> Blocks:
    """The blocks of several chunks as one."""
    return Blocks(
        item for blocks in chunks for part in blocks.parts for item in (part if isinstance(part, list) else (part,))
    )
