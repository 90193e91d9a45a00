"""Probing programs for Siemens 840D: MEAS in machine coordinates (SUPA), log by WRITE."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from postproc.generate import plain
from postproc.probing.sequence import ProbingSequence, ProbingSettings, Touch, joined

CELL = 16
"""Most characters of an axis in a line of the log."""


@dataclass
class Siemens:
    """Siemens 840D with the probe at measuring input 1."""

    sequence: ProbingSequence
    settings: ProbingSettings

    @property
    def file(self) -> str:
        """Name of the log."""
        return f"NCOMP{self.sequence.plan_id}"

    def head(self, remarks: Sequence[str], park: Mapping[str, float]) -> list[str]:
        """The lines up to the parking position, with the opening of the log."""
        touches = int(np.count_nonzero(self.sequence.touch))
        size = np.ceil(touches * (len("NCOMP P999 T9\n") + CELL * len(self.sequence.machine.names)) / 1024.0)
        return [
            *(f"; {plain(text)}" for text in remarks),
            f"; THE LOG HAS ABOUT {size:.0f} KB: MD11420 LEN_PROTOCOL_FILE MUST BE AS LARGE. DELETE AN OLD LOG FIRST",
            "DEF INT ERR",
            "G71 G17 G90 G94",
            "G40 G60 TRAFOOF D0",
            "M5",
            "; GO ON WHEN THE PROBE IS READY AND THE PATH TO THE PARKING POSITION IS CLEAR",
            "M0",
            *self.move(park, "PARKING POSITION"),
            *self._written(f'"NCOMP PLAN {self.sequence.plan_id}"'),
        ]

    def move(self, words: Mapping[str, float], remark: str) -> list[str]:
        """A straight move in machine coordinates."""
        return [f"SUPA G1 {joined(words)} F{self.settings.feed:g}" + (f" ; {plain(remark)}" if remark else "")]

    def touch(self, touch: Touch) -> list[str]:
        """Both touches of a contact, and its line in the log."""
        end = joined({name: touch.end[name] for name in touch.back})
        # from the contact in machine coordinates: an increment would follow the rotation of an active frame
        back = " ".join(f"{name}=$AA_MM[{name}]{value:+.4f}" for name, value in touch.back.items())
        missed = "IF $AC_MEA[1]==0 GOTOF MISSED"
        rotary = [name for name in self.sequence.machine.names if name not in touch.back]
        cells = [f'<<" {name}"<<$AA_MM[{name}]' for name in touch.back]
        cells += [f'<<" {name}"<<$AA_IM[{name}]' for name in rotary]
        return [
            f"SUPA MEAS=1 G1 {end} F{self.settings.probing:g}",
            "STOPRE",
            missed,
            f"SUPA G1 {back} F{self.settings.feed:g}",
            f"SUPA MEAS=1 G1 {end} F{self.settings.measuring:g}",
            "STOPRE",
            missed,
            *self._written(f'"NCOMP P{touch.row} T{touch.number}"{"".join(cells)}'),
        ]

    def end(self) -> list[str]:
        """The end of the log and of the program."""
        missed = ["MISSED:", 'MSG("NCOMP: NO CONTACT")', "M0", "M30"]
        return ["M30", *missed, "NOLOG:", 'MSG("NCOMP: LOG NOT WRITTEN, ERROR "<<ERR)', "M0", "M30"]

    def _written(self, text: str) -> list[str]:
        """A line of the log; the program stops where it is not written."""
        return [f'WRITE(ERR,"{self.file}",{text})', "IF ERR<>0 GOTOF NOLOG"]
