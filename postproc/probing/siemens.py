"""Probing programs for Siemens 840D: MEAS in machine coordinates (SUPA), log by WRITE."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from postproc.generate import plain
from postproc.probing.sequence import ProbingSequence, ProbingSettings, Touch, joined


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
        return [
            *(f"; {plain(text)}" for text in remarks),
            "DEF INT ERR",
            "G71 G17 G90 G94",
            "G40 G60 TRAFOOF D0",
            "M5",
            "; GO ON WHEN THE PROBE IS READY AND THE PATH TO THE PARKING POSITION IS CLEAR",
            "M0",
            *self.move(park, "PARKING POSITION"),
            f'WRITE(ERR,"{self.file}","NCOMP PLAN {self.sequence.plan_id}")',
        ]

    def move(self, words: Mapping[str, float], remark: str) -> list[str]:
        """A straight move in machine coordinates."""
        return [f"SUPA G1 {joined(words)} F{self.settings.feed:g}" + (f" ; {plain(remark)}" if remark else "")]

    def touch(self, touch: Touch) -> list[str]:
        """Both touches of a contact, and its line in the log."""
        end = joined({name: touch.end[name] for name in touch.back})
        missed = "IF $AC_MEA[1]==0 GOTOF MISSED"
        rotary = [name for name in self.sequence.machine.names if name not in touch.back]
        cells = [f'<<" {name}"<<$AA_MM[{name}]' for name in touch.back]
        cells += [f'<<" {name}"<<$AA_IM[{name}]' for name in rotary]
        return [
            f"SUPA MEAS=1 G1 {end} F{self.settings.probing:g}",
            "STOPRE",
            missed,
            f"G91 G1 {joined(touch.back)} F{self.settings.feed:g}",
            f"G90 SUPA MEAS=1 G1 {end} F{self.settings.measuring:g}",
            "STOPRE",
            missed,
            f'WRITE(ERR,"{self.file}","NCOMP P{touch.row} T{touch.number}"{"".join(cells)})',
        ]

    def end(self) -> list[str]:
        """The end of the log and of the program."""
        return ["M30", "MISSED:", 'MSG("NCOMP: NO CONTACT")', "M0", "M30"]
