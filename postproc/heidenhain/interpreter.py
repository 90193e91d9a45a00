"""Meaning of HEIDENHAIN Klartext blocks: modal state in, moves out; words that are not understood are refused."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

import numpy as np

from kinematics.machine import Machine
from postproc.control.codes import INCH
from postproc.control.functions import end_compensation, note_after_end, note_tcp, note_unknown_m
from postproc.control.setup import Setup
from postproc.control.state import ControlState
from postproc.heidenhain.approach import approach
from postproc.heidenhain.arcs import Arcs
from postproc.heidenhain.codes import (
    AXIS_M,
    CALL_M,
    COMPENSATIONS,
    HARMLESS_FN,
    HARMLESS_KINDS,
    HARMLESS_M,
    MEANT_M,
    MOVING_KINDS,
    PLC_FN,
    PROGRAM_END_M,
    REFUSED_FN,
    REFUSED_KINDS,
    REFUSED_M,
)
from postproc.heidenhain.cycles import Cycles
from postproc.heidenhain.datum_transformations import SHIFT
from postproc.heidenhain.modal_state import Content, Control, sort
from postproc.heidenhain.tilted_planes import Planes
from postproc.heidenhain.tool_vectors import normal_line
from postproc.heidenhain.tools import Tools
from postproc.heidenhain.variables import QParameters, operations_of
from postproc.motion.motions import Motions
from postproc.motion.moves import Kind
from postproc.motion.recorder import Recorder
from postproc.text.block import Block
from postproc.text.notes import Notes

_TCPM = re.compile(
    r"FUNCTION TCPM( F (TCP|CONT))?( AXIS POS)?( PATHCTRL (AXIS|VECTOR))?( REFPNT TIP-TIP)?( F ?[\d.,]+)?",
    re.IGNORECASE,
)
_HARMLESS_FUNCTION = re.compile(r"FUNCTION (MODE MILL|(S-PULSE|FEED DWELL)\b.*)", re.IGNORECASE)
_RESETS = {"TRANS MIRROR RESET": 8, "TRANS ROTATION RESET": 10, "TRANS SCALE RESET": 11}
"""RESET blocks, with the numbers of the cycles that have the same effect."""
_FN = re.compile(r"FN ?(\d+)", re.IGNORECASE)


@dataclass
class HeidenhainInterpreter:
    """Reads blocks in order; modal state carries over from chunk to chunk."""

    machine: Machine
    setup: Setup
    notes: Notes
    scope: QParameters = field(default_factory=QParameters)

    def __post_init__(self) -> None:
        self.control_state = ControlState(self.setup)
        self.scope.operations = operations_of(self.machine.control)
        self.control = Control(self.machine, self.control_state, self.notes, self.scope)
        self.arcs = Arcs(self.control)
        self.tools = Tools(self.control)
        self.planes = Planes(self.control)
        self.cycles = Cycles(self.control, self.planes)
        self._statements: dict[str, Callable[[int, Block], None]] = {
            "begin_pgm": lambda _, block: self._begin(block),
            "tool_call": lambda _, block: self.tools.call(block),
            "tool_def": lambda _, block: self.tools.define(block),
            "cycle_def": self.cycles.define,
            "cycle_call": lambda _, block: self.cycles.call(block),
            "fn": lambda _, block: self._fn(block),
            "function": lambda _, block: self._function(block),
            "plane": self.planes.define,
            "transformation": lambda _, block: self._transformation(block),
            "centre": self.arcs.set_pole,
            "program_call": lambda _, block: self._call_program(block),
        }

    @property
    def ended(self) -> bool:
        """The program has come to its end."""
        return self.control.ended

    @property
    def moved(self) -> bool:
        """False: cycles that run after moves (M89) are refused."""
        return False

    @property
    def recorder(self) -> Recorder:
        """Where the axes are."""
        return self.control.recorder

    def read(self, blocks: Iterable[Block]) -> Motions:
        """The moves of a chunk of blocks, each read before the next is asked for.

        Refusal at the first block that isn't fully understood.
        """
        self.arcs.new_chunk()
        control, done = self.control, []
        for index, block in enumerate(blocks):
            done.append(block)
            if block.kind in HARMLESS_KINDS:
                continue
            compensated = control.compensated
            self._read_block(index, block)
            self.control_state.use(block, control.recorder.used)
            shifted = control.cornered or compensated or control.compensated or block.kind == "normal_line"
            if shifted and block.kind in MOVING_KINDS:
                done[-1] = block._replace(no_insertion=True)
            control.cornered = block.kind in ("rounding", "chamfer")
        return control.recorder.finish(done)

    def _read_block(self, index: int, block: Block) -> None:
        if self.ended and block.kind != "begin_pgm":
            if block.kind != "end_pgm":
                note_after_end(block, self.notes)
        elif block.kind in REFUSED_KINDS:
            raise block.refuse(f"{block.detail}: {REFUSED_KINDS[block.kind]}")
        elif block.skippable:
            raise block.refuse_skip()
        elif block.kind in self._statements:
            self._statements[block.kind](index, block)
        elif block.kind == "end_pgm":
            self.control.ended = True
        elif block.kind not in ("rounding", "chamfer"):
            self._read_positioning(index, block)

    def _begin(self, block: Block) -> None:
        control = self.control
        if control.begun:
            raise block.refuse("a second program in one file")
        control.begun = True
        unit = block.detail.split()[-1].upper()
        if unit not in ("MM", "INCH"):
            self.notes.add("BEGIN PGM without MM or INCH: coordinates taken in mm", block.line)
        control.unit = INCH if unit == "INCH" else 1.0

    # ---- moves

    def _read_positioning(self, index: int, block: Block) -> None:
        content = sort(block)
        frame = self.recorder.frame
        self._functions_at_start(block, content)
        frame_unchanged = frame == self.recorder.frame
        self._compensate(block, content)
        if content.bare_axes and 94.0 not in content.m:
            raise block.refuse(f"{block.words[content.bare_axes[0]].address} without a number")
        if 91.0 in content.m:
            self._machine_move(index, block, content)
        else:
            self._move(index, block, content, frame_unchanged)
        self._functions_at_end(block, content)

    def _move(self, index: int, block: Block, content: Content, frame_unchanged: bool) -> None:
        match block.kind:
            case "circle" | "circle_radius" | "tangent":
                self.arcs.circle(index, block, content, frame_unchanged)
            case "polar_line" | "polar_circle" | "polar_tangent":
                self.arcs.polar(index, block, content, frame_unchanged)
            case "approach" | "departure":
                approach(self.control, index, block, content)
            case "cycle_position":
                self.cycles.call_at(index, block, content)
            case "normal_line":
                normal_line(self.control, index, block, content, frame_unchanged)
            case "line" if content.axes:
                self._line(index, block, content, frame_unchanged)
            case _ if content.axes:
                raise block.refuse("coordinates without L")

    def _compensate(self, block: Block, content: Content) -> None:
        """Radius compensation: the points of the contour are corrected, and the control shifts the path with them."""
        control, shifting = self.control, sorted(COMPENSATIONS & content.other)
        if shifting and (shifting[0] in ("R+", "R-") or control.tcp):
            raise block.refuse(f"{shifting[0]}: radius compensation of single axes, or under M128, is not corrected")
        if shifting:
            control.compensated = True
            self.notes.add("radius compensation: the points of the contour are corrected", block.line)
        elif "R0" in content.other or block.kind == "departure":
            if control.compensated and block.kind == "line":
                end_compensation(control.recorder, "XYZ")
            control.compensated = False

    def _line(self, index: int, block: Block, content: Content, frame_unchanged: bool) -> None:
        words = self.control.axis_words(block, content.axes)
        target = self.control.target(block, words)
        kind = Kind.RAPID if "FMAX" in content.other else Kind.LINE
        self.recorder.move(
            index, kind, target, self.control.unit, tuple(word for word, _ in words), frame_unchanged=frame_unchanged
        )

    def _machine_move(self, index: int, block: Block, content: Content) -> None:
        if block.kind != "line":
            raise block.refuse("M91 without a straight line")
        if self.control.tcp:
            raise block.refuse("M91 while M128 is on: HEIDENHAIN asks for M129 before it")
        words = self.control.axis_words(block, content.axes)
        if any(word.incremental for word, _ in words):
            raise block.refuse("an increment from an earlier M91 position")
        if words:
            targets = {word.axis: value for word, value in words}
            self.recorder.move_to_machine_position(index, targets, tuple(word for word, _ in words))

    # ---- functions

    def _functions_at_start(self, block: Block, content: Content) -> None:
        for code in content.m:
            if code in REFUSED_M:
                raise block.refuse(f"M{code:g} {REFUSED_M[code]}")
            if code in AXIS_M and (content.axes or content.bare_axes):
                raise block.refuse(f"M{code:g} {AXIS_M[code]}")
            if code not in HARMLESS_M and code not in MEANT_M:
                note_unknown_m(code, block, self.recorder, self.notes)
        if 94.0 in content.m:
            self._take_off_turns(block, content)
        if 143.0 in content.m:
            self.control.delete_basic_rotation(block)
        if 124.0 in content.m:
            self.notes.add("M124: the control may skip short blocks, also blocks that ncomp adds", block.line)
        if 128.0 in content.m:
            self._start_tcp(block, "M128")
        if 140.0 in content.m:
            self._retract()

    def _functions_at_end(self, block: Block, content: Content) -> None:
        if CALL_M in content.m:
            self.cycles.run(block)
        if 129.0 in content.m:
            self.control.switch_tcp(False)
        if 6.0 in content.m:
            self.control.mark_unknown(self.machine.control.tool_change_moves)
        if not PROGRAM_END_M.isdisjoint(content.m):
            self.control.ended = True

    def _start_tcp(self, block: Block, name: str) -> None:
        if self.control.tilt is not None:
            raise block.refuse(f"{name} in a tilted plane")
        self.control.switch_tcp(True)
        note_tcp(name, block, self.notes)

    def _take_off_turns(self, block: Block, content: Content) -> None:
        """M94: the control counts rotary axes, or those that are named, between 0 and 360 degrees from here."""
        recorder = self.recorder
        named = {recorder.axis(block, block.words[i].address) for i in content.bare_axes}
        for axis in named or np.flatnonzero(self.machine.rotary).tolist():
            if not 0.0 <= recorder.position[axis] < 360.0 and recorder.known[axis]:
                name, at = self.machine.names[axis], recorder.position[axis]
                raise block.refuse(f"M94 subtracts whole turns from {name}{at:g}: its turn is not known then")

    def _retract(self) -> None:
        """M140: the tool goes off along its axis."""
        leans = self.recorder.frame.tcp or any(axis.rotary and axis.side == "tool" for axis in self.machine.axes)
        self.control.mark_unknown("XYZ" if leans else "Z")

    # ---- statements

    def _call_program(self, block: Block) -> None:
        """CALL PGM: its effect on parameters is a step of the block."""
        if not self.machine.control.calls_leave_state:
            reason = "other programs are not followed; if they leave tool, frames and modes unchanged, write"
            raise block.refuse(f"{block.detail}: {reason} calls_leave_state = true in the machine file")
        self.control.mark_unknown(self.machine.names)
        self.arcs.pole = None
        says = f"{block.detail}: taken to leave tool, frames and modes as they are (machine file: calls_leave_state)"
        self.notes.add(says, block.line)

    def _transformation(self, block: Block) -> None:
        words = {word.address: word.value for word in block.words}
        if block.detail.upper() == "TRANS DATUM AXIS" and words:
            self.cycles.shift(block, SHIFT, {name: value or 0.0 for name, value in words.items()})
        elif block.detail.upper() == "TRANS DATUM RESET":
            self.cycles.shift(block, SHIFT, dict.fromkeys("XYZ", 0.0))
        elif block.words or (cycle := _RESETS.get(block.detail.upper())) is None:
            raise block.refuse(f"{block.detail}: changes the meaning of coordinates, which is not followed")
        elif cycle in self.control.transformations.active or cycle in self.control.tilted_transformations.active:
            raise block.refuse(f"{block.detail}: whether it ends cycle {cycle} depends on the control")

    def _fn(self, block: Block) -> None:
        match = _FN.match(block.detail)
        assert match is not None
        number = int(match[1])
        if number in REFUSED_FN:
            raise block.refuse(f"{block.detail}: {REFUSED_FN[number]}")
        if number in PLC_FN:
            self.notes.add(f"FN {number} passes values to the PLC and is taken to move nothing", block.line)
        elif number not in HARMLESS_FN:
            raise block.refuse(f"FN {number} is not known")

    def _function(self, block: Block) -> None:
        if _TCPM.fullmatch(block.detail):
            self._start_tcp(block, "FUNCTION TCPM")
        elif block.detail.upper() == "FUNCTION RESET TCPM":
            self.control.switch_tcp(False)
        elif not _HARMLESS_FUNCTION.fullmatch(block.detail):
            raise block.refuse(f"{block.detail}: is not known")
