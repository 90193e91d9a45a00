"""The channel of ISO / Fanuc / LinuxCNC controls: what words mean there, and what modes the program leaves open."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from kinematics.machine import TURN
from postproc.control import channel
from postproc.control.channel import AxisWords
from postproc.control.codes import DISTANCES, INCH, LARGEST, PLANES
from postproc.control.words import no_number
from postproc.iso.codes import (
    CENTRE_DISTANCES,
    FEED_MODES,
    OTHER_UNITS,
    REFUSED_M,
    RETURN_TO_LEVEL,
    RETURN_TO_R,
    TURNING_WORDS,
    UNITS,
)
from postproc.iso.modal_state import InForce, ModalState
from postproc.iso.variables import IsoVariables
from postproc.motion.moves import Kind
from postproc.text.block import Block
from postproc.text.blocks import PlainRun

INTEGERS = "coordinates without decimal point are taken in mm, inches or degrees, not in increments"
LINUXCNC_SHORT_RADIUS_MM = 0.00127
"""LinuxCNC's RADIUS_TOLERANCE_MM (interp_internal.hh), 0.00005 inch: a radius may be so much too short."""


@dataclass
class Channel(channel.Channel):
    """The operations that the parts of the dialect share."""

    modal: ModalState
    scope: IsoVariables

    refused_m: ClassVar[Mapping[float, str]] = REFUSED_M
    units: ClassVar[Mapping[float, float]] = UNITS
    feed_modes: ClassVar[frozenset[float]] = FEED_MODES

    def __post_init__(self) -> None:
        super().__post_init__()
        self.family = self.machine.control.family
        """The family of controls that decides where controls differ."""
        if self.family == "linuxcnc":
            self.short_radius_mm = LINUXCNC_SHORT_RADIUS_MM
        self.unstated_turns = frozenset(
            i for i, axis in enumerate(self.machine.axes) if axis.turns_fully and not axis.rollover
        )
        """Columns of rotary axes for which the machine file does not state the meaning of numbers beyond a turn."""

    # ---- modes and numbers

    def take_mode(self, block: Block, code: float) -> bool:
        """Take over a modal code; False for any other code."""
        code, modal = self._unit_code(block, code), self.modal
        if code in CENTRE_DISTANCES:
            modal.arc_absolute = code == 90.1
        elif code in (RETURN_TO_LEVEL, RETURN_TO_R):
            modal.to_retract = code == RETURN_TO_R
        elif not super().take_mode(block, code):
            return False
        mode = "plane" if code in PLANES else "unit" if code in UNITS else "distance" if code in DISTANCES else ""
        modal.not_programmed.pop(mode, None)
        if mode in modal.mode_assumed and code in (21.0, 90.0):
            self.recorder.mark_uncertain()
        modal.mode_assumed.discard(mode)
        return True

    def _unit_code(self, block: Block, code: float) -> float:
        """G20 or G21 for G70 or G71 alone, where no control is stated and the program has no other unit."""
        if code not in OTHER_UNITS or self.family != "any" or any(w.address in TURNING_WORDS for w in block.words):
            return code
        unit = UNITS[OTHER_UNITS[code]]
        if "unit" not in self.modal.not_programmed and unit != self.modal.unit:
            raise block.refuse(
                f"G{code:g} is another unit than that of the program on some controls, and none on others: write G20 "
                "or G21"
            )
        self.notes.add(f"G{code:g} is taken for {'inches' if unit == INCH else 'mm'}", block.line)
        return OTHER_UNITS[code]

    def note_not_programmed(self, line: int, kind: Kind) -> None:
        """Note the assumptions of a move: modes that the program has not given."""
        for mode in ("unit", "distance", "plane") if kind is Kind.ARC else ("unit", "distance"):
            if mode in self.modal.not_programmed:
                self.notes.add(self.modal.not_programmed.pop(mode), line)
                self.modal.mode_assumed.add(mode)

    def axis_words(self, block: Block, indices: Iterable[int]) -> AxisWords:
        """The axis words of a block with their values."""
        words = super().axis_words(block, indices)
        for word, value in words:
            if not 0.0 <= value <= TURN and word.axis in self.unstated_turns and not word.incremental:
                self.assume_turns(word.axis, value, block.line)
        return words

    def assume_turns_of(self, run: PlainRun) -> None:
        """Register the assumption on turns for plain lines, as `axis_words` does for other blocks."""
        for axis in self.unstated_turns:
            numbers = np.where(run.columns.end[axis] > 0, run.columns.value[axis], 0.0)
            if (outside := np.flatnonzero((numbers < 0.0) | (numbers > TURN))).size:
                self.assume_turns(axis, float(numbers[outside[0]]), run.number + int(outside[0]))

    def assume_turns(self, axis: int, number: float, line: int) -> None:
        """Register the assumption that the numbers of a rotary axis count turns, with the first that shows it."""
        name = self.machine.names[axis]
        self.control_state.taken.setdefault(
            f"turns of {name}",
            f"{name}{number:g} in line {line} is taken as a position, and its sign not as a direction: state this by "
            f'rollover under [axes.{name}] in the machine file ("as-written", "signed" or "shortest").',
        )

    def number(self, block: Block, index: int, unit: float) -> float:
        """The number of a word in mm or degrees; without a decimal point it may be a number of increments."""
        word = block.words[index]
        value = word.value
        if value is None or not abs(value) < LARGEST:
            raise no_number(block, word)
        if value and word.formula is None and "." not in block.text[word.start : word.end]:
            if self.machine.control.integer_words == "increments":
                if unit == INCH:
                    raise block.refuse(
                        f"{word.address} is an inch coordinate without decimal point, and its increment is not known: "
                        "write the decimal point"
                    )
                return value * self.machine.control.increment
            self.notes.add(INTEGERS, block.line)
        return value * unit

    # ---- frames

    def changed_since(self, before: InForce) -> None:
        """Set the frame of the recorder, with the axes whose coordinates differ from those of the state before."""
        x_y_z, (offset, length, tcp) = self.x_y_z, self.modal.in_force
        changed: set[int] = set()
        if offset != before[0]:
            changed.update(range(len(self.machine.axes)))
        if tcp != before[2] or (tcp and length != before[1]):
            changed.update(x_y_z)
        elif length != before[1]:
            changed.add(x_y_z[2])
        self.change_frame(changed)

    def change_shifted(self, axes: Iterable[int]) -> None:
        """Program in the present frame from here, if it differs; coordinates of these axes mean something else."""
        if self.modal.frame() != self.recorder.frame:
            self.change_frame(axes)
