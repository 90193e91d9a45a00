"""The meaning of ISO coordinates in machine axes, block by block: offsets, lengths and rotations."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from kinematics.machine import Machine
from postproc.control.functions import move_for_tool_change
from postproc.control.state import ControlState
from postproc.control.tilted_planes import lean, normal_of
from postproc.iso.codes import MIRROR, SCALE, TILT
from postproc.iso.datum_transformations import MAKERS, Programmed
from postproc.iso.offsets import TCP_CODES, Lengths, Offsets, Shifts
from postproc.motion.frames import Frame, Placement, cartesian, renamed, rotated, shifted
from postproc.motion.moves import Known
from postproc.motion.recorder import Recorder
from postproc.text.block import Block
from postproc.text.notes import Notes

UPRIGHT = 1e-6
"""rad: a tool that leans no more is perpendicular to the tilted plane."""


class Frames:
    """Offsets, lengths and turns in force; every change goes to the recorder, with the axes that it concerns."""

    def __init__(self, machine: Machine, state: ControlState, notes: Notes) -> None:
        self.machine, self.notes = machine, notes
        self.offsets = Offsets(state)
        self.lengths = Lengths(state, notes, machine.control)
        self.place, self.placement_code = Placement(), 0.0
        """The rotation, mirror or scale of the coordinates, and its G code; 0 for none."""
        self.mirrors: dict[str, float] = {}
        """Of G51.1."""
        self.upright = False
        """The tool is perpendicular to the tilted plane."""
        self.recorder = Recorder(machine, self.frame())

    @property
    def tilted(self) -> bool:
        """True while a tilted plane is on."""
        return self.placement_code == TILT

    @property
    def shifted(self) -> bool:
        """True while a turn, a scale, G52 or G92 is on."""
        return bool(self.placement_code) or self.offsets.moved

    def frame(self) -> Frame:
        """The frame that coordinates are programmed in now."""
        added, x_y_z, lengths = self.offsets.added(), cartesian(self.machine), self.lengths
        placed = rotated(self.offsets.turn).then(shifted(*(added.pop(axis, 0.0) for axis in x_y_z))).then(self.place)
        return self.offsets.state.frame(
            self.offsets.name,
            placed,
            added,
            tool=lengths.tool_name,
            length=lengths.tool(),
            length_offset=lengths.offset() or 0.0,
            tcp=lengths.tcp or self.tilted,
        )

    # ---- work offsets and lengths

    def change_tool(self, block: Block) -> None:
        """M6."""
        self.hold_tool(self.lengths.selected_tool)
        move_for_tool_change(block, self.recorder, self.notes)

    def hold_tool(self, number: int) -> None:
        """Another tool is in the spindle; the axes do not move."""
        self.lengths.spindle_tool = number
        by_spindle_tool = (self.lengths.tcp or self.tilted) and self.lengths.offset() is None
        self.recorder.set_frame(self.frame(), cartesian(self.machine) if by_spindle_tool else ())

    def select_offset(self, block: Block, code: float, extended: int | None) -> None:
        """G54 and its kin, G54.1 P. LinuxCNC keeps G52 and G92, which are one store there, in every offset."""
        if self.placement_code or (self.offsets.moved and self.machine.control.family != "linuxcnc"):
            raise block.refuse(
                "a work offset while G52, G92 or a turn of the coordinates is on: what becomes of these depends on the "
                "control"
            )
        self.offsets.select(code, extended)

    def select_length(self, block: Block, code: float, number: int | None) -> None:
        """G43, G43.4, G43.5, G49."""
        if code in TCP_CODES and (self.placement_code or self.offsets.turn):
            raise block.refuse(f"G{code:g} while the coordinates are turned: not corrected")
        self.lengths.select(block, code, number)

    def state(self) -> tuple[str | None, tuple[int, float | None] | None, bool]:
        """Work offset and length in force, None where the program has not set it yet, and TCP."""
        return self.offsets.name if self.offsets.selected else None, self.lengths.key, self.lengths.tcp

    def changed_since(self, before: tuple[str | None, tuple[int, float | None] | None, bool]) -> None:
        """Set the frame of the recorder, with the axes whose coordinates differ from those of the state before."""
        x_y_z, (offset, length, tcp) = cartesian(self.machine), self.state()
        changed: set[int] = set()
        if offset != before[0]:
            changed.update(range(len(self.machine.axes)))
        if tcp != before[2] or (tcp and length != before[1]):
            changed.update(x_y_z)
        elif length != before[1]:
            changed.add(x_y_z[2])
        self.recorder.set_frame(self.frame(), changed)

    # ---- G52, G92, G10

    def shift_origin(self, block: Block, values: Shifts) -> None:
        """G52."""
        if self.offsets.preset and any(self.offsets.preset.values()):
            raise block.refuse("G52 while G92 is on: one store on some controls, two on others")
        self.offsets.local.update(values)
        self.recorder.set_frame(self.frame(), values)

    def preset_here(self, block: Block, values: Shifts) -> None:
        """G92 with axes: new coordinates for the present positions."""
        self._refuse_turned(block)
        self.offsets.call(block, self._present_positions(block, values), values)
        self.recorder.set_frame(self.frame(), ())

    def enter_offset(self, block: Block, name: str, values: Shifts, turn: float | None) -> None:
        """G10 L2: a work offset of the table, and by how many degrees it turns X and Y."""
        if self.placement_code and name == self.offsets.name:
            raise block.refuse(
                "G10 changes the active work offset while the coordinates are rotated: write it before the rotation"
            )
        self.offsets.enter(name, values)
        self.notes.add(f"{name} as G10 sets it", block.line)
        changed = set(values)
        if turn is not None:
            self.offsets.turned[name] = turn
            changed.update(cartesian(self.machine)[:2])
        if name == self.offsets.name:
            self.recorder.set_frame(self.frame(), changed)

    def enter_here(self, block: Block, values: Shifts) -> None:
        """G10 L20 of LinuxCNC: the active work offset that gives the present positions these coordinates."""
        self._refuse_turned(block)
        here = self._present_positions(block, values)
        work = self.offsets.work()
        entered = {axis: work[axis] + here[axis] - value for axis, value in values.items()}
        self.offsets.enter(self.offsets.name, entered)
        self.recorder.set_frame(self.frame(), ())

    def cancel_preset(self, block: Block, axes: Iterable[int]) -> None:
        """G92.1."""
        if self.placement_code and self.offsets.moved:
            raise block.refuse("G92.1 while the coordinates are turned")
        axes = list(axes)
        self.offsets.cancel_preset(axes)
        self._tell_shifted(axes)

    def suspend(self, block: Block, suspended: bool) -> None:
        """G92.2, G92.3."""
        self.offsets.suspend(block, suspended)
        self._tell_shifted(self.offsets.preset or {})

    def _tell_shifted(self, axes: Iterable[int]) -> None:
        frame = self.frame()
        if frame != self.recorder.frame:
            self.recorder.set_frame(frame, axes)

    def _refuse_turned(self, block: Block) -> None:
        if self.placement_code or self.lengths.tcp or self.offsets.turn:
            raise block.refuse(
                "a preset of the present position (G92, G10 L20) is not corrected while the coordinates "
                "or the table are rotated: write it before the rotation"
            )

    def _present_positions(self, block: Block, axes: Iterable[int]) -> Shifts:
        """The present positions of axes; Refusal where the program has not given them in this frame."""
        for axis in axes:
            if self.recorder.known[axis] != Known.PROGRAM:
                name = self.machine.names[axis]
                raise block.refuse(
                    f"the preset of {name} needs a programmed position: write a move of {name} in this frame before it"
                )
        return {axis: self.recorder.position[axis] for axis in axes}

    # ---- turns

    def turn(self, code: float, programmed: Programmed) -> None:
        """G68, G51, G51.1, G68.2."""
        if self.placement_code and not (code == MIRROR == self.placement_code):
            raise programmed.block.refuse(f"G{code:g} while G{self.placement_code:g} is on")
        if self.offsets.turn:
            raise programmed.block.refuse(f"G{code:g} within a work offset that turns the coordinates")
        if code == TILT and (self.offsets.moved or self.lengths.tcp):
            raise programmed.block.refuse("a tilted plane while G52, G92 or TCP is on: not corrected")
        if code == MIRROR:
            self.mirrors.update(programmed.axes)
            programmed = Programmed(programmed.block, programmed.plane, self.mirrors, programmed.others)
        self._put(MAKERS[code](programmed), code)
        self.upright = False

    def scaled_along(self, axis: int) -> bool:
        """True where G51 or G51.1 changes lengths along an axis."""
        i = cartesian(self.machine).index(axis)
        return self.placement_code == SCALE or (self.placement_code == MIRROR and self.place.turn[4 * i] < 0.0)

    def end_turn(self, code: float) -> None:
        """G69, G50: of the code that it ends."""
        if self.placement_code == code:
            self._put(Placement(), 0.0)

    def end_mirror(self, block: Block, axes: Iterable[str]) -> None:
        """G50.1: of these axes, all for none."""
        if self.placement_code != MIRROR:
            return
        named = set(axes)
        self.mirrors = {axis: place for axis, place in self.mirrors.items() if named and axis not in named}
        left = MAKERS[MIRROR](Programmed(block, "", self.mirrors, {})) if self.mirrors else Placement()
        self._put(left, MIRROR if self.mirrors else 0.0)

    def _put(self, place: Placement, code: float) -> None:
        was_tilted, before, x_y_z = self.tilted, self.place, cartesian(self.machine)
        self.place, self.placement_code = place, code
        if was_tilted != self.tilted:
            self.recorder.set_frame(self.frame(), x_y_z)
        elif self.frame() != self.recorder.frame:
            self.recorder.set_frame(self.frame(), [x_y_z[i] for i in renamed(before, place)])

    def stand_upright(self, block: Block) -> None:
        """G53.1: the tool along the normal of the tilted plane; otherwise the control chooses how to turn it."""
        if not self.tilted:
            raise block.refuse("G53.1 without a tilted plane")
        degrees = np.add(self.recorder.position, self.recorder.frame.offset)
        known = all(self.recorder.known[i] != Known.ASSUMED for i in np.flatnonzero(self.machine.rotary))
        if (
            not known
            or lean(self.machine, np.where(self.machine.rotary, degrees, 0.0), normal_of(self.place)) > UPRIGHT
        ):
            raise block.refuse(
                "the tool is not perpendicular to the tilted plane, and the control chooses how G53.1 turns "
                "the rotary axes: turn them in a block before it"
            )
        self.upright = True
