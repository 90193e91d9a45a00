"""A channel of a control: it runs one program, and what the words of a block do to its modes and axes."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import ClassVar, TypeAlias

import numpy as np

from kinematics.inverse import closed_form, inverse
from kinematics.machine import Machine
from kinematics.transforms import Array
from postproc.control.codes import ABSOLUTE, DISTANCES, HARMLESS_M, INCH, INVERSE_TIME, MOTION, PLANES
from postproc.control.modal_state import ModalState
from postproc.control.setup import Setup, construct
from postproc.control.state import ControlState
from postproc.control.words import value_of
from postproc.motion.circles import RADIUS_TOLERANCE_MM
from postproc.motion.frames import Frame, cartesian, drills_along, in_workpiece, to_machine
from postproc.motion.moves import Arc, AxisWord, Kind, Known
from postproc.motion.plain_moves import PlainMoves
from postproc.motion.recorder import Recorder
from postproc.text.block import Block
from postproc.text.flow import Variables
from postproc.text.notes import Notes

LEANS = (
    "is followed only where the program has positioned the rotary axes such that the tool stands along {axis} of the "
    "part: end TCP before it, or write its moves"
)
"""Reason why a drilling cycle under TCP is refused."""
AxisWords: TypeAlias = list[tuple[AxisWord, float]]
"""Axis words with their values, mm or degrees, in the order of the block."""


@dataclass
class Channel:
    """The modal state, the variables and the axes of one run of a program, and the operations that blocks share.

    Positions are in programmed coordinates, mm and degrees.
    """

    notes: Notes
    modal: ModalState
    scope: Variables
    """The variables of the program."""
    recorder: Recorder = field(init=False)
    """The positions of the axes, and the recorded moves."""
    short_radius_mm: float = RADIUS_TOLERANCE_MM
    """Length by which the radius of an arc may be too short for half a circle."""

    harmless_m: ClassVar[frozenset[float]] = HARMLESS_M
    """M functions that move nothing, or that the dialect follows."""
    refused_m: ClassVar[Mapping[float, str]] = {}
    """M functions that ncomp does not follow, with the reason."""
    units: ClassVar[Mapping[float, float]] = {}
    """G codes of units, with the unit in mm."""
    feed_modes: ClassVar[frozenset[float]] = frozenset()
    """G codes of the meaning of F."""
    with_own_variables: ClassVar[re.Pattern[str]] = re.compile(r"(?!)")
    """Names of constructs unknown to ncomp that set no variable of the program."""

    def __post_init__(self) -> None:
        self.control_state: ControlState = self.modal.control_state
        self.setup: Setup = self.control_state.setup
        self.machine: Machine = self.setup.machine
        self.recorder = Recorder(self.machine, self.modal.frame())
        self.x_y_z = cartesian(self.machine)
        self.rotary: list[bool] = self.machine.rotary.tolist()
        self.rotary_axes = [axis for axis, rotary in enumerate(self.rotary) if rotary]
        self.columns = {name: axis for axis, name in enumerate(self.machine.names)}
        """Columns of the axes by the addresses of their words."""
        self.begin_block()

    def begin_block(self) -> None:
        """Reset what belongs to one block only."""
        self.no_insertion = False
        """ncomp may insert no block next to the present one."""
        self.frame_before: Frame = self.recorder.frame
        """The frame at the start of the present block."""

    # ---- frames

    def change_frame(self, axes: Iterable[int]) -> None:
        """Program in the present frame from here, in which coordinates of these axes mean something else."""
        self.recorder.set_frame(self.modal.frame(), axes)

    def switch_tcp(self, on: bool) -> None:
        """Switch TCP on or off."""
        if on != self.modal.tcp:
            self.modal.tcp = on
            self.change_frame(self.x_y_z)

    def note_tcp(self, name: str, block: Block) -> None:
        """Note a function that switches TCP on."""
        text = f"{name}: X Y Z are taken as the tool point in the workpiece frame, which turns with a table"
        self.notes.add(text, block.line)

    def leans(self, axis: int) -> bool:
        """True under TCP, unless the rotary axes are known to hold the tool along a drilling axis of the part."""
        recorder = self.recorder
        if not recorder.frame.tcp:
            return False
        known = all(recorder.known[i] != Known.ASSUMED for i in self.rotary_axes)
        return not (known and drills_along(self.machine, recorder.frame, recorder.position, axis))

    # ---- modes and functions

    def take_mode(self, block: Block, code: float) -> bool:
        """Take over a modal G code that all dialects with G codes have; False for any other code."""
        modal = self.modal
        if code in MOTION:
            modal.motion = code
        elif code in PLANES:
            modal.plane = PLANES[code]
        elif code in self.units:
            modal.unit = self.units[code]
            if modal.unit == INCH:
                self.control_state.meet_inches(block, self.notes)
        elif code in DISTANCES:
            modal.absolute = code == ABSOLUTE
        elif code in self.feed_modes:
            modal.timed = code == INVERSE_TIME
        elif code in (41.0, 42.0):
            self.compensate(block)
        elif code == 40.0:
            self.end_compensation()
        else:
            return False
        return True

    def compensate(self, block: Block) -> None:
        """Radius compensation: the points of the contour are corrected, and the control shifts the path with them."""
        if self.modal.tcp:
            raise block.refuse(
                "tool radius compensation under TCP is not corrected: switch TCP off before it, or let the CAM system "
                "compensate the radius"
            )
        self.modal.compensated = True
        self.notes.add("radius compensation: the points of the contour are corrected", block.line)

    def end_compensation(self) -> None:
        """Radius compensation ends: the tool is off the contour until both axes of the plane are programmed."""
        if self.modal.compensated:
            self.recorder.mark_uncertain(self.modal.plane_columns[:2])
        self.modal.compensated = False

    def take_function(self, block: Block, code: float) -> None:
        """Refuse an M function that is not followed; note one that is not known, for it may move any axis."""
        if code in self.refused_m:
            raise block.refuse(f"M{code:g} {self.refused_m[code]}")
        if code not in self.harmless_m:
            text = f"M{code:g} is not known to ncomp and is taken to move nothing and to set no variable"
            self.notes.add(text, block.line)
            self.recorder.mark_uncertain()

    def accept(self, block: Block, name: str, reason: str, *, moves: bool = False) -> None:
        """Pass an unknown construct that the user accepts unchanged; Refusal for any other, with the reason.

        moves: the block has coordinates, whose meaning together with the construct is not known.
        """
        key = construct(name)
        if key not in self.setup.pass_through:
            raise block.refuse(f"{reason}, or pass it by --pass-through {key} if it moves nothing and changes no mode")
        if moves:
            raise block.refuse(f"{name} passes without coordinates only: write these in a block of their own")
        self.notes.add(f"{name} passes unchanged (--pass-through) and is taken to move nothing", block.line)
        self.recorder.mark_uncertain()
        if not self.with_own_variables.fullmatch(name):
            self.scope.forget(f"{name} passes unchanged and may set it")

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

    def probe(self, block: Block, name: str, axes: Sequence[int] | None = None) -> None:
        """A probing move of these axes, or a cycle, which moves all and sets variables.

        The user states that the contour is independent of what it finds.
        """
        self.recorder.mark_unknown(list(range(len(self.machine.axes))) if axes is None else list(axes))
        self.notes.add(
            f"{name} probes: what it finds is taken to change no coordinate of the contour (probing = beside), offsets "
            "that it sets are taken from the set-up, and the positions after it are unknown",
            block.line,
        )
        if axes is None:
            self.scope.forget(f"{name} probes and may set it")

    def move_for_tool_change(self, block: Block) -> None:
        """A tool change takes the axes of the machine file to positions that the program does not give."""
        names = " ".join(self.mark_unknown(self.machine.control.tool_change_moves)) or "no axis"
        self.notes.add(f"a tool change is taken to move {names} (machine file: tool_change_moves)", block.line)

    # ---- words

    def axis_words(self, block: Block, indices: Iterable[int]) -> AxisWords:
        """The axis words of a block with their values.

        An increment has the mode IC, an I before its axis, or, without a mode, G91 in force.
        """
        result = []
        words, columns, rotary, number = block.words, self.columns, self.rotary, self.number
        angle, incremental, linear = self.modal.angle_axis, not self.modal.absolute, self.modal.unit
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
        """Record a move to `target`; `divisible` is false where the block has other effects than its move."""
        named = tuple([word for word, _ in words])
        frame = self.recorder.frame
        self.recorder.move(
            index,
            kind,
            target,
            self.modal.unit,
            named,
            arc,
            incremental=not self.modal.absolute,
            timed=self.modal.timed,
            frame_unchanged=divisible and (self.frame_before is frame or self.frame_before == frame),
        )

    def move_to_machine_position(self, index: int, block: Block, words: AxisWords, length: float = 0.0) -> None:
        """Record a move to machine coordinates; length: added to Z, mm, where the control keeps the tool length."""
        if any(word.incremental for word, _ in words):
            raise block.refuse("an increment in machine coordinates has no meaning: write absolute coordinates")
        targets = {word.axis: value + (length if word.axis == self.x_y_z[2] else 0.0) for word, value in words}
        self.recorder.rotary.check_machine_positions(block, targets, self.recorder.frame.offset)
        modes = {word.axis: block.words[word.word].mode for word, _ in words}
        self.recorder.move_to_machine_position(index, targets, tuple(word for word, _ in words), modes)

    def along_tool_axis(self, block: Block, target: Sequence[float], vector: Sequence[float]) -> dict[int, float]:
        """Programmed positions, degrees by column, of the rotary axes with the tool along a vector at a target.

        vector: from the tip towards the spindle, in the workpiece frame. The solution nearest to the present
        positions; an axis that is free keeps its position. Refusal where there is none.
        """
        if not np.linalg.norm(vector):
            raise block.refuse("the tool axis has the length 0: write a vector with a direction")
        found = self.along_tool_axes(np.array([target]), np.array([vector]))
        if not len(found):
            raise block.refuse(
                "no position of the rotary axes gives this tool axis: check the vector and the travel in the machine "
                "file"
            )
        return {axis: float(found[0, axis]) for axis in self.rotary_axes}

    def along_tool_axes(self, targets: Array, vectors: Array) -> Array:
        """Programmed positions `(k, axes)`, degrees, of the rotary axes at targets, one after the other.

        targets `(n, axes)`, vectors `(n, 3)`: as of `along_tool_axis`; k: number before the first one without a
        solution. The positions of the other axes mean nothing.
        """
        machine, frame = self.machine, self.recorder.frame
        tips = in_workpiece(machine, frame, targets)
        start = to_machine(machine, frame, np.array([self.recorder.position]))[0]
        found = inverse(machine, tips, vectors, frame.tool, start=start)
        solved = np.asarray(np.isfinite(found.q).all(axis=1))
        number = len(solved) if solved.all() else int(solved.argmin())
        positions = np.asarray(found.q[:number] / machine.scale - np.asarray(frame.offset))
        if found.singular[:number].any():
            first = self.rotary_axes[0]
            last = np.maximum.accumulate(np.where(found.singular[:number], -1, np.arange(number)))
            positions[:, first] = np.append(positions[:, first], self.recorder.position[first])[last]
        return positions

    def turn_along(self, block: Block, target: list[float], vector: Sequence[float]) -> None:
        """Turn the rotary axes of a target to a tool axis, as `along_tool_axis`; no word names their positions."""
        if not self.rotary_axes:
            raise block.refuse(f"a tool vector needs a rotary axis, and machine {self.machine.name} has none")
        for axis, angle in self.along_tool_axis(block, target, vector).items():
            target[axis] = angle
            self.recorder.known[axis] = Known.MACHINE

    @property
    def turns_in_columns(self) -> bool:
        """True where tool vectors of many lines give the same positions together as one by one."""
        frame, linear = self.recorder.frame, np.flatnonzero(~self.machine.rotary)
        closed = closed_form(self.machine) and {*linear.tolist()} == {*self.machine.translators}
        return closed and bool(self.rotary_axes) and frame.tcp and frame.turn is None

    def turned_along(self, moves: PlainMoves, vectors: Array) -> PlainMoves:
        """The first of the moves of plain lines, each with its tool vector, up to one without a solution."""
        angles = self.along_tool_axes(moves.target, vectors)
        first = moves.first(len(angles))
        start, target, known_start, known = (column.copy() for column in first)
        for axis in self.rotary_axes:
            target[:, axis] = angles[:, axis]
            start[:, axis] = np.append(self.recorder.position[axis], target[:-1, axis])[: len(angles)]
            known_start[:, axis] = known[:, axis] = Known.MACHINE
        return PlainMoves(start, target, known_start, known)
