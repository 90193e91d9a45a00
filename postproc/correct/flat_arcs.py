"""Klartext arcs that stay in their plane: the axis across it keeps its position, and with it its correction.

Arcs that follow each other share one correction across their plane, from the end of the move before them on: that of
this end, or less if an end or a middle of these arcs would otherwise err by more across the plane than in the input.
"""

from __future__ import annotations

import numpy as np
from msgspec.structs import replace

from postproc.compensation.correction import Correction
from postproc.motion.motions import Motions
from postproc.motion.moves import Kind, Known
from postproc.write.helices import stays_in_plane


def held_across_arcs(motions: Motions, correction: Correction) -> Correction:
    """The correction of a chunk, with one value across the plane for arcs that follow each other in it."""
    flat = [row for row in motions.arcs if row > 0 and stays_in_plane(motions, row)]
    if not flat:
        return correction
    target, done = correction.target.copy(), -1
    for row in sorted(flat):
        if row > done:
            done = _hold(motions, correction, target, row, set(flat))
    return replace(correction, target=target, corrected=motions.in_machine(target))


def _hold(motions: Motions, correction: Correction, target: np.ndarray, row: int, flat: set[int]) -> int:
    """Give the arcs from a row on, and the move before them, one correction across the plane; returns the last row."""
    normal, last = motions.arcs[row].plane[2], row
    while last + 1 in flat and motions.arcs[last + 1].plane[2] == normal and _same_frame(motions, last):
        last += 1
    first = row - 1 if _same_frame(motions, row - 1) and _is_corrected(motions, row - 1, normal) else row
    if first == row or (motions.known[row : last + 1, normal] != Known.PROGRAM).any():
        return last
    ends = correction.target[first : last + 1, normal] - motions.target[first : last + 1, normal]
    middles = [correction.middle_shift[i][normal] for i in range(row, last + 1)]
    target[first : last + 1, normal] = motions.target[first : last + 1, normal] + _shared([*ends.tolist(), *middles])
    return last


def _shared(shifts: list[float]) -> float:
    """The value next to the first shift from which no shift is further away than from 0."""
    low, high = max(min(0.0, 2.0 * shift) for shift in shifts), min(max(0.0, 2.0 * shift) for shift in shifts)
    return min(max(shifts[0], low), high)


def _same_frame(motions: Motions, row: int) -> bool:
    """True if a row and the next one have the same frame."""
    return bool(motions.frames[motions.frame[row]] == motions.frames[motions.frame[row + 1]])


def _is_corrected(motions: Motions, row: int, axis: int) -> bool:
    """True for a straight move or a hole whose correction along the axis may be chosen."""
    kinds = (Kind.LINE, Kind.RAPID, Kind.TAKE_UP)
    return bool(motions.known[row, axis] == Known.PROGRAM and motions.kind[row] in kinds)
