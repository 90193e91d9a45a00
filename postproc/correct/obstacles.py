"""Obstacles to changes of a program: the reasons why a move must stay in its block, or as it is.

TABLE has all of them: the reason as the user reads it, the changes that it prevents, and its condition. Of several
obstacles the first one is given as the reason.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from enum import Flag, auto
from typing import Any, NamedTuple

import msgspec
import numpy as np

from kinematics.machine import TURN_DEG, NDArrayBool
from postproc.correct.rotary.feed_in_force import PER_MINUTE, Feed
from postproc.motion.motions import Motions
from postproc.motion.moves import Known
from postproc.motion.rotary_words import SAME_ROTARY_DEG, RotaryWord, Way
from postproc.siemens.codes import FEED_TYPES
from postproc.text.block import Block
from postproc.write.added_blocks import END_M, NO_INSERTION, SINGLE_FEEDS, START_M


class Change(Flag):
    """A change of the program that an obstacle may prevent."""

    SPLIT = auto()
    """A long move is written in segments."""
    CUT = auto()
    """An arc is written in segments from the places where an axis with backlash reverses."""
    TAKE_UP = auto()
    """A block before a feed move takes up backlash."""
    PACE = auto()
    """A feed move of rotary axes alone gets words for linear axes, and an F that keeps its time."""


class Asked(msgspec.Struct, frozen=True):
    """A chunk of moves, and what else the conditions need to know."""

    motions: Motions
    varied: frozenset[int] = frozenset()
    """For SPLIT: blocks that run several times with different moves."""
    with_words: NDArrayBool | None = None
    """For TAKE_UP: rows `(n,)` whose words are read; other rows have no obstacle in their words. None for all rows."""
    feeds: Sequence[Feed] = ()
    """For PACE: the feed in force in each block."""
    paced_form: str = ""
    """For PACE: the form of the new F, as of `Paced`."""
    klartext: bool = False
    repeated: bool = False
    """For PACE: blocks may run several times."""

    def block(self, row: int) -> Block:
        """The block of a row."""
        found: Block = self.motions.blocks[int(self.motions.block[row])]
        return found


Condition = Callable[[Asked, np.ndarray], NDArrayBool]
"""True `(k,)` for the rows `(k,)` with an obstacle."""


class Obstacle(NamedTuple):
    """A reason why moves cannot be changed."""

    reason: str
    to: Change
    present: Condition


def obstacles(change: Change, asked: Asked, rows: np.ndarray) -> np.ndarray:
    """Number in TABLE `(k,)` of the first obstacle to a change of each row `(k,)`; -1 for none."""
    found = np.full(len(rows), -1)
    for number, each in enumerate(TABLE):
        left = np.flatnonzero(found < 0)
        if change in each.to and left.size:
            found[left[each.present(asked, rows[left])]] = number
    return found


def reasons(change: Change, asked: Asked, rows: Sequence[int]) -> list[str]:
    """Reason why each row cannot be changed; empty if it can."""
    found = obstacles(change, asked, np.array(rows, int)).tolist()
    return [_reason(asked.motions, row, number) for row, number in zip(rows, found, strict=True)]


def _reason(motions: Motions, row: int, number: int) -> str:
    if number < 0:
        return ""
    text = TABLE[number].reason
    return text.format(axis=motions.machine.names[turns_unknown(motions, row)[0]]) if "{axis}" in text else text


def turns_unknown(motions: Motions, row: int) -> list[int]:
    """Axes that turn by half a turn or more in a move, and the direction depends on the control."""
    words = motions.rotary_words.get(row, {})
    incremental = {word.axis for word in motions.words[row] if word.incremental}
    unknown = []
    for axis, way in enumerate((motions.target[row] - motions.start[row]).tolist()):
        turning = motions.machine.axes[axis]
        word = words.get(axis, RotaryWord(Way(turning.rollover or Way.AS_WRITTEN)))
        stated = turning.rollover == Way.AS_WRITTEN.value or axis in incremental
        if turning.turns_fully and not word.direction_known(way, stated=stated):
            unknown.append(axis)
    return unknown


def _each(present: Callable[[Asked, int], Any]) -> Condition:
    """The condition of every row by itself."""
    return lambda asked, rows: np.fromiter((bool(present(asked, row)) for row in rows.tolist()), bool, len(rows))


def _each_read_singly(present: Callable[[Asked, int], Any]) -> Condition:
    """The condition of every row by itself; plain lines of a run have no word that it looks for."""

    def of_rows(asked: Asked, rows: np.ndarray) -> NDArrayBool:
        blocks, found = asked.motions.blocks, np.zeros(len(rows), bool)
        some = np.flatnonzero(blocks.in_lists[asked.motions.block[rows]])
        found[some] = _each(present)(asked, rows[some])
        return found

    return of_rows


def _any(*conditions: Condition) -> Condition:
    """The condition that one of them holds; each is only asked about rows for which those before it do not."""

    def present(asked: Asked, rows: np.ndarray) -> NDArrayBool:
        found = np.zeros(len(rows), bool)
        for condition in conditions:
            left = np.flatnonzero(~found)
            if left.size:
                found[left] = condition(asked, rows[left])
        return found

    return present


def _listed(entries: Callable[[Motions], Mapping[int, object]]) -> Condition:
    """The condition that a row has one of these entries."""

    def present(asked: Asked, rows: np.ndarray) -> NDArrayBool:
        listed = entries(asked.motions)
        return np.isin(rows, list(listed)) if listed else np.zeros(len(rows), bool)

    return present


def _closed(asked: Asked, rows: np.ndarray) -> NDArrayBool:
    motions = asked.motions
    return np.asarray(motions.blocks.no_insertion[motions.block[rows]])


def _varied(asked: Asked, rows: np.ndarray) -> NDArrayBool:
    return np.isin(asked.motions.block[rows], list(asked.varied))


def _several(asked: Asked, rows: np.ndarray) -> NDArrayBool:
    motions = asked.motions
    own = motions.block[~(motions.added & np.isfinite(motions.start_fraction))]  # not the segments of one move
    return np.asarray(np.bincount(own, minlength=len(motions.blocks))[motions.block[rows]] > 1)


def _moves_other_axes(asked: Asked, row: int) -> bool:
    return any(word.axis not in asked.motions.machine.translators for word in asked.motions.words[row])


def _polar_straight(asked: Asked, rows: np.ndarray) -> NDArrayBool:
    motions = asked.motions
    return np.isin(motions.block[rows], list(motions.polar_ends)) & ~_ARC(asked, rows)


def _increment_unknown(asked: Asked, row: int) -> bool:
    named = [word.axis for word in asked.motions.words[row]]
    return bool((asked.motions.known[row, named] != Known.PROGRAM).any())


def _position_unknown(asked: Asked, rows: np.ndarray) -> NDArrayBool:
    """An axis that moves or is named has no position of the program before or after the move."""
    motions = asked.motions
    unknown = np.minimum(motions.known_start[rows], motions.known[rows]) != Known.PROGRAM
    moved = motions.target[rows] != motions.start[rows]
    some = np.flatnonzero(unknown.any(axis=1))
    moved[some] |= motions.words.naming(rows[some], moved.shape[1])
    return np.asarray((unknown & moved).any(axis=1))


def _turns_unknown(asked: Asked, rows: np.ndarray) -> NDArrayBool:
    """A rotary axis turns so far that its direction depends on the control, as of `turns_unknown`."""
    motions, found = asked.motions, np.zeros(len(rows), bool)
    far = np.abs((motions.target - motions.start)[rows]) >= TURN_DEG / 2.0 - SAME_ROTARY_DEG
    some = np.flatnonzero(far[:, motions.machine.rotary].any(axis=1))
    found[some] = _each(lambda asked, row: turns_unknown(asked.motions, row))(asked, rows[some])
    return found


def _turns_along_arc(asked: Asked, rows: np.ndarray) -> NDArrayBool:
    motions, found = asked.motions, np.zeros(len(rows), bool)
    arcs = np.flatnonzero(_ARC(asked, rows))
    if arcs.size:
        part = motions.bare.take(rows[arcs])
        found[arcs] = (part.machine_target != part.in_machine(part.start))[:, motions.machine.rotary].any(axis=1)
    return found


def _m_functions(*at_known_times: frozenset[float]) -> Condition:
    """The condition that the block has another M function than these."""
    known = frozenset().union(*at_known_times)
    return _each_read_singly(
        lambda asked, row: any(w.address == "M" and (w.value or 0.0) not in known for w in asked.block(row).words)
    )


def _without_feed(*, number: bool) -> Condition:
    """The condition that a block under G93 has no F; `number`: one that is written as a number."""

    def present(asked: Asked, row: int) -> bool:
        words = asked.block(row).words
        return not any(word.address == "F" and word.value and not (number and word.formula) for word in words)

    def of_rows(asked: Asked, rows: np.ndarray) -> NDArrayBool:
        timed = asked.motions.timed[rows]
        if asked.with_words is not None:
            timed = timed & asked.with_words[rows]
        found = np.zeros(len(rows), bool)
        found[timed] = _each(present)(asked, rows[timed])
        return found

    return of_rows


def _single_feed(asked: Asked, row: int) -> bool:
    return any(word.address in SINGLE_FEEDS for word in asked.block(row).words)


def _feed_mode_given(asked: Asked, row: int) -> bool:
    return any(word.address == "G" and word.value in FEED_TYPES for word in asked.block(row).words)


def _speed_unknown(asked: Asked, row: int) -> bool:
    feed = asked.feeds[int(asked.motions.block[row])]
    return not feed.value or feed.mode != PER_MINUTE


def _grouped(asked: Asked, row: int) -> bool:
    return asked.paced_form == "linear" and asked.feeds[int(asked.motions.block[row])].grouped


def _tool_point_speed(asked: Asked, rows: np.ndarray) -> NDArrayBool:
    return np.asarray(asked.motions.tcp[rows] & (asked.paced_form == "combined"))


def _always(true: Callable[[Asked], bool]) -> Condition:
    """The condition of a chunk, the same for all rows."""
    return lambda asked, rows: np.full(len(rows), true(asked))


def _column(column: Callable[[Motions], np.ndarray]) -> Condition:
    """The condition of a column `(n,)` of the moves."""
    return lambda asked, rows: np.asarray(column(asked.motions)[rows], bool)


_ARC = _listed(lambda motions: motions.arcs)
_COMPENSATED = _listed(lambda motions: motions.cutter_compensated)
_POLAR = _listed(lambda motions: motions.polars)
_LOCKED = _listed(lambda motions: motions.locked_axes)
_TCP = _column(lambda motions: motions.tcp)
_FRAME_CHANGED = _column(lambda motions: ~motions.frame_unchanged)

SPLIT, CUT, TAKE_UP, PACE = Change.SPLIT, Change.CUT, Change.TAKE_UP, Change.PACE
M_FUNCTION = "an M function in its block may run before or after the move"
NO_FEED = "its block has no F under G93"
TABLE = (
    Obstacle("the program has loops or calls (--unroll writes them out)", PACE, _always(lambda asked: asked.repeated)),
    Obstacle("Klartext has no G93", PACE, _always(lambda asked: asked.klartext)),
    Obstacle(NO_INSERTION, SPLIT | CUT | TAKE_UP | PACE, _closed),
    Obstacle("its block runs several times with different moves", SPLIT, _varied),
    Obstacle("its block makes several moves", SPLIT, _several),
    Obstacle("under TCP its axes are not the axes of the machine", CUT, _TCP),
    Obstacle("cutter compensation is active", SPLIT | CUT, _COMPENSATED),
    Obstacle("other axes move with it", CUT, _each(_moves_other_axes)),
    Obstacle("its end is given in polar coordinates", SPLIT, _any(_POLAR, _polar_straight)),
    Obstacle("no word may be added for one of its axes", SPLIT, _LOCKED),
    Obstacle("it has an increment from an unknown position", CUT, _each(_increment_unknown)),
    Obstacle("the program has not yet given the positions of all its axes", SPLIT, _position_unknown),
    Obstacle("rotary axes move along an arc", SPLIT, _turns_along_arc),
    Obstacle(
        "a rotary axis turns by half a turn or more, and its direction depends on the control: write rollover = "
        '"as-written" or "shortest" under [axes.{axis}] in the machine file',
        SPLIT,
        _turns_unknown,
    ),
    Obstacle(M_FUNCTION, SPLIT, _m_functions(START_M, END_M)),
    Obstacle(M_FUNCTION, CUT, _m_functions(START_M)),
    Obstacle("its feed is in force for one block only", SPLIT, _each_read_singly(_single_feed)),
    Obstacle(NO_FEED, SPLIT, _without_feed(number=True)),
    Obstacle(NO_FEED, CUT, _without_feed(number=False)),
    Obstacle(
        "its block changes the frame, moves rotary axes only, is polar, has locked axes, or has no F under G93",
        TAKE_UP,
        _any(
            *(_FRAME_CHANGED, _column(lambda motions: motions.rotary_only), _COMPENSATED, _POLAR, _LOCKED),
            _without_feed(number=False),
        ),
    ),
    Obstacle(
        "its block changes the feed mode or the frame", PACE, _any(_each_read_singly(_feed_mode_given), _FRAME_CHANGED)
    ),
    Obstacle("F is no speed in force that is written as a number", PACE, _each(_speed_unknown)),
    Obstacle("the program has not given X Y Z in this frame", PACE, _column(lambda motions: ~motions.evaluated_paths)),
    Obstacle("its axes are locked or polar", PACE, _any(_POLAR, _LOCKED)),
    Obstacle("FGROUP has chosen the axes of F", PACE, _each(_grouped)),
    Obstacle("F under TCP is the speed of the tool point on this control", PACE, _tool_point_speed),
)
"""All obstacles; a row has the first of those to its change."""
