"""Positions that Siemens 840D programs read from the control: `$AA_IW[X]`, `$AA_IM[X]`.

The control gives the set position of an axis, in the coordinates of the workpiece and of the machine (Function Manual
Basic Functions, 6FC5397-0BP10-2BA0, K2 2.4.11), and stops preprocessing for it. In a corrected program this is the
corrected position. So words of coordinates that depend on one are written as numbers, and a comparison must give the
same result with every correction that is allowed.
"""

from __future__ import annotations

import numpy as np

from postproc.control.setup import Origin
from postproc.motion.frames import to_machine
from postproc.motion.moves import Known
from postproc.siemens.channel import Channel
from postproc.siemens.codes import MOVING_NAMES
from postproc.siemens.words import Content
from postproc.text.block import Block
from postproc.text.expressions import NotKnown, Position, Value

WORKPIECE, OF_MACHINE = "$AA_IW", "$AA_IM"
COORDINATES = frozenset("XYZ")
"""Addresses of words that may depend on a position: the correction writes them as numbers."""
STATED = (Origin.GIVEN, Origin.PROGRAM)
"""Origins of offsets and lengths that are those of the control."""


class Positions:
    """The positions of one control that its program reads."""

    def __init__(self, channel: Channel) -> None:
        self.channel = channel
        self.beside_contour = False
        """The last move ended beside its contour, by the radius of the tool."""
        self.read = False
        """The program has read a position."""

    def value(self, name: str, indices: tuple[Value, ...]) -> Value:
        """The position of an axis as programmed, mm; NotKnown where the control may give another one."""
        channel, modal = self.channel, self.channel.modal
        axis = str(indices[0]) if len(indices) == 1 else ""
        shown = f"{name}[{axis}]"
        column = channel.columns.get(axis)
        if name not in (WORKPIECE, OF_MACHINE) or column not in channel.x_y_z:
            raise NotKnown(
                f"{shown} is read from the control, and ncomp follows $AA_IW and $AA_IM of X, Y and Z only: write the "
                "position as a number"
            )
        if modal.unit != 1.0:
            raise NotKnown(f"the unit of {shown} in a program in inches depends on the control: write a number")
        if self.beside_contour or modal.compensated or modal.cornered or modal.rounded or modal.spline:
            raise NotKnown(
                f"{shown} is read behind a move with radius compensation, a broken corner or a spline, where the tool "
                "is not at the programmed point: write a straight move without them before it"
            )
        if channel.recorder.known[column] != Known.PROGRAM:
            raise NotKnown(
                f"{shown} is read where the program has not moved {axis} in the present coordinates, for instance "
                "behind TRANS or G54 without a move, and no manual says in which coordinates the control gives it "
                f"then: write a move of {axis} before it, or the number itself"
            )
        self.read = True
        position = channel.recorder.position[column]
        if name == OF_MACHINE:
            position = self._of_machine(shown, column)
        return Position(position, channel.setup.largest_correction_um * 1e-3)

    @property
    def state(self) -> object:
        """The positions, once the program reads them."""
        return tuple(self.channel.recorder.position) if self.read else None

    def _of_machine(self, shown: str, column: int) -> float:
        """The position of an axis in the coordinates of the machine."""
        recorder, state, frame = self.channel.recorder, self.channel.control_state, self.channel.recorder.frame
        offset = not frame.work_offset or state.offset_origin(frame.work_offset) in STATED
        length = not frame.tool_name or state.tool_origin(frame.tool_name) in STATED
        if frame.tcp or not (offset and length):
            raise NotKnown(
                f"{shown} needs the offsets that are on the control: give them by --work-offset and --tool-length, and "
                "end TRAORI and CYCLE800 before it"
            )
        return float(to_machine(recorder.machine, frame, np.array([recorder.position]))[0, column])

    def check(self, block: Block, content: Content, claimed: float | None) -> None:
        """Refuse a block whose words depend on a position where a correction cannot write them as numbers.

        claimed: the G code that claims the axis words for itself; None for none.
        """
        if not self.read:
            return
        elsewhere = claimed is not None or content.frames or not MOVING_NAMES.isdisjoint(content.names)
        for word in block.words:
            if word.formula is None or not word.formula.reads:
                continue
            if elsewhere or content.other.keys() & {"AP", "RP"} or word.address not in COORDINATES:
                raise block.refuse(
                    f"{word.address} depends on a position that the program reads from the control, which a "
                    "correction changes: only X, Y and Z of a move can depend on it. Write a number"
                )
            if word.mode not in ("", "AC") or (not word.mode and not self.channel.modal.absolute):
                raise block.refuse(
                    f"{word.address} is an increment that depends on a position which the program reads from the "
                    "control, and a correction changes that: write the end of the move, or a number"
                )
