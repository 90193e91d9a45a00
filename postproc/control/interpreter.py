"""The base of the interpreters of all dialects: modal state, axis words, moves, frames and functions of a control."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import ClassVar, TypeAlias

import numpy as np

from kinematics.inverse import inverse
from kinematics.machine import Machine, NDArrayBool
from postproc.control.codes import DISTANCES, HARMLESS_M, INCH, INVERSE_TIME, MOTION, PLANES, UNIT_NAMES
from postproc.control.plain_arcs import ArcModes, arc_motion, plain_arcs
from postproc.control.setup import Setup, construct
from postproc.control.state import ControlState
from postproc.control.words import value_of
from postproc.motion.frames import Frame, cartesian, in_workpiece, to_machine
from postproc.motion.motions import Motions
from postproc.motion.moves import Arc, AxisWord, Kind, Known
from postproc.motion.plain_moves import PlainMoves
from postproc.motion.recorder import Recorder
from postproc.text.block import Block, Refusal
from postproc.text.blocks import Blocks, PlainRun
from postproc.text.flow import Variables
from postproc.text.notes import Notes

AxisWords: TypeAlias = list[tuple[AxisWord, float]]
"""Axis words with their values, mm or degrees, in the order of the block."""


@dataclass
class Interpreter(ABC):
    """Reads blocks in order; modal state carries over from chunk to chunk.

    A dialect adds its own modal state, its frame and the meaning of a block. Positions are in programmed coordinates,
    mm and degrees.
    """

    machine: Machine
    setup: Setup
    notes: Notes
    scope: Variables = field(init=False)
    """The variables of the program."""
    recorder: Recorder = field(init=False)
    """The positions of the axes, and the recorded moves; the dialect makes it, in its first frame."""

    harmless_m: ClassVar[frozenset[float]] = HARMLESS_M
    """M functions that move nothing, or that the dialect follows."""
    refused_m: ClassVar[Mapping[float, str]] = {}
    """M functions that ncomp does not follow, with the reason."""
    units: ClassVar[Mapping[float, float]] = {}
    """G codes of units, with the unit in mm."""
    feed_modes: ClassVar[frozenset[float]] = frozenset()
    """G codes of the meaning of F."""

    def __post_init__(self) -> None:
        self.control_state = ControlState(self.setup)
        self.begun = self.ended = False
        self.motion: float | None = None
        """G code of the motion in force."""
        self.plane = "XYZ"
        """First, second and normal axis of the working plane."""
        self.unit = UNIT_NAMES[self.machine.control.unit or "mm"]
        """Unit of lengths, mm."""
        self.absolute, self.timed = True, False
        self.angle_axis = -1
        """Column of the axis whose words are angles of polar coordinates; -1 for none."""
        self.tcp = self.machine.control.tcp_at_start
        """Coordinates are those of the tool point in the workpiece frame."""
        self.compensated = False
        """The control shifts the path by the radius of the tool."""
        self.no_insertion = False
        """ncomp may insert no block beside the present one."""
        self.x_y_z = cartesian(self.machine)
        self.rotary: list[bool] = self.machine.rotary.tolist()
        self.rotary_axes = [axis for axis, rotary in enumerate(self.rotary) if rotary]
        self.columns = {name: axis for axis, name in enumerate(self.machine.names)}
        """Columns of the axes by the addresses of their words."""
        self._frame_before: Frame | None = None
        """The frame at the start of the present block."""

    # ---- blocks

    def read(self, blocks: Iterable[Block | PlainRun]) -> Motions:
        """The moves of a chunk of blocks, each read before the next is taken.

        The next block may depend on the position of the tool. Refusal at the first block that is not fully understood.
        """
        done: list[Block | PlainRun] = []
        self._read_all(blocks, done)
        return self.recorder.finish(done)

    def read_to_refusal(self, blocks: Iterable[Block | PlainRun]) -> tuple[Motions, Refusal | None]:
        """As `read`, for the blocks before the first one that is not fully understood, and its refusal."""
        done: list[Block | PlainRun] = []
        refused = None
        try:
            self._read_all(blocks, done)
        except Refusal as refusal:
            refused = refusal
            self.recorder.drop(len(Blocks(done)))
        return self.recorder.finish(done), refused

    def _read_all(self, blocks: Iterable[Block | PlainRun], done: list[Block | PlainRun]) -> None:
        """Read blocks; `done` becomes those that have been read."""
        index = 0
        for item in blocks:
            if isinstance(item, PlainRun):
                for part in self._read_run(index, item):
                    done.append(part)  # one by one: those before a refusal stay
                index += len(item)
            else:
                done.append(self._read_single(index, item))
                index += 1

    def _read_single(self, index: int, block: Block) -> Block:
        self.no_insertion, self._frame_before = False, self.recorder.frame
        read = self._read_block(index, block)
        self.control_state.use(block, self.recorder.used)
        return read._replace(no_insertion=True) if self.no_insertion else read

    def _read_run(self, index: int, run: PlainRun) -> Iterator[Block | PlainRun]:
        """Take over plain lines: as columns from the first line before which the state is plain."""
        line = 0
        while line < len(run):
            taken = self._take_lines(index + line, run.part(line, len(run))) if self.plain else 0
            yield run.part(line, line + taken) if taken else self._read_single(index + line, run.block(line))
            line += max(taken, 1)

    @property
    def plain(self) -> bool:
        """True while lines of axis words, with or without a motion code, are moves to absolute positions."""
        return False

    @property
    def arc_modes(self) -> ArcModes | None:
        """The modes of arcs in plain lines; None if the arcs are read one by one in this state."""
        return ArcModes(self.plane, self.unit, absolute=False)

    def _take_lines(self, index: int, run: PlainRun) -> int:
        """Take over the first lines of a run in the present state, which is plain; returns their number.

        It ends before a line that has no motion, or words that contradict it.
        """
        motion = np.append(-1 if self.motion is None else int(self.motion), run.columns.motion)
        motion = motion[np.maximum.accumulate(np.where(motion >= 0, np.arange(len(motion)), 0))][1:]
        curved, contradicted = arc_motion(run, motion)
        arcs: dict[int, Arc] = {}
        moves = self.recorder.plain_moves(run, self.unit)
        taken = _before(contradicted | (motion < 0))
        if curved[:taken].any():
            modes = self.arc_modes
            if modes is None or not self.recorder.frame.keeps_circles(modes.plane[:2]):
                taken = _before(curved)
            else:
                curved[taken:] = False
                arcs, whole = plain_arcs(run, moves, motion, curved, modes)
                taken = min(taken, whole)
        if taken:
            self._take_run(index, run.part(0, taken), moves.first(taken), motion[:taken], arcs)
        return taken

    def _take_run(
        self, index: int, run: PlainRun, moves: PlainMoves, motion: np.ndarray, arcs: Mapping[int, Arc]
    ) -> None:
        """Take over lines, as `_read_block` does one by one; motion `(lines,)`: in force, arcs: by line."""
        self.motion = float(motion[-1])
        if not self.control_state.uses(self.recorder.frame):
            self.control_state.use(run.block(0), self.recorder.frame)
        self.recorder.append(index, run, moves, np.minimum(motion, int(Kind.ARC)), arcs, self.unit, timed=self.timed)

    @abstractmethod
    def _read_block(self, index: int, block: Block) -> Block:
        """Take over a block, `index` within its chunk; returned with the words that a correction may change."""

    @property
    def moved(self) -> bool:
        """True if the last block moved the tool; Refusal if a modal call after it depends on the control."""
        return False

    def note_after_end(self, block: Block) -> None:
        """Note a block behind the end of the program."""
        self.notes.add("blocks after the end of the program do not run and stay as programmed", block.line)

    # ---- frames

    @abstractmethod
    def frame(self) -> Frame:
        """The frame of programmed coordinates in force."""

    def change_frame(self, axes: Iterable[int]) -> None:
        """Program in the present frame from here, in which coordinates of these axes mean something else."""
        self.recorder.set_frame(self.frame(), axes)

    def switch_tcp(self, on: bool) -> None:
        """Switch TCP on or off."""
        if on != self.tcp:
            self.tcp = on
            self.change_frame(self.x_y_z)

    def note_tcp(self, name: str, block: Block) -> None:
        """Note a function that switches TCP on."""
        text = f"{name}: X Y Z are taken as the tool point in the workpiece frame, which turns with a table"
        self.notes.add(text, block.line)

    # ---- modes and functions

    def take_mode(self, block: Block, code: float) -> bool:
        """Take over a modal G code that all dialects with G codes have; False for any other code."""
        if code in MOTION:
            self.motion = code
        elif code in PLANES:
            self.plane = PLANES[code]
        elif code in self.units:
            self.unit = self.units[code]
            if self.unit == INCH:
                self.control_state.meet_inches(block, self.notes)
        elif code in DISTANCES:
            self.absolute = code == 90.0
        elif code in self.feed_modes:
            self.timed = code == INVERSE_TIME
        elif code in (41.0, 42.0):
            self.compensate(block)
        elif code == 40.0:
            self.end_compensation()
        else:
            return False
        return True

    def compensate(self, block: Block) -> None:
        """Radius compensation: the points of the contour are corrected, and the control shifts the path with them."""
        if self.tcp:
            raise block.refuse(
                "tool radius compensation under TCP is not corrected: switch TCP off before it, or let the CAM system "
                "compensate the radius"
            )
        self.compensated = True
        self.notes.add("radius compensation: the points of the contour are corrected", block.line)

    def end_compensation(self) -> None:
        """Radius compensation ends: the tool is beside the contour until both axes of the plane are programmed."""
        if self.compensated:
            self.recorder.mark_uncertain(self.plane_columns[:2])
        self.compensated = False

    def take_function(self, block: Block, code: float) -> None:
        """Refuse an M function that is not followed; note one that is not known, for it may move any axis."""
        if code in self.refused_m:
            raise block.refuse(f"M{code:g} {self.refused_m[code]}")
        if code not in self.harmless_m:
            self.notes.add(f"M{code:g} is not known to ncomp and is taken to move nothing", block.line)
            self.recorder.mark_uncertain()

    def accept(self, block: Block, name: str, reason: str, *, moves: bool = False) -> None:
        """Pass an unknown construct that the user accepts unchanged; Refusal for any other, with the reason.

        moves: the block has coordinates, whose meaning beside the construct is not known.
        """
        key = construct(name)
        if key not in self.setup.pass_through:
            raise block.refuse(f"{reason}, or pass it by --pass-through {key} if it moves nothing and changes no mode")
        if moves:
            raise block.refuse(f"{name} passes without coordinates only: write these in a block of their own")
        self.notes.add(f"{name} passes unchanged (--pass-through) and is taken to move nothing", block.line)
        self.recorder.mark_uncertain()

    def take_unknown(self, block: Block, code: float, refused: Mapping[float, str], *, moves: bool) -> None:
        """Refuse a G code that is not followed; one that is not known may pass (`accept`)."""
        name = f"G{code:g}"
        if code in refused:
            raise block.refuse(f"{name} {refused[code]}")
        self.accept(block, name, f"{name} is not known to ncomp: take it out, or write its moves", moves=moves)

    def mark_unknown(self, names: Sequence[str]) -> list[str]:
        """Mark the positions of these axes as unknown; returns those of them that the machine has."""
        present = [name for name in names if name in self.columns]
        self.recorder.mark_unknown([self.columns[name] for name in present])
        return present

    def move_for_tool_change(self, block: Block) -> None:
        """A tool change takes the axes of the machine file to positions that the program does not give."""
        names = " ".join(self.mark_unknown(self.machine.control.tool_change_moves)) or "no axis"
        self.notes.add(f"a tool change is taken to move {names} (machine file: tool_change_moves)", block.line)

    # ---- words

    @property
    def plane_columns(self) -> tuple[int, int, int]:
        """Columns of the axes of the working plane."""
        first, second, normal = (self.machine.index(axis) for axis in self.plane)
        return first, second, normal

    @property
    def sense(self) -> int:
        """Sense of the arcs of the motion in force: +1 counter-clockwise seen from the end of the normal, else -1."""
        return 1 if self.motion == 3.0 else -1

    def axis_words(self, block: Block, indices: Iterable[int]) -> AxisWords:
        """The axis words of a block with their values.

        An increment has the mode IC, an I before its axis, or, without a mode, G91 in force.
        """
        result = []
        words, columns, rotary, angle = block.words, self.columns, self.rotary, self.angle_axis
        incremental, linear, number = not self.absolute, self.unit, self.number
        for i in indices:
            word = words[i]
            axis = columns.get(word.address)
            if axis is None:
                axis = self.recorder.axis(block, word.address[-1])
            unit = 1.0 if rotary[axis] or axis == angle else linear
            counts = word.mode == "IC" if word.mode else incremental or len(word.address) > 1
            result.append((AxisWord(axis, i, counts), number(block, i, unit)))
        return result

    def number(self, block: Block, index: int, unit: float) -> float:
        """The number of a word, in mm or degrees."""
        return value_of(block, block.words[index]) * unit

    # ---- moves

    def move(
        self,
        index: int,
        kind: Kind,
        target: list[float],
        words: AxisWords,
        arc: Arc | None = None,
        *,
        divisible: bool = True,
    ) -> None:
        """Record a move to `target`; `divisible` is false where the block has effects beside its move."""
        named = tuple([word for word, _ in words])
        frame = self.recorder.frame
        self.recorder.move(
            index,
            kind,
            target,
            self.unit,
            named,
            arc,
            incremental=not self.absolute,
            timed=self.timed,
            frame_unchanged=divisible and (self._frame_before is frame or self._frame_before == frame),
        )

    def move_to_machine_position(self, index: int, block: Block, words: AxisWords, length: float = 0.0) -> None:
        """Record a move to machine coordinates; length: added to Z, mm, where the control keeps the tool length."""
        if any(word.incremental for word, _ in words):
            raise block.refuse("an increment in machine coordinates has no meaning: write absolute coordinates")
        targets = {word.axis: value + (length if word.axis == self.x_y_z[2] else 0.0) for word, value in words}
        self.recorder.move_to_machine_position(index, targets, tuple(word for word, _ in words))

    def along_tool_axis(self, block: Block, target: Sequence[float], vector: Sequence[float]) -> dict[int, float]:
        """Programmed positions, degrees by column, of the rotary axes with the tool along a vector at a target.

        vector: from the tip towards the spindle, in the workpiece frame. The solution nearest to the present
        positions. Refusal where there is none.
        """
        machine, frame = self.machine, self.recorder.frame
        if not np.linalg.norm(vector):
            raise block.refuse("the tool axis has the length 0: write a vector with a direction")
        tip = in_workpiece(machine, frame, np.array([target]))
        start = to_machine(machine, frame, np.array([self.recorder.position]))[0]
        found = inverse(machine, tip, [vector], frame.tool, start=start)
        if not np.isfinite(found.q).all():
            raise block.refuse(
                "no position of the rotary axes gives this tool axis: check the vector and the travel in the machine "
                "file"
            )
        positions = found.q[0] / machine.scale - np.asarray(frame.offset)
        return {axis: float(positions[axis]) for axis in self.rotary_axes}

    def turn_along(self, block: Block, target: list[float], vector: Sequence[float]) -> None:
        """Turn the rotary axes of a target to a tool axis, as `along_tool_axis`; no word names their positions."""
        if not self.rotary_axes:
            raise block.refuse(f"a tool vector needs a rotary axis, and machine {self.machine.name} has none")
        for axis, angle in self.along_tool_axis(block, target, vector).items():
            target[axis] = angle
            self.recorder.known[axis] = Known.MACHINE


def _before(found: NDArrayBool) -> int:
    """Number of lines before the first one that is found `(lines,)`."""
    return int(found.argmax()) if found.any() else len(found)
