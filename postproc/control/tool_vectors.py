"""Tool axes programmed as vectors: the positions of the rotary axes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from kinematics.inverse import inverse
from postproc.motion.frames import in_workpiece, to_machine
from postproc.motion.moves import Known
from postproc.motion.recorder import Recorder
from postproc.text.block import Block


def turn_along(block: Block, recorder: Recorder, target: list[float], vector: Sequence[float]) -> None:
    """Turn the rotary axes of a programmed target to where the tool is along a vector; no word names their positions.

    vector: as for `turned_to`, with its Refusal.
    """
    for axis, angle in turned_to(block, recorder, target, vector).items():
        target[axis] = angle
        recorder.known[axis] = Known.MACHINE


def turned_to(block: Block, recorder: Recorder, target: Sequence[float], vector: Sequence[float]) -> dict[int, float]:
    """Programmed positions, degrees by column, of the rotary axes with the tool along a vector at a programmed target.

    vector: from the tip towards the spindle, in the workpiece frame. The solution nearest to the present
    positions. Refusal where there is none.
    """
    machine, frame = recorder.machine, recorder.frame
    if not np.linalg.norm(vector):
        raise block.refuse("a tool axis of length 0")
    place = in_workpiece(machine, frame, np.array([target]))
    start = to_machine(machine, frame, np.array([recorder.position]))[0]
    found = inverse(machine, place, [vector], frame.tool, start=start)
    if not np.isfinite(found.q).all():
        raise block.refuse(
            "no position of the rotary axes gives this tool axis: check the vector and the travel in the machine file"
        )
    places = found.q[0] / machine.scale - np.asarray(frame.offset)
    return {int(axis): float(places[axis]) for axis in np.flatnonzero(machine.rotary)}
