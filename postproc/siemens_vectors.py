"""Tool vectors of Siemens programs: A3, B3, C3 under TRAORI; the rotary axes are what the machine makes of them."""

from __future__ import annotations

import numpy as np

from kinematics.inverse import inverse
from postproc.frames import in_workpiece, to_machine
from postproc.motions import Known, Recorder
from postproc.program import Block
from postproc.siemens_codes import VECTOR
from postproc.siemens_content import Content, plain_of


def turn_to_vector(block: Block, content: Content, recorder: Recorder, target: list[float]) -> None:
    """Turn the rotary axes of `target` so that the tool points along the vector of the block.

    The vector points from the tip to the spindle, in programmed coordinates. Of the solutions that nearest to where
    the axes stand is taken. Their positions are not the program's own words, so none of ours ever names them.
    """
    machine, frame = recorder.machine, recorder.frame
    if not any(axis.rotary for axis in machine.axes):
        raise block.refuse(f"a tool vector on machine {machine.name}, which has no axis that turns")
    words = {address: content.other.pop(address) for address in VECTOR if address in content.other}
    vector = np.array([plain_of(block, block.words[words[a]]) if a in words else 0.0 for a in VECTOR])
    if not np.linalg.norm(vector) > 0.0:
        raise block.refuse("a tool vector of length 0")
    here = to_machine(machine, frame, np.array([recorder.position]))[0]
    place, direction = in_workpiece(machine, frame, np.array([target])), frame.turned(vector)
    found = inverse(machine, place, direction, frame.tool, start=here, respect_travel=False).q[0]
    if not np.isfinite(found).all():
        raise block.refuse("no position of the axes points the tool along this vector")
    for i, axis in enumerate(machine.axes):
        if axis.rotary:
            target[i] = float(found[i] / machine.scale[i]) - frame.offset[i]
            recorder.known[i] = Known.MACHINE
