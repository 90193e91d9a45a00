"""The feed in force in each block of a program."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from postproc.control.codes import DWELL
from postproc.siemens.codes import FEED_MODES
from postproc.text.block import Block
from postproc.text.blocks import Blocks

PER_MINUTE = 94.0
"""Feed mode in which F is a speed, mm/min or deg/min."""
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


def feeds_in_force(blocks: Blocks, before: Feed) -> list[Feed]:
    """The feed in force in each block; `before`: that before the first one."""
    return list(_followed(blocks, before))


def _followed(blocks: Blocks, feed: Feed) -> Iterator[Feed]:
    for block in blocks:
        feed = _after(block, feed)
        yield feed


def _after(block: Block, feed: Feed) -> Feed:
    """The feed in force after the words of a block."""
    for word in block.words:
        if word.address == "G" and word.value in FEED_MODES and word.value != feed.mode:
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
