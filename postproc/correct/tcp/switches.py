"""The words of each dialect that switch TCP, and what a converted program has in their place."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from kinematics.machine import NDArrayBool
from postproc.dialects import Dialect
from postproc.iso.offsets import TCP_CODES
from postproc.motion.moves import Kind
from postproc.siemens.codes import VECTOR_WORDS
from postproc.text.block import Block, Edit
from postproc.text.blocks import Blocks
from postproc.write.editors import Rewrite

_TCPM = re.compile(r"FUNCTION\s+(RESET\s+)?TCPM\b.*?(?=\s*[\r\n]|$)", re.IGNORECASE | re.DOTALL)
_LN = re.compile(r"\bLN\b", re.IGNORECASE)
VECTORS = {
    "iso": frozenset("IJK"),
    "siemens": VECTOR_WORDS,
    "heidenhain": frozenset(("NX", "NY", "NZ", "TX", "TY", "TZ")),
}
"""Words of tool vectors and surface normals."""
M128, M129 = 128.0, 129.0


def switch_off(dialect: Dialect, index: int, block: Block, rewrite: Rewrite) -> None:
    """A block of a program of the tool point without its words for TCP."""
    if dialect.name == "iso":
        found = [word for word in block.words if word.address == "G" and word.value in TCP_CODES]
        rewrite.edits.setdefault(index, []).extend(Edit(word.start, word.end, "43") for word in found)
    elif dialect.name == "siemens":
        found = [word for word in block.words if word.address == "TRAORI"]
        rewrite.edits.setdefault(index, []).extend(Edit(word.at, word.end, "TRAFOOF") for word in found)
    else:
        _switch_off_klartext(dialect, index, block, rewrite)
    if not rewrite.edits.get(index, True):
        del rewrite.edits[index]


def _switch_off_klartext(dialect: Dialect, index: int, block: Block, rewrite: Rewrite) -> None:
    gone = [i for i, word in enumerate(block.words) if word.address == "M" and word.value in (M128, M129)]
    if gone and any(block.words[i].value == M128 for i in gone):  # its F limits the speed of the compensating moves
        gone += [i for i in range(gone[0], len(block.words)) if block.words[i].address in ("F", "FMAX")]
    alone = _without_words(block, gone, dialect.comment) if gone else None
    if alone is not None:
        rewrite.edits[index] = [alone]
    elif gone:
        rewrite.cut[index] = gone
    if block.kind == "function" and (match := _TCPM.search(block.text)):
        rewrite.edits[index] = [Edit(match.start(), match.end(), dialect.comment.format(match[0]))]


def spell_vector(dialect: Dialect, index: int, block: Block, rewrite: Rewrite) -> bool:
    """Take the tool vector out of a block; False for a block without one."""
    gone = [i for i, word in enumerate(block.words) if word.address in VECTORS[dialect.name]]
    if not gone:
        return False
    rewrite.cut[index] = [*rewrite.cut.get(index, ()), *gone]
    rewrite.spelled.add(index)
    if match := _LN.search(block.text) if block.kind == "normal_line" else None:
        rewrite.edits.setdefault(index, []).append(Edit(match.start(), match.end(), "L"))
    return True


@dataclass
class SwitchedOn:
    """Where a program of axis positions gets TCP: its state is carried from chunk to chunk."""

    dialect: Dialect
    always: bool
    """The control positions the tool point from the start."""
    on: bool = field(init=False)

    def __post_init__(self) -> None:
        self.on = self.always

    def follow(self, blocks: Blocks, kinds: dict[int, list[Kind]], ready: NDArrayBool, rewrite: Rewrite) -> NDArrayBool:
        """True `(blocks,)` for the blocks whose moves are those of the tool point.

        kinds: of the moves of each block that is no plain line; ready `(blocks,)`: True for feed moves from and to
        known positions of all axes.
        """
        inside = np.full(len(blocks), self.always)
        for part, first in zip(blocks.parts, blocks.firsts, strict=False) if not self.always else ():
            if isinstance(part, list):
                for index, block in enumerate(part, start=first):
                    if self.dialect.name == "iso":
                        self._follow_length(index, block, kinds.get(index, []), rewrite)
                    else:
                        self._put_lines(index, block, kinds.get(index, []), bool(ready[index]), rewrite)
                    inside[index] = self.on
                continue
            begins = 0 if self.on else len(part)  # a plain line never ends TCP
            if not self.on and self.dialect.name != "iso" and ready[first : first + len(part)].any():
                begins = int(ready[first : first + len(part)].argmax())
                self._put_lines(first + begins, part.block(begins), [Kind.LINE], True, rewrite)
            inside[first + begins : first + len(part)] = True
        return inside

    def _follow_length(self, index: int, block: Block, kinds: list[Kind], rewrite: Rewrite) -> None:
        """G43 becomes G43.4, and G49 ends it."""
        codes = {word.value for word in block.words if word.address == "G"}
        for word in block.words:
            if word.address == "G" and word.value == 43.0:
                rewrite.edits.setdefault(index, []).append(Edit(word.start, word.end, "43.4"))
                rewrite.whole.add(index)
                self.on = True
        ends = 49.0 in codes or any(word.address == "M" and word.value in (2.0, 6.0, 30.0) for word in block.words)
        if self.on and not ends and (codes & {28.0, 30.0, 53.0} or Kind.MACHINE in kinds):
            raise block.refuse(
                "a reference position or machine coordinates while the tool length is in force: FANUC refuses them "
                "under G43.4. Write G49 before this block"
            )
        self.on = self.on and not ends

    def _put_lines(self, index: int, block: Block, kinds: list[Kind], ready: bool, rewrite: Rewrite) -> None:
        """TRAORI and TRAFOOF, or M128 and M129, in lines of their own."""
        begin, end = ("TRAORI", "TRAFOOF") if self.dialect.name == "siemens" else ("M128", "M129")
        if self.on and not self._stays(block, kinds):
            self.on = False
            rewrite.before.setdefault(index, []).append(end)
        elif not self.on and ready:
            self.on = True
            rewrite.before.setdefault(index, []).append(begin)
            rewrite.whole.add(index)

    @staticmethod
    def _stays(block: Block, kinds: list[Kind]) -> bool:
        """True for a move of the tool point, and for a block without effect on positions."""
        moves = bool(kinds) and all(kind in (Kind.RAPID, Kind.LINE, Kind.ARC) for kind in kinds)
        functions = {word.value for word in block.words if word.address == "M"}
        harmless = functions <= {3.0, 4.0, 5.0, 7.0, 8.0, 9.0, 13.0, 14.0}
        if moves:
            return harmless and not any(word.address in ("T", "D") for word in block.words)
        return (
            harmless
            and all(word.address in ("N", "F", "S", "M") for word in block.words)
            and block.kind
            in (
                "blank",
                "words",
                "miscellaneous",
            )
        )


def _without_words(block: Block, gone: Sequence[int], comment: str) -> Edit | None:
    """The text of a Klartext block as a comment, if it would be empty without some of its words; else None."""
    if len(gone) < len(block.words) or block.kind != "miscellaneous":
        return None
    first = min(word.at for word in block.words)
    body = block.text[first:].rstrip("\r\n")
    return Edit(first, first + len(body), comment.format(body.strip()))
