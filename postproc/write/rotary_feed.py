"""F of moves that take a time of their own, and the line behind them that restores the feed of the program."""

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
    if mode := motions.paced[row].mode:
        editor.insert_motion_code(mode)


def write_feed(motions: Motions, row: int, editor: WordEditor | AddedBlock, moved: float) -> None:
    """Write the F of a row, or of a segment; moved: length of its written path of X Y Z, mm."""
    block = motions.blocks[motions.block[row]]
    value, paced = _feed_of(motions, row, moved), motions.paced[row]
    least = decimals_holding(paced.feed) if paced.form == "programmed" else None
    if isinstance(editor, AddedBlock):
        if value is not None:
            editor.feed = [f"F{_digits(value, editor.layout.numbers, least)}"]
        return
    if value is None:
        return
    index = feed_index(block)
    blank = " " if editor.layout.blank else ""
    if index is None and block.kind != "words":  # Klartext: F stands before the M functions
        behind = min((word.at for word in block.words if word.address == "M"), default=-1)
        last = behind if behind >= 0 else max(word.end + word.tail for word in block.words)
        text = f"F{_digits(value, editor.layout.numbers, least)}"
        editor.put(last, last, f"{text} " if behind >= 0 else f" {text}")
    elif index is None:
        last = max(word.end + word.tail for word in block.words)
        editor.put(last, last, f"{blank}F{_digits(value, editor.layout.numbers, least)}")
    else:
        editor.put(block.words[index].start, block.words[index].end, _digits(value, editor.layout.numbers, least))


def takes_up_in_time(motions: Motions, row: int) -> bool:
    """True for a backlash take-up under a G93 that is in force since an earlier block."""
    paced = motions.paced.get(row + 1) if motions.kind[row] == Kind.TAKE_UP else None
    return paced is not None and paced.form == "inverse-time" and not paced.mode


def restored_feed(motions: Motions, row: int, numbers: NumberStyle, comment: str) -> list[str]:
    """The line behind the last segment of a row that restores the feed; none where the feed has stayed."""
    paced = motions.paced[row]
    if paced.form == "combined" or not paced.restored:
        return []
    mode = "G94 " if paced.form == "inverse-time" else ""
    return [f"{mode}F{numbers.write(paced.feed, decimals_holding(paced.feed)).lstrip('+')} {comment.format(RESTORED)}"]


def _feed_of(motions: Motions, row: int, moved: float) -> float | None:
    """F of a row in the units of its words; None if it stays."""
    paced = motions.paced[row]
    same_block = np.flatnonzero((motions.block == motions.block[row]) & (motions.kind != Kind.TAKE_UP)).tolist()
    rows = [other for other in same_block if motions.paced.get(other) is paced]
    lengths = motions.path_lengths
    whole = float(lengths[rows].sum())
    minutes = paced.minutes * lengths[row] / whole if whole > SAME else paced.minutes
    if paced.form == "inverse-time":
        return float(1.0 / minutes)
    if paced.form == "combined":
        return None
    if paced.form == "programmed":
        return paced.feed
    way = (motions.target - motions.start)[row]
    angle = float(np.linalg.norm(way[motions.machine.rotary]))
    if paced.form == "all-axes":
        return float(np.hypot(moved / motions.unit[row], angle) / minutes)
    if moved <= SAME and not paced.restored:
        return float(max(angle, SAME) / minutes)
    return float(moved / motions.unit[row] / minutes) if moved > SAME else paced.feed


def _digits(value: float, numbers: NumberStyle, decimals: int | None = None) -> str:
    """A positive number with DIGITS digits, or with these decimals."""
    if decimals is None:
        decimals = max(1, DIGITS - 1 - int(np.floor(np.log10(value))))
    return numbers.write(value, decimals).lstrip("+")
