"""Meaning of ISO / Fanuc / LinuxCNC blocks: modal state in, moves out; words that are not understood are refused."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from kinematics.machine import Machine
from postproc.control.codes import DWELL, MOTION, PALLET_CHANGE, PLANES, PROGRAM_ENDS, TOOL_CHANGE
from postproc.control.interpreter import Interpreter
from postproc.control.setup import Setup
from postproc.control.state import ControlState
from postproc.control.words import whole_of
from postproc.iso.arcs import arc_of, check_corner, end_by_angle, end_words, go_polar, select_polar, turn_tool
from postproc.iso.channel import INTEGERS, Channel
from postproc.iso.codes import (
    AFTER_MOTION,
    BESIDE_LEAVING,
    COMPENSATION,
    CONSTRUCTS,
    COORDINATE_CHANGES,
    CORNER_WORDS,
    CYCLE_END,
    CYCLES,
    DATA,
    FINE_BORING,
    FRAME_CODES,
    LENGTH_CODES,
    MIRROR,
    MOVE_WORDS,
    NOT_MOVING,
    OFFSET_CODES,
    ONE_SHOT,
    POLAR,
    POLAR_END,
    PRESET_END,
    PROBING,
    REFUSED_G,
    ROTATION_END,
    SCALE,
    SCALE_END,
    TOOL_IS,
    TOWARDS,
    TURNS,
)
from postproc.iso.coordinate_presets import cancel_preset, change_coordinates
from postproc.iso.cycles import calls_macro
from postproc.iso.datum_transformations import end_mirror, end_turn
from postproc.iso.drilling import begin_cycle, drill, drill_lines, end_cycle
from postproc.iso.families import KINEMATICS, LINUXCNC, MACH3, REFERENCED
from postproc.iso.modal_state import ModalState
from postproc.iso.reading.commands import run_command
from postproc.iso.reading.lines import DETAIL as LEADER
from postproc.iso.reading.lines import refuse_long_line
from postproc.iso.selection import change_tool, hold_tool, select_kinematics, select_length, select_offset
from postproc.iso.variables import variables_of
from postproc.iso.words import Content, check_content, check_speed, dwells_alone, sort_words, take_own_words
from postproc.motion.cutter_compensation import follow_contour
from postproc.motion.moves import Arc, Kind
from postproc.motion.plain_moves import PlainMoves
from postproc.text.block import Block
from postproc.text.blocks import PlainRun
from postproc.text.notes import Notes


class IsoInterpreter(Interpreter):
    """Reads ISO blocks in order, in the modal state that the blocks before have left."""

    channel: Channel
    modal: ModalState

    def __init__(self, machine: Machine, setup: Setup, notes: Notes) -> None:
        self.family = machine.control.family
        super().__init__(Channel(notes, ModalState(ControlState(setup)), variables_of(self.family)))
        self.opened = self.torn = False
        """A tape mark came before all words; the first one came after words."""
        self._last: tuple[Content, float | None] | PlainRun | None = None
        """The last block, and the code that claims its coordinates; the plain lines that end with it; None for one
        without words."""

    @property
    def moved(self) -> bool:
        """Whether a modal macro runs after the last block; Refusal where that depends on the control."""
        last = self._last
        if last is None:
            return False
        content, claimed = (sort_words(last.block(len(last) - 1)), None) if isinstance(last, PlainRun) else last
        modal = self.modal
        inside = "a canned cycle" if modal.cycle is not None else "radius compensation" if modal.compensated else ""
        return calls_macro(content, claimed, inside, self.recorder.stayed)

    def _read_run(self, index: int, run: PlainRun) -> Iterator[Block | PlainRun]:
        if self.machine.control.integer_words == "increments" and _has_integers(run):
            return (self._read_single(index + line, run.block(line)) for line in range(len(run)))
        return super()._read_run(index, run)

    def _take_run(
        self, index: int, run: PlainRun, moves: PlainMoves, motion: np.ndarray, arcs: Mapping[int, Arc]
    ) -> None:
        super()._take_run(index, run, moves, motion, arcs)
        self._note_run(run)

    def _take_holes(self, index: int, run: PlainRun) -> PlainRun | None:
        if not (lines := drill_lines(self.channel, index, run)):
            return None
        self._note_run(part := run.part(0, lines))
        return part

    def _note_run(self, run: PlainRun) -> None:
        if _has_integers(run):
            integers = _integers(run)
            self.notes.add(INTEGERS, run.number + int(np.flatnonzero(integers)[0]), int(integers.sum()))
        self.channel.assume_turns_of(run)
        self._last, self.modal.begun = run, True

    def _read_block(self, index: int, block: Block) -> Block:
        modal = self.modal
        self._last = None
        if not modal.ended:
            refuse_long_line(self.machine.control, block)
        if block.kind == "words" and not modal.ended:
            return self._read_words(index, block)
        if modal.ended:
            self._read_after_end(block)
        elif block.kind == "tape_mark":
            self._read_tape_mark(block)
        elif block.kind == "command":
            run_command(self.channel, block)
        elif block.kind in CONSTRUCTS:
            raise block.refuse(f"{block.detail}: {CONSTRUCTS[block.kind]}")
        return block

    def _read_after_end(self, block: Block) -> None:
        if any(word.address == "O" for word in block.words):
            raise block.refuse("a second program in one file is not corrected: write it into a file of its own")
        if self.torn and block.kind not in ("blank", "tape_mark"):
            raise block.refuse(
                "text follows the only tape mark (%), and some controls begin the program here: write % before the "
                "first block too"
            )
        if block.kind not in ("blank", "tape_mark"):
            self.note_after_end(block)

    def _read_tape_mark(self, block: Block) -> None:
        modal = self.modal
        if block.words or block.skippable:
            raise block.refuse("the tape mark shares its line with other text: write it in a line of its own")
        if block.detail == LEADER:
            self.notes.add("the text before the first tape mark is taken for the leader of a tape", block.line)
        self.torn = modal.begun and not self.opened
        self.opened, modal.ended = True, modal.begun

    def _read_words(self, index: int, block: Block) -> Block:
        modal = self.modal
        content, family = sort_words(block), self.family
        take_own_words(content, modal.motion, family)
        moves, other = content.moves, content.other.keys()
        check_content(content, modal.begun, family)
        if content.m or "T" in other:
            self._functions(content)
        claimed = self._modes(content) if content.g else None
        if claimed == DWELL and not dwells_alone(content, family):
            claimed = None
        if modal.cornered or not CORNER_WORDS.isdisjoint(content.names):
            check_corner(self.channel, content, claimed)
        if "L" in other and claimed != DATA and not (modal.cycle is not None and moves):
            raise block.refuse(
                "L calls a subprogram on some controls and repeats the block on others: write the call by M98"
            )
        if claimed is None:
            if moves:
                self._move(index, content)
        elif claimed in COORDINATE_CHANGES:
            self._change_coordinates(index, content, claimed)
        elif claimed in PROBING:
            self._probe(content, claimed)
        elif claimed not in NOT_MOVING:
            self._leave_path(index, content, claimed)
        if moves and not AFTER_MOTION.isdisjoint(content.m) and family != "linuxcnc":
            self._change_behind(content)
        self._last = content, claimed
        modal.begun |= bool(moves or content.g or content.m or other - {"N", "O"})
        modal.ended = not PROGRAM_ENDS.isdisjoint(content.m)
        return content.block

    # ---- functions and modes

    def _functions(self, content: Content) -> None:
        channel = self.channel
        block = content.block
        if "T" in content.other:
            self.modal.lengths.selected_tool = whole_of(block, block.words[content.other["T"]])
        for code in content.m:
            if code == TOOL_IS and "Q" in content.names:
                hold_tool(channel, whole_of(block, block.words[content.names["Q"]]))
                continue
            channel.take_function(block, code)
            if code in (TOOL_CHANGE, PALLET_CHANGE):
                self._refuse_compensated(content)
            if code == TOOL_CHANGE:
                change_tool(channel, content)
            elif code == PALLET_CHANGE:
                self.recorder.mark_unknown(list(range(len(self.machine.axes))))

    def _change_behind(self, content: Content) -> None:
        """Some controls change the tool or the pallet after the move of the block, and then the axes have moved."""
        names = self.machine.names
        changed = self.machine.control.tool_change_moves if PALLET_CHANGE not in content.m else names
        self.recorder.mark_uncertain([names.index(name) for name in changed if name in names])

    def _modes(self, content: Content) -> float | None:
        """Take over the modal G codes; the code that claims the block's axis words for itself, or None."""
        channel = self.channel
        claimed = None
        block, ends = content.block, content.ends
        self._end_coordinate_changes(content, ends)
        before = self.modal.in_force
        for code in content.g:
            channel.check_family(block, "G", code)
            if code in ends:
                continue
            if code in ONE_SHOT:
                claimed = code
                if code in (5.0, 5.1):
                    check_speed(content, code)
            elif (code in PROBING and channel.setup.probing) or (code == REFERENCED and self.family == MACH3):
                claimed = code
            elif code in OFFSET_CODES:
                select_offset(channel, content, code)
            elif code in LENGTH_CODES:
                select_length(channel, content, code)
            elif code in KINEMATICS and self.family == LINUXCNC:
                select_kinematics(channel, content, code)
            elif not self._take_mode(block, code) and code not in channel.harmless_g:
                channel.take_unknown(block, code, REFUSED_G, moves=content.moves)
        if not FRAME_CODES.isdisjoint(content.g):
            channel.changed_since(before)
        return claimed

    def _end_coordinate_changes(self, content: Content, ends: list[float]) -> None:
        """G50, G50.1, G69 and G92.1 without axis words."""
        channel, modal = self.channel, self.modal
        drilling = modal.cycle is not None and CYCLE_END not in content.g
        for code in ends:
            if code == ROTATION_END:
                self._end_rotation()
            elif (modal.compensated or drilling or modal.polar is not None) and modal.shifted:
                raise content.refuse(
                    f"G{code:g} under radius compensation, in polar coordinates or in a canned cycle is not corrected: "
                    "end these before it"
                )
            elif code == PRESET_END:
                cancel_preset(channel, content, range(len(self.machine.axes)))
            elif code == SCALE_END:
                end_turn(channel, SCALE)
            else:
                end_mirror(channel, content.block, ())

    def _end_rotation(self) -> None:
        for turn in TURNS - {SCALE, MIRROR}:
            end_turn(self.channel, turn)

    def _take_mode(self, block: Block, code: float) -> bool:
        """Take over a modal G code that changes how later words are read; False when it is none."""
        channel, modal = self.channel, self.modal
        if code in MOTION:
            modal.motion, modal.cycle = code, None
        elif code in CYCLES or (code == FINE_BORING and self.family == "fanuc"):
            begin_cycle(channel, block, code)
        elif code == CYCLE_END:
            end_cycle(channel)
        elif code in COMPENSATION:
            self._compensate(block)
        elif code in (POLAR, POLAR_END):
            select_polar(channel, block, code == POLAR)
        elif code == ROTATION_END:
            self._end_rotation()
        elif code in PLANES and PLANES[code] != modal.plane and (modal.placement_code or modal.polar):
            raise block.refuse(
                "another plane while the coordinates are rotated or polar is not corrected: end these before it"
            )
        else:
            return channel.take_mode(block, code)
        return True

    def _compensate(self, block: Block) -> None:
        """G41, G42."""
        if self.modal.tilted or self.modal.cycle is not None:
            raise block.refuse(
                "radius compensation in a tilted plane or in a canned cycle is not corrected: end these before it"
            )
        self.channel.compensate(block)

    def _refuse_compensated(self, content: Content) -> None:
        if self.modal.compensated:
            raise content.refuse(
                "the position of the tool is not known while radius compensation is on: write G40 before this block"
            )

    # ---- moves

    def _leave_path(self, index: int, content: Content, code: float) -> None:
        """G28, G30: to a reference point, its intermediate point uncorrected. G53: to machine coordinates."""
        modal = self.modal
        self._refuse_compensated(content)
        if modal.polar is not None:
            raise content.refuse(f"G{code:g} in polar coordinates is not corrected: write G15 before it")
        strange = sorted(content.other.keys() - BESIDE_LEAVING - ({"P"} if code == 30.0 else set()))
        if strange:
            raise content.refuse(
                f"the effect of {strange[0]} in a G{code:g} block depends on the control: leave it out"
            )
        words = self.channel.axis_words(content.block, content.axes)
        if code == 53.0 and not words:
            return
        if code != 53.0:
            if modal.cycle is not None:
                # the effect of coordinates from here on depends on the control
                modal.motion = modal.cycle = None
            if modal.absolute and words and code != REFERENCED:
                self.notes.add("G28/G30 passes its intermediate point uncorrected", content.block.line)
            self.recorder.mark_unknown([word.axis for word, _ in words] or list(range(len(self.machine.axes))))
            return
        if not modal.absolute or modal.motion not in (0.0, 1.0):
            raise content.refuse("G53 needs G90 and G0 or G1: write them before it")
        self.channel.move_to_machine_position(index, content.block, words)

    def _probe(self, content: Content, code: float) -> None:
        """A probing move; G38.2 to G38.5 are modal, so that coordinates after them need a code."""
        self._refuse_compensated(content)
        words = self.channel.axis_words(content.block, content.axes)
        self.channel.probe(content.block, f"G{code:g}", [word.axis for word, _ in words])
        if code in TOWARDS:
            self.modal.motion = self.modal.cycle = None

    def _move(self, index: int, content: Content) -> None:
        channel, modal = self.channel, self.modal
        if modal.motion is None:
            raise content.refuse("the coordinates have no G0, G1, G2 or G3 before them: write one")
        if modal.tilted and not modal.upright:
            raise content.refuse(
                "the tool is not yet perpendicular to the tilted plane in this move: write G53.1 before it"
            )
        if modal.cycle is not None:
            drill(channel, index, content, modal.cycle)
            return
        self._check_move_words(content)
        end_by_angle(channel, content)
        words, polar = end_words(channel, content)
        target = self.recorder.target(content.block, words)
        if polar is not None:
            go_polar(channel, target, polar)
        if modal.tilted or modal.lengths.vectors:
            words += turn_tool(channel, content, target, words)
        kind = MOTION[modal.motion]
        arc = None
        if kind is Kind.ARC:
            if polar is not None or modal.polar is not None:
                raise content.refuse("an arc in polar coordinates is not corrected: write G15 before it")
            arc = arc_of(channel, content, target)
        if modal.not_programmed:
            channel.note_not_programmed(content.block.line, kind)
        if modal.compensated:
            channel.no_insertion = True
            follow_contour(self.recorder, modal.plane_columns[:2], target, arc)
        channel.move(index, kind, target, words, arc)

    def _check_move_words(self, content: Content) -> None:
        other = content.other.keys()
        strange = sorted(other - MOVE_WORDS)
        if strange:
            raise content.refuse(f"the effect of {strange[0]} in a move depends on the control: leave it out")
        if self.modal.motion in (0.0, 1.0) and not other.isdisjoint("R" if self.modal.lengths.vectors else "IJKR"):
            letters = ", ".join(sorted(other & set("IJKR")))
            raise content.refuse(f"the block is no arc and has {letters}: write G2 or G3, or leave these words out")

    # ---- meaning of coordinates

    def _change_coordinates(self, index: int, content: Content, code: float) -> None:
        modal = self.modal
        self._refuse_compensated(content)
        if modal.polar is not None or modal.cycle is not None:
            raise content.refuse(
                f"G{code:g} in polar coordinates or in a canned cycle is not corrected: end these before it"
            )
        words = self.channel.axis_words(content.block, content.axes)
        if change_coordinates(self.channel, content, code, words):
            self.recorder.call(index, modal.unit, tuple(word for word, _ in words))


def _has_integers(run: PlainRun) -> bool:
    """True for lines with coordinates without a decimal point, zeros apart."""
    return bool((run.columns.decimals < 0).any()) and bool(_integers(run).any())


def _integers(run: PlainRun) -> np.ndarray:
    """Number of coordinates without a decimal point in each line `(lines,)`, zeros apart."""
    words = run.columns
    return np.asarray(((words.end > 0) & (words.decimals < 0) & (words.value != 0.0)).sum(axis=0))
