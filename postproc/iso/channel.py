"""The channel of ISO / Fanuc / LinuxCNC controls: what words mean there, and what modes the program leaves open."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from kinematics.machine import TURN_DEG
from postproc.control import channel
from postproc.control.channel import AxisWords
from postproc.control.codes import DISTANCES, INCH, LARGEST_CODE, PLANES
from postproc.control.words import no_number
from postproc.iso.codes import (
    CENTRE_DISTANCES,
    FEED_MODES,
    HARMLESS_G,
    OTHER_UNITS,
    REFUSED_M,
    RETURN_TO_LEVEL,
    RETURN_TO_R,
    TURNING_WORDS,
    UNITS,
)
from postproc.iso.families import (
    ANY,
    GRBL,
    HARMLESS,
    HARMLESS_M,
    LINUXCNC,
    MACH3,
    STORED,
    refused_by_family,
)
from postproc.iso.modal_state import InForce, ModalState
from postproc.iso.variables import IsoVariables
from postproc.motion.moves import Kind
from postproc.text.block import Block
from postproc.text.blocks import PlainRun
from postproc.text.line_numbers import shown

INTEGERS = "coordinates without decimal point are taken in mm, inches or degrees, not in increments"
SHORT_RADIUS_MM = {LINUXCNC: 0.00127, GRBL: 1e-9}
"""Length by which a radius may be too short, by family: LinuxCNC's RADIUS_TOLERANCE_MM (interp_internal.hh), 0.00005
inch; grbl's gcode.c takes none that is too short."""


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
        self.short_radius_mm = SHORT_RADIUS_MM.get(self.family, self.short_radius_mm)
        self.harmless_g = HARMLESS_G | HARMLESS.get(self.family, frozenset())
        """G codes that neither move the tool nor change where coordinates point."""
        self.unstated_turns = frozenset(
            i for i, axis in enumerate(self.machine.axes) if axis.turns_fully and not axis.rollover
        )
        """Columns of rotary axes for which the machine file does not state the meaning of numbers beyond a turn."""

    # ---- modes and numbers

    def check_family(self, block: Block, address: str, code: float) -> None:
        """Refuse a G or M code that the family of the control does not have, or reads as something not followed."""
        if reason := refused_by_family(self.family, address, code):
            raise block.refuse(f"{address}{code:g} {reason}")

    def take_function(self, block: Block, code: float) -> None:
        """Take over an M function."""
        self.check_family(block, "M", code)
        if code not in HARMLESS_M.get(self.family, ()):
            super().take_function(block, code)

    def take_unknown(self, block: Block, code: float, refused: Mapping[float, str], *, moves: bool) -> None:
        """Refuse a G code that is not followed, or pass it; G28.1 and G30.1 store a position or reference the axes."""
        if code not in STORED or self.family != ANY:
            super().take_unknown(block, code, refused, moves=moves)
            return
        if moves:
            raise block.refuse(
                f"coordinates with G{code:g} are a move on LinuxCNC, and the axes to be referenced on Mach3: write "
                "them in a block of their own"
            )
        self.recorder.mark_unknown(list(range(len(self.machine.axes))))
        self.notes.add(
            f"G{code:g} stores the present position on LinuxCNC and grbl and references the axes on Mach3: their "
            "positions after it are taken as unknown",
            block.line,
        )

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
        if code in OTHER_UNITS and self.family == MACH3:
            return OTHER_UNITS[code]
        if code not in OTHER_UNITS or self.family != ANY or any(w.address in TURNING_WORDS for w in block.words):
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
            if not 0.0 <= value <= TURN_DEG and word.axis in self.unstated_turns and not word.incremental:
                self.assume_turns(word.axis, value, block.line)
        return words

    def assume_turns_of(self, run: PlainRun) -> None:
        """Register the assumption on turns for plain lines, as `axis_words` does for other blocks."""
        for axis in self.unstated_turns if not run.incremental else ():
            numbers = np.where(run.columns.end[axis] > 0, run.columns.value[axis], 0.0)
            if (outside := np.flatnonzero((numbers < 0.0) | (numbers > TURN_DEG))).size:
                self.assume_turns(axis, float(numbers[outside[0]]), run.number + int(outside[0]))

    def assume_turns(self, axis: int, number: float, line: int) -> None:
        """Register the assumption that the numbers of a rotary axis count turns, with the first that shows it."""
        name = self.machine.names[axis]
        self.control_state.taken.setdefault(
            f"turns of {name}",
            f"{name}{number:g} in line {shown(line)} is taken as a position, and its sign not as a direction: state "
            f'this by rollover under [axes.{name}] in the machine file ("as-written", "signed" or "shortest").',
        )

    def number(self, block: Block, index: int, unit: float) -> float:
        """The number of a word in mm or degrees; without a decimal point it may be a number of increments."""
        word = block.words[index]
        value = word.value
        if value is None or not abs(value) < LARGEST_CODE:
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
