"""Inverse time (G93): F of the segments of a move and of backlash take-ups."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from kinematics.transforms import Array
from postproc.motion.circles import SAME_POINT_MM
from postproc.motion.motions import Motions
from postproc.motion.moves import Kind
from postproc.motion.segments import arc_ends, arc_turned
from postproc.text.editing import WordEditor
from postproc.write.added_blocks import AddedBlock, Tag, feed_index


def add_inverse_time(motions: Motions, row: int, added: AddedBlock, moved: float) -> None:
    """F under G93: of a segment by its share of the time of its move; of a take-up by the speed of the move."""
    if added.tag is Tag.TAKE_UP:
        added.feed_of(_per_minute(motions, row, _length) / max(moved, SAME_POINT_MM))
    else:
        added.feed_of(_per_minute(motions, row, _extent) / max(_extent(motions, row), SAME_POINT_MM))


def write_inverse_time(motions: Motions, row: int, editor: WordEditor) -> None:
    """Under G93: F of the first segment of a move, for its share of the time of the move."""
    index = feed_index(editor.block)
    assert index is not None
    editor.set(index, _per_minute(motions, row, _extent) / max(_extent(motions, row), SAME_POINT_MM), 3)


def _per_minute(motions: Motions, row: int, length: Callable[[Motions, int], float]) -> float:
    """Under G93: length per minute of the programmed move of a row; `length`: length of one segment."""
    block = motions.blocks[motions.block[row]]
    index = feed_index(block)
    assert index is not None
    rows = np.flatnonzero((motions.block == motions.block[row]) & (motions.kind != Kind.TAKE_UP))
    return (block.words[index].value or 0.0) * sum(length(motions, int(i)) for i in rows)


def _extent(motions: Motions, row: int) -> float:
    """Length of a segment, in a measure common to all segments of its move."""
    length = motions.target[row] - motions.start[row]
    return _length(motions, row) if row in motions.arcs else float(np.linalg.norm(length))


def _length(motions: Motions, row: int) -> float:
    """Length of a move, mm, nominal."""
    arc = motions.arcs.get(row)
    linear = list(motions.machine.translators)
    length: Array = (motions.target - motions.start)[row]
    if arc is None:
        return float(np.linalg.norm(length[linear]))
    start, _ = arc_ends(motions, row)
    return math.hypot(math.dist(start, arc.centre) * arc_turned(motions, row), float(length[arc.plane[2]]))
