"""How the number of a rotary word becomes a position and a direction of rotation, and a position becomes a number.

Positions count whole turns: an axis that goes on from 355 to 5 degrees the shortest way is at 365. The number that the
control has then is 5, and words after it count from there.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from typing import NamedTuple

import numpy as np

from kinematics.machine import TURN_DEG, Machine
from kinematics.transforms import Array
from postproc.motion.moves import AxisWord
from postproc.text.block import Block
from postproc.text.blocks import PlainRun

SAME_ROTARY_DEG = 1e-6
"""Degrees: positions that differ by less are one; far above rounding, far below the resolution of any axis."""


class Way(Enum):
    """The way to the position that an absolute word gives."""

    AS_WRITTEN = "as-written"
    """The numbers of the words count whole turns: from 355 to 5 the axis turns back."""
    SHORTEST = "shortest"
    POSITIVE = "positive"
    NEGATIVE = "negative"
    """In this direction, by less than a turn."""
    SIGNED = "signed"
    """The sign of the number is the direction (LinuxCNC's WRAPPED_ROTARY, FANUC's parameter 1008 #1)."""

    @property
    def wraps(self) -> bool:
        """True where the control has positions of one turn only."""
        return self in (Way.SHORTEST, Way.POSITIVE, Way.NEGATIVE)


BY_MODE = {"DC": Way.SHORTEST, "ACP": Way.POSITIVE, "ACN": Way.NEGATIVE}
"""Siemens: modes of a rotary word that give the way."""


class RotaryWord(NamedTuple):
    """How the control reads the word of a rotary axis in one move."""

    way: Way
    turns: float = 0.0
    """Position minus number, degrees: whole turns."""
    mode: str = ""
    """Siemens: mode of the word, which an added word needs too."""

    def reached(self, number: float, here: float) -> float:
        """Position, degrees, that a number leads to from the position `here`."""
        ahead = (number - here) % TURN_DEG
        ahead = 0.0 if TURN_DEG - ahead < SAME_ROTARY_DEG else ahead
        match self.way:
            case Way.AS_WRITTEN:
                return number + self.turns
            case Way.SIGNED:
                return _signed(number, here)
            case Way.SHORTEST if ahead > TURN_DEG / 2 + SAME_ROTARY_DEG:
                ahead -= TURN_DEG
            case Way.NEGATIVE if ahead > SAME_ROTARY_DEG:
                ahead -= TURN_DEG
        return number + TURN_DEG * round((here + ahead - number) / TURN_DEG)

    def direction_known(self, way: float, *, stated: bool) -> bool:
        """True where the direction of a move by `way`, degrees, does not depend on the control.

        stated: the machine file, or an increment, says that numbers count turns.
        """
        if abs(way) < TURN_DEG / 2 - SAME_ROTARY_DEG or self.way in (Way.POSITIVE, Way.NEGATIVE, Way.SIGNED):
            return True
        whole_turn = abs(math.remainder(way, TURN_DEG)) < SAME_ROTARY_DEG
        return self.way is Way.AS_WRITTEN and (stated or whole_turn)

    def number(self, position: float, here: float, decimals: int) -> float:
        """The number, degrees, of a word that leads from `here` to a position, rounded where it has to wrap."""
        if self.way is Way.SIGNED:
            return math.copysign(round(position % TURN_DEG, decimals) % TURN_DEG, position - here)
        number = position - self.turns
        if not self.way.wraps or 0.0 <= round(number, decimals) < TURN_DEG:
            return number
        return round(number % TURN_DEG, decimals) % TURN_DEG


PLAIN = RotaryWord(Way.AS_WRITTEN)


def _signed(number: float, here: float) -> float:
    """The position by LinuxCNC's rule."""
    position = abs(number) + TURN_DEG * math.floor(here / TURN_DEG)
    if math.copysign(1.0, number) > 0.0:
        return position + TURN_DEG if position < here - SAME_ROTARY_DEG else position
    return position - TURN_DEG if position > here + SAME_ROTARY_DEG else position


@dataclass
class RotaryAxes:
    """How the control reads the words of the rotary axes at this place of the program."""

    machine: Machine
    axes: frozenset[int] = field(init=False)
    """Columns of the rotary axes."""
    ways: list[Way] = field(init=False)
    """The way of words without a mode, by axis."""
    turns: list[float] = field(init=False)
    """Whole turns, degrees, by which the positions exceed the numbers of the control, by axis."""
    _read: dict[int, RotaryWord] = field(init=False, default_factory=dict)
    """How the words of the next move were read."""
    _as_written: bool = field(init=False)
    """True while all ways are those of the numbers as they are written."""

    def __post_init__(self) -> None:
        self.axes = frozenset(np.flatnonzero(self.machine.rotary).tolist())
        self._set_ways([Way(axis.rollover or Way.AS_WRITTEN) for axis in self.machine.axes])
        self.turns = [0.0] * len(self.ways)

    def _set_ways(self, ways: list[Way]) -> None:
        self.ways, self._as_written = ways, all(way is Way.AS_WRITTEN for way in ways)

    @property
    def plain(self) -> bool:
        """True while the numbers of all words are the positions."""
        return self._as_written and not any(self.turns)

    def in_turn(self, run: PlainRun) -> np.ndarray:
        """True `(lines,)` for plain lines whose rotary words or tool vectors have to be read one after the other.

        A number with a sign may lead over a turn, and an axis that does not turn without end stays in its travel.
        """
        limited = [not math.isinf(self.machine.axes[axis].travel[1]) for axis in range(len(self.ways))]
        axes = [
            axis for axis in self.axes if self.ways[axis] is Way.SIGNED or (self.ways[axis].wraps and limited[axis])
        ]
        found = (run.columns.end[axes] > 0).any(axis=0)
        vectors = run.vectors if axes else None
        return np.asarray(found if vectors is None else found | np.isfinite(vectors.tool[:, 0]))

    def turn_by(self, way: Way) -> None:
        """Read the words from here on by this way (Klartext: M126, M127)."""
        self._set_ways([way if axis in self.axes else before for axis, before in enumerate(self.ways)])

    def accepts(self, axis: int, number: float) -> bool:
        """False for a number that a control with signed positions refuses."""
        return self.ways[axis] is not Way.SIGNED or abs(number) < TURN_DEG

    def read(self, block: Block, word: AxisWord, number: float, here: float, offset: float) -> float:
        """Position after the word of a rotary axis, as `position`; Refusal for a number that is not followed."""
        mode = block.words[word.word].mode if word.word >= 0 else ""
        if not mode and self.plain:
            return number
        if not self.accepts(word.axis, number):
            name = self.machine.names[word.axis]
            raise block.refuse(f'{name} is an axis with rollover = "signed": write a number between -360 and 360')
        return self.position(word.axis, number, here, offset, mode)

    def check_machine_positions(self, block: Block, targets: Mapping[int, float], offsets: Sequence[float]) -> None:
        """Refusal for a machine position, degrees by axis, that is not followed; offsets: work offsets `(axes)`."""
        for axis, number in targets.items():
            if (offsets[axis] and self.ways[axis] is Way.SIGNED) or not self.accepts(axis, number):
                raise block.refuse(
                    f'machine coordinates of {self.machine.names[axis]}, with rollover = "signed", are followed '
                    "without a work offset of this axis only: write the move in the coordinates of the work offset"
                )

    def position(self, axis: int, number: float, here: float, offset: float, mode: str = "") -> float:
        """Position that the word of the next move leads to from `here`, degrees.

        offset: work offset of the axis, degrees. An axis that cannot turn without end never leaves its travel for the
        way.
        """
        if self.plain and not mode:
            return number
        way = BY_MODE.get(mode, self.ways[axis])
        position = RotaryWord(way, self.turns[axis]).reached(number, here)
        if way.wraps and not self._inside(axis, position + offset):
            way, position = Way.AS_WRITTEN, number + self.turns[axis]
        if way is not Way.SIGNED:
            self.turns[axis] = position - number
        self._read[axis] = RotaryWord(way, self.turns[axis], mode)
        return position

    def _inside(self, axis: int, degrees: float) -> bool:
        low, high = self.machine.axes[axis].travel
        return low - SAME_ROTARY_DEG <= degrees <= high + SAME_ROTARY_DEG

    def words_of_move(self) -> dict[int, RotaryWord]:
        """How the control reads the words of the rotary axes in the next move, without those that count turns."""
        if not self._read and self.plain:
            return {}
        found, self._read = self._read, {}
        for axis in self.axes:
            found.setdefault(axis, RotaryWord(self.ways[axis], self.turns[axis]))
        return {axis: word for axis, word in found.items() if word != PLAIN}

    def of_run(self, run: PlainRun, target: Array, here: Sequence[float]) -> dict[str, Array]:
        """`start` and `target` `(lines, axes)` of the moves of plain lines, in positions instead of numbers.

        target: the numbers of the words, held where a line has none; here `(axes)`: position before the lines.
        """
        target = target.copy()
        for axis in self.axes:
            rows, values = self._named(run, axis)
            if self.ways[axis] is Way.SHORTEST:
                values = shortest_positions(values, here[axis], self.turns[axis])
            else:
                values = values + self.turns[axis]
            last = np.searchsorted(rows, np.arange(len(target)), side="right") - 1
            target[:, axis] = np.where(last >= 0, np.append(values, here[axis])[last], here[axis])
        return {"start": np.concatenate([[here], target[:-1]]), "target": target}

    def words_of_run(self, first: int, run: PlainRun, target: Array) -> dict[int, dict[int, RotaryWord]]:
        """How the control reads the rotary words of plain lines, by row from `first` on; the turns of the last stay.

        target `(lines, axes)`: positions.
        """
        turns = np.tile(self.turns, (len(target), 1))
        for axis in self.axes:
            rows, values = self._named(run, axis)
            last = np.searchsorted(rows, np.arange(len(target)), side="right") - 1
            found = TURN_DEG * np.round((target[rows, axis] - values) / TURN_DEG)
            turns[:, axis] = np.where(last >= 0, np.append(found, self.turns[axis])[last], self.turns[axis])
        self.turns = turns[-1].tolist()
        shared: dict[tuple[float, ...], dict[int, RotaryWord]] = {}
        words = {}
        for row, key in enumerate(map(tuple, turns.tolist()), start=first):
            if key not in shared:
                every = {axis: RotaryWord(self.ways[axis], key[axis]) for axis in self.axes}
                shared[key] = {axis: word for axis, word in every.items() if word != PLAIN}
            words[row] = shared[key]
        return words

    @staticmethod
    def _named(run: PlainRun, axis: int) -> tuple[np.ndarray, Array]:
        """The lines of a run that name an axis, and their numbers."""
        rows = np.flatnonzero(run.columns.end[axis] > 0)
        return rows, np.asarray(run.columns.value[axis, rows], float)


def shortest_positions(numbers: Array, here: float, turns: float) -> Array:
    """Positions `(n,)`, degrees, that words with these numbers lead to one after the other the shortest way.

    here: position before them; turns: its excess over the number of the control, degrees.
    """
    before = np.concatenate([[here - turns], numbers[:-1]])
    ahead = (numbers - before) % TURN_DEG
    ahead = np.where(ahead > TURN_DEG / 2 + SAME_ROTARY_DEG, ahead - TURN_DEG, ahead)
    ahead = np.where(TURN_DEG - ahead < SAME_ROTARY_DEG, 0.0, ahead)
    return np.asarray(numbers + TURN_DEG * np.round((here + np.cumsum(ahead) - numbers) / TURN_DEG))
