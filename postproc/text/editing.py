"""Changing the words of one block in the style they are written in."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import msgspec
from msgspec.structs import replace

from postproc.text.block import Block, Edit, Word
from postproc.text.number_style import NumberStyle, decimals_of

ORDER = "XYZABCUVWIJKR"


CARRIERS = {address: 450 + i for i, address in enumerate((*ORDER, "PR", "PA", "Q216", "Q217", "Q225", "Q226"))}
"""Klartext: numbers of the QL parameters that take corrected coordinates."""
_RANKS = {letter: i for i, letter in enumerate(ORDER)}
_RANKS.update({f"I{letter}": i for i, letter in enumerate(ORDER) if letter not in "IJKR"})
_RANKS.update({"PR": -2, "IPR": -2, "PA": -1, "IPA": -1})


def end_of(text: str) -> str:
    """How the last line of a text ends, empty where it has no end."""
    return text[len(text.rstrip("\r\n")) :]


def rank_of(address: str) -> int:
    """Rank of an added word among coordinates."""
    return _RANKS[address if address in _RANKS else address[0]]


def rank(word: Word) -> int | None:
    """Rank of a word (X, or IX for a Klartext increment) among coordinates; None for other words."""
    return _RANKS.get(word.address) if word.start < word.end else None


class Form(NamedTuple):
    """How a word shows the value that it leads to."""

    number: Callable[[float], float] = float
    """The number of a word for a value."""
    mode: str = ""
    """Siemens: mode of the word, DC."""


PLAIN = Form()


class Layout(msgspec.Struct, frozen=True):
    """How a program separates words and writes numbers, learned from the blocks before."""

    blank: bool = True
    numbers: NumberStyle = msgspec.field(default_factory=NumberStyle)
    end: str = "\n"
    """How lines end."""

    def after(self, block: Block) -> Layout:
        """The layout, extended by one more block."""
        numbers = self.numbers
        for word in block.words:
            if rank(word) is not None and word.formula is None:
                numbers = NumberStyle.of(block.text[word.start : word.end], numbers)
        blank = block.text[block.words[-1].at - 1] in " \t" if len(block.words) > 1 else self.blank
        end = end_of(block.text) or self.end
        same = numbers is self.numbers and blank == self.blank and end == self.end
        return self if same else Layout(blank, numbers, end)


class Iterations(msgspec.Struct):
    """The numbers that a block was given when it ran first: it keeps them where others differ by no more than `counts`.

    So a block of a loop has one text, which is that of its first iteration in style too.
    """

    layout: Layout
    counts: float
    """Largest difference of a number from that of the first iteration, in units of its last decimal."""
    numbers: dict[str, float | None] = msgspec.field(default_factory=dict)
    """Numbers by a name for the word; None for a word that was left out."""

    def agreed(self, name: str, number: float, decimals: int) -> float:
        """The number of the first iteration, if it is near enough."""
        first = self.numbers.setdefault(name, number)
        return first if first is not None and self._near(first, number, decimals) else number

    def added(self, name: str, number: float | None, wanted: float, held: float, decimals: int) -> float | None:
        """The same for a word that may be omitted: None if the position `held` is near enough to `wanted`."""
        first = self.numbers.setdefault(name, number)
        return first if self._near(held if first is None else first, wanted, decimals) else number

    def chosen(self, name: str, choice: bool) -> bool:
        """The choice of the first iteration."""
        return bool(self.numbers.setdefault(name, float(choice)))

    def _near(self, first: float, number: float, decimals: int) -> bool:
        return abs(number - first) <= self.counts * 10.0**-decimals


class WordEditor(msgspec.Struct):
    """Collects the edits of one block; values in the units of its words."""

    block: Block
    layout: Layout
    iterations: Iterations | None = None
    """Iterations of a block that may run several times."""
    edits: list[Edit] = msgspec.field(default_factory=list)

    def set(self, index: int, value: float, decimals: int) -> float:
        """Set a word to `value`, with no fewer decimals than it has or than given; returns its new value."""
        word = self.block.words[index]
        if word.formula is None:
            return self._set_number(index, word, value, decimals)
        number = self.rounded(index, value, decimals)
        if word.formula.instead:
            self._write_coordinate(word, number, decimals)
        elif word.formula.reads:
            self.edits.append(Edit(word.start, word.end, self.layout.numbers.write(number, decimals)))
        elif number != word.value and word.formula.carrier:
            self._carry(word, number - (word.value or 0.0), max(decimals_of(self._number(word)), decimals))
        elif number != word.value:
            shift = f"{number - (word.value or 0.0):+.{max(decimals_of(self._number(word)), decimals)}f}"
            text = word.formula.plus(self.block.text[word.start : word.end], shift)
            self.edits.append(Edit(word.start, word.end, text))
        return number

    def _set_number(self, index: int, word: Word, value: float, decimals: int) -> float:
        """As `set`, of a word without a formula."""
        text, number = self.block.text[word.start : word.end], self.rounded(index, value, decimals)
        if number != word.value:
            style = NumberStyle.of(text, self.layout.numbers)
            self.edits.append(Edit(word.start, word.end, style.write(number, max(decimals_of(text), decimals))))
        return number

    def rounded(self, index: int, value: float, decimals: int) -> float:
        """The value of a word after `set` to `value`: its present value if this is the same rounded."""
        word, counted = self.block.words[index], decimals
        original = word.value or 0.0
        if word.formula is not None:
            original = 0.0 if word.formula.instead or word.formula.reads else original
            return original + self.agreed(f"shift {index}", round(value - original, decimals), counted)
        decimals = max(decimals_of(self.block.text[word.start : word.end]), decimals)
        number = round(value, decimals)
        number = original if abs(number - original) < 0.5 * 10.0**-decimals else number
        return number if self.iterations is None else self.agreed(f"word {index}", number, counted)

    def agreed(self, name: str, number: float, decimals: int) -> float:
        """The number that a word of this name had when the block ran first, where that is near enough."""
        return number if self.iterations is None else self.iterations.agreed(name, number, decimals)

    def add(self, address: str, wanted: float, held: float, decimals: int, form: Form = PLAIN) -> float:
        """Add a word if the rounded wanted value differs from the held one; returns the value of the control then."""
        number = None if round(wanted - held, decimals) == 0.0 else round(wanted, decimals)
        if self.iterations is not None:
            number = self.iterations.added(address, number, wanted, held, decimals)
        if number is None:
            return held
        self.insert(address, form.number(number), decimals)
        return number

    def insert(self, address: str, value: float, decimals: int) -> None:
        """Add a word at its rank in the order PR PA X Y Z A B C U V W I J K R."""
        ranked = [(r, word) for word in self.block.words if (r := rank(word)) is not None]
        before = [word for r, word in ranked if r < rank_of(address)]
        if not ranked:
            raise self.block.refuse(
                f"the correction must add {address} to this block, which has no axis word: write {address} in it"
            )
        neighbour = before[-1] if before else ranked[0][1]
        text = self._like(neighbour, address, value, decimals)
        blank = " " if self.layout.blank else ""
        at = neighbour.end + neighbour.tail if before else neighbour.at
        self.edits.append(Edit(at, at, blank + text if before else text + blank))

    def cut(self, word: Word) -> str:
        """Remove a word, with the blanks before it; returns its text."""
        text = self.block.text
        start = len(text[: word.at].rstrip(" \t"))
        follows = text[word.end + word.tail : word.end + word.tail + 1]
        gap = start if start and text[start : word.at] and follows.strip() == "" else word.at
        self.edits.append(Edit(gap, word.end + word.tail, ""))
        return text[word.at : word.end + word.tail]

    def replace(self, index: int, words: list[tuple[str, float]], decimals: int) -> None:
        """Replace a word by others."""
        word = self.block.words[index]
        texts = [self._like(word, address, value, decimals) for address, value in words]
        self.edits.append(Edit(word.at, word.end + word.tail, (" " if self.layout.blank else "").join(texts)))

    def remove(self, index: int) -> None:
        """Remove a word, and the blanks before it."""
        word = self.block.words[index]
        before = self.block.text[: word.at]
        self.edits.append(Edit(len(before.rstrip(" \t")), word.end + word.tail, ""))

    def put(self, start: int, end: int, text: str) -> None:
        """Replace a part of the block's text."""
        self.edits.append(Edit(start, end, text))

    def centre_before(self, words: list[tuple[str, float]], decimals: int) -> None:
        """Klartext: add the pole of an arc before it."""
        body = " ".join(address + self.layout.numbers.write(value, decimals) for address, value in words)
        self.lines_before([f"CC {body}"])

    def lines_before(self, lines: list[str]) -> None:
        """Put lines before the block, ended as the block is."""
        self._refuse_insertion()
        end = self._end or self.layout.end
        self.edits.append(Edit(0, 0, "".join(line + end for line in lines)))

    def lines_after(self, lines: list[str]) -> None:
        """Put lines behind the block, ended as the block is; the last block of a file may have no end."""
        self._refuse_insertion()
        at = len(self.block.text)
        text = "".join(line + self._end if self._end else self.layout.end + line for line in lines)
        self.edits.append(Edit(at, at, text))

    def insert_motion_code(self, code: str) -> None:
        """Put a G code in front of the block's words, behind its number."""
        first = next(word for word in self.block.words if word.address != "N")
        lower = self.block.text[first.at].islower()
        self.edits.append(Edit(first.at, first.at, (code.lower() if lower else code) + " " * self.layout.blank))

    def _write_coordinate(self, word: Word, number: float, decimals: int) -> None:
        """Siemens: replace a word by the coordinate, or the radius, that it describes."""
        equals = "=" if len(word.address) > 1 else ""
        text = f"{word.address}{equals}{self.layout.numbers.write(number, decimals)}"
        self.edits.append(Edit(word.at, word.end + word.tail, text))

    def _carry(self, word: Word, shift: float, decimals: int) -> None:
        """Klartext: give a parameter of ncomp's own the sum, and the word that parameter."""
        name = f"QL{CARRIERS[word.address.removeprefix('I')]}"
        text = "".join(self.block.text[word.start : word.end].split())
        summand = text if text[0] in "+-" else f"+{text}"
        style = replace(self.layout.numbers, plus=True)
        self.lines_before([f"FN 1: {name} ={summand} + {style.write(shift, decimals)}"])
        self.edits.append(Edit(word.start, word.end, f"+{name}"))

    def _refuse_insertion(self) -> None:
        if self.block.no_insertion:
            raise self.block.refuse(
                "the correction needs an added block here, which is not possible: a jump would skip it, a modal macro "
                "or radius compensation would act on it, or its coordinates would be of another kind"
            )

    @property
    def _end(self) -> str:
        return end_of(self.block.text)

    def _like(self, neighbour: Word, address: str, value: float, decimals: int) -> str:
        lower = self.block.text[neighbour.at].islower()
        gap = " " if self.block.text[neighbour.at + len(neighbour.address) : neighbour.start].isspace() else ""
        decimals = max(decimals, decimals_of(self._number(neighbour)))
        return (address.lower() if lower else address) + gap + self._style(neighbour).write(value, decimals)

    def _number(self, word: Word) -> str:
        """The number of a word as it is written; empty for a formula."""
        return "" if word.formula else self.block.text[word.start : word.end]

    def _style(self, word: Word) -> NumberStyle:
        return NumberStyle.of(self._number(word), self.layout.numbers)
