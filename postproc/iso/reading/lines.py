"""Lines of ISO programs: the leader of a tape, and the largest length of a line."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator

from kinematics.machine import Control
from postproc.iso.reading.blocks import plain_block
from postproc.iso.reading.calls import CALLS, with_calls
from postproc.text.block import Block, Refusal

MOST_LEADER_LINES = 100
"""Largest number of lines of a leader, and of lines that are examined after it."""
DETAIL = "leader"


class Leader(str):
    """The lines up to the first tape mark as one text, for a block of its own."""

    __slots__ = ()


def join_lines(lines: Iterable[tuple[int, str]]) -> Iterator[tuple[int, str]]:
    """Numbered lines, those of a leader and of the tape mark behind it as one."""
    remaining = iter(lines)
    first = list(itertools.islice(remaining, 2 * MOST_LEADER_LINES))
    end = next((i for i, (_, text) in enumerate(first[:MOST_LEADER_LINES]) if text.lstrip("\0 \t").startswith("%")), 0)
    goes_on = any(text.strip() for _, text in first[end + 1 :])
    if end and goes_on and _is_leader(first[:end]):
        yield first[0][0], Leader("".join(text for _, text in first[: end + 1]))
        first = first[end + 1 :]
    yield from first
    yield from remaining


def read_line(line: int, text: str) -> Block:
    """The block of a line, or of a leader."""
    if isinstance(text, Leader):
        return Block(line, text, "tape_mark", detail=DETAIL)
    return read_block(line, text)


def read_block(line: int, text: str) -> Block:
    """The block of one line of text, its end of line included. Refusal when the grammar doesn't know it."""
    block = plain_block(line, text)
    if block is None:
        from postproc.iso.reading.grammar import parse_block

        block = parse_block(line, text)
    return with_calls(block) if CALLS.search(text) else block


def _is_leader(lines: list[tuple[int, str]]) -> bool:
    """Whether some line is no block, and none has words that a control could run."""
    strange = False
    for line, text in lines:
        try:
            block = read_block(line, text)
        except Refusal:
            strange = True
            continue
        if block.words or block.code:
            return False
        strange |= block.kind != "blank"
    return strange


# ---- lengths of lines

LINUXCNC = 253
"""Characters, end of line included, that LinuxCNC 2.9 reads at most (its buffer has 255)."""


def refuse_long_line(control: Control, block: Block) -> None:
    """Refuse a line of the program, comments among them, that LinuxCNC can't read, where the control is one."""
    if control.family == "linuxcnc" and len(block.text) > LINUXCNC and _longest(block.text) > LINUXCNC:
        raise block.refuse(
            f"the line has {_longest(block.text)} characters, and LinuxCNC reads {LINUXCNC}: make it shorter"
        )


def refuse_lengthened(control: Control, block: Block, text: str) -> None:
    """Refuse a block that has become too long for LinuxCNC, unless the control is another; `text`: its present text."""
    if control.family == "fanuc":
        return
    if len(text) > LINUXCNC and _longest(text) > LINUXCNC >= _longest(block.text):
        raise block.refuse(
            f"its corrected line has {_longest(text)} characters, and LinuxCNC reads {LINUXCNC}: make it shorter, "
            'or write family = "fanuc" in the machine file'
        )


def _longest(text: str) -> int:
    return max(map(len, text.splitlines(keepends=True)), default=0)
