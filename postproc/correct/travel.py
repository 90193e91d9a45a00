"""Travel check: every commanded position must be inside the travel of its axis."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from kinematics.machine import TRAVEL_ROUNDING, NDArrayBool
from kinematics.transforms import Array
from postproc.control.state import ControlState
from postproc.motion.motions import Motions
from postproc.motion.moves import Known
from postproc.text.block import Refusal
from postproc.text.notes import Notes


def refuse_outside(motions: Motions, positions: Array, when: str, state: ControlState) -> None:
    """Refusal at the first move to a position `(n, axes)`, mm and rad, outside the travel of an axis.

    Axes whose position the program has not given are not checked. `when` is part of the message: "as programmed",
    "after correction".
    """
    for refusal in refusals_outside(motions, positions, when, state):
        raise refusal


def refusals_outside(
    motions: Motions, positions: Array, when: str, state: ControlState, *, only: NDArrayBool | None = None
) -> Iterator[Refusal]:
    """A refusal for every move and axis outside the travel, as by `refuse_outside`; the message names the set-up.

    only: mask `(n,)` of the checked moves.
    """
    machine, programmed, outside = motions.machine, motions.programmed, _outside(motions, positions)
    for row, i in np.argwhere(outside if only is None else outside & only[:, None]):
        axis = machine.axes[i]
        origins = state.origins(motions.frames[motions.frame[row]]) if programmed[row] else ""
        setup = (
            f" with {origins}: check these (--work-offset, --tool-length, or their entries in the job or machine file)"
            if origins
            else ""
        )
        yield motions.blocks[motions.block[row]].refuse(
            f"{axis.name} would go to {positions[row, i] / machine.scale[i]:.4f} {axis.unit} {when} (machine "
            f"coordinates), outside its travel {axis.travel[0]:g}..{axis.travel[1]:g}{setup}; "
            "--no-travel-check lets it pass"
        )


def note_outside(motions: Motions, positions: Array, notes: Notes) -> None:
    """Add notes on the moves that `refuse_outside` would refuse."""
    outside = _outside(motions, positions)
    for i in np.flatnonzero(outside.any(axis=0)).tolist():
        axis, rows = motions.machine.axes[i], np.flatnonzero(outside[:, i])
        text = f"{axis.name} outside its travel {axis.travel[0]:g}..{axis.travel[1]:g} {axis.unit}"
        notes.add(text, int(motions.line[rows[0]]), len(rows))


def note_assumed(motions: Motions, correctable: NDArrayBool, notes: Notes) -> None:
    """Add notes on moves that were corrected, a mask `(n,)`, with an assumed position of an axis."""
    for i, axis in enumerate(motions.machine.axes):
        rows = np.flatnonzero(correctable & (motions.known[:, i] == Known.ASSUMED))
        if rows.size:
            text = f"the program has not given {axis.name} yet: its home {axis.home:g} is assumed"
            notes.add(text, int(motions.line[rows[0]]), rows.size)


def _outside(motions: Motions, positions: Array) -> NDArrayBool:
    low, high = motions.machine.travel
    if len(positions) and (positions.min(axis=0) >= low).all() and (positions.max(axis=0) <= high).all():
        return np.zeros(positions.shape, bool)
    beyond = np.maximum(low - positions, positions - high) > TRAVEL_ROUNDING
    return np.asarray(beyond & (motions.known != Known.ASSUMED))
