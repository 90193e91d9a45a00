"""Meaning of HEIDENHAIN Klartext blocks: modal state in, moves out; what could move the tool unseen is refused."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field

from kinematics.machine import Machine
from postproc.circles import Point, centre_from_radius, radius_fault, same
from postproc.expressions import NotKnown
from postproc.frames import Frame, cartesian
from postproc.heidenhain_codes import (
    AXIS_M,
    CALL_M,
    COMPENSATIONS,
    CONTOUR_CYCLES,
    CYCLES_AT_PLACE,
    CYCLES_AT_START,
    CYCLES_ROUND_PLACE,
    DATA_CYCLES,
    DIRECTIONS,
    FRAME_CYCLES,
    HARMLESS_CYCLES,
    HARMLESS_FN,
    HARMLESS_KINDS,
    HARMLESS_M,
    MEANT_M,
    MOVING_KINDS,
    PLACING,
    PLC_FN,
    PRESET_CYCLE,
    PROGRAM_END_M,
    REFUSED_CYCLES,
    REFUSED_FN,
    REFUSED_KINDS,
    REFUSED_M,
)
from postproc.heidenhain_places import Places
from postproc.heidenhain_variables import QParameters
from postproc.iso_codes import AXES, INCH
from postproc.motions import Arc, AxisWord, Kind, Known, Motions, Recorder
from postproc.notes import Notes
from postproc.program import Block, Word
from postproc.setup import Setup

_CALL = re.compile(r"CYCL CALL(?: M ?(\d*))?", re.IGNORECASE)
_TCPM = re.compile(
    r"FUNCTION TCPM( F (TCP|CONT))?( AXIS POS)?( PATHCTRL (AXIS|VECTOR))?( REFPNT TIP-TIP)?( F ?[\d.,]+)?",
    re.IGNORECASE,
)
_HARMLESS_FUNCTION = re.compile(r"FUNCTION (MODE MILL|(S-PULSE|FEED DWELL)\b.*)", re.IGNORECASE)
_TRANSFORMATION_RESET = re.compile(r"TRANS [A-Z]+ RESET", re.IGNORECASE)
_FN = re.compile(r"FN ?(\d+)", re.IGNORECASE)
_CYCLE = re.compile(r"CYCL DEF (\d+)(\.\d+)?(.*)", re.IGNORECASE)


@dataclass
class _Content:
    """The words of one block, sorted."""

    axes: list[int] = field(default_factory=list)
    """Indices of the axis words with a value."""
    bare_axes: list[int] = field(default_factory=list)
    """Indices of those without."""
    m: list[float] = field(default_factory=list)
    other: set[str] = field(default_factory=set)
    """Addresses of all other words."""


@dataclass
class HeidenhainInterpreter:
    """Reads blocks in order; modal state carries over from chunk to chunk."""

    machine: Machine
    setup: Setup
    notes: Notes
    scope: QParameters = field(default_factory=QParameters)

    def __post_init__(self) -> None:
        self.begun = self.ended = False
        self.unit = 1.0
        self.preset = "0"
        self.tool_length = self.oversize = 0.0
        self.tcp = self.machine.control.tcp_at_start
        self.places = Places()
        self.cycle = 0  # the last one that was defined for a call
        self.levelled = False  # cycle 19 tilts the working plane by zero angles
        self.compensated = self.cornered = False
        """The control shifts the path by the radius of the tool; the block before is a rounding or a chamfer."""
        self._statements: dict[str, Callable[[Block], None]] = {
            "begin_pgm": self._begin,
            "tool_call": self._tool_call,
            "tool_def": self._tool_def,
            "cycle_def": self._cycle,
            "cycle_call": self._cycle_call,
            "fn": self._fn,
            "function": self._function,
            "plane": self._plane,
            "transformation": self._plane,
        }
        self.pole: Point | None = None
        self.pole_block = -1
        self.pole_words: tuple[int | None, int | None] = (None, None)
        self.recorder = Recorder(self.machine, self._frame())

    def read(self, blocks: Iterable[Block]) -> Motions:
        """The moves of a chunk of blocks, each read before the next is asked for.

        Refusal at the first block that isn't fully understood.
        """
        self.pole_block, self.pole_words = -1, (None, None)
        done = []
        for index, block in enumerate(blocks):
            done.append(block)
            if block.kind in HARMLESS_KINDS:
                continue
            cornered, self.cornered = self.cornered, False
            self._read_block(index, block)
            if (cornered or self.compensated) and block.kind in MOVING_KINDS:
                done[-1] = block._replace(alone=True)
        return self.recorder.finish(done)

    def _read_block(self, index: int, block: Block) -> None:
        if self.ended and block.kind != "begin_pgm":
            if block.kind != "end_pgm":
                self.notes.add("blocks behind the end of the program do not run and stay as they are", block.line)
        elif block.kind in REFUSED_KINDS:
            raise block.refuse(f"{block.detail}: {REFUSED_KINDS[block.kind]}")
        elif block.skippable:
            raise block.refuse("whether it runs depends on the block-skip switch")
        elif block.kind == "centre":
            self._set_pole(index, block)
        elif block.kind in ("line", "circle", "circle_radius", "miscellaneous", "stop"):
            self._read_positioning(index, block)
        else:
            self._read_statement(block)

    def _read_statement(self, block: Block) -> None:
        match block.kind:
            case "end_pgm":
                self.ended = True
            case "rounding" | "chamfer":
                self.cornered = True
            case _:
                self._statements[block.kind](block)

    def _plane(self, block: Block) -> None:
        if block.kind == "transformation":
            if not _TRANSFORMATION_RESET.fullmatch(block.detail):
                raise block.refuse(f"{block.detail}: changes what coordinates mean")
        elif block.detail.upper() not in ("PLANE RESET", "PLANE RESET STAY"):
            raise block.refuse(f"{block.detail}: tilts the working plane or moves rotary axes")
        else:
            self.levelled = False

    def _begin(self, block: Block) -> None:
        if self.begun:
            raise block.refuse("a second program in one file")
        self.begun = True
        unit = block.detail.split()[-1].upper()
        if unit not in ("MM", "INCH"):
            self.notes.add("BEGIN PGM without MM or INCH: coordinates taken in mm", block.line)
        self.unit = INCH if unit == "INCH" else 1.0

    # ---- moves

    def _read_positioning(self, index: int, block: Block) -> None:
        content = self._sort(block)
        frame = self.recorder.frame
        self._functions_at_start(block, content)
        settled = frame == self.recorder.frame
        self._compensate(block, content)
        if content.bare_axes and 94.0 not in content.m:
            raise block.refuse(f"{block.words[content.bare_axes[0]].address} without a number")
        if 91.0 in content.m:
            self._machine_move(index, block, content)
        elif block.kind in ("circle", "circle_radius"):
            self._circle(index, block, content, settled)
        elif content.axes and block.kind != "line":
            raise block.refuse("coordinates without L")
        elif content.axes:
            self._line(index, block, content, settled)
        self._functions_at_end(block, content)

    def _compensate(self, block: Block, content: _Content) -> None:
        """Radius compensation: the points of the contour are corrected, and the control shifts the path with them."""
        shifting = sorted(COMPENSATIONS & content.other)
        if shifting and (shifting[0] in ("R+", "R-") or self.tcp):
            raise block.refuse(f"{shifting[0]}: radius compensation of single axes, or under M128, is not corrected")
        if shifting:
            self.compensated = True
            self.notes.add("radius compensation: the points of the contour are corrected", block.line)
        elif "R0" in content.other:
            self.compensated = False

    def _sort(self, block: Block) -> _Content:
        content = _Content()
        for i, word in enumerate(block.words):
            address = word.address
            if address[-1] in AXES and address[:-1] in ("", "I"):
                if any(block.words[j].address[-1] == address[-1] for j in content.axes):
                    raise block.refuse(f"two {address[-1]} words")
                (content.bare_axes if word.start == word.end else content.axes).append(i)
            elif address == "M":
                if word.value is not None:
                    content.m.append(word.value)
            else:
                content.other.add(address)
        return content

    def _line(self, index: int, block: Block, content: _Content, settled: bool) -> None:
        words = self._axis_words(block, content.axes)
        target = self._target(block, words)
        kind = Kind.RAPID if "FMAX" in content.other else Kind.LINE
        self.recorder.move(index, kind, target, self.unit, tuple(word for word, _ in words), settled=settled)

    def _machine_move(self, index: int, block: Block, content: _Content) -> None:
        if block.kind != "line":
            raise block.refuse("M91 without a straight line")
        if self.tcp:
            raise block.refuse("M91 while M128 is on: HEIDENHAIN asks for M129 before it")
        words = self._axis_words(block, content.axes)
        if any(word.incremental for word, _ in words):
            raise block.refuse("an increment from an earlier M91 position")
        if words:
            targets = {word.axis: value for word, value in words}
            self.recorder.move_to_machine_position(index, targets, tuple(word for word, _ in words))

    def _axis_words(self, block: Block, indices: Iterable[int]) -> list[tuple[AxisWord, float]]:
        """Axis words with their values, mm or degrees, in the order of the block."""
        result = []
        for i in indices:
            address = block.words[i].address
            axis = self.recorder.axis(block, address[-1])
            unit = 1.0 if self.machine.axes[axis].rotary else self.unit
            result.append((AxisWord(axis, i, len(address) > 1), self._value(block, block.words[i]) * unit))
        return result

    def _value(self, block: Block, word: Word) -> float:
        if word.value is None:
            raise block.refuse(f"{block.text[word.at : word.end]}: its value is computed while the program runs")
        return word.value

    def _target(self, block: Block, words: list[tuple[AxisWord, float]]) -> list[float]:
        """Where a move with these words ends, in programmed coordinates."""
        if not self.begun:
            self.notes.add("no BEGIN PGM: coordinates taken in mm", block.line)
        target = self.recorder.target(block, words)
        if self.levelled and any(target[i] for i, axis in enumerate(self.machine.axes) if axis.rotary):
            raise block.refuse("rotary axes away from 0 while cycle 19 is on: the control may turn the coordinates")
        return target

    # ---- circles

    def _set_pole(self, index: int, block: Block) -> None:
        plane = cartesian(self.machine)[:2]
        words = self._axis_words(block, range(len(block.words)))
        if any(word.axis not in plane for word, _ in words):
            raise block.refuse("arcs are corrected in the plane of X and Y only")
        if len({word.axis for word, _ in words}) < len(words):
            raise block.refuse("one coordinate of the pole twice")
        relative = [word.axis for word, _ in words if word.incremental] if words else plane
        if not all(self.recorder.known[axis] for axis in relative):
            raise block.refuse("a pole from a position that the program has not said")
        here = [self.recorder.position[axis] for axis in plane]
        pole: list[float | None] = list(self.pole or (None, None)) if words else [*here]
        places: list[int | None] = [None, None]
        for word, value in words:
            i = plane.index(word.axis)
            pole[i] = here[i] + value if word.incremental else value
            places[i] = None if word.incremental else word.word
        if pole[0] is None or pole[1] is None:
            raise block.refuse("one coordinate of a pole, and no earlier pole to take the other from")
        self.pole = (pole[0], pole[1])
        self.pole_block, self.pole_words = index, (places[0], places[1])

    def _circle(self, index: int, block: Block, content: _Content, settled: bool) -> None:
        senses = DIRECTIONS.keys() & content.other
        if len(senses) != 1:
            raise block.refuse("an arc without DR+ or DR-")
        sense = DIRECTIONS[senses.pop()]
        words = self._axis_words(block, content.axes)
        if not words:
            raise block.refuse("an arc without an end point")
        target = self._target(block, words)
        first, second, normal = cartesian(self.machine)
        if not (self.recorder.known[first] and self.recorder.known[second]):
            raise block.refuse("an arc from a position that the program has not said")
        position = self.recorder.position
        start, end = (position[first], position[second]), (target[first], target[second])
        plane = (first, second, normal)
        if block.kind == "circle":
            centre = self._centre(block, start, end)
            arc = Arc(plane, sense, centre, same(start, end), "pole", self.pole_words, self.pole_block)
        else:
            i, radius = self._radius(block)
            found = centre_from_radius(start, end, radius, sense)
            if found is None:
                raise block.refuse("no circle of this radius joins start and end")
            arc = Arc(plane, sense, found, False, "radius", (i, None))
        named = tuple(word for word, _ in words)
        self.recorder.move(index, Kind.ARC, target, self.unit, named, arc, settled=settled)

    def _radius(self, block: Block) -> tuple[int, float]:
        """Index of the radius word, and its value, mm; a bare R is no radius."""
        for i, word in enumerate(block.words):
            if word.address == "R" and word.start < word.end:
                return i, self._value(block, word) * self.unit
        raise block.refuse("CR without a radius")

    def _centre(self, block: Block, start: Point, end: Point) -> Point:
        if self.pole is None:
            raise block.refuse("an arc without a pole (CC) in the present frame")
        fault = radius_fault(start, end, self.pole)
        if fault is not None:
            raise block.refuse(fault)
        return self.pole

    # ---- functions

    def _functions_at_start(self, block: Block, content: _Content) -> None:
        for code in content.m:
            if code in REFUSED_M:
                raise block.refuse(f"M{code:g} {REFUSED_M[code]}")
            if code in AXIS_M and (content.axes or content.bare_axes):
                raise block.refuse(f"M{code:g} {AXIS_M[code]}")
            if code not in HARMLESS_M and code not in MEANT_M:
                self.notes.add(f"M{code:g} is not known to ncomp and taken to move nothing", block.line)
                self.recorder.doubt()
        if 128.0 in content.m:
            self._start_tcp(block, "M128")
        if 140.0 in content.m:
            self._retract()

    def _functions_at_end(self, block: Block, content: _Content) -> None:
        if CALL_M in content.m:
            self._run_cycle(block)
        if 129.0 in content.m:
            self._switch_tcp(False)
        if 6.0 in content.m:
            self._forget(self.machine.control.tool_change_moves)
        if not PROGRAM_END_M.isdisjoint(content.m):
            self.ended = True

    def _start_tcp(self, block: Block, name: str) -> None:
        self._switch_tcp(True)
        text = f"{name}: X Y Z taken as the tool point in the workpiece frame that turns with a table"
        self.notes.add(text, block.line)

    def _switch_tcp(self, on: bool) -> None:
        if on != self.tcp:
            self.tcp, self.pole = on, None
            self._change_frame(cartesian(self.machine))

    def _retract(self) -> None:
        """M140: the tool goes off along its axis."""
        leans = self.tcp or any(axis.rotary and axis.side == "tool" for axis in self.machine.axes)
        self._forget("XYZ" if leans else "Z")

    def _forget(self, names: Sequence[str]) -> None:
        self.recorder.forget([self.machine.index(name) for name in names if name in self.machine.names])

    def _frame(self) -> Frame:
        offset = list(self.setup.work_offset(self.preset))
        length = self.tool_length + self.oversize
        placed = self.places.placement
        for axis, shift in zip(cartesian(self.machine), placed.shift, strict=True):
            offset[axis] += shift
        if not self.tcp:
            offset[cartesian(self.machine)[2]] += length
        return Frame(tuple(offset), length, self.tcp, placed.frame_turn)

    def _change_frame(self, axes: Iterable[int]) -> None:
        """Program in the present frame from here, in which coordinates of these axes mean something else."""
        self.recorder.set_frame(self._frame(), axes)

    # ---- statements

    def _tool_call(self, block: Block) -> None:
        words = {word.address: word for word in block.words}
        other_axis = [axis for axis in "XYUVW" if axis in words]
        if other_axis:
            raise block.refuse(f"tool axis {other_axis[0]}: only tools along Z are corrected")
        oversize = self._value(block, words["DL"]) * self.unit if "DL" in words else 0.0
        if "T" not in words:
            if "DL" not in words and self.oversize:
                raise block.refuse("whether DL stays in force when no tool is named depends on the control")
            self.oversize = oversize
        else:
            if self.tcp:
                raise block.refuse("a tool call while M128 is on: HEIDENHAIN asks for M129 before it")
            number = self._tool_number(block, words["T"])
            self.tool_length = self.setup.tool_length(number) if number else 0.0
            self.oversize = oversize
            self._forget(self.machine.control.tool_change_moves)
        self._change_frame(cartesian(self.machine)[2:])

    def _tool_def(self, block: Block) -> None:
        words = {word.address: word for word in block.words}
        if "L" not in words:
            return
        if "T" not in words:
            raise block.refuse("a tool length without a tool number")
        length = self._value(block, words["L"]) * self.unit
        self.setup.tools[str(self._tool_number(block, words["T"]))] = length

    def _tool_number(self, block: Block, word: Word) -> int:
        text = block.text[word.at : word.end]
        if text.startswith('"'):
            raise block.refuse(f"tool {text}: tool lengths are known by number only")
        value = self._value(block, word)
        if value != int(value):
            raise block.refuse(f"tool {text}: lengths of indexed tools are not known")
        return int(value)

    def _cycle(self, block: Block) -> None:
        match = _CYCLE.fullmatch(block.detail)
        assert match is not None
        number = int(match[1])
        if number == PRESET_CYCLE:
            self._set_preset(block)
        elif number in FRAME_CYCLES:
            self._frame_cycle(block, number, match[2], match[3])
        elif number in REFUSED_CYCLES:
            raise block.refuse(f"cycle {number}: {REFUSED_CYCLES[number]}")
        elif number not in HARMLESS_CYCLES:
            raise block.refuse(f"cycle {number} is not known")
        elif number not in DATA_CYCLES:
            self.cycle = number

    def _cycle_call(self, block: Block) -> None:
        match = _CALL.fullmatch(block.detail)
        if match is None:
            raise block.refuse(f"{block.detail}: where it runs the cycle is not known")
        if match[1]:
            code = float(match[1])
            if code not in HARMLESS_M:
                raise block.refuse(f"M{code:g} with a cycle")
        self._run_cycle(block)

    def _run_cycle(self, block: Block) -> None:
        """A canned cycle goes with the corrected place it starts from; depths and outlines are the control's."""
        z = cartesian(self.machine)[2]
        if self.tcp:
            raise block.refuse("a canned cycle while M128 is on")
        if self.cycle in CYCLES_AT_PLACE:
            self._end_above(z)
        elif self.cycle in CYCLES_ROUND_PLACE:
            self._end_above(z)
            self._forget("XY")
        elif self.cycle in CONTOUR_CYCLES:
            self._forget("XYZ")
            self.notes.add(f"cycle {self.cycle} runs along its contour as programmed: not corrected", block.line)
            return
        elif self.cycle not in CYCLES_AT_START:
            known = f"cycle {self.cycle}: where it runs is not known"
            raise block.refuse(known if self.cycle else "M99 or CYCL CALL without a cycle")
        self.notes.add(
            "canned cycles start from the corrected place; their depths and outlines stay as programmed", block.line
        )

    def _end_above(self, z: int) -> None:
        """Where a cycle leaves Z, as far as its parameters say so; no word of ours relies on it."""
        try:
            surface, second, first = (self._q(number) for number in (203, 204, 200))
        except NotKnown:
            self._forget("Z")
            return
        self.recorder.doubt([z])
        self.recorder.position[z] = (surface + max(second, first)) * self.unit
        self.recorder.known[z] = Known.MACHINE

    def _q(self, number: int) -> float:
        value = self.scope.get("Q", (float(number),))
        assert isinstance(value, float)
        return value

    def _set_preset(self, block: Block) -> None:
        values = [self._value(block, word) for word in block.words if word.address == "Q339"]
        if len(values) != 1 or values[0] != int(values[0]):
            raise block.refuse("cycle 247 without a preset number Q339")
        self.preset = f"{values[0]:.0f}"
        self.notes.add("presets taken without rotation", block.line)
        self.pole = None
        self._change_frame(range(len(self.machine.axes)))

    def _frame_cycle(self, block: Block, number: int, part: str | None, name: str) -> None:
        if number in PLACING and part is not None and not re.search(r"[\d#]", name):
            if part != ".0":
                self._place(block, number)
            return
        addresses, neutral, meaning = FRAME_CYCLES[number]
        changes = [word for word in block.words if not re.fullmatch(addresses, word.address) or word.value != neutral]
        if part is None or changes or re.search(r"[\d#]", name):
            raise block.refuse(f"cycle {number} {meaning}")
        if number == 19 and part != ".0":
            self.levelled = bool(block.words)

    def _place(self, block: Block, number: int) -> None:
        words = {word.address: self._value(block, word) if word.start < word.end else 0.0 for word in block.words}
        if self.places.set(block, number, words, self.unit):
            self.pole = None
            self._change_frame(cartesian(self.machine))

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
            self._switch_tcp(False)
        elif not _HARMLESS_FUNCTION.fullmatch(block.detail):
            raise block.refuse(f"{block.detail}: is not known")
