"""Motions: the commanded moves of a program as columns, one row per move."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property, wraps
from typing import Any

import numpy as np

from kinematics.machine import Machine, NDArrayBool
from kinematics.transforms import AnyArray, Array, read_only
from postproc.motion import axis_words
from postproc.motion.axis_words import AxisWords
from postproc.motion.circle_columns import CircleColumns
from postproc.motion.circles import SAME_POINT_MM
from postproc.motion.frames import Frame, cartesian, to_machine, to_program
from postproc.motion.moves import Arc, Cycle, Kind, Known, Paced, Polar, PolarEnd, Spline
from postproc.motion.rotary_words import RotaryWord
from postproc.text import blocks as text_blocks
from postproc.text.blocks import Blocks
from postproc.text.number_style import decimals_for
from rendering.shown import Shown


def column(compute: Callable[[Motions], AnyArray]) -> cached_property[AnyArray]:
    """A column derived from Motions: computed once, read-only."""
    return cached_property(wraps(compute)(lambda motions: read_only(compute(motions))))


@dataclass(frozen=True, repr=False)
class Motions(Shown):
    """One row per move, in program order; positions `(n, axes)` in programmed coordinates, mm and degrees.

    Its columns are read-only, because several Motions share them.
    """

    machine: Machine
    blocks: Blocks
    frames: Sequence[Frame]
    block: np.ndarray
    """Index of the block `(n,)`."""
    kind: np.ndarray
    """Kind `(n,)`."""
    frame: np.ndarray
    """Index of the frame `(n,)`."""
    unit: Array
    """mm per unit of the words `(n,)`: 1, or 25.4 in an inch block."""
    incremental: np.ndarray
    """True `(n,)` where the control reads a word added to the block as an increment (G91)."""
    timed: np.ndarray
    """True `(n,)` where F is the inverse time of the move (G93) and not a speed."""
    frame_unchanged: np.ndarray
    """True `(n,)` where the block does not change the frame before its move."""
    added: np.ndarray
    """True `(n,)` for moves with an added block: backlash take-ups, and all segments of a move except the first."""
    start_fraction: Array
    """Share `(n,)` of the programmed move at which a row begins; nan for a segment that begins at a reversal within an
    arc: the share then follows from the quadrants of the circle."""
    start: Array
    target: Array
    known_start: np.ndarray
    """`Known` `(n, axes)` before the move."""
    known: np.ndarray
    """`Known` `(n, axes)` after the move."""
    words: AxisWords
    arcs: Mapping[int, Arc]
    """Arcs by row."""
    cycles: Mapping[int, Cycle] = field(default_factory=dict)
    """Holes of canned cycles by row."""
    polars: Mapping[int, Polar] = field(default_factory=dict)
    """Positions in polar coordinates by row."""
    cutter_compensated: Mapping[int, tuple[int, int]] = field(default_factory=dict)
    """Columns of the plane, by row of a move that the control shifts by the tool radius."""
    splines: Mapping[int, Spline] = field(default_factory=dict)
    """Points of splines by row; such a row is a straight line to its point."""
    locked_axes: Mapping[int, tuple[int, ...]] = field(default_factory=dict)
    """Columns of axes for which no word may be added to the block, by row."""
    paced: Mapping[int, Paced] = field(default_factory=dict)
    """Feed moves of rotary axes alone that are corrected, by row."""
    rotary_words: Mapping[int, Mapping[int, RotaryWord]] = field(default_factory=dict)
    """By row and column of the axis, how the control reads rotary words; axes that are left out count whole turns."""
    polar_ends: Mapping[int, PolarEnd] = field(default_factory=dict)
    """Polar ends of Klartext blocks by index of the block."""

    @property
    def headline(self) -> str:
        """The result in a few words."""
        return f"{len(self)} moves of {self.machine.name}"

    @property
    def columns(self) -> dict[str, np.ndarray]:
        """Line, kind, and axis positions at the end, mm and degrees, of the moves by name `(n,)`."""
        kinds = np.array([kind.name.lower() for kind in Kind])[self.kind]
        axes = zip(self.machine.names, (self.machine_target / self.machine.scale).T, strict=True)
        return {"line": self.line, "kind": kinds, **dict(axes)}

    def __post_init__(self) -> None:
        for name in COLUMNS:
            read_only(getattr(self, name))

    def __reduce__(self) -> tuple[Any, ...]:
        return Motions, tuple(getattr(self, field.name) for field in fields(self))

    def __len__(self) -> int:
        return len(self.block)

    @column
    def left_elsewhere(self) -> NDArrayBool:
        """True `(n, axes)` where a cycle without a move of its own has left an axis elsewhere than the row before."""
        moved = np.zeros(self.start.shape, bool)
        same = (self.frame[1:] == self.frame[:-1]) & (self.kind[:-1] != Kind.CYCLE)
        moved[1:] = same[:, None] & (np.abs(self.start[1:] - self.target[:-1]) > SAME_POINT_MM)
        return np.asarray(moved & (self.known_start == Known.MACHINE))

    @column
    def evaluated(self) -> NDArrayBool:
        """Rows `(n,)` that end a programmed move with all linear axes programmed: the moves that are evaluated."""
        return np.asarray(self._said(self.known) & self.programmed & ~self.intermediate)

    @column
    def programmed(self) -> NDArrayBool:
        """Rows `(n,)` that move to programmed coordinates."""
        return np.asarray((self.kind != Kind.MACHINE) & (self.kind != Kind.PRESET))

    @column
    def correctable(self) -> NDArrayBool:
        """True `(n, axes)` where the program has given the position, so that a word may change it."""
        return np.asarray(self.known == Known.PROGRAM)

    @column
    def movable(self) -> NDArrayBool:
        """True `(n, axes)` for machine axes that a position given by the program moves."""
        movable: NDArrayBool = self.correctable & self.programmed[:, None]
        x_y_z = np.array(cartesian(self.machine))
        for i, frame in enumerate(self.frames):
            if frame.couples:
                cells = np.ix_(np.flatnonzero(self.frame == i), x_y_z)
                movable[cells] = movable[cells] @ frame.shares.T
        return movable

    @column
    def tcp(self) -> NDArrayBool:
        """Rows `(n,)` under TCP."""
        return np.asarray(np.array([frame.tcp for frame in self.frames], bool)[self.frame])

    @column
    def coupled(self) -> NDArrayBool:
        """Rows `(n,)` in which a programmed coordinate may move several axes of the machine."""
        return np.asarray(np.array([frame.tcp or frame.couples for frame in self.frames], bool)[self.frame])

    def frames_of(self, rows: np.ndarray) -> list[int]:
        """Numbers of the frames of rows, by a mask or by their numbers, in the order in which they first appear."""
        found = self.frame[rows]
        present: list[int] = np.flatnonzero(np.bincount(found)).tolist()
        return present if len(present) < 2 else list(dict.fromkeys(found.tolist()))

    @column
    def intermediate(self) -> NDArrayBool:
        """Rows `(n,)` that end inside a programmed move: backlash take-ups, and all segments except the last."""
        intermediate = np.asarray(self.kind == Kind.TAKE_UP)
        moves = np.flatnonzero(~intermediate)
        intermediate[moves[:-1]] = self.added[moves[1:]]
        return intermediate

    @column
    def rotary_only(self) -> NDArrayBool:
        """Feed moves `(n,)` of rotary axes alone: the tool keeps its programmed position.

        Their F is an angular speed. On controls where F is the speed of X Y Z as soon as one of them moves, a
        correction of some micrometres would make F the speed along these micrometres: the rotary axes would run at
        rapid. Those in `paced` do not count: their F is written anew.
        """
        way = np.abs(self.target - self.start)
        linear, rotary = list(self.machine.translators), self.machine.rotary
        still = (way[:, linear] < SAME_POINT_MM).all(axis=1) & (self.known == self.known_start)[:, linear].all(axis=1)
        turns = (way[:, rotary] > SAME_POINT_MM).any(axis=1)
        found = np.asarray((self.kind == Kind.LINE) & ~self.timed & still & turns)
        found[list(self.paced)] = False
        return found

    def take(self, rows: np.ndarray) -> Motions:
        """These rows, in this order; a row taken more than once shares its arc and words."""
        columns = {name: getattr(self, name)[rows] for name in COLUMNS}
        taken = rows.tolist()
        by_row: dict[str, Any] = {
            name: {i: there[row] for i, row in enumerate(taken) if row in there}
            for name in BY_ROW
            if (there := getattr(self, name))
        }
        words = self.words.take(rows) if len(self.words) else self.words
        return replace(self, words=words, **columns, **by_row)

    def copies(self, *names: str) -> tuple[Any, ...]:
        """Writable copies of columns, for new Motions."""
        return tuple(getattr(self, name).copy() for name in names)

    @column
    def evaluated_paths(self) -> NDArrayBool:
        """Feed moves `(n,)`, also segments, whose start and end the program has given."""
        evaluated = self._said(self.known_start) & self._said(self.known)
        return np.asarray(evaluated & ((self.kind == Kind.LINE) | (self.kind == Kind.ARC)))

    @column
    def known_paths(self) -> NDArrayBool:
        """Feed moves `(n,)`, also segments, from a known position to a position that the program has given."""
        known = (self.known_start[:, self.machine.translators] != Known.ASSUMED).all(axis=1)
        return np.asarray(known & self._said(self.known) & ((self.kind == Kind.LINE) | (self.kind == Kind.ARC)))

    @column
    def uncorrected(self) -> NDArrayBool:
        """Cells `(n, axes)` of feed moves and holes that are not corrected.

        The program has not named the axis since a new frame, a move in machine coordinates or an M function that ncomp
        does not know.
        """
        uncorrected = self.known == Known.MACHINE
        uncorrected[:, self.machine.rotary] = False
        uncorrected[~self.programmed | self.intermediate | (self.kind == Kind.RAPID)] = False
        return np.asarray(uncorrected)

    @column
    def uncorrected_moves(self) -> NDArrayBool:
        """Rows `(n,)` of feed moves and holes with axes that are not corrected, to positions that are known."""
        known = (self.known[:, self.machine.translators] != Known.ASSUMED).all(axis=1)
        return np.asarray(known & self.uncorrected.any(axis=1))

    @column
    def uncorrected_paths(self) -> NDArrayBool:
        """Those of `uncorrected_moves` that are feed moves from known positions."""
        known = (self.known_start[:, self.machine.translators] != Known.ASSUMED).all(axis=1)
        return np.asarray(known & self.uncorrected_moves & (self.kind != Kind.CYCLE))

    def _said(self, known: np.ndarray) -> NDArrayBool:
        return np.asarray((known[:, self.machine.translators] == Known.PROGRAM).all(axis=1))

    @column
    def machine_target(self) -> Array:
        """Nominal axis positions at the ends of the moves `(n, axes)`, mm and rad."""
        return self.in_machine(self.target)

    @column
    def tool(self) -> Array:
        """Tool tips seen from the tool reference point `(n, 3)`, mm."""
        tools = np.array([frame.tool for frame in self.frames], float)
        return np.broadcast_to(tools, (len(self), 3)) if len(tools) == 1 else np.asarray(tools[self.frame])

    def along(self, share: float) -> Array:
        """Programmed positions `(n, axes)` at a share of the path of each move, for arcs along the circle.

        If the two radii of an arc differ within the tolerance of controls, the radius changes linearly between them.
        """
        if share == 1.0:
            return self.target.copy()
        program = np.asarray(self.start + share * (self.target - self.start))
        if self.arcs:
            self.circles.put(program, share)
        return program

    @cached_property
    def circles(self) -> CircleColumns:
        """The circles of all arcs."""
        return CircleColumns.of(self.arcs, self.start, self.target)

    @column
    def path_lengths(self) -> Array:
        """Lengths of the programmed paths `(n,)`, mm and degrees: only those of the segments of one move compare."""
        lengths = np.linalg.norm(self.target - self.start, axis=1)
        if self.arcs:
            lengths[self.circles.rows] = self.circles.lengths
        return np.asarray(lengths)

    @property
    def line(self) -> np.ndarray:
        """Number of the first line of the block of each move `(n,)`."""
        return np.asarray(self.blocks.line_numbers[self.block])

    @property
    def with_used_frames(self) -> Motions:
        """The moves with the frames that they use, each once."""
        used, which = np.unique(self.frame, return_inverse=True)
        frames = {frame: i for i, frame in enumerate(dict.fromkeys(self.frames[i] for i in used.tolist()))}
        index = np.array([frames[self.frames[i]] for i in used.tolist()], int)
        return replace(self, frames=list(frames), frame=index[which])

    @property
    def bare(self) -> Motions:
        """The columns alone, without words, arcs and other entries by row."""
        nothing: dict[str, Any] = {name: {} for name in BY_ROW}
        return replace(self, words=AxisWords(), polar_ends={}, **nothing)

    def in_machine(self, program: Array) -> Array:
        """Axis positions `(n, axes)`, mm and rad, of programmed positions given for all rows."""
        if len(self.frames) == 1 and len(self):
            return to_machine(self.machine, self.frames[0], program)
        q = np.empty_like(program)
        for i, frame in enumerate(self.frames):
            rows = self.frame == i
            if rows.any():
                q[rows] = to_machine(self.machine, frame, program[rows])
        return q

    def as_written(self, q: Array, axis: int) -> Array:
        """Positions `(n,)`, rad, that a rotary axis takes for `(n,)` ones by words of its resolution."""
        offset = np.array([frame.offset[axis] for frame in self.frames])[self.frame]
        scale, decimals = self.machine.scale[axis], decimals_for(self.machine.axes[axis].resolution)
        return np.asarray((np.round(q / scale - offset, decimals) + offset) * scale)

    def in_program(self, q: Array) -> Array:
        """Programmed positions `(n, axes)`, mm and degrees, of axis positions given for all rows."""
        if len(self.frames) == 1 and len(self):
            return to_program(self.machine, self.frames[0], q)
        program = np.empty_like(q)
        for i, frame in enumerate(self.frames):
            rows = self.frame == i
            if rows.any():
                program[rows] = to_program(self.machine, frame, q[rows])
        return program


COLUMNS = (
    *("block", "kind", "frame", "unit", "incremental", "timed", "frame_unchanged", "added", "start_fraction"),
    *("start", "target", "known_start", "known"),
)
"""Fields of Motions with one row per move."""
BY_ROW = ("arcs", "cycles", "polars", "cutter_compensated", "splines", "locked_axes", "paced", "rotary_words")
"""Fields of Motions with entries for some rows."""


def merged(parts: Sequence[Motions]) -> Motions:
    """The chunks of a program as one, with the blocks that they hold."""
    counts = [(len(part), len(part.blocks)) for part in parts]
    firsts = np.cumsum([(0, 0), *counts[:-1]], axis=0).tolist()
    frames: dict[Frame, int] = {}
    columns: dict[str, Any] = {name: np.concatenate([getattr(part, name) for part in parts]) for name in COLUMNS}
    by_row: dict[str, Any] = {name: {} for name in (*BY_ROW, "polar_ends")}
    for part, (row, block) in zip(parts, firsts, strict=True):
        numbers = np.array([frames.setdefault(frame, len(frames)) for frame in part.frames], int)
        columns["frame"][row : row + len(part)] = numbers[part.frame]
        columns["block"][row : row + len(part)] += block
        for name in BY_ROW:
            by_row[name].update({row + i: value for i, value in getattr(part, name).items()})
        by_row["polar_ends"].update({block + i: end for i, end in part.polar_ends.items()})
        for i, arc in part.arcs.items():
            if arc.pole_block >= 0:
                by_row["arcs"][row + i] = arc._replace(pole_block=block + arc.pole_block)
    return Motions(
        parts[0].machine,
        text_blocks.joined([part.blocks for part in parts]),
        list(frames),
        words=axis_words.joined([part.words for part in parts]),
        **columns,
        **by_row,
    )
