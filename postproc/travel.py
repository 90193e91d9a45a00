"""Travel check: every commanded position lies inside the travel of its axis."""

from __future__ import annotations

import numpy as np

from kinematics.machine import NDArrayBool
from kinematics.transforms import Array
from postproc.motions import Motions
from postproc.moves import Known
from postproc.notes import Notes

TOLERANCE = 1e-9


def refuse_outside(motions: Motions, positions: Array, when: str) -> None:
    """Refusal at the first move to a position `(n, axes)`, mm and rad, outside the travel of an axis.

    Axes whose position the program has not said are not looked at. `when` ends the message: "as programmed", "after
    correction".
    """
    machine = motions.machine
    for row, i in np.argwhere(_outside(motions, positions)):
        axis = machine.axes[i]
        raise motions.blocks[motions.block[row]].refuse(
            f"{axis.name} would go to {positions[row, i] / machine.scale[i]:.4f} {axis.unit} {when} (machine "
            f"coordinates), outside its travel {axis.travel[0]:g}..{axis.travel[1]:g}; --no-travel-check lets it pass"
        )


def note_outside(motions: Motions, positions: Array, notes: Notes) -> None:
    """Note the moves that `refuse_outside` would refuse."""
    for row, i in np.argwhere(_outside(motions, positions)):
        axis = motions.machine.axes[i]
        text = f"{axis.name} outside its travel {axis.travel[0]:g}..{axis.travel[1]:g} {axis.unit}"
        notes.add(text, motions.blocks[motions.block[row]].line)


def _outside(motions: Motions, positions: Array) -> NDArrayBool:
    low, high = motions.machine.travel
    beyond = np.maximum(low - positions, positions - high) > TOLERANCE
    return np.asarray(beyond & (motions.known != Known.ASSUMED))
