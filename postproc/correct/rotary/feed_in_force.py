"""The feed in force in each block of a program."""

from __future__ import annotations

import bisect
from collections.abc import Sequence
from typing import NamedTuple, overload

import numpy as np

from postproc.control.codes import DWELL
from postproc.siemens.codes import FEED_TYPES
from postproc.text.block import Block
from postproc.text.blocks import Blocks

PER_MINUTE = 94.0
"""Feed mode in which F is a speed, mm/min or deg/min."""
FEED_IS_KNOWN = frozenset(("fanuc", "linuxcnc"))
"""Families of ISO controls whose F for linear and rotary axes in one block is known."""
OTHER_FEEDS = frozenset(("FAUTO", "FU", "FZ"))
"""Addresses of feeds of the tool table, per revolution and per tooth."""
TCP_M = 128.0
"""Klartext: an F behind M128 limits the speed of the compensating moves."""


class Feed(NamedTuple):
    """The feed in force."""

    value: float | None = None
    """Number of the last F; None if it is not known."""
    mode: float = PER_MINUTE
    grouped: bool = False
    """Siemens: FGROUP has chosen the axes whose path F is for."""


class FeedsInForce(Sequence[Feed]):
    """The feed in force in each block."""

    def __init__(self, blocks: Blocks, before: Feed) -> None:
        """`before`: the feed before the first block."""
        self.values = np.empty(len(blocks))
        """Numbers of the last F `(blocks,)`; nan where it is not known."""
        self._others: dict[int, Feed] = {}
        """The feed behind each part of the blocks, or each block that is no plain line, by its index."""
        feed = before
        for part, first in zip(blocks.parts, blocks.firsts, strict=False):
            if isinstance(part, list):
                for index, block in enumerate(part, start=first):
                    self._others[index] = feed = _after(block, feed)
                    self.values[index] = np.nan if feed.value is None else feed.value
                continue
            last = np.maximum.accumulate(np.where(np.isfinite(part.feeds), np.arange(len(part)), -1))
            held = np.nan if feed.value is None else feed.value
            self.values[first : first + len(part)] = np.where(last >= 0, part.feeds[last], held)
            self._others[first] = feed
            feed = feed._replace(value=_known(float(self.values[first + len(part) - 1])))
        self._indices = sorted(self._others)

    def __len__(self) -> int:
        return len(self.values)

    @overload
    def __getitem__(self, index: int) -> Feed: ...
    @overload
    def __getitem__(self, index: slice) -> list[Feed]: ...
    def __getitem__(self, index: int | slice) -> Feed | list[Feed]:
        if isinstance(index, slice):
            return [self[i] for i in range(*index.indices(len(self)))]
        index = range(len(self))[index]
        other = self._others[self._indices[bisect.bisect_right(self._indices, index) - 1]]
        return other._replace(value=_known(float(self.values[index])))


def _known(value: float) -> float | None:
    return None if np.isnan(value) else value


def _after(block: Block, feed: Feed) -> Feed:
    """The feed in force after the words of a block."""
    for word in block.words:
        if word.address == "G" and word.value in FEED_TYPES and word.value != feed.mode:
            feed = feed._replace(value=None, mode=word.value)
    if "FGROUP" in block.text.upper():
        feed = feed._replace(grouped=True)
    if any(word.address == "G" and word.value == DWELL for word in block.words):
        return feed  # its F is the time of the dwell
    for word in block.words:
        if word.address == "M" and word.value == TCP_M:
            break
        if word.address in OTHER_FEEDS:
            feed = feed._replace(value=None)
        if word.address == "F":
            feed = feed._replace(value=None if word.formula else word.value)
    return feed
