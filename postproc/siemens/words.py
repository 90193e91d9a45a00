"""The words of a Siemens 840D block, sorted; an unknown word that could move the tool is refused."""

from __future__ import annotations

import re
from collections.abc import Callable

from postproc.control import words
from postproc.control.codes import SKIPPABLE_M
from postproc.control.words import refuse_two_of_a_group, value_of
from postproc.siemens.codes import (
    CORNERS,
    CYCLES,
    FRAME_NAMES,
    GROUPS,
    HARMLESS_ADDRESSES,
    HARMLESS_CALLS,
    HARMLESS_NAMES,
    MEANT_NAMES,
    MOVE_ADDRESSES,
    REFERENCE,
    REFUSED_NAMES,
    SKIPPABLE_G,
    SKIPPABLE_NAMES,
    SPLINE_WORDS,
)
from postproc.text.block import Block, Word

AXES = "XYZABCUVWEQ"
ALLOWED = HARMLESS_ADDRESSES | MOVE_ADDRESSES | CORNERS | SPLINE_WORDS | {"T", "D"}
"""Addresses that may be in any block."""
OF_CONTROL = re.compile(r"CYCLE\d+")
"""Names of cycles of the control: their variables are their own."""
_SPINDLE_M = re.compile(r"M\d+")
_SPINDLE_S = re.compile(r"[SH]\d+")
_MACHINE_AXIS = re.compile(r"[A-Z]\d+|FP")
"""Words of G74 and G75: a machine axis, or the number of a fixed point."""


class Content(words.Content):
    """The words of one block, sorted; `names` are words without a value and calls."""

    @property
    def moves(self) -> bool:
        """True for a block with an end point or a centre."""
        return bool(self.axes) or not MOVE_ADDRESSES.isdisjoint(self.other)

    @property
    def frames(self) -> set[str]:
        """The statements of the programmable frame."""
        return self.names.keys() & FRAME_NAMES if self.names else set()


def sort(block: Block, passive: tuple[str, ...] = ()) -> Content:
    """The words of a block by kind; those of `passive` axes are left out."""
    content, axes = Content(block), ""
    for i, word in enumerate(block.words):
        address = word.address
        if address in passive:
            continue
        if word.arguments is not None or word.start == word.end:
            content.names[address] = i
        elif address in AXES:
            if address in axes:
                raise block.refuse(f"the block has two {address} words: write one")
            axes += address
            content.axes.append(i)
        elif address == "G":
            content.g.append(word.value or 0.0)
        elif address[0] == "M" and (address == "M" or _SPINDLE_M.fullmatch(address)):
            content.m.append(word.value or 0.0)
        elif address in content.other:
            raise block.refuse(f"the block has two {address} words: write one")
        else:
            content.other[address] = i
    return content


def check(block: Block, content: Content, accept: Callable[..., None]) -> None:
    """Refuse words that are not known, and those that do not go together.

    accept: passes a name that the user accepts unchanged, as `Interpreter.accept`.
    """
    if block.skippable:
        active = content.moves or content.axes or not {"T", "D"}.isdisjoint(content.other)
        names = all(name in SKIPPABLE_NAMES for name in content.names)
        if active or not (names and SKIPPABLE_G.issuperset(content.g) and SKIPPABLE_M.issuperset(content.m)):
            raise block.refuse_skip()
    for name, i in content.names.items():
        if name in REFUSED_NAMES:
            raise block.refuse(f"{name} {REFUSED_NAMES[name]}")
        if not is_known(name, block.words[i]):
            reason = f"{name} is not known to ncomp: write the moves of this cycle, subprogram or function"
            accept(block, name, reason, moves=content.moves)
    if not ALLOWED.issuperset(content.other):
        _check_others(block, content)
    if len(content.g) > 1:
        refuse_two_of_a_group(block, content.g, GROUPS)
    if content.frames and (content.g or content.m or len(content.names) > 1 or content.other.keys() - {"N", "RPL"}):
        raise block.refuse(
            "a frame statement (TRANS, ROT, SCALE, MIRROR, ...) must be alone in its block: write the "
            "other words in a block of their own"
        )


def _check_others(block: Block, content: Content) -> None:
    """Words that are allowed in some blocks only: numbers of spindles, RPL in a frame, machine axes in G74 and G75."""
    machine_axes = set(filter(_MACHINE_AXIS.fullmatch, content.other)) if REFERENCE & set(content.g) else set()
    rotation = {"RPL"} if content.frames else set()
    for address in sorted(content.other.keys() - ALLOWED - machine_axes - rotation):
        if not _SPINDLE_S.fullmatch(address):
            raise block.refuse(_strange(address))


def is_known(name: str, word: Word) -> bool:
    """True for a word or call that ncomp follows or passes."""
    known = HARMLESS_CALLS | CYCLES if word.arguments is not None else HARMLESS_NAMES | FRAME_NAMES
    return name in known or name in MEANT_NAMES


def _strange(address: str) -> str:
    if address == "L":
        return "L calls a subprogram: write its number behind it"
    if address == "RPL":
        return "RPL has no rotation: write ROT or AROT before it"
    if re.fullmatch(r"[ABC][24-7]|LEAD|TILT|THETA|PHI|PSI", address):
        return f"{address} is an orientation that is not corrected: write A3 B3 C3 or the rotary axes"
    return f"the address {address} is not known to ncomp: remove it"


# ---- values


def plain_of(block: Block, word: Word) -> float:
    """The number of a word without AC, IC and the like."""
    if word.mode:
        raise block.refuse(f"{word.mode} has no meaning in {word.address}: write the number alone")
    return value_of(block, word)
