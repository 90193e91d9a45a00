"""The axis words of one move: its corrected end, written into its block or into an added block.

An axis that the block does not name keeps its position on the control; if its correction has changed, a word is
inserted.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from kinematics.machine import TURN_DEG, Machine
from postproc.compensation.correction import Correction
from postproc.motion.cutter_compensation import check_turned
from postproc.motion.motions import Motions
from postproc.motion.rotary_words import RotaryWord
from postproc.text.editing import PLAIN, Form, WordEditor
from postproc.text.number_style import decimals_holding
from postproc.write.added_blocks import AddedBlock
from postproc.write.arcs import round_off
from postproc.write.decimals import decimals_of_axis
from postproc.write.helices import axes_across, replaced_by_angle
from postproc.write.polar import PolarWriter

HALF_TURN_DEG = TURN_DEG / 2


@dataclass
class RowWords:
    """The words of one move and the positions of the control around it, mm and degrees, in its frame."""

    machine: Machine
    motions: Motions
    row: int
    editor: WordEditor | AddedBlock
    programmed: list[bool]
    """True for axes whose position the program has given."""
    held: list[float]
    """Position on the control; after all words, that behind the move."""
    corrected: list[float]
    """Corrected end."""
    written: Sequence[int]
    """Axes with words of their own, by letter."""
    exact: set[int]
    """Axes whose numbers are written without rounding."""
    spelled: bool = False
    """Rotary axes that a tool vector has turned get words."""
    whole: bool = False
    """X Y Z get words also where they do not move."""
    dropped: list[int] = field(default_factory=list)
    """Klartext arcs: indices of the words that an angle must replace."""
    start: list[float] = field(init=False)
    """Position on the control before the move."""
    unit: float = field(init=False)
    """Mm per unit of the words of linear axes."""
    named: set[int] = field(default_factory=set)
    """Axes whose position behind the move is known already."""
    turning: Mapping[int, RotaryWord] = field(init=False)
    """How the control reads the words of the rotary axes that do not simply count turns."""

    def __post_init__(self) -> None:
        self.unit = float(self.motions.unit[self.row])
        self.start, self.turning = list(self.held), self.motions.rotary_words.get(self.row, {})
        if self.row in self.motions.arcs:
            self.dropped = self._keep_in_plane()

    def write_named(self) -> None:
        """Write the axes that the block names."""
        motions, row, held = self.motions, self.row, self.held
        for axis, index, incremental in motions.words[row]:
            if index < 0 and self.spelled:
                continue
            self.named.add(axis)
            if not self.programmed[axis]:
                self._move_as_programmed(axis)
            elif index < 0:
                held[axis] = self.corrected[axis]
            elif axis in self.written and index not in self.dropped:
                unit, base = self._unit(axis), self.start[axis] if incremental else 0.0
                number = (self.corrected[axis] - base) / unit
                decimals = self._decimals(axis, unit, number)
                assert isinstance(self.editor, WordEditor)  # an added block has no axis words yet
                if not incremental and axis in self.turning:
                    held[axis] = self._turn(self.editor, axis, index, decimals)
                else:
                    held[axis] = base + self.editor.set(index, number, decimals) * unit
            else:
                held[axis] = float(motions.target[row, axis])
        for axis in motions.arcs[row].plane[:2] if self.dropped else ():
            self.named.add(axis)
            held[axis] = self.corrected[axis]

    def turn_by_vector(self, axes: Iterable[int]) -> None:
        """Move those of the axes that a tool vector may turn without words for them."""
        for axis in axes:
            if axis not in self.named and not self.programmed[axis]:
                self._move_as_programmed(axis)

    def write_polar(self, writer: PolarWriter) -> None:
        """Write the position by radius and angle."""
        assert isinstance(self.editor, WordEditor)  # no block is added beside polar coordinates
        motions, row = self.motions, self.row
        polar = motions.polars[row]
        i, j = polar.axes
        position = (
            (self.corrected[i], self.corrected[j])
            if self.programmed[i] and self.programmed[j]
            else motions.target[row, [i, j]]
        )
        names = self.machine.names[i], self.machine.names[j]
        resolution = self.machine.axes[i].resolution
        unit = float(motions.unit[row])
        self.held[i], self.held[j] = writer.write(
            self.editor, polar, names, (position[0], position[1]), unit, resolution
        )
        self.named.update((i, j))

    def write_omitted(self) -> None:
        """Add words for the axes that the block omits, if they have to move."""
        incremental = self.motions.incremental[self.row]
        for axis in self.written:
            if axis in self.named or not self.programmed[axis]:
                continue
            held, unit = self.held[axis], self._unit(axis)
            base = held if incremental else 0.0
            number, before = (self.corrected[axis] - base) / unit, (held - base) / unit
            if self.whole and not self.machine.rotary[axis]:
                before = math.nan  # no position is in force
            decimals = self._decimals(axis, unit, number)
            form = self._form(axis, held, decimals) if axis in self.turning and not incremental else PLAIN
            after = self.editor.add(self.machine.names[axis], number, before, decimals, form)
            self.held[axis] = held if after == before else base + after * unit

    def check_cutter_compensation(self) -> None:
        """Refusal for a move with radius compensation that its correction would turn too much."""
        motions, row = self.motions, self.row
        i, j = motions.cutter_compensated[row]
        nominal = motions.start[row].tolist(), motions.target[row].tolist()
        before, after = (((a[i], a[j]), (b[i], b[j])) for a, b in (nominal, (self.start, self.held)))
        check_turned(motions.blocks[motions.block[row]], before, after)

    def _turn(self, editor: WordEditor, axis: int, index: int, decimals: int) -> float:
        """Write the word of a rotary axis; the position that it leads to, degrees."""
        word, here = self.turning[axis], self.start[axis]
        return self._checked(axis, editor.set(index, word.number(self.corrected[axis], here, decimals), decimals))

    def _form(self, axis: int, here: float, decimals: int) -> Form:
        """How an added word of a rotary axis shows a position."""
        word = self.turning[axis]

        def number(position: float) -> float:
            shown = word.number(position, here, decimals)
            self._checked(axis, shown)
            return shown

        return Form(number, word.mode)

    def _checked(self, axis: int, number: float) -> float:
        """The position that a number leads to, degrees; Refusal where this is not the corrected one."""
        reached = self.turning[axis].reached(number, self.start[axis])
        if abs(reached - self.corrected[axis]) > HALF_TURN_DEG or (not number and math.copysign(1.0, number) < 0.0):
            raise self.motions.blocks[self.motions.block[self.row]].refuse(
                f"the corrected position of {self.machine.names[axis]} lies just before the present one, and the "
                "control would turn it once round: program the shortest way, or leave the orientation uncorrected"
            )
        return reached

    def _move_as_programmed(self, axis: int) -> None:
        self.held[axis] += float(self.motions.target[self.row, axis] - self.motions.start[self.row, axis])

    def _unit(self, axis: int) -> float:
        """Mm or degrees per unit of the words of an axis."""
        return 1.0 if self.machine.rotary[axis] else self.unit

    def _decimals(self, axis: int, unit: float, number: float) -> int:
        least = decimals_of_axis(self.machine, axis, unit)
        return max(least, decimals_holding(number)) if axis in self.exact else least

    def _has_moved(self, axis: int) -> bool:
        """True if the words of the start and of the end of an axis differ."""
        unit = self._unit(axis)
        digit = 10.0 ** -decimals_of_axis(self.machine, axis, unit) * unit
        return abs(self.corrected[axis] - self.start[axis]) >= 0.5 * digit

    def _keep_in_plane(self) -> list[int]:
        """Klartext arcs: axes across the plane keep their positions if the block cannot name them.

        If it can, the result is the indices of the words that an angle must replace.
        """
        moved = [axis for axis in self.written if self.programmed[axis] and self._has_moved(axis)]
        across = axes_across(self.motions, self.row, moved)
        block = self.editor.block if isinstance(self.editor, WordEditor) else None
        dropped = replaced_by_angle(self.motions, self.row, across, block) if across else []
        for axis in across if dropped is None else ():
            self.corrected[axis] = self.start[axis]
        return dropped or []


def kept_axes(machine: Machine, motions: Motions, row: int, *, rotary_only: bool) -> tuple[int, ...]:
    """Columns of the axes whose end must equal their start to the last digit."""
    arc, locked = motions.arcs.get(row), motions.locked_axes.get(row, ())
    if rotary_only:
        return (*machine.translators, *locked)
    if arc is not None and arc.full:
        return (*arc.plane[:2], *locked)
    return (motions.cycles[row].axis, *locked) if row in motions.cycles else locked


def corrected_end(
    motions: Motions, correction: Correction, row: int, start: list[float], kept: tuple[int, ...]
) -> list[float]:
    """Corrected end of a move, mm and degrees, with `kept` axes at its start; for an arc, after `round_off`."""
    corrected: list[float] = correction.target[row].tolist()
    for axis in kept:
        # exactly: a full circle with the smallest gap would be, for the control, an arc across this gap
        corrected[axis] = start[axis]
    if row in motions.arcs and not motions.arcs[row].full:
        round_off(motions, row, start, corrected, correction.middle_shift[row])
    return corrected
