"""Meaning of Siemens 840D blocks: modal state in, moves out; an unknown word that could move the tool is refused."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from kinematics.machine import Machine, NDArrayBool
from postproc.control.codes import DWELL, MOTION
from postproc.control.interpreter import Interpreter
from postproc.control.setup import Setup
from postproc.control.state import ControlState
from postproc.control.words import value_of
from postproc.motion.cutter_compensation import follow_contour
from postproc.motion.frames import renamed
from postproc.motion.moves import Arc, Kind, Known
from postproc.motion.plain_moves import PlainMoves
from postproc.siemens.arcs import ARC_WORDS, Programmed, arc_of, calculated_arc, with_angle
from postproc.siemens.channel import Channel
from postproc.siemens.codes import (
    CALCULATED_ARCS,
    CALCULATED_CURVES,
    CORNERS,
    FRAME_ENDS,
    HARMLESS_G,
    LENGTH_STAYS,
    LIMITS,
    MACHINE,
    MOVING_NAMES,
    POLES,
    REFERENCE,
    REFUSED_G,
    VECTOR,
    VECTOR_WORDS,
    WORK_OFFSETS,
)
from postproc.siemens.cycle800 import tilt
from postproc.siemens.cycles import check_tolerance_cycle, read_cycle, run_modal_cycle
from postproc.siemens.modal_state import ModalState, SavedModes
from postproc.siemens.polar import POLAR
from postproc.siemens.reading.calls import ends, saves_modes
from postproc.siemens.reading.definitions import define_all
from postproc.siemens.reading.positions import Positions
from postproc.siemens.splines import begin_spline, take_point
from postproc.siemens.tools import take_functions
from postproc.siemens.variables import EMPTY, SiemensVariables
from postproc.siemens.words import Content, check, plain_of, sort
from postproc.text.block import Block
from postproc.text.blocks import PlainRun
from postproc.text.expressions import Constant
from postproc.text.notes import Notes
from postproc.text.plain_columns import PlainVectors

BY_CONTROL = -1.0
"""Instead of a G code: a circle that the control calculates (CIP, CT) is active."""
WITHOUT_MOTION = LIMITS | {DWELL}
"""The tool stays where it is, whatever the words of the block."""


class SiemensInterpreter(Interpreter):
    """Reads Siemens 840D blocks in order, in the modal state that the blocks before have left."""

    channel: Channel
    modal: ModalState
    nearest = "tool vectors: the control is taken to turn the rotary axes to the nearest solution"

    def __init__(self, machine: Machine, setup: Setup, notes: Notes) -> None:
        control, scope = machine.control, SiemensVariables()
        scope.passive, scope.basic_unit_is_inch = frozenset(control.passive_axes), control.unit == "inch"
        for name, text in setup.definitions:
            define_all(scope, name, text)
        super().__init__(Channel(notes, ModalState(ControlState(setup)), scope))
        self._positions = Positions(self.channel)
        scope.positions = self._positions
        self._saved: list[SavedModes] = []
        """Modes that subprograms with SAVE found, the last one last."""
        self._moved: Block | None = None
        """The last block, if it moved the tool along a path."""
        self._moved_otherwise: Block | None = None
        """The last block, if the control may run a subprogram of MCALL at other positions than its end."""

    @property
    def moved(self) -> bool:
        """True if the last block moved the tool along a path; Refusal if a call by MCALL after it is not followed."""
        if self._moved_otherwise is not None:
            raise self._moved_otherwise.refuse(
                "a cycle, a pattern of positions or a move to machine coordinates is not followed while MCALL of a "
                "subprogram is active: write its positions as blocks, or MCALL before it"
            )
        block, self._moved = self._moved, None
        if block is not None and (
            self.modal.compensated or self.modal.cornered or self.modal.spline or self.recorder.stayed
        ):
            raise block.refuse(
                "MCALL of a subprogram with radius compensation, a broken corner, a spline or a move to the present "
                "position is not followed: end it before the block"
            )
        return block is not None

    def _take_run(
        self, index: int, run: PlainRun, moves: PlainMoves, motion: np.ndarray, arcs: Mapping[int, Arc]
    ) -> None:
        super()._take_run(index, run, moves, motion, arcs)
        self.modal.begun, self._positions.beside_contour = True, False

    def _read_singly(self, run: PlainRun, vectors: PlainVectors) -> NDArrayBool:
        return super()._read_singly(run, vectors) | self.modal.machine_vectors

    def _read_block(self, index: int, block: Block) -> Block:
        channel, modal = self.channel, self.modal
        self._keep_modes(block)
        self._moved = self._moved_otherwise = None
        if block.kind == "header":
            self._begin_program(block)
        if block.kind != "words":
            return block
        if modal.ended:
            self.note_after_end(block)
            return block
        content = sort(block, self.machine.control.passive_axes)
        check(block, content, channel.accept)
        modal.begun = True
        take_functions(channel, block, content)
        claimed = self._modes(block, content) if content.g or content.names else None
        corner = self._corner(block, content)
        self._positions.check(block, content, claimed)
        if content.frames:
            self._change_frame(block, content)
        elif claimed in POLES:
            modal.polar.set_pole(channel, block, content, claimed or 0.0)
        elif claimed in REFERENCE:
            self.recorder.mark_unknown(list(range(len(self.machine.axes))))
        elif claimed in MACHINE or "SUPA" in content.names:
            self._machine_move(index, block, content)
        elif "CYCLE800" in content.names:
            tilt(channel, index, block, content)
        elif read_cycle(channel, index, block, content):
            modal.polar.clear()
        elif content.moves and claimed not in WITHOUT_MOTION:
            drills, points = modal.cycle is not None, not VECTOR_WORDS.isdisjoint(content.other)
            block = self._move(index, block, content, divisible=not drills)
            channel.no_insertion = corner or modal.compensated or drills or points or bool(modal.spline)
            run_modal_cycle(channel, index, block)
            self._moved = block
        self._moved_otherwise = block if _moves_otherwise(content, claimed) else None
        modal.ended = bool(content.m or content.names) and ends(block) and not channel.scope.depth
        return block

    def _begin_program(self, block: Block) -> None:
        if self.modal.begun:
            raise block.refuse("the program before this one has no end: write M30, M17 or RET before this block")
        self.modal.begun = True

    def _keep_modes(self, block: Block) -> None:
        """Restore the modes of the caller behind a subprogram with SAVE, and keep them at its beginning."""
        depth = self.channel.scope.depth
        ended = depth - saves_modes(block)  # one that begins again has ended before
        while self._saved and ended < self._saved[-1].depth:
            saved = self._saved.pop()
            if saved.put_back(block, self.modal):
                self._set_work_offset(block, saved.work_offset)
                self.modal.offset_programmed = saved.offset_programmed
        if depth and saves_modes(block):
            self._saved.append(SavedModes.of(self.modal, depth))

    def _corner(self, block: Block, content: Content) -> bool:
        """True where the corner that this block begins at, or ends at, is one that the control breaks."""
        modal = self.modal
        before, here = modal.cornered, not CORNERS.isdisjoint(content.other)
        if here:
            self.notes.add("chamfers and roundings: the corner points are corrected", block.line)
        if "RNDM" in content.other:
            modal.rounded = value_of(block, block.words[content.other["RNDM"]]) > 0.0
        if content.moves:
            modal.cornered = here
        return modal.rounded or before or here

    # ---- modes and frames

    def _modes(self, block: Block, content: Content) -> float | None:
        """Take over the modal codes; the G code that claims the block's axis words for itself, or None."""
        channel = self.channel
        claimed = None
        for code in content.g:
            if code in WITHOUT_MOTION or code in MACHINE or code in REFERENCE or code in POLES:
                claimed = code
            elif code in WORK_OFFSETS:
                self._set_work_offset(block, f"G{code:.0f}")
            elif not channel.take_mode(block, code) and code not in HARMLESS_G:
                channel.take_unknown(block, code, REFUSED_G, moves=content.moves)
        if DWELL in content.g and content.axes:
            raise block.refuse("G4 has a coordinate: write F or S, the time of the dwell")
        if self.modal.tilted and not FRAME_ENDS.isdisjoint(content.names):
            raise block.refuse(
                f"{', '.join(FRAME_ENDS & content.names.keys())} in a tilted plane is not followed: write CYCLE800() "
                "before it"
            )
        if "CYCLE832" in content.names:
            check_tolerance_cycle(channel, block, block.words[content.names["CYCLE832"]])
        if not CALCULATED_CURVES.isdisjoint(content.names):
            self._begin_curve(block, content)
        if "TRAORI" in content.names or "TRAFOOF" in content.names:
            self._switch_tcp(block, content)
        if "ORIWKS" in content.names or "ORIMKS" in content.names:
            self.modal.machine_vectors = "ORIMKS" in content.names
        if "RET" in content.names and block.words[content.names["RET"]].arguments is not None:
            raise block.refuse("RET with arguments returns to another block, which is not followed: write RET alone")
        return claimed

    def _begin_curve(self, block: Block, content: Content) -> None:
        """A spline, or CIP and CT instead of G2 and G3."""
        modal = self.modal
        if CALCULATED_ARCS.isdisjoint(content.names):
            begin_spline(self.channel, block, content)
            return
        if len(CALCULATED_CURVES & content.names.keys()) > 1 or not MOTION.keys().isdisjoint(content.g):
            raise block.refuse("CIP and CT exclude G0 to G3 and each other in one block: write one of them")
        if not POLAR.isdisjoint(content.other) or modal.tcp:
            raise block.refuse(
                "CIP or CT with polar coordinates, or while TRAORI is on, is not corrected: write G2 or G3"
            )
        if modal.cornered or modal.rounded:
            raise block.refuse(
                "CIP or CT directly after a chamfer or rounding is not corrected: write G2 or G3 with a centre"
            )
        modal.motion, modal.spline = BY_CONTROL, ""

    def _set_work_offset(self, block: Block, name: str) -> None:
        channel, modal, state = self.channel, self.modal, self.control_state
        if modal.tilted and name != modal.work_offset:
            raise block.refuse("the work offset changes in a tilted plane: write CYCLE800() before it")
        data = channel.scope.data
        if name in data.offsets:
            state.offsets[name] = data.coarse(name)
            state.fine[name] = dict(data.fine.get(name, {}))
            if name not in data.whole and not data.fine.get(name) and channel.setup.names_offset(name):
                self.notes.add(f"{name}: the fine shift, which the program does not set, is taken as 0", block.line)
        modal.work_offset, modal.offset_programmed = name, True
        channel.change_frame(range(len(self.machine.axes)))

    def _switch_tcp(self, block: Block, content: Content) -> None:
        on = "TRAORI" in content.names
        arguments = block.words[content.names["TRAORI" if on else "TRAFOOF"]].arguments
        given = [argument for argument in arguments or () if argument != EMPTY]
        if given and (not on or given != [Constant(1.0)]):
            raise block.refuse(
                "TRAORI with another transformation than the first, or a direction, is not followed: write TRAORI(1)"
            )
        if on and self.modal.tilted:
            raise block.refuse("TRAORI in a tilted plane is not followed: write CYCLE800() before it")
        if on:
            self.channel.note_tcp("TRAORI", block)
        self.channel.switch_tcp(on)

    def _change_frame(self, block: Block, content: Content) -> None:
        """A statement of the programmable frame."""
        channel, transformations = self.channel, self.modal.transformations
        before, placed = self.recorder.frame, transformations.programmed
        shifted = transformations.change(channel, block, content)
        after = self.modal.frame()
        changed = {channel.machine.index(axis) for axis in shifted}
        changed.update(channel.x_y_z[i] for i in renamed(placed, transformations.programmed))
        changed.update(i for i in channel.rotary_axes if before.offset[i] != after.offset[i])
        self.recorder.set_frame(after, changed)

    # ---- moves

    def _machine_move(self, index: int, block: Block, content: Content) -> None:
        modal = self.modal
        if modal.motion not in (None, 0.0, 1.0) or modal.spline:
            raise block.refuse("machine coordinates need a straight line: write G0 or G1")
        words = self.channel.axis_words(block, content.axes)
        if words and (modal.tcp or modal.cycle is not None):
            raise block.refuse("machine coordinates while TRAORI or MCALL is on are not corrected: end it before them")
        if words:
            kept = self.machine.control.g53_tool_length == "kept"
            self.channel.move_to_machine_position(index, block, words, modal.length if kept else 0.0)
            modal.polar.clear()

    def _move(self, index: int, block: Block, content: Content, *, divisible: bool) -> Block:
        """Record a move; its block comes back with the words that a correction may change."""
        modal, channel = self.modal, self.channel
        if modal.motion is None:
            self.notes.add("no G0 or G1 before it: the coordinates are taken for straight lines", block.line)
            modal.motion = 1.0
        if modal.motion == BY_CONTROL and CALCULATED_ARCS.isdisjoint(content.names):
            raise block.refuse(
                "CIP or CT is modal from an earlier block, which ncomp corrects to G2 or G3: write it in every block"
            )
        if modal.length and modal.plane != "XYZ":
            self.notes.add(LENGTH_STAYS, block.line)
        kind = MOTION.get(modal.motion, Kind.ARC)
        programmed = Programmed(block, channel.axis_words(block, content.axes), {})
        if any(word.incremental for word, _ in programmed.words):
            self._check_increments(block, programmed)
        polar = not POLAR.isdisjoint(content.other)
        if polar:
            programmed = modal.polar.coordinates(channel, block, content, programmed)
        elif modal.polar.radius is not None and any(block.words[i].address in modal.plane[:2] for i in content.axes):
            modal.polar.clear()
        if kind is not Kind.ARC and content.other.keys() & ARC_WORDS:
            raise block.refuse("the block has a centre, a radius or turns, but no arc: write G2 or G3")
        if kind is Kind.ARC and "AR" in content.other:
            programmed = with_angle(channel, block, content, programmed)
        target = programmed.target(self.recorder)
        if not VECTOR_WORDS.isdisjoint(content.other):
            self._point(block, content, target)
        arc = self._arc(programmed.block, content, target, polar) if kind is Kind.ARC else None
        take_point(channel, block, content, target)
        self._positions.beside_contour = modal.compensated
        if modal.compensated:
            follow_contour(self.recorder, modal.plane_columns[:2], target, arc)
        channel.move(index, kind, target, programmed.words, arc, divisible=divisible)
        return programmed.block

    def _arc(self, block: Block, content: Content, target: list[float], polar: bool) -> Arc:
        channel = self.channel
        if polar:
            return self.modal.polar.arc(channel, block, content, target)
        if not CALCULATED_ARCS.isdisjoint(content.names):
            return calculated_arc(channel, block, content, target)
        return arc_of(channel, block, content, target)

    def _point(self, block: Block, content: Content, target: list[float]) -> None:
        """A tool vector."""
        if not self.modal.tcp or self.modal.machine_vectors:
            raise block.refuse(
                "a tool vector without TRAORI, or with ORIMKS, is not corrected: write TRAORI and ORIWKS before it"
            )
        if not all(self.recorder.frame.keeps_circles(plane) for plane in ("XY", "YZ")):
            raise block.refuse(
                "a tool vector with different factors of SCALE is not corrected: write one factor for all axes"
            )
        words = {address: content.other.pop(address) for address in VECTOR if address in content.other}
        vector = np.array([plain_of(block, block.words[words[a]]) if a in words else 0.0 for a in VECTOR])
        self.channel.turn_along(block, target, self.recorder.frame.turned(vector).tolist())
        self.notes.add(self.nearest, block.line)

    def _check_increments(self, block: Block, programmed: Programmed) -> None:
        for word, _ in programmed.words:
            declared = word.axis in self.recorder.start.at
            if word.incremental and self.recorder.known[word.axis] == Known.MACHINE and not declared:
                name = self.machine.names[word.axis]
                raise block.refuse(
                    f"an increment of {name} before its first absolute position in this frame depends on settings of "
                    "the control: write an absolute position first, or state --start"
                )


def _moves_otherwise(content: Content, claimed: float | None) -> bool:
    """True for a block that may move the tool, but not along a path to its own coordinates."""
    return claimed in MACHINE | REFERENCE or not MOVING_NAMES.isdisjoint(content.names)
