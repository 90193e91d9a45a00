"""Blocks with a slash: the block-skip switch of the control decides whether they run."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from typing import Literal, TypeAlias

from postproc.text.block import Block
from postproc.text.blocks import PlainRun
from postproc.text.notes import Notes
from postproc.text.statements import Label

BlockSkip: TypeAlias = Literal["", "on", "off"]
"""Position of the switch: on, so that blocks with a slash do not run; off; or empty where nobody states it."""
_AT_START = re.compile(r"\s*(?:[N:]?\s*\d+)?\s*/", re.IGNORECASE)
TEXTS = {
    "on": "blocks with a slash are taken to be skipped (block skip on)",
    "off": "blocks with a slash are taken to run (block skip off)",
}


def decided(items: Iterable[Block | PlainRun], switch: BlockSkip, notes: Notes) -> Iterator[Block | PlainRun]:
    """The blocks as the switch lets them run; those that the dialect has to judge stay as they are."""
    for item in items:
        yield item if isinstance(item, PlainRun) or not item.skippable else decide(item, switch, notes)


def decide(block: Block, switch: BlockSkip, notes: Notes) -> Block:
    """One block; Refusal where it has a slash and statements, and nobody states the switch."""
    if not block.skippable:
        return block
    steps = block.code.before + block.code.after if block.code is not None else ()
    if not switch:
        if steps:
            raise block.refuse_skip()
        return block
    notes.add(TEXTS[switch], block.line)
    if switch == "off":
        return block._replace(skippable=False)
    if not _AT_START.match(block.text) or any(isinstance(step, Label) for step in steps):
        raise block.refuse(
            "what the control skips here depends on it: write the slash at the beginning of a block without a label"
        )
    numbers = tuple(word for word in block.words if word.address == "N")
    return block._replace(kind="words" if numbers else "blank", words=numbers, code=None, skippable=False)
