"""The NC program of a measuring plan: go to each position, dwell, stop where the target changes.

Positions are those of the axes. ncomp never corrects moves in machine coordinates (G53, M91), so such a program
measures the uncorrected machine. In a work offset ncomp corrects it as any other program: it measures the error after
correction.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal, Protocol

import numpy as np

from kinematics.machine import Machine
from kinematics.transforms import Array
from kinematics.user_error import UserError

DIALECTS = ("iso", "fanuc", "heidenhain")
TargetChange = Literal["M0", "M1"]


PATH_DWELL_S = 3.0
"""Dwell at the start of a path, where recording begins, and at its end, s."""


@dataclass(frozen=True)
class Visits:
    """Measuring sequence, one row per observation; mm and degrees."""

    machine: Machine
    positions: Array
    """Axis positions `(n, axes)`."""
    before: Array | None
    """Axis positions `(n, axes)` to pass before each position; nan for none."""
    names: Sequence[str]
    targets: Sequence[str]


@dataclass(frozen=True)
class Manner:
    """Feed, dwell, stops and coordinates of a measuring program."""

    feed: float = 2000.0
    """Feed, mm/min; degrees/min if only rotary axes move."""
    dwell_s: float = 3.0
    rapid: bool = False
    target_change: TargetChange = "M0"
    """M1 stops only if the operator selects it: for targets that are all mounted."""
    offset: tuple[str, Mapping[str, float]] | None = None
    """Name of the work offset or preset, and its values by axis, mm and degrees; None for machine coordinates."""


class Speech(Protocol):
    """The form of the program in a dialect."""

    def head(self, remarks: Sequence[str]) -> list[str]:
        """The lines before the first move, with remarks."""

    def move(self, words: Mapping[str, float], remark: str) -> str:
        """A straight move of all axes, mm and degrees by axis."""

    def dwell(self) -> list[str]:
        """The lines of a dwell."""

    def stop(self, code: str, remark: str) -> list[str]:
        """The lines of a stop for the operator, by M0 or M1."""

    def end(self) -> list[str]:
        """The lines at the end of the program."""


def measuring_program(visits: Visits, manner: Manner, dialect: str, title: str) -> Iterator[str]:
    """The lines of the program of a measuring sequence; UserError as by `speech_of`."""
    speech = speech_of(visits.machine, manner, dialect)
    offset = np.array([(manner.offset[1] if manner.offset else {}).get(name, 0.0) for name in visits.machine.names])
    yield from speech.head([*_remarks(visits, manner, title), *assumptions(dialect, manner)])
    target = None
    for i, (name, wanted) in enumerate(zip(visits.names, visits.targets, strict=True)):
        if wanted != target:
            code = "M0" if target is None else manner.target_change
            way = " AND THE WAY TO THE FIRST POSITION IS FREE" if target is None else ""
            yield from speech.stop(code, f"GO ON WHEN TARGET {wanted} IS READY{way}")
            target = wanted
        if visits.before is not None and not np.isnan(visits.before[i, 0]):
            yield speech.move(words_of(visits.machine, visits.before[i] - offset), "")
        if i == 0 or name != visits.names[i - 1] or not np.array_equal(visits.positions[i], visits.positions[i - 1]):
            yield speech.move(words_of(visits.machine, visits.positions[i] - offset), name)
        yield from speech.dwell()
    yield from speech.end()


def path_program(machine: Machine, corners: Array, manner: Manner, dialect: str, title: str) -> Iterator[str]:
    """The lines of the program along corners `(m, axes)`, mm and degrees; UserError as by `speech_of`."""
    manner = replace(manner, dwell_s=PATH_DWELL_S)
    speech = speech_of(machine, manner, dialect)
    offset = [(manner.offset[1] if manner.offset else {}).get(name, 0.0) for name in machine.names]
    yield from speech.head(
        [
            f"{title} - MACHINE {machine.name} - {len(corners)} CORNERS - FEED {manner.feed:g} MM/MIN",
            "RUN IT FROM START TO END ONCE FOR EACH TARGET - STATION AND FEED - RECORDING ALL THE TIME",
            "SPINDLE OFF - MOVES ARE STRAIGHT LINES FROM CORNER TO CORNER: TRY IT AT LOW OVERRIDE",
            *assumptions(dialect, manner),
        ]
    )
    yield from speech.stop("M0", "GO ON WHEN THE WAY TO THE FIRST CORNER IS FREE")
    yield speech.move(words_of(machine, corners[0] - offset), "START")
    yield from speech.stop("M0", "START RECORDING AND GO ON")
    yield from speech.dwell()
    for number, corner in enumerate(corners[1:], start=2):
        yield speech.move(words_of(machine, corner - offset), f"C{number}")
    yield from speech.dwell()
    yield from speech.end()


def assumptions(dialect: str, manner: Manner) -> list[str]:
    """Conditions that the program assumes of the control."""
    if manner.offset is None:
        code = "M91" if dialect == "heidenhain" else "G53 ON EVERY BLOCK"
        return [f"POSITIONS ARE MACHINE COORDINATES: {code}", "NCOMP DOES NOT CORRECT SUCH MOVES"]
    name, values = manner.offset
    said = " ".join(f"{axis}{value:g}" for axis, value in values.items()) or "0"
    which = f"PRESET {name}" if name.isdigit() else name
    return [
        f"POSITIONS COUNT FROM {which}, WHICH MUST BE {said}",
        "TOOL LENGTH MUST BE 0: POSITIONS ARE THOSE OF THE AXES",
    ]


def _remarks(visits: Visits, manner: Manner, title: str) -> list[str]:
    machine = visits.machine
    turns = " - DEG/MIN WHERE ONLY ROTARY AXES MOVE" if machine.rotary.any() else ""
    return [
        f"{title} - MACHINE {machine.name} - {len(visits.positions)} OBSERVATIONS",
        f"{'RAPID' if manner.rapid else f'FEED {manner.feed:g} MM/MIN{turns}'} - DWELL {manner.dwell_s:g} S AT EACH",
        "SPINDLE OFF - MOVES ARE STRAIGHT LINES FROM POINT TO POINT: TRY IT AT LOW OVERRIDE",
    ]


def words_of(machine: Machine, positions: Array) -> dict[str, float]:
    """Positions `(axes,)`, mm and degrees, by axis, rounded as they are written."""
    return dict(zip(machine.names, (np.round(positions, 4) + 0.0).tolist(), strict=True))


def speech_of(machine: Machine, manner: Manner, dialect: str) -> Speech:
    """The form of the program in a dialect; UserError if machine, dialect or `manner` do not allow a program."""
    for name in machine.names:
        if len(name) > 1:
            raise UserError(f"--nc: axis {name} has no word of its own in NC programs that ncomp writes")
    if machine.control.tcp_at_start and machine.rotary.any():
        raise UserError(
            f"--nc: the control of {machine.name} positions the tool point from the start (tcp_at_start); "
            "a plan gives positions of axes"
        )
    if dialect == "heidenhain":
        return _Klartext(manner)
    if dialect not in DIALECTS:
        raise UserError(f"--dialect {dialect}: expected one of {', '.join(DIALECTS)}")
    if dialect == "fanuc" and manner.offset is None:
        raise UserError(
            "--dialect fanuc: G53 of this control always moves in rapid; "
            "give the work offset that is active, --work-offset G54=x,y,z"
        )
    return _Iso(manner, dwell_word="X" if dialect == "fanuc" else "P")


@dataclass
class _Iso:
    """LinuxCNC, Fanuc."""

    manner: Manner
    dwell_word: str
    """P counts in s on LinuxCNC and in ms on Fanuc, where X counts in s."""

    def head(self, remarks: Sequence[str]) -> list[str]:
        """See `Speech`."""
        offset = [self.manner.offset[0]] if self.manner.offset else []
        return ["%", *(f"({_plain(text)})" for text in remarks), "G21 G17 G90 G94", "G40 G49 G80", *offset, "M5"]

    def move(self, words: Mapping[str, float], remark: str) -> str:
        """See `Speech`."""
        code = "G0" if self.manner.rapid else "G1"
        frame = "" if self.manner.offset else "G53 "
        targets = " ".join(f"{name}{value:.4f}" for name, value in words.items())
        feed = "" if self.manner.rapid else f" F{_number(self.manner.feed)}"
        return f"{frame}{code} {targets}{feed}" + (f" ({_plain(remark)})" if remark else "")

    def dwell(self) -> list[str]:
        """See `Speech`."""
        return [f"G4 {self.dwell_word}{_number(self.manner.dwell_s)}"]

    def stop(self, code: str, remark: str) -> list[str]:
        """See `Speech`."""
        return [f"({_plain(remark)})", code]

    def end(self) -> list[str]:
        """See `Speech`."""
        return ["M30", "%"]


@dataclass
class _Klartext:
    """Heidenhain Klartext with numbered blocks."""

    manner: Manner
    name: str = "PLAN"
    block: int = -1

    def head(self, remarks: Sequence[str]) -> list[str]:
        """See `Speech`."""
        start = [
            self._numbered(f"BEGIN PGM {self.name} MM"),
            *(self._numbered(f"; {_plain(text)}") for text in remarks),
        ]
        if self.manner.offset:
            preset = self.manner.offset[0]
            if not preset.isdigit():
                raise UserError(f"--work-offset {preset}=...: a Heidenhain control has presets by number, e.g. 1=x,y,z")
            start.append(self._numbered(f"CYCL DEF 247 DATUM SETTING ~\n  Q339=+{preset} ;DATUM NUMBER"))
        return [*start, self._numbered("M5")]

    def move(self, words: Mapping[str, float], remark: str) -> str:
        """See `Speech`."""
        targets = " ".join(f"{name}{value:+.4f}" for name, value in words.items())
        feed = "FMAX" if self.manner.rapid else f"F{self.manner.feed:g}"
        frame = "" if self.manner.offset else " M91"
        return self._numbered(f"L {targets} R0 {feed}{frame}" + (f" ; {_plain(remark)}" if remark else ""))

    def dwell(self) -> list[str]:
        """See `Speech`."""
        return [
            self._numbered("CYCL DEF 9.0 DWELL TIME"),
            self._numbered(f"CYCL DEF 9.1 DWELL {_number(self.manner.dwell_s)}"),
        ]

    def stop(self, code: str, remark: str) -> list[str]:
        """See `Speech`."""
        return [self._numbered(f"; {_plain(remark)}"), self._numbered("STOP" if code == "M0" else code)]

    def end(self) -> list[str]:
        """See `Speech`."""
        return [self._numbered("M30"), self._numbered(f"END PGM {self.name} MM")]

    def _numbered(self, text: str) -> str:
        self.block += 1
        return f"{self.block} {text}"


def _number(value: float) -> str:
    """A number with a decimal point; without one, some controls read it in units of their smallest increment."""
    return f"{value:.3f}".rstrip("0") if value != int(value) else f"{value:.1f}"


def _plain(text: str) -> str:
    """Text with only the characters that comments of all controls may have."""
    return re.sub(r"[^A-Z0-9 .,:+\-/=]", " ", text.upper()).strip()
