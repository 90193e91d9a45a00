"""The base of the interpreters of all dialects: it reads blocks one by one, and plain lines together."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Mapping
from typing import ClassVar

import numpy as np
from msgspec.structs import replace

from kinematics.machine import NDArrayBool
from postproc.control.channel import Channel
from postproc.control.modal_state import ModalState
from postproc.control.plain_arcs import arc_motion, plain_arcs
from postproc.control.state import ControlState
from postproc.motion.motions import Motions
from postproc.motion.moves import Arc, Kind
from postproc.motion.plain_moves import PlainMoves
from postproc.motion.recorder import Recorder
from postproc.text.block import Block, Refusal
from postproc.text.blocks import Blocks, PlainRun
from postproc.text.flow import Variables
from postproc.text.notes import Notes
from postproc.text.plain_columns import PlainVectors


class Interpreter(ABC):
    """Reads blocks in order, in the modal state that the blocks before have left; a dialect adds their meaning."""

    channel: Channel
    modal: ModalState
    nearest: ClassVar[str] = ""
    """The note on tool vectors."""
    along_normals: ClassVar[str] = ""
    """The note on surface normals."""

    def __init__(self, channel: Channel) -> None:
        self.channel, self.modal, self.machine = channel, channel.modal, channel.machine
        self.notes: Notes = channel.notes
        self.scope: Variables = channel.scope
        self.recorder: Recorder = channel.recorder
        self.control_state: ControlState = channel.control_state
        start = channel.setup.start
        if start:
            place = " ".join(f"{name}{position:.10g}" for name, position in start.items())
            self.notes.add(f"the tool is taken to stand at {place} when the program starts, uncorrected (start)", 1)
        self.recorder.start_at({self.machine.index(name): position for name, position in start.items()})

    @property
    def ended(self) -> bool:
        """True if the program has ended."""
        return self.modal.ended

    # ---- blocks

    def read(self, blocks: Iterable[Block | PlainRun]) -> Motions:
        """The moves of a chunk of blocks, each read before the next is taken.

        The next block may depend on the position of the tool. Refusal at the first block that is not fully understood.
        """
        done: list[Block | PlainRun] = []
        self._read_all(blocks, done)
        return self.recorder.finish(done)

    def read_to_refusal(self, blocks: Iterable[Block | PlainRun]) -> tuple[Motions, Refusal | None]:
        """The moves of the blocks before the first one that is not fully understood, and the refusal of that block."""
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
        self.channel.begin_block()
        read = self._read_block(index, block)
        self.control_state.use(block, self.recorder.used)
        return read._replace(no_insertion=True) if self.channel.no_insertion else read

    def _read_run(self, index: int, run: PlainRun) -> Iterator[Block | PlainRun]:
        """Take over plain lines: as columns from the first line before which the state is plain."""
        line = 0
        run = replace(run, incremental=not self.modal.absolute)
        ends = np.append(np.flatnonzero(self.recorder.rotary.in_turn(run)), len(run))
        while line < len(run):
            end = int(ends[np.searchsorted(ends, line)])
            part = run.part(line, end)
            take = self._take_lines if self.modal.plain else self._take_holes
            taken = take(index + line, part) if len(part) else None
            yield self._read_single(index + line, run.block(line)) if taken is None else taken
            line += 1 if taken is None else len(taken)

    def _take_lines(self, index: int, run: PlainRun) -> PlainRun | None:
        """Take over the first lines of a run in the present state, which is plain; returns them, None for none.

        They end before a line that has no motion, or words that contradict it, among increments before an arc and
        before an axis whose position the program has not given, and before a line with a vector, or without one again.
        """
        run, vectors = _alike(run)
        before = self.modal.motion
        motion = np.append(-1 if before is None else int(before), run.columns.motion)
        motion = motion[np.maximum.accumulate(np.where(motion >= 0, np.arange(len(motion)), 0))][1:]
        curved, contradicted = arc_motion(run, motion)
        arcs: dict[int, Arc] = {}
        moves = self.recorder.plain_moves(run, self.modal.unit)
        singly = contradicted | (motion < 0)
        if run.incremental:
            singly |= curved | ~self.recorder.adds_up(run)
        if vectors is not None:
            singly |= curved | run.incremental | self._read_singly(run, vectors)
        taken = _before(singly)
        if curved[:taken].any():
            modes = self.modal.arc_modes
            if modes is None or not self.recorder.frame.keeps_circles(modes.plane[:2]):
                taken = _before(curved)
            else:
                curved[taken:] = False
                arcs, whole = plain_arcs(run, moves, motion, curved, modes)
                taken = min(taken, whole)
        if taken and vectors is not None and np.isfinite(vectors.tool[0, 0]):
            moves = self.channel.turned_along(moves.first(taken), vectors.tool[:taken])
            taken = len(moves.target)
        if not taken:
            return None
        part = run.part(0, taken)
        if vectors is not None:
            self._note_vectors(part, vectors)
        self._take_run(index, part, moves.first(taken), motion[:taken], arcs)
        return part

    def _take_holes(self, _index: int, _run: PlainRun) -> PlainRun | None:
        """Take over the first lines of a run as holes of the cycle in force; returns them, None for none."""
        return None

    def _read_singly(self, run: PlainRun, vectors: PlainVectors) -> NDArrayBool:
        """True `(lines,)` for lines with vectors that are read one by one in the present state."""
        rotary = np.any(run.columns.end[self.channel.rotary_axes] > 0, axis=0)
        return np.asarray(np.isfinite(vectors.tool[:, 0]) & (rotary | (not self.channel.turns_in_columns)))

    def _note_vectors(self, run: PlainRun, vectors: PlainVectors) -> None:
        """Note what is taken for granted of the vectors of lines, which are all alike."""
        if np.isfinite(vectors.tool[0, 0]):
            self.notes.add(self.nearest, run.number, len(run))
        if vectors.normal[0]:
            self.notes.add(self.along_normals, run.number, len(run))

    def _take_run(
        self, index: int, run: PlainRun, moves: PlainMoves, motion: np.ndarray, arcs: Mapping[int, Arc]
    ) -> None:
        """Take over lines, as `_read_block` does one by one; motion `(lines,)`: in force, arcs: by line."""
        modal, kinds = self.modal, np.minimum(motion, int(Kind.ARC))
        modal.motion = float(motion[-1])
        if not self.control_state.uses(self.recorder.frame):
            self.control_state.use(run.block(0), self.recorder.frame)
        self.recorder.append(index, run, moves, kinds, arcs, modal.unit, timed=modal.timed)

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


def _alike(run: PlainRun) -> tuple[PlainRun, PlainVectors | None]:
    """The first lines of a run that have the kinds of vectors of the first one, and these vectors; None for none."""
    vectors = run.vectors
    if vectors is None:
        return run, None
    pointing = np.isfinite(vectors.tool[:, 0])
    number = _before((pointing != pointing[0]) | (vectors.normal != vectors.normal[0]))
    if not (pointing[0] or vectors.normal[0]):
        return run.part(0, number), None
    part = replace(run.part(0, number), no_insertion=True)
    return part, PlainVectors(vectors.tool[:number], vectors.normal[:number])


def _before(found: NDArrayBool) -> int:
    """Number of lines before the first one that is found `(lines,)`."""
    return int(found.argmax()) if found.any() else len(found)
