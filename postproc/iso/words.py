"""The words of one ISO block, sorted; what controls read in different ways is refused, whatever the modes are."""

from __future__ import annotations

from dataclasses import dataclass, field

from postproc.control.codes import AXES, SKIPPABLE_M
from postproc.iso.blocks import WORDS
from postproc.iso.codes import CYCLES, DWELL, ENDS, GROUPS, LENGTH_CODES, MEANINGFUL, MOTION, NAMING, REFUSED_G
from postproc.text.block import Block, Refusal


@dataclass(slots=True)
class Content:
    """The words of one block, sorted."""

    block: Block
    g: list[float] = field(default_factory=list)
    m: list[float] = field(default_factory=list)
    axes: list[int] = field(default_factory=list)
    """Indices of the axis words."""
    other: dict[str, int] = field(default_factory=dict)
    """Indices of all other words by address."""

    own: dict[str, int] = field(default_factory=dict)
    """Those of these words that belong to M functions."""

    @property
    def ends(self) -> list[float]:
        """The codes that end a rotation or a preset, whatever else the block contains, in the order of execution."""
        if self.axes or not self.other.keys().isdisjoint("IJKRPL"):
            return []
        return [code for code in ENDS if code in self.g]

    @property
    def moves(self) -> bool:
        """True where a word may say a place."""
        return bool(self.axes) or not self.other.keys().isdisjoint("IJKR")

    def refuse(self, reason: str) -> Refusal:
        """The exception that stops the run at this block."""
        return self.block.refuse(reason)


def sort_words(block: Block) -> Content:
    """The content of a block; Refusal for one address twice."""
    content, done = Content(block), ""
    for i, word in enumerate(block.words):
        address = word[0]
        if address == "G":
            content.g.append(word[1] or 0.0)
        elif address == "M":
            content.m.append(word[1] or 0.0)
        elif address in done:
            raise block.refuse(f"two {address} words")
        else:
            done += address
            if address in AXES:
                content.axes.append(i)
            else:
                content.other[address] = i
    return content


def check_content(content: Content, begun: bool, family: str) -> None:
    """Refuse what no reading is sure of; `begun`: the program has words before this block."""
    block, g, other = content.block, content.g, content.other
    if block.skippable and not _may_be_skipped(content):
        raise block.refuse("whether it runs depends on the block-skip switch")
    if "O" in other and begun:
        raise block.refuse("a second program in one file")
    if ";" in block.text:
        _check_line_end(block)
    if "H" in other and LENGTH_CODES.isdisjoint(g) and REFUSED_G.keys().isdisjoint(g):
        raise block.refuse("H without G43: some controls take the new length at once, others do not")
    if len(g) > 1:
        naming = NAMING - {DWELL} if family == "linuxcnc" else NAMING
        if content.axes and not naming.isdisjoint(g) and not (MOTION.keys() | CYCLES).isdisjoint(g):
            raise block.refuse("coordinates that two codes may take")
        alone = [code for code in g if code not in content.ends]
        for group in GROUPS:
            clash = sorted(group.intersection(alone))
            if len(clash) > 1:
                raise block.refuse(f"G{clash[0]:g} and G{clash[1]:g} in one block")


def _may_be_skipped(content: Content) -> bool:
    """Whether no other block depends on this one: M functions that move nothing, and a dwell."""
    if content.moves or "T" in content.other or not SKIPPABLE_M.issuperset(content.m):
        return False
    return not content.g or (content.g == [DWELL] and "P" in content.other)


def _check_line_end(block: Block) -> None:
    """Refuse words behind a semicolon that stands behind words: where it ends a block, they are the next one."""
    _, mark, rest = block.text[block.words[-1].end :].partition(";")
    if mark and WORDS.fullmatch(rest.rstrip("\r\n")) and not MEANINGFUL.isdisjoint(rest.upper()):
        raise block.refuse("words behind a semicolon: a comment on some controls, the next block on others")
