"""Cycles of Klartext: those that change the meaning of coordinates, and those that machine."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from postproc.control.channel import LEANS
from postproc.control.words import Content, value_of
from postproc.heidenhain.channel import Channel
from postproc.heidenhain.codes import (
    CALL_M,
    CONTOUR_CYCLES,
    CYCLES_AROUND_POSITION,
    CYCLES_AT_POSITION,
    CYCLES_AT_START,
    DATA_CYCLES,
    DRILLING_CYCLES,
    FRAME_CYCLES,
    HARMLESS_CYCLES,
    HARMLESS_M,
    MODAL_CALL_M,
    PATTERN_CYCLES,
    PRESET_CYCLE,
    PROGRAM_CALL_CYCLE,
    TRANSFORMATION_CYCLES,
)
from postproc.heidenhain.datum_transformations import SCALING_CYCLE, SHIFT_CYCLE
from postproc.heidenhain.tilted_planes import Planes
from postproc.motion.circles import Point
from postproc.motion.frames import renamed
from postproc.motion.moves import AxisWord, Kind
from postproc.text.block import Block
from postproc.text.expressions import NotKnown

_CALL = re.compile(r"CYCL CALL(?: M ?(\d*))?", re.IGNORECASE)
_CYCLE = re.compile(r"CYCL DEF (\d+)(\.\d+)?(.*)", re.IGNORECASE)
_DATUM_LINE = re.compile(r"#\s*(\d+)")


@dataclass
class Cycles:
    """The cycles of one control."""

    channel: Channel
    planes: Planes

    def define(self, index: int, block: Block) -> None:
        """CYCL DEF."""
        channel = self.channel
        match = _CYCLE.fullmatch(block.detail)
        assert match is not None
        number = int(match[1])
        if number not in DATA_CYCLES and number not in FRAME_CYCLES and number != PRESET_CYCLE:
            channel.modal.calls_cycle = False
        if number == PRESET_CYCLE:
            self._set_preset(block)
        elif number in FRAME_CYCLES:
            self._frame_cycle(block, number, match[2], match[3])
        elif number in PATTERN_CYCLES:
            self._pattern(index, block, number)
        elif number == PROGRAM_CALL_CYCLE:
            if block.code is None:
                raise block.refuse("cycle 12 calls a program whose file is not known: write its blocks")
            channel.modal.cycle = number
        elif number not in HARMLESS_CYCLES:
            channel.accept(block, f"CYCL DEF {number}", f"cycle {number} is not known to ncomp: write its moves")
            channel.modal.cycle = number
        elif number not in DATA_CYCLES:
            channel.modal.cycle = number

    # ---- calls

    def call(self, block: Block) -> None:
        """CYCL CALL."""
        match = _CALL.fullmatch(block.detail)
        if match is None:
            raise block.refuse(f"{block.detail} runs the cycle at positions that are not known: write CYCL CALL or M99")
        if match[1]:
            code = float(match[1])
            if code not in HARMLESS_M:
                raise block.refuse(f"M{code:g} in a cycle call is not followed: write it in a block of its own")
        self.run(block)

    def call_at(self, index: int, block: Block, content: Content) -> None:
        """CYCL CALL POS: at X and Y; its Z shifts the surface and all that counts from it."""
        channel = self.channel
        words = channel.axis_words(block, content.axes)
        x_y_z = channel.x_y_z
        channel.modal.calls_cycle = False
        if sorted(word.axis for word, _ in words) != sorted(x_y_z) or any(word.incremental for word, _ in words):
            raise block.refuse("CYCL CALL POS needs an absolute position: write X, Y and Z")
        target = channel.target(block, words)
        channel.move(index, Kind.RAPID, target, words)
        self.run(block, target[x_y_z[2]] / channel.modal.unit)

    def run_behind(self, block: Block, content: Content) -> None:
        """Behind a move with M99, and from one with M89 on behind each move, up to the next M99."""
        modal = self.channel.modal
        if MODAL_CALL_M in content.m:
            if not content.axes or CALL_M in content.m:
                raise block.refuse(
                    "M89 needs a move and no M99: write it with X or Y, and M99 in the last of its blocks"
                )
            modal.calls_cycle = True
            text = (
                "M89 is taken to run the cycle behind every move, until M99 or another cycle (machine parameter 7440)"
            )
            self.channel.notes.add(text, block.line)
        if CALL_M in content.m or (modal.calls_cycle and content.axes):
            self.run(block)
        if CALL_M in content.m:
            modal.calls_cycle = False

    def run(self, block: Block, shifted: float = 0.0) -> None:
        """A canned cycle starts from its corrected position; the control makes depths and contours.

        `shifted`: height of the surface above its parameter, in units of the program.
        """
        channel, cycle = self.channel, self.channel.modal.cycle
        z = channel.x_y_z[2]
        if cycle == PROGRAM_CALL_CYCLE:
            raise block.refuse("the program of cycle 12 is called in another place: write cycle 12 before the call")
        if channel.modal.tcp and cycle not in DRILLING_CYCLES:
            raise block.refuse(f"cycle {cycle} while M128 is on is not corrected: write M129 before it")
        if channel.modal.tcp and channel.leans(z):
            raise block.refuse(f"a drilling cycle while M128 is on {LEANS.format(axis='Z')}")
        if cycle in CYCLES_AT_POSITION:
            self._end_above(z, shifted)
        elif cycle in CYCLES_AROUND_POSITION:
            self._end_above(z, shifted)
            channel.mark_unknown("XY")
        elif cycle in CONTOUR_CYCLES:
            channel.mark_unknown("XYZ")
            text = f"cycle {cycle} runs along its contour as programmed and is not corrected"
            channel.notes.add(text, block.line)
            return
        elif cycle not in CYCLES_AT_START:
            raise block.refuse(
                f"cycle {cycle} runs at positions that are not known to ncomp: write its moves"
                if cycle
                else "M99 or CYCL CALL has no cycle to run: write its CYCL DEF before it"
            )
        self._note(block)

    def _note(self, block: Block) -> None:
        text = "canned cycles start from the corrected position; their depths and contours stay as programmed"
        self.channel.notes.add(text, block.line)

    def _end_above(self, z: int, shifted: float) -> None:
        """Z after a cycle, as far as its parameters give it; no added word relies on it."""
        channel = self.channel
        try:
            surface, second, first = (channel.q(number) for number in (203, 204, 200))
        except NotKnown:
            channel.mark_unknown("Z")
            return
        channel.recorder.record_machine_position(z, (surface + shifted + max(second, first)) * channel.modal.unit)

    # ---- patterns

    def _pattern(self, index: int, block: Block, number: int) -> None:
        """Cycles 220 and 221 run the cycle before at once, hole by hole; only their first position can be corrected."""
        channel, cycle = self.channel, self.channel.modal.cycle
        if cycle not in CYCLES_AT_POSITION | CYCLES_AROUND_POSITION:
            raise block.refuse(
                f"cycle {number} repeats cycle {cycle}, whose position is not known: write another cycle before it"
                if cycle
                else f"cycle {number} has no cycle to repeat: write its CYCL DEF before it"
            )
        if channel.modal.tcp:
            raise block.refuse(f"cycle {number} while M128 is on is not corrected: write M129 before it")
        words = {word.address: i for i, word in enumerate(block.words)}
        values = {name: value_of(block, block.words[i]) for name, i in words.items()}
        required = PATTERN_CYCLES[number]
        if not required <= values.keys():
            raise block.refuse(
                f"cycle {number} has no {', '.join(sorted(required - values.keys()))}: write all its parameters"
            )
        x, y, z = channel.x_y_z
        first = zip((x, y), HOLE_WORDS[number], strict=True)
        named = [(AxisWord(axis, words[name], False), values[name]) for axis, name in first]
        channel.recorder.record_machine_position(
            z, (values["Q203"] + max(values["Q204"], values["Q200"])) * channel.modal.unit
        )
        for i, (at_x, at_y) in enumerate(_positions(number, values)):
            target = list(channel.recorder.position)
            target[x], target[y] = at_x * channel.modal.unit, at_y * channel.modal.unit
            channel.move(index, Kind.RAPID if i == 0 else Kind.PATTERN, target, named)
        if cycle in CYCLES_AROUND_POSITION:
            channel.mark_unknown("XY")
        self._note(block)

    # ---- frames

    def _set_preset(self, block: Block) -> None:
        values = [value_of(block, word) for word in block.words if word.address == "Q339"]
        if len(values) != 1 or values[0] != int(values[0]):
            raise block.refuse("cycle 247 has no whole preset number: write Q339")
        self.channel.set_preset(block, f"{values[0]:.0f}")

    def _frame_cycle(self, block: Block, number: int, part: str | None, name: str) -> None:
        if number in TRANSFORMATION_CYCLES and part is not None and not re.search(r"[\d#]", name):
            if part != ".0":
                self._transform(block, number)
            return
        addresses, neutral, meaning = FRAME_CYCLES[number]
        changes = [word for word in block.words if not re.fullmatch(addresses, word.address) or word.value != neutral]
        if part is not None and number == 19 and part != ".0" and changes:
            self.planes.tilt_by_cycle(block)
            return
        if part is None or changes or re.search(r"[\d#]", name):
            raise block.refuse(
                f"cycle {number} {meaning} in a form that is not followed: write CYCL DEF {number}.0 and {number}.1"
            )
        if number == 19 and part != ".0":
            self.planes.level(block, bool(block.words))

    def _transform(self, block: Block, number: int) -> None:
        line = next((match for word in block.words if (match := _DATUM_LINE.fullmatch(word.address))), None)
        if line is not None and number == SHIFT_CYCLE:
            words = self._datum(block, line[1])
        else:
            words = {word.address: value_of(block, word) if word.start < word.end else 0.0 for word in block.words}
        self.shift(block, number, words)

    def shift(self, block: Block, number: int, words: dict[str, float]) -> None:
        """A part of cycle 7, 8, 10, 11 or 26, or an equivalent TRANS block."""
        channel, modal = self.channel, self.channel.modal
        active = modal.transformations if modal.tilt is None else modal.tilted_transformations
        before = active.placement
        scaled_axes = channel.machine.control.scaled_axes
        if number == SCALING_CYCLE and scaled_axes:
            channel.notes.add(f"cycle 11 is taken to scale {' '.join(scaled_axes)} (machine file)", block.line)
        if active.set(block, number, words, modal.unit, scaled_axes):
            channel.change_frame([channel.x_y_z[i] for i in renamed(before, active.placement)])

    def _datum(self, block: Block, line: str) -> dict[str, float]:
        """A line of the datum table, in units of the program."""
        channel = self.channel
        if line not in channel.setup.datums:
            raise block.refuse(f"datum #{line} is in no datum table: give the table by --tool-table ZERO.D")
        shifts = channel.setup.datums[line]
        return {axis: value / (1.0 if axis in "ABC" else channel.modal.unit) for axis, value in shifts.items()}


HOLE_WORDS = {220: ("Q216", "Q217"), 221: ("Q225", "Q226")}
"""Parameters of the centre, or of the first hole, of a pattern."""


# ---- positions of the holes of the pattern cycles 220 (on a circle) and 221 (in lines)


def _positions(number: int, values: Mapping[str, float]) -> Iterator[Point]:
    """The position in the cycle, then the others, in units of the program: holes, or first the centre of a circle."""
    return _on_circle(values) if number == 220 else _in_lines(values)


def _on_circle(values: Mapping[str, float]) -> Iterator[Point]:
    """Q216, Q217 centre, Q244 diameter, Q245 first angle, Q246 last angle, Q247 step, Q241 number of holes."""
    count = round(values["Q241"])
    whole = values["Q246"] - values["Q245"]
    step = values["Q247"] or whole / (count if abs(whole) == 360.0 else max(count - 1, 1))
    yield values["Q216"], values["Q217"]
    for i in range(count):
        angle = math.radians(values["Q245"] + i * step)
        radius = values["Q244"] / 2.0
        yield values["Q216"] + radius * math.cos(angle), values["Q217"] + radius * math.sin(angle)


def _in_lines(values: Mapping[str, float]) -> Iterator[Point]:
    """Q225, Q226 first hole, Q237, Q238 spacing, Q242 columns, Q243 lines, Q224 rotation about the first hole.

    Every second line is run backwards.
    """
    c, s = math.cos(math.radians(values["Q224"])), math.sin(math.radians(values["Q224"]))
    columns = range(round(values["Q242"]))
    for j in range(round(values["Q243"])):
        for i in columns if j % 2 == 0 else reversed(columns):
            x, y = i * values["Q237"], j * values["Q238"]
            yield values["Q225"] + c * x - s * y, values["Q226"] + s * x + c * y
