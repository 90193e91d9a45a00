"""Meaning of Siemens 840D blocks: modal state in, moves out; what could move the tool unseen is refused."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from kinematics.machine import Machine
from postproc.circles import centre_from_radius, radius_fault, same
from postproc.frames import Frame, Placement, cartesian, mirrored, rotated, scaled, shifted
from postproc.iso_codes import HARMLESS_M, LARGEST, PROGRAM_ENDS, SKIPPABLE_M, TOOL_CHANGE
from postproc.motions import Arc, AxisWord, Kind, Known, Motions, Recorder
from postproc.notes import Notes
from postproc.program import Block, Word
from postproc.setup import Setup
from postproc.siemens_codes import (
    CENTRES,
    DISTANCES,
    DWELL,
    FEED_MODES,
    FRAME_NAMES,
    GROUPS,
    HARMLESS_ADDRESSES,
    HARMLESS_CALLS,
    HARMLESS_G,
    HARMLESS_NAMES,
    INVERSE_TIME,
    MACHINE,
    MOTION,
    PLANES,
    REFERENCE,
    REFUSED_G,
    REFUSED_NAMES,
    SPATIAL_NAMES,
    UNITS,
    WORK_OFFSETS,
)
from postproc.siemens_variables import SiemensVariables

AXES = "XYZABCUVWEQ"
NORMALS = {"X": "YZX", "Y": "ZXY", "Z": "XYZ"}
"""The plane that a rotation about an axis turns."""
END_OF_SUBPROGRAM = 17.0
_SPINDLE_M = re.compile(r"M\d+")
_MACHINE_AXIS = re.compile(r"[A-Z]\d+|FP")
"""Of G74 and G75, with the number of a fixed point."""
_SPINDLE_S = re.compile(r"[SH]\d+")


@dataclass
class _Content:
    """The words of one block, sorted."""

    g: list[float] = field(default_factory=list)
    m: list[float] = field(default_factory=list)
    axes: list[int] = field(default_factory=list)
    """Indices of the axis words."""
    names: set[str] = field(default_factory=set)
    """Words that stand alone, and calls."""
    other: dict[str, int] = field(default_factory=dict)
    """Indices of all other words by address."""


@dataclass
class SiemensInterpreter:
    """Reads blocks in order; modal state carries over from chunk to chunk."""

    machine: Machine
    setup: Setup
    notes: Notes
    scope: SiemensVariables = field(default_factory=SiemensVariables)

    def __post_init__(self) -> None:
        self.begun = self.ended = False
        self.motion: float | None = None
        self.timed = False
        self.plane = "XYZ"
        self.absolute = True
        self.unit = 1.0
        self.work_offset = "G500"
        self.shift = [0.0] * len(self.machine.axes)
        self.placed = Placement()
        """The programmable frame: of axes that turn, and of X Y Z."""
        self.selected_tool: int | str = 0
        self.spindle_tool: int | str | None = None
        self.edge = 1
        self.tcp = self.machine.control.tcp_at_start
        self.recorder = Recorder(self.machine, self._frame())

    def read(self, blocks: Iterable[Block]) -> Motions:
        """The moves of a chunk of blocks, each read before the next is asked for.

        Refusal at the first block that isn't fully understood.
        """
        done = []
        for index, block in enumerate(blocks):
            done.append(block)
            if block.kind == "words":
                self._read_block(index, block)
            elif block.kind == "header":
                if self.begun:
                    raise block.refuse("a second program in one file")
                self.begun = True
        return self.recorder.finish(done)

    def _read_block(self, index: int, block: Block) -> None:
        if self.ended:
            self.notes.add("blocks behind the end of the program do not run and stay as they are", block.line)
            return
        content = self._sort(block)
        moves = bool(content.axes) or bool(content.other.keys() & {*CENTRES, "CR", "TURN"})
        self._check_block(block, content, moves)
        self.begun = True
        frame = self.recorder.frame
        self._functions(block, content)
        claimed = self._modes(block, content)
        frames = content.names & FRAME_NAMES
        if frames:
            self._change_programmable(block, content, frames)
        elif claimed in REFERENCE:
            self.recorder.forget(list(range(len(self.machine.axes))))
        elif claimed in MACHINE or "SUPA" in content.names:
            self._machine_move(index, block, content)
        elif moves and claimed != DWELL:
            self._move(index, block, content, frame == self.recorder.frame)
        self.ended = not PROGRAM_ENDS.isdisjoint(content.m) or END_OF_SUBPROGRAM in content.m or "RET" in content.names

    # ---- what stands in a block

    def _sort(self, block: Block) -> _Content:
        content = _Content()
        for i, word in enumerate(block.words):
            address = word.address
            if word.start == word.end and not word.mode:
                content.names.add(address)
            elif address == "G":
                content.g.append(word.value or 0.0)
            elif address == "M" or _SPINDLE_M.fullmatch(address):
                content.m.append(word.value or 0.0)
            elif address in AXES:
                if any(block.words[j].address == address for j in content.axes):
                    raise block.refuse(f"two {address} words")
                content.axes.append(i)
            elif address in content.other:
                raise block.refuse(f"two {address} words")
            else:
                content.other[address] = i
        return content

    def _check_block(self, block: Block, content: _Content, moves: bool) -> None:
        active = moves or content.g or content.names or "T" in content.other or "D" in content.other
        if block.skippable and (active or not SKIPPABLE_M.issuperset(content.m)):
            raise block.refuse("whether it runs depends on the block-skip switch")
        for name in sorted(content.names):
            self._check_name(block, name)
        frame_words = {"RPL"} if content.names & FRAME_NAMES else set()
        machine_axes = set(filter(_MACHINE_AXIS.fullmatch, content.other)) if REFERENCE & set(content.g) else set()
        for address in sorted(
            content.other.keys() - machine_axes - frame_words - HARMLESS_ADDRESSES - {"T", "D", "CR", "TURN", *CENTRES}
        ):
            if not _SPINDLE_S.fullmatch(address):
                raise block.refuse(_strange(address))
        for group in GROUPS:
            clash = sorted(group.intersection(content.g))
            if len(clash) > 1:
                raise block.refuse(f"G{clash[0]:g} and G{clash[1]:g} in one block")
        if len(content.names & FRAME_NAMES) and (
            content.g or content.m or len(content.names) > 1 or content.other.keys() - {"N", "RPL"}
        ):
            raise block.refuse("a frame and something beside it")

    def _check_name(self, block: Block, name: str) -> None:
        plain = name.partition("(")[0]
        if plain in REFUSED_NAMES:
            raise block.refuse(f"{plain} {REFUSED_NAMES[plain]}")
        called = name.endswith(")")
        known = HARMLESS_CALLS if called else HARMLESS_NAMES | FRAME_NAMES | {"SUPA", "RET", "TRAFOOF", "TRAORI"}
        if plain in known or name in ("TRAORI()", "TRAFOOF()"):
            return
        if plain == "TRAORI":
            raise block.refuse("TRAORI with a number: which transformation that is, is not known")
        raise block.refuse(f"{plain} is not known: a cycle, a subprogram or a function of the control")

    # ---- tools and functions

    def _functions(self, block: Block, content: _Content) -> None:
        before = self._length_key()
        if "T" in content.other:
            word = block.words[content.other["T"]]
            self.selected_tool = word.mode or self._whole(block, word)
        for code in content.m:
            if code not in HARMLESS_M and code != END_OF_SUBPROGRAM and not 40.0 <= code <= 45.0:
                self.notes.add(f"M{code:g} is not known to ncomp and taken to move nothing", block.line)
                self.recorder.doubt()
            if code == TOOL_CHANGE:
                self._change_tool(block)
        if "D" in content.other:
            self.edge = self._whole(block, block.words[content.other["D"]])
        if self._length_key() != before:
            x_y_z = cartesian(self.machine)
            self.recorder.set_frame(self._frame(), x_y_z if self.tcp else x_y_z[2:])

    def _change_tool(self, block: Block) -> None:
        self.spindle_tool = self.selected_tool
        names = [name for name in self.machine.control.tool_change_moves if name in self.machine.names]
        text = f"a tool change taken to move {' '.join(names) or 'no axis'} (machine file: tool_change_moves)"
        self.notes.add(text, block.line)
        self.recorder.forget([self.machine.index(name) for name in names])

    def _length_key(self) -> tuple[int | str | None, int]:
        return self.spindle_tool, self.edge

    def _tool_length(self) -> float:
        if not self.edge or not self.spindle_tool:
            return 0.0
        return self.setup.tool_length(self.spindle_tool)

    # ---- modes and frames

    def _modes(self, block: Block, content: _Content) -> float | None:
        """Take over the modal G codes; the code that claims the block's axis words for itself, or None."""
        claimed = None
        for code in content.g:
            if code in MACHINE or code in REFERENCE or code == DWELL:
                claimed = code
            elif code in WORK_OFFSETS:
                self.work_offset = f"G{code:.0f}"
                self.recorder.set_frame(self._frame(), range(len(self.machine.axes)))
            elif not self._take_mode(code) and code not in HARMLESS_G:
                raise block.refuse(f"G{code:g} {REFUSED_G.get(code, 'is not known')}")
        on, off = content.names & {"TRAORI", "TRAORI()"}, content.names & {"TRAFOOF", "TRAFOOF()"}
        if on or off:
            self._switch_tcp(block, bool(on))
        return claimed

    def _take_mode(self, code: float) -> bool:
        if code in MOTION:
            self.motion = code
        elif code in PLANES:
            self.plane = PLANES[code]
        elif code in UNITS:
            self.unit = UNITS[code]
        elif code in DISTANCES:
            self.absolute = code == 90.0
        elif code in FEED_MODES:
            self.timed = code == INVERSE_TIME
        else:
            return False
        return True

    def _switch_tcp(self, block: Block, on: bool) -> None:
        if on:
            text = "TRAORI: X Y Z taken as the tool point in the workpiece frame that turns with a table"
            self.notes.add(text, block.line)
        if on != self.tcp:
            self.tcp = on
            self.recorder.set_frame(self._frame(), cartesian(self.machine))

    def _change_programmable(self, block: Block, content: _Content, names: set[str]) -> None:
        """TRANS, ROT, SCALE, MIRROR set the programmable frame anew; with an A before them they add to it."""
        (name,) = names
        if name in SPATIAL_NAMES:
            raise block.refuse(f"{name} turns the coordinates by angles in space")
        added = name.startswith("A")
        kind = name.removeprefix("A") if added else name
        words = {block.words[i].address: self._frame_value(block, block.words[i]) for i in content.axes}
        inner = self._inner_frame(block, content, kind, {a: v for a, v in words.items() if a in "XYZ"})
        turned = {axis: value for axis, value in words.items() if axis not in "XYZ"}
        if turned and kind != "TRANS":
            raise block.refuse(f"{name} of an axis that turns")
        before = self.placed
        self.placed = before.then(inner) if added else inner
        if not added:
            self.shift = [0.0] * len(self.machine.axes)
        for axis, value in turned.items():
            self.shift[self.recorder.axis(block, axis)] += value
        self.recorder.set_frame(self._frame(), self._places_changed(before, words))

    def _places_changed(self, before: Placement, words: Mapping[str, float]) -> Iterable[int] | None:
        """Axes whose coordinates mean something else now; those that differ, and those that the program has named."""
        if before.turn != self.placed.turn:
            return range(len(self.machine.axes))
        named = {self.machine.index(axis) for axis in words if axis in self.machine.names}
        moved = {
            i for i, (a, b) in enumerate(zip(self.recorder.frame.offset, self._frame().offset, strict=True)) if a != b
        }
        return named | moved

    def _frame_value(self, block: Block, word: Word) -> float:
        if word.mode:
            raise block.refuse(f"{word.mode} in a frame")
        return self._value(block, word)

    def _inner_frame(self, block: Block, content: _Content, kind: str, words: Mapping[str, float]) -> Placement:
        unit = self.unit
        if kind == "TRANS":
            return shifted(*(words.get(axis, 0.0) * unit for axis in "XYZ"))
        if kind == "MIRROR":
            return mirrored("".join(words))
        if kind == "SCALE":
            if words and (len(words) < 3 or len(set(words.values())) > 1 or min(words.values()) <= 0.0):
                raise block.refuse("a scale that is not the same along X, Y and Z")
            return scaled(words["X"]) if words else Placement()
        angle = content.other.get("RPL")
        if angle is not None:
            if words:
                raise block.refuse("RPL beside an axis")
            return rotated(self._value(block, block.words[angle]), self.plane)
        if len(words) > 1:
            raise block.refuse("a rotation about more than one axis in one block")
        return next((rotated(value, NORMALS[axis]) for axis, value in words.items()), Placement())

    def _frame(self) -> Frame:
        offset = [a + b for a, b in zip(self.setup.work_offset(self.work_offset), self.shift, strict=True)]
        length, x_y_z = self._tool_length(), cartesian(self.machine)
        for axis, shift in zip(x_y_z, self.placed.shift, strict=True):
            offset[axis] += shift
        if not self.tcp:
            offset[x_y_z[2]] += length
        return Frame(tuple(offset), length, self.tcp, self.placed.frame_turn)

    # ---- moves

    def _value(self, block: Block, word: Word) -> float:
        value = word.value
        if value is None or not abs(value) < LARGEST:
            raise block.refuse(f"{word.address} with a number that no control reads")
        return value

    def _whole(self, block: Block, word: Word) -> int:
        value = self._value(block, word)
        if value != int(value):
            raise block.refuse(f"{word.address} with a number that is not whole")
        return int(value)

    def _axis_words(self, block: Block, content: _Content) -> list[tuple[AxisWord, float]]:
        """Axis words with their values, mm or degrees, in the order of the block."""
        result = []
        for i in content.axes:
            word = block.words[i]
            axis = self.recorder.axis(block, word.address)
            rotary = self.machine.axes[axis].rotary
            if word.mode in ("DC", "ACP", "ACN") and not rotary:
                raise block.refuse(f"{word.mode} for an axis that does not turn")
            incremental = word.mode == "IC" or (not word.mode and not self.absolute)
            result.append((AxisWord(axis, i, incremental), self._value(block, word) * (1.0 if rotary else self.unit)))
        return result

    def _machine_move(self, index: int, block: Block, content: _Content) -> None:
        if self.motion not in (None, 0.0, 1.0):
            raise block.refuse("machine coordinates need G0 or G1")
        words = self._axis_words(block, content)
        if any(word.incremental for word, _ in words):
            raise block.refuse("an increment in machine coordinates")
        if self.tcp and words:
            raise block.refuse("machine coordinates while TRAORI is on")
        if words:
            x_y_z = cartesian(self.machine)
            length = self._tool_length()
            targets = {w.axis: value + (length if w.axis == x_y_z[2] else 0.0) for w, value in words}
            self.recorder.move_to_machine_position(index, targets, tuple(word for word, _ in words))

    def _move(self, index: int, block: Block, content: _Content, settled: bool) -> None:
        if self.motion is None:
            self.notes.add("no G0 or G1 before it: coordinates taken for straight lines", block.line)
            self.motion = 1.0
        words = self._axis_words(block, content)
        for word, _ in words:
            if word.incremental and self.recorder.known[word.axis] == Known.MACHINE:
                name = self.machine.names[word.axis]
                raise block.refuse(
                    f"an increment of {name} before its position is said in this frame: whether the control runs the "
                    "new offset with it depends on its settings"
                )
        target = self.recorder.target(block, words)
        kind = MOTION[self.motion]
        if kind is not Kind.ARC and content.other.keys() & {*CENTRES, "CR", "TURN"}:
            raise block.refuse("a centre, a radius or turns without an arc")
        arc = self._arc(block, content, target) if kind is Kind.ARC else None
        named = tuple(word for word, _ in words)
        modes = {"incremental": not self.absolute, "timed": self.timed, "settled": settled}
        self.recorder.move(index, kind, target, self.unit, named, arc, **modes)

    def _arc(self, block: Block, content: _Content, target: list[float]) -> Arc:
        plane = (
            self.machine.index(self.plane[0]),
            self.machine.index(self.plane[1]),
            self.machine.index(self.plane[2]),
        )
        first, second, _ = plane
        sense = 1 if self.motion == 3.0 else -1
        position, known = self.recorder.position, self.recorder.known
        if not (known[first] and known[second]):
            raise block.refuse("an arc from a position that the program has not said")
        other = content.other
        if "TURN" in other and self._value(block, block.words[other["TURN"]]) != 0.0:
            raise block.refuse("an arc of several turns is not corrected")
        start, end = (position[first], position[second]), (target[first], target[second])
        if "CR" in other:
            if other.keys() & set(CENTRES):
                raise block.refuse("an arc by its radius and its centre at once")
            i = other["CR"]
            centre = centre_from_radius(start, end, self._value(block, block.words[i]) * self.unit, sense)
            if centre is None:
                raise block.refuse("no circle of this radius joins start and end")
            return Arc(plane, sense, centre, False, "radius", (i, None))
        return self._arc_by_centre(block, content, plane, sense, (start, end))

    def _arc_by_centre(
        self,
        block: Block,
        content: _Content,
        plane: tuple[int, int, int],
        sense: int,
        ends: tuple[tuple[float, float], tuple[float, float]],
    ) -> Arc:
        letters = [CENTRES["XYZ".index(letter)] for letter in self.plane[:2]]
        stray = [a for a in CENTRES if a in content.other and a not in letters]
        if any(self._value(block, block.words[content.other[a]]) for a in stray):
            raise block.refuse(f"{stray[0]} gives no centre in the plane of {' and '.join(self.plane[:2])}")
        indices = [content.other.get(letter) for letter in letters]
        if indices == [None, None]:
            raise block.refuse(f"an arc without {' or '.join(letters)} or CR")
        words = [None if i is None else block.words[i] for i in indices]
        modes = {word.mode for word in words if word is not None}
        if len(modes) > 1 or not modes <= {"", "AC"}:
            raise block.refuse("one coordinate of a centre absolute and the other not")
        absolute = modes == {"AC"}
        if absolute and None in indices:
            raise block.refuse(f"an absolute centre takes both {' and '.join(letters)}")
        values = [0.0 if word is None else self._value(block, word) * self.unit for word in words]
        start, end = ends
        base = (0.0, 0.0) if absolute else start
        centre = (base[0] + values[0], base[1] + values[1])
        fault = radius_fault(start, end, centre)
        if fault is not None:
            raise block.refuse(fault)
        form = "absolute" if absolute else "incremental"
        return Arc(plane, sense, centre, same(start, end), form, (indices[0], indices[1]))


def _strange(address: str) -> str:
    if address == "L":
        return "L calls a subprogram"
    if address in ("AP", "RP", "RPL"):
        return f"{address}: polar coordinates and rotations are not corrected"
    if address == "AR":
        return "AR: an arc by its angle is not corrected"
    if re.fullmatch(r"[ABC][2-7]|[IJK]1|LEAD|TILT|THETA|PHI|PSI", address):
        return f"{address}: tool vectors and points on arcs are not corrected"
    return f"{address} in a block: what it does is not known"
