"""Meaning of HEIDENHAIN Klartext blocks: modal state in, moves out; words that are not understood are refused."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping

import numpy as np

from kinematics.machine import TURN_DEG, Machine, NDArrayBool
from postproc.control.codes import INCH
from postproc.control.interpreter import Interpreter
from postproc.control.setup import Setup
from postproc.control.state import ControlState
from postproc.control.words import Content, value_of
from postproc.heidenhain.arcs import Arcs
from postproc.heidenhain.calls import program, unit_of
from postproc.heidenhain.channel import Channel
from postproc.heidenhain.codes import (
    AXIS_M,
    COMPENSATIONS,
    HARMLESS_FN,
    HARMLESS_KINDS,
    MOVING_KINDS,
    PLC_FN,
    PROGRAM_END_M,
    REFUSED_FN,
    REFUSED_KINDS,
    SKIPPABLE_M,
)
from postproc.heidenhain.cycles import Cycles
from postproc.heidenhain.datum_transformations import SHIFT_CYCLE
from postproc.heidenhain.modal_state import ModalState
from postproc.heidenhain.tilted_planes import Planes
from postproc.heidenhain.tools import Tools
from postproc.heidenhain.variables import QParameters, operations_of
from postproc.heidenhain.words import sort, straight
from postproc.motion.motions import Motions
from postproc.motion.moves import Arc, Kind
from postproc.motion.plain_moves import PlainMoves
from postproc.motion.rotary_words import Way
from postproc.text.block import Block
from postproc.text.blocks import PlainRun
from postproc.text.notes import Notes
from postproc.text.plain_columns import PlainVectors

_TCPM = re.compile(
    r"FUNCTION TCPM( F (TCP|CONT))?( AXIS POS)?( PATHCTRL (AXIS|VECTOR))?( REFPNT TIP-TIP)?( F ?[\d.,]+)?",
    re.IGNORECASE,
)
_HARMLESS_FUNCTION = re.compile(r"FUNCTION (MODE MILL|(S-PULSE|FEED DWELL)\b.*)", re.IGNORECASE)
_RESETS = {"TRANS MIRROR RESET": 8, "TRANS ROTATION RESET": 10, "TRANS SCALE RESET": 11}
"""RESET blocks, with the numbers of the cycles that have the same effect."""
WAYS = {126.0: Way.SHORTEST, 127.0: Way.AS_WRITTEN}
"""M functions for the way of rotary axes, until the other one."""
WITH_END = frozenset(("LCT",))
"""Departures whose end is in the block; the others end at a length, or on an arc, beyond the contour."""
OUTPUT_FN = frozenset((16, 20, 38))
"""Functions that write a text, wait for the PLC or send a message."""
SKIPPABLE_CYCLE = re.compile(r"CYCL DEF (9|32)\.", re.IGNORECASE)
"""The dwell and the tolerance."""
BUILDER_M = 92.0
MACHINE_M = frozenset((91.0, BUILDER_M))
"""The coordinates of the block count from a point of the machine."""
_FN = re.compile(r"FN ?(\d+)", re.IGNORECASE)


class HeidenhainInterpreter(Interpreter):
    """Reads Klartext blocks in order, in the modal state that the blocks before have left."""

    channel: Channel
    modal: ModalState
    nearest = "TX TY TZ: the control is taken to turn the rotary axes to the nearest solution"
    along_normals = "surface normals: the offset of the tool along them is not corrected"

    def __init__(self, machine: Machine, setup: Setup, notes: Notes) -> None:
        super().__init__(Channel(notes, ModalState(ControlState(setup)), QParameters(operations_of(machine.control))))
        self.arcs = Arcs(self.channel)
        self.tools = Tools(self.channel)
        self.planes = Planes(self.channel)
        self.cycles = Cycles(self.channel, self.planes)
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

    def read(self, blocks: Iterable[Block | PlainRun]) -> Motions:
        """The moves of a chunk of blocks, as for `Interpreter`."""
        self.arcs.new_chunk()
        return super().read(blocks)

    def _take_run(
        self, index: int, run: PlainRun, moves: PlainMoves, motion: np.ndarray, arcs: Mapping[int, Arc]
    ) -> None:
        super()._take_run(index, run, moves, motion, arcs)
        self.modal.motion = None

    def _read_singly(self, run: PlainRun, vectors: PlainVectors) -> NDArrayBool:
        return super()._read_singly(run, vectors) | (np.isfinite(vectors.tool[:, 0]) & (not self.modal.tcp))

    def _read_block(self, index: int, block: Block) -> Block:
        modal = self.modal
        if block.kind in HARMLESS_KINDS:
            return block
        compensated = modal.compensated
        self._run_block(index, block)
        shifted = modal.cornered or compensated or modal.compensated or block.kind == "normal_line"
        self.channel.no_insertion = (shifted or modal.calls_cycle) and block.kind in MOVING_KINDS
        modal.cornered = block.kind in ("rounding", "chamfer")
        return block

    def _run_block(self, index: int, block: Block) -> None:
        if self.modal.ended and block.kind != "begin_pgm":
            if block.kind != "end_pgm":
                self.note_after_end(block)
        elif block.kind == "probe" and self.channel.setup.probing and not block.skippable:
            self.channel.probe(block, " ".join(block.detail.split()[:3]))
            self.arcs.pole = None
        elif block.kind in REFUSED_KINDS:
            raise block.refuse(f"{block.detail}: {REFUSED_KINDS[block.kind]}")
        elif block.skippable and not _may_be_skipped(block):
            raise block.refuse_skip()
        elif block.kind in self._statements:
            self._statements[block.kind](index, block)
        elif block.kind == "end_pgm":
            self.modal.ended = True
        elif block.kind not in ("rounding", "chamfer"):
            self._read_positioning(index, block)

    def _begin(self, block: Block) -> None:
        modal = self.modal
        if modal.begun:
            raise block.refuse("the file has a second BEGIN PGM: write each program in a file of its own")
        modal.begun = True
        unit = block.detail.split()[-1].upper()
        self.channel.scope.unit = unit_of(block)
        if unit not in ("MM", "INCH"):
            self.notes.add("BEGIN PGM has no MM or INCH: the coordinates are taken in mm", block.line)
        modal.unit = INCH if unit == "INCH" else 1.0
        if modal.unit == INCH:
            self.control_state.meet_inches(block, self.notes)

    # ---- moves

    def _read_positioning(self, index: int, block: Block) -> None:
        content = sort(block)
        self._functions_at_start(block, content)
        self._compensate(block, content)
        if content.names and 94.0 not in content.m:
            name = next(iter(content.names))
            raise block.refuse(f"the axis {name} has no coordinate: write a number behind it")
        if not MACHINE_M.isdisjoint(content.m):
            self._machine_move(index, block, content)
        else:
            self._move(index, block, content)
        self._functions_at_end(block, content)

    def _move(self, index: int, block: Block, content: Content) -> None:
        channel = self.channel
        match block.kind:
            case "circle" | "circle_radius" | "tangent":
                self.arcs.circle(index, block, content)
            case "polar_line" | "polar_circle" | "polar_tangent":
                self.arcs.polar(index, block, content)
            case "approach" | "departure":
                self._approach(index, block, content)
            case "cycle_position":
                self.cycles.call_at(index, block, content)
            case "normal_line":
                self._normal_line(index, block, content)
            case "line" if content.axes:
                words = channel.axis_words(block, content.axes)
                channel.move(index, straight(content), channel.target(block, words), words)
            case _ if content.axes:
                raise block.refuse("the block has coordinates and no path function: write L before them")

    def _compensate(self, block: Block, content: Content) -> None:
        """RL and RR begin radius compensation; R0 and departures end it."""
        shifting = sorted(COMPENSATIONS & content.other.keys())
        if shifting and shifting[0] in ("R+", "R-"):
            raise block.refuse(
                f"{shifting[0]}: radius compensation of single axes is not corrected: write the compensated coordinates"
            )
        if shifting:
            self.channel.compensate(block)
        elif "R0" in content.other and block.kind == "line":
            self.channel.end_compensation()
        elif "R0" in content.other or block.kind == "departure":
            self.modal.compensated = False

    def _machine_move(self, index: int, block: Block, content: Content) -> None:
        """M91, or M92: from a point that only the machine manufacturer knows, so that the end is not known."""
        name = "M92" if BUILDER_M in content.m else "M91"
        if block.kind != "line":
            raise block.refuse(f"{name} needs a straight line: write L")
        if self.modal.tcp:
            raise block.refuse(f"{name} while M128 is on is not allowed by HEIDENHAIN: write M129 before it")
        words = self.channel.axis_words(block, content.axes)
        if BUILDER_M not in content.m:
            if words:
                self.channel.move_to_machine_position(index, block, words)
            return
        self.channel.mark_unknown([self.machine.names[word.axis] for word, _ in words])
        self.notes.add(
            "M92 counts from a point of the machine manufacturer: the move stays as programmed, and the positions of "
            "its axes after it are taken as unknown",
            block.line,
        )

    def _approach(self, index: int, block: Block, content: Content) -> None:
        """APPR LT, LN, CT, LCT to the first point of a contour; DEP from the last one.

        The control calculates the path to the contour, or from it, from the elements after or before it and the radius
        of the tool. The path leads to the point of the block, and that point is corrected; so are the first and last
        elements of the contour, so the path stays as tangential as it was.
        """
        channel = self.channel
        form = block.detail.upper().split()[-1]
        if form.startswith("P"):
            raise block.refuse(
                f"{block.detail}: an approach in polar coordinates is not corrected: write it with X and Y"
            )
        if self.modal.tcp:
            raise block.refuse(f"{block.detail} while M128 is on is not corrected: write M129 before it")
        words = channel.axis_words(block, content.axes)
        if block.kind == "approach" and not any(self.machine.names[word.axis] in "XY" for word, _ in words):
            raise block.refuse(f"{block.detail} needs the first point of the contour: write its X and Y in the block")
        if words:
            channel.move(index, Kind.RAPID, channel.target(block, words), words)
        if block.kind == "departure" and form not in WITH_END:
            channel.mark_unknown("XY")
        text = "approaches and departures end at corrected points; the control calculates the path between them"
        self.notes.add(text, block.line)

    def _normal_line(self, index: int, block: Block, content: Content) -> None:
        """LN X Y Z with NX NY NZ, along which the control shifts the tool by its oversizes, and with TX TY TZ (M128).

        X Y Z are those of the tool point and are corrected; both vectors stay. Where TX TY TZ take the rotary axes is
        calculated, and no word of ncomp names them.
        """
        channel = self.channel
        normal, tool_axis = _vector(block, "N"), _vector(block, "T")
        if normal is None and tool_axis is None:
            raise block.refuse("LN needs a vector: write NX NY NZ, or TX TY TZ, or both")
        words = channel.axis_words(block, content.axes)
        target = channel.target(block, words)
        if tool_axis is not None:
            if not self.modal.tcp or self.modal.tilt is not None or self.recorder.frame.turn is not None:
                raise block.refuse("TX TY TZ need M128 and coordinates that are not rotated: write M128 before them")
            if any(channel.rotary[word.axis] for word, _ in words):
                raise block.refuse("TX TY TZ and a rotary axis in one block: write one of them")
            channel.turn_along(block, target, tool_axis)
            self.notes.add(self.nearest, block.line)
        if normal is not None:
            self.notes.add(self.along_normals, block.line)
        channel.move(index, straight(content), target, words)

    # ---- functions

    def _functions_at_start(self, block: Block, content: Content) -> None:
        for code in content.m:
            if code in AXIS_M and (content.axes or content.names):
                raise block.refuse(f"M{code:g} {AXIS_M[code]}")
            self.channel.take_function(block, code)
            self.channel.set_by_control(f"M{code:g}")
        for code, way in WAYS.items():
            if code in content.m:
                self.recorder.rotary.turn_by(way)
        if 94.0 in content.m:
            self._take_off_turns(block, content)
        if 143.0 in content.m:
            self.channel.delete_basic_rotation(block)
        if 124.0 in content.m:
            self.notes.add("M124: the control may skip short blocks, also blocks that ncomp adds", block.line)
        if 128.0 in content.m:
            self._start_tcp(block, "M128")
        if 140.0 in content.m:
            self._retract()

    def _functions_at_end(self, block: Block, content: Content) -> None:
        self.cycles.run_behind(block, content)
        if 129.0 in content.m:
            self.channel.switch_tcp(False)
        if 6.0 in content.m:
            self.channel.mark_unknown(self.machine.control.tool_change_moves)
        if not PROGRAM_END_M.isdisjoint(content.m):
            self.modal.ended = True

    def _start_tcp(self, block: Block, name: str) -> None:
        if self.modal.tilt is not None:
            raise block.refuse(f"{name} in a tilted plane is not followed: write PLANE RESET before it")
        self.channel.switch_tcp(True)
        self.channel.note_tcp(name, block)

    def _take_off_turns(self, block: Block, content: Content) -> None:
        """M94: the control counts rotary axes, or those that are named, between 0 and 360 degrees from here."""
        recorder = self.recorder
        named = {recorder.axis(block, block.words[i].address) for i in content.names.values()}
        for axis in named or self.channel.rotary_axes:
            if recorder.known[axis]:
                recorder.rotary.turns[axis] = TURN_DEG * (recorder.position[axis] // TURN_DEG)

    def _retract(self) -> None:
        """M140: the tool goes off along its axis."""
        leans = self.recorder.frame.tcp or any(axis.rotary and axis.side == "tool" for axis in self.machine.axes)
        self.channel.mark_unknown("XYZ" if leans else "Z")

    # ---- statements

    def _call_program(self, block: Block) -> None:
        """CALL PGM: its effect on parameters is a step of the block."""
        if not self.machine.control.calls_leave_state:
            raise block.refuse(
                f"{block.detail}: {_why_not_followed(block.detail)}; if it leaves tool, frames and modes unchanged, "
                "write calls_leave_state = true in the machine file"
            )
        self.channel.mark_unknown(self.machine.names)
        self.arcs.pole = None
        text = f"{block.detail} is taken to leave tool, frames and modes as they are (machine file: calls_leave_state)"
        self.notes.add(text, block.line)

    def _transformation(self, block: Block) -> None:
        words = {word.address: word.value for word in block.words}
        if block.detail.upper() == "TRANS DATUM AXIS" and words:
            self.cycles.shift(block, SHIFT_CYCLE, {name: value or 0.0 for name, value in words.items()})
        elif block.detail.upper() == "TRANS DATUM RESET":
            self.cycles.shift(block, SHIFT_CYCLE, dict.fromkeys("XYZ", 0.0))
        elif block.words or (cycle := _RESETS.get(block.detail.upper())) is None:
            raise block.refuse(f"{block.detail} transforms the coordinates in a form that is not followed")
        elif cycle in self.modal.transformations.active or cycle in self.modal.tilted_transformations.active:
            raise block.refuse(f"{block.detail} ends cycle {cycle} on some controls only: reset it by CYCL DEF {cycle}")

    def _fn(self, block: Block) -> None:
        match = _FN.match(block.detail)
        assert match is not None
        number = int(match[1])
        if number in REFUSED_FN:
            raise block.refuse(f"FN {number} {REFUSED_FN[number]}")
        if number in PLC_FN:
            self.notes.add(f"FN {number} passes values to the PLC and is taken to move nothing", block.line)
        elif number not in HARMLESS_FN:
            self.channel.accept(block, f"FN {number}", f"FN {number} is not known to ncomp: remove it")

    def _function(self, block: Block) -> None:
        if _TCPM.fullmatch(block.detail):
            self._start_tcp(block, "FUNCTION TCPM")
        elif block.detail.upper() == "FUNCTION RESET TCPM":
            self.channel.switch_tcp(False)
        elif not _HARMLESS_FUNCTION.fullmatch(block.detail):
            name = " ".join(block.detail.split()[:2])
            self.channel.accept(block, name, f"{block.detail} is not known to ncomp: remove it")


def _may_be_skipped(block: Block) -> bool:
    """Whether no other block depends on this one: STOP, M functions that move nothing, outputs, dwell and tolerance."""
    match block.kind:
        case "stop" | "miscellaneous" | "line":
            return all(
                word.address == "S" or (word.address == "M" and word.value in SKIPPABLE_M) for word in block.words
            )
        case "fn":
            return block.code is None and (found := _FN.match(block.detail)) is not None and int(found[1]) in OUTPUT_FN
        case "cycle_def":
            return SKIPPABLE_CYCLE.match(block.detail) is not None
        case "tool_def":
            return all(word.address == "T" for word in block.words)
    return False


def _vector(block: Block, kind: str) -> list[float] | None:
    words = {word.address: word for word in block.words if word.address in (f"{kind}X", f"{kind}Y", f"{kind}Z")}
    if not words:
        return None
    if len(words) < 3 or sum(word.address in words for word in block.words) > 3:
        raise block.refuse(f"{kind}X {kind}Y {kind}Z must all be in the block, each once")
    return [value_of(block, words[kind + axis]) for axis in "XYZ"]


def _why_not_followed(call: str) -> str:
    """The reason why the program of a `CALL PGM` is not read."""
    if not program(call[len("CALL PGM") :]):
        return "a program outside of the folder of the calling one is not read: write its name alone"
    return "its file is not in the folder of the program: write it there, or give its folder by --subprograms"
