"""Words of one block, sorted by address, and their numbers."""

from __future__ import annotations

from collections.abc import Collection, Iterable

import msgspec

from postproc.control.codes import LARGEST_CODE
from postproc.text.block import Block, Refusal, Word
from postproc.text.expressions import Constant, Formula


class Content(msgspec.Struct):
    """The words of one block, sorted."""

    block: Block
    g: list[float] = msgspec.field(default_factory=list)
    m: list[float] = msgspec.field(default_factory=list)
    axes: list[int] = msgspec.field(default_factory=list)
    """Indices of the axis words."""
    names: dict[str, int] = msgspec.field(default_factory=dict)
    """Indices of the words and calls without a value that the dialect reads by their names."""
    other: dict[str, int] = msgspec.field(default_factory=dict)
    """Indices of all other words by address."""

    def refuse(self, reason: str) -> Refusal:
        """The exception that stops the run at this block."""
        return self.block.refuse(reason)


def value_of(block: Block, word: Word) -> float:
    """The number of a word; Refusal where the program does not give it, or no control reads it."""
    if word.value is None or not abs(word.value) < LARGEST_CODE:
        raise no_number(block, word)
    return word.value


def no_number(block: Block, word: Word) -> Refusal:
    """The exception for a word without a number that can be used."""
    if word.value is not None:
        return block.refuse(f"{word.address} has a number that no control reads: write one below {LARGEST_CODE:g}")
    return block.refuse(
        f"{block.text[word.at : word.end]}: its value is known only while the program runs: assign the variable "
        "in the program or write a number"
    )


def whole_of(block: Block, word: Word) -> int:
    """The whole number of a word."""
    value = value_of(block, word)
    if value != int(value):
        raise block.refuse(f"{word.address} has a number that is not whole: write a whole number")
    return int(value)


def refuse_two_of_a_group(block: Block, codes: Iterable[float], groups: Iterable[Collection[float]]) -> None:
    """Refusal for two G codes of one modal group."""
    present = set(codes)
    for group in groups:
        both = sorted(present.intersection(group))
        if len(both) > 1:
            raise block.refuse(f"G{both[0]:g} and G{both[1]:g} in one block exclude each other: write one of them")


def with_word(block: Block, index: int, word: Word) -> Block:
    """The block with one word replaced."""
    return block._replace(words=(*block.words[:index], word, *block.words[index + 1 :]))


def given_as(word: Word, address: str, value: float) -> Word:
    """The word of a coordinate, or of a radius, that replaces it in a corrected block."""
    return Word(address, value, word.at, word.at, word.end + word.tail, Formula(Constant(value), instead=True))
