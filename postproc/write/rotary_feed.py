"""F of moves that take a time of their own, and the line behind them that restores the feed of the program."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from kinematics.transforms import Array
from postproc.motion.circles import SAME_POINT_MM
from postproc.motion.motions import Motions
from postproc.motion.moves import Kind, Paced
from postproc.text.editing import WordEditor
from postproc.text.number_style import NumberStyle, decimals_holding
from postproc.write.added_blocks import AddedBlock, feed_index

FEED_DIGITS = 6
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
    paced = motions.paced.get(row + 1)
    if paced is None or motions.kind[row] != Kind.TAKE_UP:
        return False
    return paced.form == "inverse-time" and not paced.mode


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
    same_block = range(*np.searchsorted(motions.block, [motions.block[row], motions.block[row] + 1]))
    rows = [row for row in same_block if motions.kind[row] != Kind.TAKE_UP and motions.paced.get(row) is paced]
    lengths = motions.path_lengths
    whole = float(lengths[rows].sum())
    minutes = paced.minutes * lengths[row] / whole if whole > SAME_POINT_MM else paced.minutes
    if paced.form == "combined":
        return None
    if paced.form == "inverse-time":
        return float(1.0 / minutes)
    return float(_feeds(motions, np.array([row]), [paced], np.array([minutes]), np.array([moved]))[0])


def feeds_of_moves(motions: Motions, first: int, starts: Array, ends: Array) -> tuple[Array, np.ndarray]:
    """F of moves that are not divided, `(k,)` from row `first` on, and its decimals; nan where it stays.

    starts, ends `(k, axes)`: as they are written, mm and degrees.
    """
    moved = np.linalg.norm((ends - starts)[:, list(motions.machine.translators)], axis=1)
    found, decimals = np.full(len(moved), np.nan), np.zeros(len(moved), int)
    rows = np.array([row for row in range(first, first + len(moved)) if row in motions.paced], int)
    if not len(rows):
        return found, decimals
    paced, lengths = [motions.paced[row] for row in rows.tolist()], motions.path_lengths[rows]
    times = np.array([each.minutes for each in paced])
    divided = times * lengths / np.where(lengths > SAME_POINT_MM, lengths, 1.0)  # as of `_feed_of`, to the last digit
    minutes = np.where(lengths > SAME_POINT_MM, divided, times)
    found[rows - first] = values = _feeds(motions, rows, paced, minutes, moved[rows - first])
    with np.errstate(divide="ignore"):
        decimals[rows - first] = np.maximum(1, FEED_DIGITS - 1 - np.floor(np.log10(values)))
    for row, each in zip(rows.tolist(), paced, strict=True):
        if each.form == "programmed":
            decimals[row - first] = decimals_holding(each.feed)
    return found, decimals


@np.errstate(divide="ignore")  # the time of a move that keeps its F is 0
def _feeds(motions: Motions, rows: np.ndarray, paced: Sequence[Paced], minutes: Array, moved: Array) -> Array:
    """F `(k,)` of rows that take these times, in the units of their words; moved `(k,)`: lengths of paths, mm."""
    form, feed = np.array([each.form for each in paced]), np.array([each.feed for each in paced])
    angle = np.linalg.norm((motions.target - motions.start)[rows][:, motions.machine.rotary], axis=1)
    path = moved / motions.unit[rows]
    still = np.where([each.restored for each in paced], feed, np.maximum(angle, SAME_POINT_MM) / minutes)
    linear = np.where(moved > SAME_POINT_MM, path / minutes, still)
    timed, every, kept = form == "inverse-time", form == "all-axes", form == "programmed"
    return np.select([timed, every, kept], [1.0 / minutes, np.hypot(path, angle) / minutes, feed], linear)


def _digits(value: float, numbers: NumberStyle, decimals: int | None = None) -> str:
    """A positive number with `FEED_DIGITS` digits, or with these decimals."""
    if decimals is None:
        decimals = max(1, FEED_DIGITS - 1 - int(np.floor(np.log10(value))))
    return numbers.write(value, decimals).lstrip("+")
