"""Meaning of ISO / Fanuc / LinuxCNC blocks: modal state in, moves out; what could move the tool unseen is refused."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

from kinematics.machine import Machine
from postproc.circles import centre_from_radius, radius_fault, same
from postproc.frames import Frame, Placement, cartesian, rotated, shifted
from postproc.iso_blocks import WORDS
from postproc.iso_codes import (
    AXES,
    CENTRE_DISTANCES,
    CENTRES,
    CONSTRUCTS,
    CYCLE_END,
    CYCLES,
    DISTANCES,
    FEED_MODES,
    FRAME_CODES,
    GROUPS,
    HARMLESS_G,
    HARMLESS_M,
    INCH,
    INVERSE_TIME,
    LARGEST,
    LENGTH_CODES,
    LOCAL,
    MEANINGFUL,
    MOTION,
    MOVE_WORDS,
    NAMING,
    OFFSET_CODES,
    ONE_SHOT,
    PALLET_CHANGE,
    PLACING,
    PLANES,
    PROGRAM_ENDS,
    REFUSED_G,
    REFUSED_M,
    RETURN_TO_LEVEL,
    RETURN_TO_R,
    ROTATION,
    ROTATION_END,
    SKIPPABLE_M,
    STANDING,
    TOOL_CHANGE,
    UNITS,
    WORK_OFFSETS,
)
from postproc.iso_cycles import CannedCycle, check_cycle_words
from postproc.iso_variables import IsoVariables
from postproc.motions import Arc, AxisWord, Kind, Motions, Recorder
from postproc.notes import Notes
from postproc.program import Block
from postproc.setup import Setup

CENTRE_WORD = {"X": "I", "Y": "J", "Z": "K"}


@dataclass
class _Content:
    """The words of one block, sorted."""

    g: list[float] = field(default_factory=list)
    m: list[float] = field(default_factory=list)
    axes: list[int] = field(default_factory=list)
    """Indices of the axis words."""
    other: dict[str, int] = field(default_factory=dict)
    """Indices of all other words by address."""


@dataclass
class IsoInterpreter:
    """Reads blocks in order; modal state carries over from chunk to chunk."""

    machine: Machine
    setup: Setup
    notes: Notes
    scope: IsoVariables = field(default_factory=IsoVariables)

    def __post_init__(self) -> None:
        self.begun = self.ended = False
        self.opened = self.torn = False
        """A tape mark has stood before all words; the first one came behind words."""
        self.motion: float | None = None
        self.cycle: CannedCycle | None = None
        self.to_retract: bool | None = None
        self.timed = False
        self.unsaid = {
            "unit": "no G20 or G21 before it: coordinates taken in mm",
            "distance": "no G90 or G91 before it: coordinates taken as absolute",
            "plane": "no G17, G18 or G19 before it: arcs taken in X Y",
        }
        self.taken: set[str] = set()
        """What the program has left unsaid and moves have been read by."""
        self.offset_said = self.length_said = False
        self.plane = "XYZ"
        self.absolute = True
        self.arc_absolute = self.machine.control.arc_centres == "absolute"
        self.unit = 1.0
        self.work_offset = "G54"
        self.local = [0.0] * len(self.machine.axes)
        """G52."""
        self.rotation = Placement()
        """G68."""
        self.selected_tool = 0
        self.spindle_tool: int | None = None
        self.length_offset: int | None = None
        self.tcp = self.machine.control.tcp_at_start
        self.recorder = Recorder(self.machine, self._frame())

    def read(self, blocks: Iterable[Block]) -> Motions:
        """The moves of a chunk of blocks, each read before the next is asked for.

        Refusal at the first block that isn't fully understood.
        """
        done = []
        for index, block in enumerate(blocks):
            done.append(block)
            if block.kind != "blank":
                self._read_block(index, block)
        return self.recorder.finish(done)

    def _read_block(self, index: int, block: Block) -> None:
        if self.ended:
            if any(word.address == "O" for word in block.words):
                raise block.refuse("a second program in one file")
            if self.torn and block.kind != "tape_mark":
                raise block.refuse("behind a tape mark that none opened: for some controls the program begins here")
            if block.kind != "tape_mark":
                self.notes.add("blocks behind the end of the program do not run and stay as they are", block.line)
        elif block.kind == "words":
            self._read_words(index, block)
        elif block.kind == "tape_mark":
            self._read_tape_mark(block)
        elif block.kind in CONSTRUCTS:
            raise block.refuse(f"{block.detail}: {CONSTRUCTS[block.kind]}")

    def _read_tape_mark(self, block: Block) -> None:
        if block.words or block.skippable:
            raise block.refuse("a tape mark that does not stand alone")
        self.torn = self.begun and not self.opened
        self.opened, self.ended = True, self.begun

    def _read_words(self, index: int, block: Block) -> None:
        content = self._sort(block)
        other = content.other.keys()
        moves = bool(content.axes) or not other.isdisjoint("IJKR")
        self._check_block(block, content, moves)
        frame = self.recorder.frame
        if content.m or "T" in other:
            self._functions(block, content)
        claimed = self._modes(block, content) if content.g else None
        if claimed in STANDING or (claimed is None and not moves):
            pass
        elif claimed in PLACING:
            self._change_place(block, content, claimed == ROTATION)
        elif claimed in (28.0, 30.0):
            self._reference_return(block, content)
        elif claimed == 53.0:
            self._machine_move(index, block, content)
        else:
            self._move(index, block, content, frame == self.recorder.frame)
        self.begun |= bool(moves or content.g or content.m or other - {"N", "O"})
        self.ended = not PROGRAM_ENDS.isdisjoint(content.m)

    def _check_block(self, block: Block, content: _Content, moves: bool) -> None:
        """Refuse what controls read in different ways, whatever the modes are."""
        other = content.other.keys()
        if block.skippable and (moves or content.g or "T" in other or not SKIPPABLE_M.issuperset(content.m)):
            raise block.refuse("whether it runs depends on the block-skip switch")
        if "O" in other and self.begun:
            raise block.refuse("a second program in one file")
        if "L" in other and not REFUSED_G.keys() & content.g:
            raise block.refuse("L calls a subprogram on some controls and repeats the block on others")
        if ";" in block.text:
            self._check_line_end(block)
        if "H" in other and LENGTH_CODES.isdisjoint(content.g) and REFUSED_G.keys().isdisjoint(content.g):
            raise block.refuse("H without G43: some controls take the new length at once, others do not")
        if len(content.g) > 1:
            if content.axes and not NAMING.isdisjoint(content.g) and not (MOTION.keys() | CYCLES).isdisjoint(content.g):
                raise block.refuse("coordinates that two codes may take")
            for group in GROUPS:
                clash = sorted(group.intersection(content.g))
                if len(clash) > 1:
                    raise block.refuse(f"G{clash[0]:g} and G{clash[1]:g} in one block")

    def _check_line_end(self, block: Block) -> None:
        """Refuse words behind a semicolon that stands behind words: where it ends a block, they are the next one."""
        _, mark, rest = block.text[block.words[-1].end :].partition(";")
        if mark and WORDS.fullmatch(rest.rstrip("\r\n")) and not MEANINGFUL.isdisjoint(rest.upper()):
            raise block.refuse("words behind a semicolon: a comment on some controls, the next block on others")

    def _sort(self, block: Block) -> _Content:
        content = _Content()
        for i, (address, value, *_) in enumerate(block.words):
            if address == "G":
                content.g.append(value or 0.0)
            elif address == "M":
                content.m.append(value or 0.0)
            elif address in AXES:
                if any(block.words[j].address == address for j in content.axes):
                    raise block.refuse(f"two {address} words")
                content.axes.append(i)
            elif address in content.other:
                raise block.refuse(f"two {address} words")
            else:
                content.other[address] = i
        return content

    def _functions(self, block: Block, content: _Content) -> None:
        if "T" in content.other:
            self.selected_tool = self._whole_number(block, content.other["T"])
        for code in content.m:
            if code in REFUSED_M:
                raise block.refuse(f"M{code:g} {REFUSED_M[code]}")
            if code not in HARMLESS_M:
                self.notes.add(f"M{code:g} is not known to ncomp and taken to move nothing", block.line)
                self.recorder.doubt()
            if code == TOOL_CHANGE:
                self._change_tool(block)
            elif code == PALLET_CHANGE:
                self.recorder.forget(list(range(len(self.machine.axes))))

    def _change_tool(self, block: Block) -> None:
        self.spindle_tool = self.selected_tool
        names = [name for name in self.machine.control.tool_change_moves if name in self.machine.names]
        text = f"a tool change taken to move {' '.join(names) or 'no axis'} (machine file: tool_change_moves)"
        self.notes.add(text, block.line)
        moved = [self.machine.index(name) for name in names]
        self.recorder.forget(moved)
        by_spindle_tool = self.tcp and not self.length_offset
        self.recorder.set_frame(self._frame(), cartesian(self.machine) if by_spindle_tool else ())

    def _modes(self, block: Block, content: _Content) -> float | None:
        """Take over the modal G codes; the code that claims the block's axis words for itself, or None."""
        claimed = None
        frame = self._offsets(), self.tcp
        for code in content.g:
            if code == 5.1 and "Q" not in content.other:
                raise block.refuse("G5.1 without Q: splines are not corrected")
            if code in ONE_SHOT:
                claimed = code
            elif code in OFFSET_CODES:
                self._select_work_offset(block, content, code)
                self.offset_said = True
            elif code in LENGTH_CODES:
                self._select_length_offset(block, content, code)
                self.length_said = True
            elif code == ROTATION_END:
                self._turn_to(Placement())
            elif not self._take_mode(code) and code not in HARMLESS_G:
                raise block.refuse(f"G{code:g} {REFUSED_G.get(code, 'is not known')}")
        if not FRAME_CODES.isdisjoint(content.g):
            self._change_frame(*frame)
        return claimed

    def _take_mode(self, code: float) -> bool:
        """Take over a modal G code that changes how later words are read; False when it is none."""
        said = None
        if code in MOTION:
            self.motion, self.cycle = code, None
        elif code in CYCLES:
            self._begin_cycle(code)
        elif code == CYCLE_END:
            # what coordinates do from here depends on the control
            self.motion, self.cycle = (self.motion, None) if self.cycle is None else (None, None)
        elif code in (RETURN_TO_LEVEL, RETURN_TO_R):
            self.to_retract = code == RETURN_TO_R
        elif code in PLANES:
            self.plane, said = PLANES[code], "plane"
        elif code in UNITS:
            self.unit, said = UNITS[code], "unit"
        elif code in DISTANCES:
            self.absolute, said = code == 90.0, "distance"
        elif code in CENTRE_DISTANCES:
            self.arc_absolute = code == 90.1
        elif code in FEED_MODES:
            self.timed = code == INVERSE_TIME
        else:
            return False
        if said is not None:
            self.unsaid.pop(said, None)
            if said in self.taken and code in (21.0, 90.0):
                # just what moves have been read by unsaid: if it was another before, the axes stand elsewhere
                self.recorder.doubt()
            self.taken.discard(said)
        return True

    def _change_place(self, block: Block, content: _Content, rotation: bool) -> None:
        """G52: the origin at another place. G68 X Y R: coordinates turned round a point."""
        words = self._axis_words(block, content)
        if not self.absolute or content.g.count(ROTATION) + content.g.count(LOCAL) != len(content.g):
            raise block.refuse("G52 and G68 need G90, and a block of their own")
        if self.rotation != Placement() or content.m or content.other.keys() - {"N", "R" if rotation else "N"}:
            raise block.refuse("G52 or G68 while G68 is on, or beside something else")
        if not rotation:
            for word, value in words:
                self.local[word.axis] = value
            self.recorder.set_frame(self._frame(), {word.axis for word, _ in words})
            return
        x, y, _ = cartesian(self.machine)
        centre = {word.axis: value for word, value in words}
        if centre.keys() != {x, y} or "R" not in content.other or self.plane != "XYZ":
            raise block.refuse("G68 needs X, Y and R, in G17")
        angle = self._value(block, content.other["R"], 1.0)
        turned = shifted(centre[x], centre[y]).then(rotated(angle)).then(shifted(-centre[x], -centre[y]))
        self._turn_to(turned)

    def _turn_to(self, rotation: Placement) -> None:
        if rotation != self.rotation:
            self.rotation = rotation
            self.recorder.set_frame(self._frame(), cartesian(self.machine))

    def _offsets(self) -> tuple[str | None, int | None]:
        """Work offset and length offset in force, None where the program has said nothing of it yet."""
        return self.work_offset if self.offset_said else None, (self.length_offset or 0) if self.length_said else None

    def _select_work_offset(self, block: Block, content: _Content, code: float) -> None:
        if self.rotation != Placement() or any(self.local):
            raise block.refuse("a work offset while G52 or G68 is on: what becomes of these depends on the control")
        extended = "P" in content.other and code in (54.0, 54.1)
        if code == 54.1 and not extended:
            raise block.refuse("G54.1 without P")
        if extended and not ONE_SHOT.isdisjoint(content.g):
            raise block.refuse("P in one block with two codes that may take it")
        if extended:
            self.work_offset = f"G54.1P{self._whole_number(block, content.other['P'])}"
        else:
            self.work_offset = WORK_OFFSETS[code]

    def _select_length_offset(self, block: Block, content: _Content, code: float) -> None:
        if code == 49.0:
            self.length_offset, self.tcp = None, self.machine.control.tcp_at_start
            return
        if "H" in content.other:
            self.length_offset = self._whole_number(block, content.other["H"])
        elif self.length_offset is None:
            self.length_offset = self.spindle_tool or 0
            self.notes.add("G43 without H: taken for the length of the tool in the spindle", block.line)
        elif self.spindle_tool not in (None, self.length_offset):
            raise block.refuse(
                f"G43 without H while tool {self.spindle_tool} is in the spindle and H{self.length_offset} in force: "
                "some controls take the one, some the other"
            )
        self.tcp = code == 43.4 or self.machine.control.tcp_at_start
        if code == 43.4:
            self.notes.add(
                "G43.4: X Y Z taken as the tool point in the workpiece frame that turns with a table", block.line
            )

    def _change_frame(self, offsets: tuple[str | None, int | None], tcp: bool) -> None:
        """Tell the recorder of the new frame, and which axes are another place in it than in the one given."""
        x_y_z, (work_offset, length) = cartesian(self.machine), self._offsets()
        changed: set[int] = set()
        if work_offset != offsets[0]:
            changed.update(range(len(self.machine.axes)))
        if self.tcp != tcp or (tcp and length != offsets[1]):
            changed.update(x_y_z)
        elif length != offsets[1]:
            changed.add(x_y_z[2])
        self.recorder.set_frame(self._frame(), changed)

    def _frame(self) -> Frame:
        offset = [a + b for a, b in zip(self.setup.work_offset(self.work_offset), self.local, strict=True)]
        for axis, shift in zip(cartesian(self.machine), self.rotation.shift, strict=True):
            offset[axis] += shift
        length = 0.0
        if self.length_offset:
            length = self.setup.tool_length(self.length_offset)
            if not self.tcp:
                offset[cartesian(self.machine)[2]] += length
        elif self.spindle_tool:
            length = self.setup.tool_length(self.spindle_tool)
        return Frame(tuple(offset), length, self.tcp, self.rotation.frame_turn)

    def _value(self, block: Block, index: int, unit: float) -> float:
        """The number of a word in mm or degrees."""
        word = block.words[index]
        value = word.value or 0.0
        if not abs(value) < LARGEST:
            raise block.refuse(f"{word.address} with a number that no control reads")
        if value and word.formula is None and "." not in block.text[word.start : word.end]:
            if self.machine.control.integer_words == "increments":
                if unit == INCH:
                    raise block.refuse("an inch coordinate without decimal point: its increment is not known")
                return value * self.machine.control.increment
            self.notes.add(
                "coordinates without decimal point taken in mm, inches or degrees, not in increments", block.line
            )
        return value * unit

    def _whole_number(self, block: Block, index: int) -> int:
        word = block.words[index]
        value = word.value or 0.0
        if not (abs(value) < LARGEST and value == int(value)):
            raise block.refuse(f"{word.address} with a number that is not whole")
        return int(value)

    def _axis_words(self, block: Block, content: _Content) -> list[tuple[AxisWord, float]]:
        """Axis words with their values, mm or degrees, in the order of the block."""
        result = []
        for i in content.axes:
            axis = self.recorder.axis(block, block.words[i].address)
            unit = 1.0 if self.machine.axes[axis].rotary else self.unit
            result.append((AxisWord(axis, i, not self.absolute), self._value(block, i, unit)))
        return result

    def _reference_return(self, block: Block, content: _Content) -> None:
        axes = [word.axis for word, _ in self._axis_words(block, content)]
        if self.absolute and axes:
            self.notes.add("G28/G30 passes its intermediate point uncorrected", block.line)
        self.recorder.forget(axes or list(range(len(self.machine.axes))))

    def _machine_move(self, index: int, block: Block, content: _Content) -> None:
        if not self.absolute or self.motion not in (0.0, 1.0):
            raise block.refuse("G53 needs G90 and G0 or G1")
        words = self._axis_words(block, content)
        if words:
            targets = {word.axis: value for word, value in words}
            self.recorder.move_to_machine_position(index, targets, tuple(word for word, _ in words))

    def _begin_cycle(self, code: float) -> None:
        z = cartesian(self.machine)[2]
        begun = self.cycle
        # the level before the first of several cycles is that of all
        level = self.recorder.position[z] if begun is None else begun.level
        known = self.recorder.known[z] if begun is None else begun.known
        self.cycle = CannedCycle(not self.absolute, level, known, begun=begun is not None and begun.begun)
        self.motion = code

    def _drill(self, index: int, block: Block, content: _Content) -> None:
        assert self.cycle is not None
        rotary = any(self.machine.axes[self.recorder.axis(block, block.words[i].address)].rotary for i in content.axes)
        check_cycle_words(block, set(content.other), rotary, self.plane, self.tcp)
        if self.cycle.incremental == self.absolute:
            raise block.refuse("G90 or G91 within a canned cycle: controls differ in how its depth is read then")
        words = self._axis_words(block, content)
        retract = self._value(block, content.other["R"], self.unit) if "R" in content.other else None
        target, level, places, cycle = self.cycle.hole(block, self.recorder, words, retract, self.to_retract)
        if self.unsaid:
            self._note_unsaid(block, Kind.CYCLE)
        self.recorder.drill(index, target, level, self.unit, places, cycle)

    def _move(self, index: int, block: Block, content: _Content, settled: bool) -> None:
        if self.motion is None:
            raise block.refuse("coordinates before any G0, G1, G2 or G3")
        if self.cycle is not None:
            self._drill(index, block, content)
            return
        self._check_move_words(block, content)
        words = self._axis_words(block, content)
        target = self.recorder.target(block, words)
        kind = MOTION[self.motion]
        arc = self._arc(block, content, target) if kind is Kind.ARC else None
        if self.unsaid:
            self._note_unsaid(block, kind)
        named = tuple(word for word, _ in words)
        modes = {"incremental": not self.absolute, "timed": self.timed, "settled": settled}
        self.recorder.move(index, kind, target, self.unit, named, arc, **modes)

    def _check_move_words(self, block: Block, content: _Content) -> None:
        other = content.other.keys()
        strange = sorted(other - MOVE_WORDS)
        if strange:
            raise block.refuse(f"{strange[0]} in a move: what it does depends on the control")
        if self.motion in (0.0, 1.0) and not other.isdisjoint("IJKR"):
            raise block.refuse(f"{', '.join(sorted(other & set('IJKR')))} without an arc")

    def _note_unsaid(self, block: Block, kind: Kind) -> None:
        for what in ("unit", "distance", "plane") if kind is Kind.ARC else ("unit", "distance"):
            if what in self.unsaid:
                self.notes.add(self.unsaid.pop(what), block.line)
                self.taken.add(what)

    def _arc(self, block: Block, content: _Content, target: list[float]) -> Arc:
        first, second, normal = (self.machine.index(letter) for letter in self.plane)
        sense = 1 if self.motion == 3.0 else -1
        position = self.recorder.position
        if not (self.recorder.known[first] and self.recorder.known[second]):
            raise block.refuse("an arc from a position that the program has not said")
        if "P" in content.other and block.words[content.other["P"]].value != 1.0:
            raise block.refuse("an arc of several turns is not corrected")
        start, end = (position[first], position[second]), (target[first], target[second])
        plane = (first, second, normal)
        if "R" in content.other:
            if not content.other.keys().isdisjoint(CENTRES):
                raise block.refuse("an arc by its radius and its centre at once")
            i = content.other["R"]
            centre = centre_from_radius(start, end, self._value(block, i, self.unit), sense)
            if centre is None:
                raise block.refuse("no circle of this radius joins start and end")
            return Arc(plane, sense, centre, False, "radius-absolute" if self.arc_absolute else "radius", (i, None))
        letters = [CENTRE_WORD[letter] for letter in self.plane[:2]]
        indices = [content.other.get(letter) for letter in letters]
        self._check_centre_words(block, content, letters, indices)
        values = [None if i is None else self._value(block, i, self.unit) for i in indices]
        base = (0.0, 0.0) if self.arc_absolute else start
        centre = (base[0] + (values[0] or 0.0), base[1] + (values[1] or 0.0))
        fault = radius_fault(start, end, centre)
        if fault is not None:
            raise block.refuse(fault + self._arc_hint(start, end, values))
        form = "absolute" if self.arc_absolute else "incremental"
        return Arc(plane, sense, centre, same(start, end), form, (indices[0], indices[1]))

    def _check_centre_words(
        self, block: Block, content: _Content, letters: list[str], indices: list[int | None]
    ) -> None:
        stray = [a for a in CENTRES if a not in letters and a in content.other and block.words[content.other[a]].value]
        if stray:
            raise block.refuse(f"{stray[0]} gives no centre in the plane of {' and '.join(self.plane[:2])}")
        if indices == [None, None]:
            raise block.refuse(f"an arc without {' or '.join(letters)} or R")
        if self.arc_absolute and None in indices:
            raise block.refuse(f"an absolute centre (G90.1) takes both {' and '.join(letters)}")

    def _arc_hint(self, start: tuple[float, float], end: tuple[float, float], values: list[float | None]) -> str:
        absolute = (values[0] or 0.0, values[1] or 0.0)
        if self.arc_absolute or radius_fault(start, end, absolute) is not None:
            return ""
        return '; its centre would fit as absolute: for such a control set arc_centres = "absolute" in the machine file'
