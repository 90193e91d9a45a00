"""Probing programs for Heidenhain: TCH PROBE 4 in the active system, log by FN 16 with a mask of its own."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from kinematics.machine import Machine
from postproc.generate import plain
from postproc.probing.sequence import ProbingSequence, ProbingSettings, Touch, joined

MISSED_LABEL = 99
"""Label of the stop for a touch without contact."""
RESULT, START, FOUND, ROW, Q_TOUCH = 60, 70, 80, 90, 91
"""Q parameters: first of the result of the cycle, of the position before it, of the axis positions at the contact."""
SYSTEM = "XYZABC"
"""Axes in the order of the indices of FN 18 ID270."""


@dataclass
class Klartext:
    """Heidenhain Klartext with numbered blocks: machine coordinates by M91."""

    sequence: ProbingSequence
    settings: ProbingSettings
    block: int = -1

    def head(self, remarks: Sequence[str], park: Mapping[str, float]) -> list[str]:
        """The lines up to the parking position, with the opening of the log."""
        return [
            *self._blocks("BEGIN PGM NCOMP MM"),
            *self._blocks(*(f"; {plain(text)}" for text in remarks)),
            *self._blocks("M5", "M129"),
            *self._blocks("; GO ON WHEN THE PROBE IS READY AND THE PATH TO THE PARKING POSITION IS CLEAR", "STOP"),
            *self.move(park, "PARKING POSITION"),
        ]

    def move(self, words: Mapping[str, float], remark: str) -> list[str]:
        """A straight move in machine coordinates."""
        block = f"L {joined(words, signed=True)} R0 F{self.settings.feed:g} M91"
        return self._blocks(block + (f" ; {plain(remark)}" if remark else ""))

    def touch(self, touch: Touch) -> list[str]:
        """Both touches of a contact, and its line in the log."""
        linear = list(touch.back)
        # the cycle and FN 18 give positions of the active system: their difference is the distance from the start
        start = [f"FN 18: SYSREAD Q{START + k} = ID270 NR1 IDX{SYSTEM.index(n) + 1}" for k, n in enumerate(linear)]
        found = [f"Q{FOUND + k} = {touch.start[n]:+.4f} + Q{RESULT + k} - Q{START + k}" for k, n in enumerate(linear)]
        rotary = [name for name in self.sequence.machine.names if name not in linear]
        turned = [
            f"FN 18: SYSREAD Q{FOUND + len(linear) + k} = ID270 NR1 IDX{SYSTEM.index(name) + 1}"
            for k, name in enumerate(rotary)
        ]
        output = f"TNC:\\ncomp{self.sequence.plan_id}"
        return self._blocks(
            *start,
            *self._cycle(touch, self.settings.probing, touch.length),
            *self._cycle(touch, self.settings.measuring, 2.0 * self.settings.back_mm),
            *found,
            *turned,
            f"Q{ROW} = {touch.row}",
            f"Q{Q_TOUCH} = {touch.number}",
            f"FN 16: F-PRINT TNC:\\ncomp.a / {output}.txt",
        )

    def end(self) -> list[str]:
        """The end of the log and of the program."""
        return self._blocks("M30", f"LBL {MISSED_LABEL}", "; NO CONTACT", "STOP", "M30", "END PGM NCOMP MM")

    def _cycle(self, touch: Touch, feed: float, length: float) -> list[str]:
        """A touch along the line to its end, and back from the contact by MB.

        A move of the program would not do: the control refuses moves while the stylus is deflected, except by M141.
        """
        way = " ".join(f"I{name}{value:+.4f}" for name, value in touch.path.items())
        return [
            "TCH PROBE 4.0 MEASURING IN 3-D",
            f"TCH PROBE 4.1 Q{RESULT}",
            f"TCH PROBE 4.2 {way}",
            f"TCH PROBE 4.3 DIST+{length:.3f} F{feed:g} MB{self.settings.back_mm:g} REFERENCE SYSTEM:0",
            f"FN 9: IF +Q{RESULT + 3} EQU -1 GOTO LBL {MISSED_LABEL}",
        ]

    def _blocks(self, *texts: str) -> list[str]:
        found = []
        for text in texts:
            self.block += 1
            found.append(f"{self.block} {text}")
        return found


def mask(machine: Machine) -> str:
    """The mask of FN 16: one line of the log for each touch."""
    linear = [axis.name for axis in machine.axes if not axis.rotary]
    names = [*linear, *(axis.name for axis in machine.axes if axis.rotary)]
    cells = " ".join(f"{name}%+12.5LF" for name in names)
    numbers = ", ".join(f"Q{FOUND + k}" for k in range(len(names)))
    return f'"NCOMP P%5.0LF T%2.0LF {cells}", Q{ROW}, Q{Q_TOUCH}, {numbers};\n'
