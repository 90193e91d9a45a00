"""Notes on moves near a singular position: rotary axes turn far while the tool hardly tilts."""

from __future__ import annotations

import numpy as np

from kinematics.columns import ChainColumns, rows_of
from kinematics.transforms import Array
from postproc.correct.tcp.path import turns
from postproc.motion.motions import Motions
from postproc.text.notes import Notes

NOTED_MOVE_DEG = 15.0
"""Smallest turn of a rotary axis in one move that is noted."""
RATIO = 4.0
"""Smallest turn per tilt of the tool."""
MOVE_STEPS = 16
"""Steps along a move."""
MOST_NAMED_MOVES = 20
"""Most moves that are named."""


def note_singular(motions: Motions, rows: np.ndarray, notes: Notes, before: int) -> int:
    """Note the moves of rows `(k,)` near a singular position; the number of such moves with those `before`."""
    found = turns(motions)[rows]
    large = found.max(axis=1, initial=0.0) >= NOTED_MOVE_DEG
    rows, found = rows[large], found[large]
    if not len(rows):
        return before
    tilt = _tilts(motions, rows)
    for row, turned, angle in zip(rows.tolist(), found, tilt.tolist(), strict=True):
        if turned.max() < RATIO * angle:
            continue
        before += 1
        axis = motions.machine.names[int(turned.argmax())]
        text = f"near a singular position: {axis} turns {turned.max():.1f} degrees while the tool tilts {angle:.2f}"
        if before <= MOST_NAMED_MOVES:
            notes.add(text, int(motions.line[row]))
        elif before == MOST_NAMED_MOVES + 1:
            notes.add("near a singular position: further moves", int(motions.line[row]))
    return before


def _tilts(motions: Motions, rows: np.ndarray) -> Array:
    """Ways `(k,)`, degrees, of the tool axis in the workpiece frame along the moves of rows."""
    part, way, before = motions.bare.take(rows), np.zeros(len(rows)), None
    for share in np.linspace(0.0, 1.0, MOVE_STEPS + 1).tolist():
        axis = rows_of(ChainColumns(motions.machine, part.in_machine(part.along(share))).nominal_tool_axis, len(rows))
        if before is not None:
            way += np.rad2deg(2.0 * np.arcsin(np.minimum(np.linalg.norm(axis - before, axis=1) / 2.0, 1.0)))
        before = axis
    return way
