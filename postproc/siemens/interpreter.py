"""Meaning of Siemens 840D blocks: modal state in, moves out; an unknown word that could move the tool is refused."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from postproc.control.codes import DWELL, HARMLESS_M, MOTION, PLANES, TOOL_CHANGE
from postproc.control.interpreter import AxisWords, Interpreter
from postproc.control.words import value_of, whole_of
from postproc.motion.cutter_compensation import follow_contour
from postproc.motion.frames import Frame, Placement, renamed
from postproc.motion.moves import Arc, AxisWord, Kind, Known
from postproc.motion.plain_moves import PlainMoves
from postproc.motion.recorder import Recorder
from postproc.siemens.arcs import ARC_WORDS, Programmed, arc_of, calculated_arc, with_angle
from postproc.siemens.calls import ends
from postproc.siemens.codes import (
    CALCULATED_ARCS,
    CORNERS,
    END_OF_SUBPROGRAM,
    FEED_MODES,
    FRAME_ENDS,
    HARMLESS_G,
    LIMITS,
    MACHINE,
    POLES,
    REFERENCE,
    REFUSED_G,
    UNITS,
    VECTOR,
    VECTOR_WORDS,
    WORK_OFFSETS,
)
from postproc.siemens.control_data import edge_key
from postproc.siemens.cycle800 import read_tilted_plane, rotary_positions
from postproc.siemens.cycle832 import check_tolerance_cycle
from postproc.siemens.cycles import Cycles
from postproc.siemens.frames import DatumTransformations
from postproc.siemens.polar import POLAR, Polar
from postproc.siemens.variables import EMPTY, SiemensVariables
from postproc.siemens.words import Content, check, plain_of, sort
from postproc.text.block import Block
from postproc.text.blocks import PlainRun
from postproc.text.expressions import Constant

BY_CONTROL = -1.0
"""Instead of a G code: a circle that the control calculates (CIP, CT) is active."""
LENGTH_STAYS = (
    "G18 or G19 with a tool length: the length is taken to stay along Z, which needs setting data SD42940 "
    "($SC_TOOL_LENGTH_CONST) other than 0"
)
WITHOUT_MOTION = LIMITS | {DWELL}
"""The tool stays where it is, whatever the words of the block."""


@dataclass
class SiemensInterpreter(Interpreter):
    """Reads blocks in order; modal state carries over from chunk to chunk."""

    scope: SiemensVariables = field(default_factory=SiemensVariables)

    harmless_m: ClassVar[frozenset[float]] = HARMLESS_M | {END_OF_SUBPROGRAM, *map(float, range(40, 46))}
    units: ClassVar[Mapping[float, float]] = UNITS
    feed_modes: ClassVar[frozenset[float]] = FEED_MODES

    def __post_init__(self) -> None:
        super().__post_init__()
        self.scope.passive = frozenset(self.machine.control.passive_axes)
        self.scope.basic_unit_is_inch = self.machine.control.unit == "inch"
        self.work_offset, self.offset_programmed = "G500", False
        """Active work offset, and whether the program has named it: a named G500 that is not given is machine zero."""
        self.transformations = DatumTransformations(self.machine, self.notes)
        self.polar = Polar()
        self.cycles = Cycles(self)
        self.selected_tool: int | str = 0
        self.spindle_tool: int | str | None = None
        self.edge, self.length, self.length_key = 1, 0.0, ""
        """The cutting edge in force, its length, mm, and its name in the set-up."""
        self.machine_vectors = False
        """ORIMKS: vectors are those of the machine."""
        self.rounded = self.cornered = False
        """The control rounds every corner, rounds the corner after the block."""
        self.recorder = Recorder(self.machine, self.frame())

    @property
    def plain(self) -> bool:
        """True while lines of axis words are moves to absolute positions without corners and cycles."""
        blocked = self.ended or self.compensated or self.cornered or self.rounded or self.polar.radius is not None
        special = self.transformations.tilted is not None or self.cycles.modal is not None
        noted = bool(self.length) and self.plane != "XYZ"
        passive = not set(self.machine.control.passive_axes).isdisjoint(self.machine.names)
        return self.absolute and not (blocked or special or noted or passive)

    def _take_run(
        self, index: int, run: PlainRun, moves: PlainMoves, motion: np.ndarray, arcs: Mapping[int, Arc]
    ) -> None:
        super()._take_run(index, run, moves, motion, arcs)
        self.begun = True

    def _read_block(self, index: int, block: Block) -> Block:
        if block.kind == "header":
            if self.begun:
                raise block.refuse("the program before this one has no end: write M30, M17 or RET before this block")
            self.begun = True
        if block.kind != "words":
            return block
        if self.ended:
            self.note_after_end(block)
            return block
        content = sort(block, self.machine.control.passive_axes)
        check(block, content, self.accept)
        self.begun = True
        self._functions(block, content)
        claimed = self._modes(block, content) if content.g or content.names else None
        corner = self._corner(block, content)
        if content.frames:
            self._change_frame(block, content)
        elif claimed in POLES:
            self.polar.set_pole(self, block, content, claimed or 0.0)
        elif claimed in REFERENCE:
            self.recorder.mark_unknown(list(range(len(self.machine.axes))))
        elif claimed in MACHINE or "SUPA" in content.names:
            self._machine_move(index, block, content)
        elif "CYCLE800" in content.names:
            self._tilt(index, block, content)
        elif self.cycles.read(index, block, content):
            self.polar.clear()
        elif content.moves and claimed not in WITHOUT_MOTION:
            drills, points = self.cycles.modal is not None, not VECTOR_WORDS.isdisjoint(content.other)
            block = self._move(index, block, content, divisible=not drills)
            self.no_insertion = corner or self.compensated or drills or points
            self.cycles.run_modal(index, block)
        self.ended = bool(content.m or content.names) and ends(block) and not self.scope.depth
        return block

    def _corner(self, block: Block, content: Content) -> bool:
        """True where the corner that this block begins at, or ends at, is one that the control breaks."""
        before, here = self.cornered, not CORNERS.isdisjoint(content.other)
        if here:
            self.notes.add("chamfers and roundings: the corner points are corrected", block.line)
        if "RNDM" in content.other:
            self.rounded = value_of(block, block.words[content.other["RNDM"]]) > 0.0
        if content.moves:
            self.cornered = here
        return self.rounded or before or here

    # ---- tools and functions

    def _functions(self, block: Block, content: Content) -> None:
        before = self._tool_key(), self.length
        if "T" in content.other:
            word = block.words[content.other["T"]]
            self.selected_tool = word.mode or whole_of(block, word)
        for code in content.m:
            self.take_function(block, code)
            if code == TOOL_CHANGE:
                self.spindle_tool = self.selected_tool
                self.move_for_tool_change(block)
        if "D" in content.other:
            self.edge = whole_of(block, block.words[content.other["D"]])
        if "D" in content.other or TOOL_CHANGE in content.m:
            self.length = self._tool_length(block)
        if (self._tool_key(), self.length) != before:
            self._note_edge(block)
            self.change_frame(self.x_y_z if self.recorder.frame.tcp else self.x_y_z[2:])

    def _note_edge(self, block: Block) -> None:
        tool, edge = self._tool_key()
        if tool and edge > 1 and not self.control_state.knows(edge_key(tool, edge)):
            self.notes.add(f"D{edge} of tool {tool} is taken to be as long as D1", block.line)

    def _tool_key(self) -> tuple[int | str | None, int]:
        return self.spindle_tool, self.edge

    def _tool_length(self, block: Block) -> float:
        self.length_key = ""
        if not self.edge or not self.spindle_tool:
            return 0.0
        self.control_state.tools.update(self.scope.data.tools())
        key = edge_key(self.spindle_tool, self.edge)
        if key in self.scope.data.worn():
            raise block.refuse(
                f"the program sets wear or base of tool {key} without its length: set the length ($TC_DP3) too"
            )
        self.length_key = key if self.control_state.knows(key) else str(self.spindle_tool)
        return self.control_state.tool_length(self.length_key)

    # ---- modes and frames

    def _modes(self, block: Block, content: Content) -> float | None:
        """Take over the modal codes; the G code that claims the block's axis words for itself, or None."""
        claimed = None
        for code in content.g:
            if code in WITHOUT_MOTION or code in MACHINE or code in REFERENCE or code in POLES:
                claimed = code
            elif code in WORK_OFFSETS:
                self._set_work_offset(block, f"G{code:.0f}")
            elif not self.take_mode(block, code) and code not in HARMLESS_G:
                self.take_unknown(block, code, REFUSED_G, moves=content.moves)
        if DWELL in content.g and content.axes:
            raise block.refuse("G4 has a coordinate: write F or S, the time of the dwell")
        if self.transformations.tilted is not None and not FRAME_ENDS.isdisjoint(content.names):
            raise block.refuse(
                f"{', '.join(FRAME_ENDS & content.names.keys())} in a tilted plane is not followed: write CYCLE800() "
                "before it"
            )
        if "CYCLE832" in content.names:
            check_tolerance_cycle(block, block.words[content.names["CYCLE832"]], self.scope, tcp=self.tcp)
        if not CALCULATED_ARCS.isdisjoint(content.names):
            self._calculate_arc(block, content)
        if "TRAORI" in content.names or "TRAFOOF" in content.names:
            self._switch_tcp(block, content)
        if "ORIWKS" in content.names or "ORIMKS" in content.names:
            self.machine_vectors = "ORIMKS" in content.names
        if "RET" in content.names and block.words[content.names["RET"]].arguments is not None:
            raise block.refuse("RET with arguments returns to another block, which is not followed: write RET alone")
        return claimed

    def _calculate_arc(self, block: Block, content: Content) -> None:
        """CIP and CT instead of G2 and G3."""
        if len(CALCULATED_ARCS & content.names.keys()) > 1 or not MOTION.keys().isdisjoint(content.g):
            raise block.refuse("CIP and CT exclude G0 to G3 and each other in one block: write one of them")
        if not POLAR.isdisjoint(content.other) or self.tcp:
            raise block.refuse(
                "CIP or CT with polar coordinates, or while TRAORI is on, is not corrected: write G2 or G3"
            )
        if self.cornered or self.rounded:
            raise block.refuse(
                "CIP or CT directly after a chamfer or rounding is not corrected: write G2 or G3 with a centre"
            )
        self.motion = BY_CONTROL

    def take_mode(self, block: Block, code: float) -> bool:
        """Take over a modal G code; another plane has no polar coordinates yet."""
        if code in PLANES:
            self.polar = Polar()
        return super().take_mode(block, code)

    def _set_work_offset(self, block: Block, name: str) -> None:
        if self.transformations.tilted is not None and name != self.work_offset:
            raise block.refuse("the work offset changes in a tilted plane: write CYCLE800() before it")
        data = self.scope.data
        if name in data.offsets:
            self.control_state.offsets[name] = data.coarse(name)
            self.control_state.fine[name] = dict(data.fine.get(name, {}))
        self.work_offset, self.offset_programmed = name, True
        self.change_frame(range(len(self.machine.axes)))

    def _switch_tcp(self, block: Block, content: Content) -> None:
        on = "TRAORI" in content.names
        arguments = block.words[content.names["TRAORI" if on else "TRAFOOF"]].arguments
        given = [argument for argument in arguments or () if argument != EMPTY]
        if given and (not on or given != [Constant(1.0)]):
            raise block.refuse(
                "TRAORI with another transformation than the first, or a direction, is not followed: write TRAORI(1)"
            )
        if on and self.transformations.tilted is not None:
            raise block.refuse("TRAORI in a tilted plane is not followed: write CYCLE800() before it")
        if on:
            self.note_tcp("TRAORI", block)
        self.switch_tcp(on)

    def _change_frame(self, block: Block, content: Content) -> None:
        """A statement of the programmable frame."""
        before, placed = self.recorder.frame, self.transformations.programmed
        shifted = self.transformations.change(block, content, self.unit, self.plane)
        after = self.frame()
        changed = {self.machine.index(axis) for axis in shifted}
        changed.update(self.x_y_z[i] for i in renamed(placed, self.transformations.programmed))
        changed.update(i for i in self.rotary_axes if before.offset[i] != after.offset[i])
        self.recorder.set_frame(after, changed)

    def _tilt(self, index: int, block: Block, content: Content) -> None:
        """CYCLE800: turns the rotary axes on a path that the control chooses, and tilts the coordinates with them."""
        tilt = read_tilted_plane(block, block.words[content.names["CYCLE800"]], self.scope, self.unit)
        if content.axes or content.g or len(content.names) > 1 or self.tcp:
            raise block.refuse("CYCLE800 must be alone in its block, and TRAORI must be off: write TRAFOOF before it")
        self.polar.clear()
        if tilt is None:
            self.transformations.tilt(None)
            self.notes.add("CYCLE800(): the rotary axes are taken to keep their positions", block.line)
        else:
            before = self.transformations.tilted
            if tilt.added and before is not None:
                tilt = tilt._replace(plane=before.then(tilt.plane))
            positions = rotary_positions(block, self, tilt)
            self.recorder.move_to_machine_position(index, positions, tuple(AxisWord(i, 0, False) for i in positions))
            listed = " ".join(f"{self.machine.names[i]}{angle:g}" for i, angle in positions.items())
            self.notes.add(f"CYCLE800 is taken to turn the rotary axes to {listed}", block.line)
            tilts = tilt.plane != Placement() or any(positions.values())
            self.transformations.tilt(tilt.plane if tilts else None)
        self.change_frame(range(len(self.machine.axes)))
        self.recorder.mark_unknown(list(self.x_y_z))

    def frame(self) -> Frame:
        """The frame of programmed coordinates in force."""
        shifts = {self.machine.index(axis): shift for axis, shift in self.transformations.rotary_shifts.items()}
        tcp, placed = self.tcp or self.transformations.tilted is not None, self.transformations.placement
        tool, length = self.length_key, self.length
        return self.control_state.frame(self._offset_name(), placed, shifts, tool=tool, length=length, tcp=tcp)

    def _offset_name(self) -> str:
        """Name of the work offset in force, empty for machine zero: a G500 that the program names and nobody gave."""
        if self.work_offset == "G500" and self.offset_programmed and not self.control_state.names_offset("G500"):
            return ""
        return self.work_offset

    # ---- moves

    def axis_words(self, block: Block, indices: Iterable[int]) -> AxisWords:
        """The axis words of a block with their values; Refusal for a mode that the axis does not have."""
        words = super().axis_words(block, indices)
        for axis, i, _ in (word for word, _ in words):
            mode, rotary = block.words[i].mode, self.rotary[axis]
            if mode in ("DC", "ACP", "ACN") and not rotary:
                raise block.refuse(f"{mode} needs a rotary axis: write AC or IC")
            if rotary and self.transformations.tilted is not None and not self.tcp:
                raise block.refuse(
                    "a rotary axis moves in a tilted plane of CYCLE800: end the plane by CYCLE800() before it"
                )
        return words

    def _machine_move(self, index: int, block: Block, content: Content) -> None:
        if self.motion not in (None, 0.0, 1.0):
            raise block.refuse("machine coordinates need a straight line: write G0 or G1")
        words = self.axis_words(block, content.axes)
        if words and (self.tcp or self.cycles.modal is not None):
            raise block.refuse("machine coordinates while TRAORI or MCALL is on are not corrected: end it before them")
        if words:
            self.move_to_machine_position(index, block, words, self.length)
            self.polar.clear()

    def _move(self, index: int, block: Block, content: Content, *, divisible: bool) -> Block:
        """Record a move; its block comes back with the words that a correction may change."""
        if self.motion is None:
            self.notes.add("no G0 or G1 before it: the coordinates are taken for straight lines", block.line)
            self.motion = 1.0
        if self.motion == BY_CONTROL and CALCULATED_ARCS.isdisjoint(content.names):
            raise block.refuse(
                "CIP or CT is modal from an earlier block, which ncomp corrects to G2 or G3: write it in every block"
            )
        if self.length and self.plane != "XYZ":
            self.notes.add(LENGTH_STAYS, block.line)
        kind = MOTION.get(self.motion, Kind.ARC)
        programmed = Programmed(block, self.axis_words(block, content.axes), {})
        if any(word.incremental for word, _ in programmed.words):
            self._check_increments(block, programmed)
        polar = not POLAR.isdisjoint(content.other)
        if polar:
            programmed = self.polar.coordinates(self, block, content, programmed)
        elif self.polar.radius is not None and any(block.words[i].address in self.plane[:2] for i in content.axes):
            self.polar.clear()
        if kind is not Kind.ARC and content.other.keys() & ARC_WORDS:
            raise block.refuse("the block has a centre, a radius or turns, but no arc: write G2 or G3")
        if kind is Kind.ARC and "AR" in content.other:
            programmed = with_angle(self, block, content, programmed)
        target = programmed.target(self.recorder)
        if not VECTOR_WORDS.isdisjoint(content.other):
            self._point(block, content, target)
        arc = self._arc(programmed.block, content, target, polar) if kind is Kind.ARC else None
        if self.compensated:
            follow_contour(self.recorder, self.plane_columns[:2], target, arc)
        self.move(index, kind, target, programmed.words, arc, divisible=divisible)
        return programmed.block

    def _arc(self, block: Block, content: Content, target: list[float], polar: bool) -> Arc:
        if polar:
            return self.polar.arc(self, block, content, target)
        if not CALCULATED_ARCS.isdisjoint(content.names):
            return calculated_arc(self, block, content, target)
        return arc_of(self, block, content, target)

    def _point(self, block: Block, content: Content, target: list[float]) -> None:
        """A tool vector."""
        if not self.tcp or self.machine_vectors:
            raise block.refuse(
                "a tool vector without TRAORI, or with ORIMKS, is not corrected: write TRAORI and ORIWKS before it"
            )
        if not all(self.recorder.frame.keeps_circles(plane) for plane in ("XY", "YZ")):
            raise block.refuse(
                "a tool vector with different factors of SCALE is not corrected: write one factor for all axes"
            )
        words = {address: content.other.pop(address) for address in VECTOR if address in content.other}
        vector = np.array([plain_of(block, block.words[words[a]]) if a in words else 0.0 for a in VECTOR])
        self.turn_along(block, target, self.recorder.frame.turned(vector).tolist())
        self.notes.add("tool vectors: the control is taken to turn the rotary axes to the nearest solution", block.line)

    def _check_increments(self, block: Block, programmed: Programmed) -> None:
        for word, _ in programmed.words:
            if word.incremental and self.recorder.known[word.axis] == Known.MACHINE:
                name = self.machine.names[word.axis]
                raise block.refuse(
                    f"an increment of {name} before its first absolute position in this frame depends on settings of "
                    "the control: write an absolute position first"
                )
