"""Which block opens and which one closes each loop, branch and subprogram of a program."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence

import msgspec

from postproc.text.block import Block
from postproc.text.statements import Again, Begin, Else, End, Leave, Step

LOOPS = frozenset(("WHILE", "FOR", "LOOP", "DO", "REPEAT"))


class Structures(msgspec.Struct):
    """The structures of a program by index of their blocks; each has a block of its own."""

    steps: dict[int, Begin | Else | End] = msgspec.field(default_factory=dict)
    begin: dict[int, int] = msgspec.field(default_factory=dict)
    """The block that opened the structure of an Else, an End, a Leave or an Again."""
    end: dict[int, int] = msgspec.field(default_factory=dict)
    """The block that closes a Begin or an Else."""
    following: dict[int, int] = msgspec.field(default_factory=dict)
    """The next Else, or the End, of a Begin or an Else."""
    with_leave: set[int] = msgspec.field(default_factory=set)
    """Blocks that open a loop that contains a Leave of this loop."""


def find_structures(blocks: Sequence[Block], first: int = 0, found: Structures | None = None) -> Structures:
    """Pair the blocks from `first` on, in addition to those that are found; Refusal for one without its partner."""
    found = found or Structures()
    open_: list[list[int]] = []
    for i, block in enumerate(itertools.islice(blocks, first, None), start=first):
        if block.code is None:
            continue
        for step in _inner(block.code.before + block.code.after):
            if isinstance(step, (Leave, Again)):
                found.begin[i] = _loop(found, open_, block, step.key)
                found.with_leave |= {found.begin[i]} if isinstance(step, Leave) else set()
            elif isinstance(step, (Begin, Else, End)):
                _pair(found, open_, i, block, step)
    if open_:
        block = blocks[open_[-1][0]]
        raise block.refuse("the end of this loop, branch or subprogram is missing: write it")
    return found


def _inner(steps: Iterable[Step]) -> Iterable[Step]:
    for step in steps:
        yield step
        then = getattr(step, "then", None)
        if then is not None:
            yield then


def _pair(found: Structures, open_: list[list[int]], i: int, block: Block, step: Begin | Else | End) -> None:
    opened = found.steps[open_[-1][0]] if open_ else None
    closes_do = isinstance(opened, Begin) and opened.kind == "DO" and opened.key == step.key
    if isinstance(step, Begin) and step.kind == "WHILE" and step.key and closes_do:
        step = End("DO", step.key, again=step.test)
    found.steps[i] = step
    if isinstance(step, Begin):
        open_.append([i])
        return
    kind_opened = "IF" if isinstance(step, Else) else step.kind
    if not isinstance(opened, Begin) or (opened.kind, opened.key) != (kind_opened, step.key):
        raise block.refuse("the block ends a loop, branch or subprogram that does not begin before it")
    members = open_[-1]
    found.begin[i] = members[0]
    found.following[members[-1]] = i
    if isinstance(step, Else):
        members.append(i)
        return
    found.end.update(dict.fromkeys(members, i))
    open_.pop()


def _loop(found: Structures, open_: list[list[int]], block: Block, key: str) -> int:
    for members in reversed(open_):
        step = found.steps[members[0]]
        if isinstance(step, Begin) and step.kind in LOOPS and key in ("", step.key):
            return members[0]
    raise block.refuse("the block leaves or continues a loop and is in none: write it in a loop or delete it")
