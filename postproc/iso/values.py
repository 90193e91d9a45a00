"""Numbers of ISO words in mm and degrees, as the machine's control reads them."""

from __future__ import annotations

from dataclasses import dataclass

from kinematics.machine import Control
from postproc.control.codes import INCH, LARGEST
from postproc.text.block import Block
from postproc.text.notes import Notes


@dataclass
class Values:
    """Reads the numbers of words; notes what it takes for granted."""

    control: Control
    notes: Notes

    def number(self, block: Block, index: int, unit: float) -> float:
        """The number of a word in mm or degrees."""
        word = block.words[index]
        value = word.value or 0.0
        if not abs(value) < LARGEST:
            raise block.refuse(f"{word.address} with a number that no control reads")
        if value and word.formula is None and "." not in block.text[word.start : word.end]:
            if self.control.integer_words == "increments":
                if unit == INCH:
                    raise block.refuse("an inch coordinate without decimal point: its increment is not known")
                return value * self.control.increment
            self.notes.add(
                "coordinates without decimal point taken in mm, inches or degrees, not in increments", block.line
            )
        return value * unit

    def whole(self, block: Block, index: int) -> int:
        """The number of a word that counts."""
        word = block.words[index]
        value = word.value or 0.0
        if not (abs(value) < LARGEST and value == int(value)):
            raise block.refuse(f"{word.address} with a number that is not whole")
        return int(value)
