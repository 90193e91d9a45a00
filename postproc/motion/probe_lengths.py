"""Length of the probe that touched a work offset off, where the set-up gives none: that of the first tool."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import msgspec

from postproc.motion.frames import Frame


class ProbeLengths:
    """Length of the first tool that moved in each work offset, mm, by name of the work offset."""

    def __init__(self) -> None:
        self.first: dict[str, float] = {}

    def in_frames(self, frames: Sequence[Frame], used: set[int]) -> list[Frame]:
        """The frames, with a length in each touch-off; used: numbers of those in which a tool moves.

        Without a probe it is the length of the first tool that moves in the work offset. Moves before the first tool
        keep a touch-off without a length.
        """
        found = []
        for i, frame in enumerate(frames):
            if frame.touch_off is not None and i in used and frame.tool_length > 0.0:
                self.first.setdefault(frame.touch_off.name, frame.tool_length)
            found.append(self._in_frame(frame))
        return found

    def _in_frame(self, frame: Frame) -> Frame:
        there = frame.touch_off
        if there is None or there.probe is not None:
            return frame
        return replace(frame, touch_off=msgspec.structs.replace(there, probe=self.first.get(there.name)))
