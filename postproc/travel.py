"""Travel check: every commanded position lies inside the travel of its axis."""

from __future__ import annotations

import numpy as np

from kinematics.transforms import Array
from postproc.motions import Known, Motions
from postproc.notes import Notes

TOLERANCE = 1e-9
LARGEST_CORRECTION_MM = 5.0
"""No machine that still cuts is off by more: a model that says so is damaged, or not this machine's."""


def check_size(motions: Motions, nominal: Array, corrected: Array) -> None:
    """Refusal at the first move whose correction `(n, axes)`, mm and rad, is too large to be one."""
    size = np.abs(corrected - nominal)[:, motions.machine.translators]
    beyond = ~(size <= LARGEST_CORRECTION_MM)
    for row in np.flatnonzero(beyond.any(axis=1)):
        i = int(np.argmax(size[row]))
        name = motions.machine.names[motions.machine.translators[i]]
        raise motions.blocks[motions.block[row]].refuse(
            f"{name} would be corrected by {size[row, i]:.4g} mm, more than {LARGEST_CORRECTION_MM:g}: "
            "this calibration can't be right"
        )


def check_travel(motions: Motions, positions: Array, when: str, notes: Notes | None) -> None:
    """Refusal at the first move to a position `(n, axes)`, mm and rad, outside the travel of an axis.

    With `notes` the moves are noted instead. Axes whose position the program has not said are not looked at.
    `when` ends the message: "as programmed", "after correction".
    """
    machine = motions.machine
    low, high = machine.travel
    beyond = np.maximum(low - positions, positions - high) > TOLERANCE
    beyond &= motions.known != Known.ASSUMED
    for row in np.flatnonzero(beyond.any(axis=1)):
        block = motions.blocks[motions.block[row]]
        for i in np.flatnonzero(beyond[row]):
            axis = machine.axes[i]
            if notes is not None:
                notes.add(
                    f"{axis.name} outside its travel {axis.travel[0]:g}..{axis.travel[1]:g} {axis.unit}", block.line
                )
                continue
            place = positions[row, i] / machine.scale[i]
            raise block.refuse(
                f"{axis.name} would go to {place:.4f} {axis.unit} {when} (machine coordinates), outside its travel "
                f"{axis.travel[0]:g}..{axis.travel[1]:g}; --no-travel-check lets it pass"
            )
