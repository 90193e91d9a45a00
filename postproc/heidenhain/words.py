"""The words of a Klartext block, sorted."""

from __future__ import annotations

from postproc.control.codes import AXES
from postproc.control.words import Content
from postproc.motion.moves import Kind
from postproc.text.block import Block


def sort(block: Block) -> Content:
    """The words of a block, axes without a value by their names; Refusal for an axis that is named twice."""
    content = Content(block)
    for i, word in enumerate(block.words):
        address = word.address
        if address[-1] in AXES and address[:-1] in ("", "I"):
            if any(block.words[j].address[-1] == address[-1] for j in content.axes):
                raise block.refuse(f"the block has two {address[-1]} words: write one")
            if word.start == word.end:
                content.names[address] = i
            else:
                content.axes.append(i)
        elif address == "M":
            if word.value is not None:
                content.m.append(word.value)
        else:
            content.other[address] = i
    return content


def straight(content: Content) -> Kind:
    """The kind of a straight move: rapid with FMAX."""
    return Kind.RAPID if "FMAX" in content.other else Kind.LINE
