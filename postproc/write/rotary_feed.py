"""F of corrected feed moves of rotary axes alone, and the line behind them that restores the feed of the program."""

from __future__ import annotations

import numpy as np

from postproc.motion.circles import SAME
from postproc.motion.motions import Motions
from postproc.motion.moves import Kind
from postproc.text.editing import WordEditor
from postproc.text.number_style import NumberStyle, decimals_holding
from postproc.write.added_blocks import AddedBlock, feed_index

DIGITS = 6
"""Digits of F: the time is that of the program to a millionth."""
RESTORED = "NCOMP FEED"
"""Comment of the line behind such a move."""


def write_feed_mode(motions: Motions, row: int, editor: WordEditor) -> None:
    """Write the feed mode of a row in front of its words."""
    if motions.paced[row].form == "inverse-time":
        editor.insert_motion_code("G93")


def write_feed(motions: Motions, row: int, editor: WordEditor | AddedBlock, moved: float) -> None:
    """Write the F of a row, or of a segment; moved: length of its written path of X Y Z, mm."""
    block = motions.blocks[motions.block[row]]
    value = _feed_of(motions, row, moved)
    if isinstance(editor, AddedBlock):
        if value is not None:
            editor.feed = [f"F{_digits(value, editor.layout.numbers)}"]
        return
    if value is None:
        return
    index = feed_index(block)
    blank = " " if editor.layout.blank else ""
    if index is None:
        last = max(word.end + word.tail for word in block.words)
        editor.put(last, last, f"{blank}F{_digits(value, editor.layout.numbers)}")
    else:
        editor.put(block.words[index].start, block.words[index].end, _digits(value, editor.layout.numbers))


def restored_feed(motions: Motions, row: int, numbers: NumberStyle, comment: str) -> list[str]:
    """The line behind the last segment of a row that restores the feed; none where the feed has stayed."""
    paced = motions.paced[row]
    if paced.form == "combined":
        return []
    mode = "G94 " if paced.form == "inverse-time" else ""
    return [f"{mode}F{numbers.write(paced.feed, decimals_holding(paced.feed)).lstrip('+')} {comment.format(RESTORED)}"]


def _feed_of(motions: Motions, row: int, moved: float) -> float | None:
    """F of a row in the units of its words; None if it stays."""
    paced = motions.paced[row]
    rows = np.flatnonzero((motions.block == motions.block[row]) & (motions.kind != Kind.TAKE_UP))
    lengths = motions.path_lengths
    minutes = paced.minutes * lengths[row] / max(float(lengths[rows].sum()), SAME)
    if paced.form == "inverse-time":
        return float(1.0 / minutes)
    if paced.form == "combined":
        return None
    return float(moved / motions.unit[row] / minutes) if moved > SAME else paced.feed


def _digits(value: float, numbers: NumberStyle) -> str:
    """A positive number with DIGITS digits."""
    decimals = max(1, DIGITS - 1 - int(np.floor(np.log10(value))))
    return numbers.write(value, decimals).lstrip("+")
