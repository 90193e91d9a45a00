"""Probing programs for LinuxCNC (G38.2, PROBEOPEN) and Fanuc (G31, DPRNT)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from postproc.generate import plain
from postproc.probing.sequence import ProbingSequence, ProbingSettings, Touch, joined

PROGRAMS = 7999
"""Program numbers from 1 to this are the user's: 8000 to 9999 may be protected (Fanuc)."""
MISSED_N = 900
"""Sequence number of the stop for a touch without contact (Fanuc)."""
AT_START_MM = 0.001
"""Largest difference of the active coordinates from the axis positions at the parking position, mm."""
SEAT_S = 0.1
"""Time in which the probe comes to rest before the second touch, s (LinuxCNC)."""


@dataclass
class LinuxCnc:
    """LinuxCNC: machine coordinates by G53; before the first touch it checks that no offset is active."""

    sequence: ProbingSequence
    settings: ProbingSettings

    def head(self, remarks: Sequence[str], park: Mapping[str, float]) -> list[str]:
        """The lines up to the parking position, with the opening of the log."""
        linear = [name for name in park if name in "XYZ"]
        # 5420 to 5422: the present position in the active coordinate system, with all offsets
        checks = " + ".join(f"ABS[#{5420 + 'XYZ'.index(name)} - {park[name]:.4f}]" for name in linear)
        return [
            "%",
            *(f"({plain(text)})" for text in remarks),
            "G21 G17 G90 G94",
            "G40 G49 G80 G61",
            "M5",
            "(GO ON WHEN THE PROBE IS READY AND THE PATH TO THE PARKING POSITION IS CLEAR)",
            "M0",
            *self.move(park, "PARKING POSITION"),
            f"O1 IF [{checks} GT {AT_START_MM}]",
            "(MSG, NCOMP: A WORK OFFSET OR TOOL LENGTH IS ACTIVE - CLEAR G54 AND G92)",
            "M2",
            "O1 ENDIF",
            f"(PROBEOPEN ncomp{self.sequence.plan_id}.txt)",
        ]

    def move(self, words: Mapping[str, float], remark: str) -> list[str]:
        """A straight move in machine coordinates."""
        return [f"G53 G1 {joined(words)} F{self.settings.feed:g}" + (f" ({plain(remark)})" if remark else "")]

    def touch(self, touch: Touch) -> list[str]:
        """Both touches of a contact, and its line in the log."""
        end = joined({name: touch.end[name] for name in touch.back})
        return [
            f"G38.2 {end} F{self.settings.probing:g}",
            f"G91 G1 {joined(touch.back)} F{self.settings.feed:g}",
            f"G4 P{SEAT_S}",
            f"G90 G38.2 {end} F{self.settings.measuring:g}",
        ]

    def end(self) -> list[str]:
        """The end of the log and of the program."""
        return ["(PROBECLOSE)", "M2", "%"]


@dataclass
class Fanuc:
    """Fanuc with custom macro B: the work offset of `settings`, which it checks before the first touch."""

    sequence: ProbingSequence
    settings: ProbingSettings

    @property
    def offset(self) -> Mapping[str, float]:
        """Values of the work offset by axis."""
        return self.settings.offset[1] if self.settings.offset else {}

    def head(self, remarks: Sequence[str], park: Mapping[str, float]) -> list[str]:
        """The lines up to the parking position, with the opening of the log."""
        name = self.settings.offset[0] if self.settings.offset else "G54"
        # 5021 to 5023: machine coordinates; 5041 to 5043: coordinates with the work offset
        checks = [
            f"IF[ABS[#{5021 + k}-#{5041 + k}-[{self.offset.get(axis, 0.0):.4f}]]GT{AT_START_MM}]GOTO{MISSED_N + 1}"
            for k, axis in enumerate("XYZ")
        ]
        return [
            "%",
            f"O{1 + self.sequence.plan_id % PROGRAMS:04d}",
            *(f"({plain(text)})" for text in remarks),
            "G21 G17 G90 G94",
            f"G40 G49 G80 {name}",
            "M5",
            "(GO ON WHEN THE PROBE IS READY AND THE PATH TO THE PARKING POSITION IS CLEAR)",
            "M0",
            *self.move(park, "PARKING POSITION"),
            *checks,
            "POPEN",
            f"#100={self.sequence.plan_id}.",
            "DPRNT[NCOMP*PLAN#100[50]]",
        ]

    def move(self, words: Mapping[str, float], remark: str) -> list[str]:
        """A straight move in machine coordinates."""
        own = {name: value - self.offset.get(name, 0.0) for name, value in words.items()}
        return [f"G1 {joined(own)} F{self.settings.feed:.1f}" + (f" ({plain(remark)})" if remark else "")]

    def touch(self, touch: Touch) -> list[str]:
        """Both touches of a contact, and its line in the log."""
        target = {name: touch.end[name] - self.offset.get(name, 0.0) for name in touch.back}
        end = joined(target)
        gap = "+".join(f"ABS[#{5061 + 'XYZ'.index(name)}-[{value:.4f}]]" for name, value in target.items())
        missed = f"IF[{gap}LT0.005]GOTO{MISSED_N}"
        found = [f"#{101 + k}=#{5061 + k}+#{5021 + k}-#{5041 + k}" for k in range(3)]
        return [
            f"G31 {end} F{self.settings.probing:.1f}",
            missed,
            f"G91 G1 {joined(touch.back)} F{self.settings.feed:.1f}",
            f"G90 G31 {end} F{self.settings.measuring:.1f}",
            missed,
            *found,
            f"#104={touch.row}.",
            f"#105={touch.number}.",
            "DPRNT[NCOMP*P#104[50]*T#105[20]*X#101[44]*Y#102[44]*Z#103[44]]",
        ]

    def end(self) -> list[str]:
        """The end of the log and of the program."""
        return [
            "PCLOS",
            "M30",
            f"N{MISSED_N}",
            "PCLOS",
            "#3000=1(NO CONTACT)",
            f"N{MISSED_N + 1} #3000=2(WORK OFFSET OR TOOL LENGTH)",
            "%",
        ]
