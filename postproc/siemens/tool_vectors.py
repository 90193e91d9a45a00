"""Tool vectors of Siemens programs: A3, B3, C3 under TRAORI; the kinematics of the machine gives the rotary axes."""

from __future__ import annotations

import numpy as np

from postproc.control.tool_vectors import turn_along
from postproc.motion.recorder import Recorder
from postproc.siemens.codes import VECTOR
from postproc.siemens.words import Content, plain_of
from postproc.text.block import Block


def turn_to_vector(block: Block, content: Content, recorder: Recorder, target: list[float]) -> None:
    """Turn the rotary axes of `target` so that the tool points along the vector of the block.

    The vector points from the tip to the spindle, in programmed coordinates. The positions of the axes are not the
    program's own words, so none of ours ever names them.
    """
    if not recorder.machine.rotary.any():
        raise block.refuse(f"a tool vector needs a rotary axis, and machine {recorder.machine.name} has none")
    if not all(recorder.frame.keeps_circles(plane) for plane in ("XY", "YZ")):
        raise block.refuse("a tool vector where the axes are scaled by different factors")
    words = {address: content.other.pop(address) for address in VECTOR if address in content.other}
    vector = np.array([plain_of(block, block.words[words[a]]) if a in words else 0.0 for a in VECTOR])
    turn_along(block, recorder, target, recorder.frame.turned(vector).tolist())
