"""Cutter radius compensation: the largest change of direction that the correction of a move may cause.

The control shifts each move along its normal by the tool radius. If a correction rotates a move by an angle t, the
shifted path deviates by radius * t^2/2 across the move, and its ends by radius * t along it, where the next move cuts
them off.
"""

from __future__ import annotations

import math

from postproc.motion.circles import SAME_POINT_MM, Point, same
from postproc.motion.moves import Arc
from postproc.motion.recorder import Recorder
from postproc.text.block import Block

MOST_TURNED = 0.01
"""Largest change of direction, rad: a path deviation of 0.5 um for a tool of 10 mm radius."""


def follow_contour(recorder: Recorder, plane: tuple[int, int], target: list[float], arc: Arc | None) -> None:
    """Record that the control shifts the next move by the tool radius.

    A move that keeps its position in the plane must not get a word of ncomp that makes it a contour move.
    """
    i, j = plane
    recorder.note("cutter_compensated", plane)
    if arc is None and same((recorder.position[i], recorder.position[j]), (target[i], target[j])):
        recorder.note("locked_axes", plane)


def check_turned(block: Block, before: tuple[Point, Point], after: tuple[Point, Point]) -> None:
    """Refusal if the correction changes the direction of a move too much; `before`, `after`: its ends in the plane."""
    (x0, y0), (x1, y1) = ((end[0] - start[0], end[1] - start[1]) for start, end in (before, after))
    if math.hypot(x0, y0) < SAME_POINT_MM and math.hypot(x1, y1) < SAME_POINT_MM:
        return
    turned = abs(math.atan2(x0 * y1 - y0 * x1, x0 * x1 + y0 * y1))
    if turned > MOST_TURNED or math.hypot(x0, y0) < SAME_POINT_MM:
        raise block.refuse(
            f"radius compensation: correcting the ends of this move of {math.hypot(x0, y0):.4f} mm would turn it by "
            f"{math.degrees(turned):.2f} deg, and the control would shift it another way"
        )
