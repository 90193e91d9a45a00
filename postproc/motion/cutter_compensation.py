"""Moves that the control shifts by the radius of the tool: how far correcting their points may turn them.

The control shifts each move along its normal. A move turned by an angle t shifts the path by the radius times t^2/2
off what it should be, and its ends by the radius times t along it, where the next move cuts them off.
"""

from __future__ import annotations

import math

from postproc.motion.circles import SAME, Point, same
from postproc.motion.moves import Arc
from postproc.motion.recorder import Recorder
from postproc.text.block import Block

MOST_TURNED = 0.01
"""rad: 0.5 um off the path for a tool of 10 mm radius."""


def follow_contour(recorder: Recorder, plane: tuple[int, int], target: list[float], arc: Arc | None) -> None:
    """The control shifts the next move; one that stays in the plane must not become a contour by a word of ours."""
    i, j = plane
    recorder.follow_contour(plane)
    if arc is None and same((recorder.position[i], recorder.position[j]), (target[i], target[j])):
        recorder.keep_still(plane)


def check_turned(block: Block, before: tuple[Point, Point], after: tuple[Point, Point]) -> None:
    """Refuse a move, start and end in its plane, that its correction turns too far: one about as short as itself."""
    (x0, y0), (x1, y1) = ((end[0] - start[0], end[1] - start[1]) for start, end in (before, after))
    if math.hypot(x0, y0) < SAME and math.hypot(x1, y1) < SAME:
        return
    turned = abs(math.atan2(x0 * y1 - y0 * x1, x0 * x1 + y0 * y1))
    if turned > MOST_TURNED or math.hypot(x0, y0) < SAME:
        raise block.refuse(
            f"radius compensation: correcting the ends of this move of {math.hypot(x0, y0):.4f} mm would turn it by "
            f"{math.degrees(turned):.2f} deg, and the control would shift it another way"
        )
