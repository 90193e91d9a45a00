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

DIALECTS = ("iso", "fanuc", "heidenhain", "siemens")
TargetChange = Literal["M0", "M1"]


PATH_DWELL_S = 3.0
"""Dwell at the start of a path, where recording begins, and at its end, s."""


@dataclass(frozen=True)
class MeasuringSequence:
    """Measuring sequence, one row per observation; mm and degrees."""

    machine: Machine
    positions: Array
    """Axis positions `(n, axes)`."""
    before: Array | None
    """Axis positions `(n, axes)` to pass before each position; nan for none."""
    names: Sequence[str]
    targets: Sequence[str]
    stations: Sequence[str] = ()
    """Station of the instrument for each observation; empty where it stands at one."""


@dataclass(frozen=True)
class ProgramSettings:
    """Feed, dwell, stops and coordinates of a measuring program."""

    feed: float = 2000.0
    """Feed, mm/min; degrees/min if only rotary axes move."""
    dwell_s: float = 3.0
    rapid: bool = False
    target_change: TargetChange = "M0"
    """M1 stops only if the operator selects it: for targets that are all mounted."""
    offset: tuple[str, Mapping[str, float]] | None = None
    """Name of the work offset or preset, and its values by axis, mm and degrees; None for machine coordinates."""

    def offset_of(self, machine: Machine) -> Array:
        """Values `(axes,)` of the work offset, mm and degrees; 0 for machine coordinates."""
        values = self.offset[1] if self.offset else {}
        return np.array([values.get(name, 0.0) for name in machine.names])


class ProgramFormat(Protocol):
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


def measuring_program(
    sequence: MeasuringSequence, settings: ProgramSettings, dialect: str, title: str
) -> Iterator[str]:
    """The lines of the program of a measuring sequence; UserError as by `program_format`."""
    machine, positions = sequence.machine, sequence.positions
    form, offset = program_format(machine, settings, dialect), settings.offset_of(machine)
    yield from form.head([*_remarks(sequence, settings, title), *assumptions(dialect, settings)])
    mounted = station = None
    for i, (name, target) in enumerate(zip(sequence.names, sequence.targets, strict=True)):
        here = sequence.stations[i] if sequence.stations else None
        if (here, target) != (station, mounted):
            first = mounted is None or here != station
            code = "M0" if first else settings.target_change
            path = " AND THE PATH TO THE FIRST POSITION IS CLEAR" if first else ""
            ready = f"TARGET {target} IS READY" if here is None else f"STATION {here} AND TARGET {target} ARE READY"
            yield from form.stop(code, f"GO ON WHEN {ready}{path}")
            mounted, station = target, here
        if sequence.before is not None and not np.isnan(sequence.before[i, 0]):
            yield form.move(axis_words(machine, sequence.before[i] - offset), "")
        if i == 0 or name != sequence.names[i - 1] or not np.array_equal(positions[i], positions[i - 1]):
            yield form.move(axis_words(machine, positions[i] - offset), name)
        yield from form.dwell()
    yield from form.end()


def path_program(machine: Machine, corners: Array, settings: ProgramSettings, dialect: str) -> Iterator[str]:
    """The lines of the program along corners `(m, axes)`, mm and degrees; UserError as by `program_format`."""
    settings = replace(settings, dwell_s=PATH_DWELL_S)
    form, offset = program_format(machine, settings, dialect), settings.offset_of(machine)
    yield from form.head(
        [
            f"ncomp path to be measured on the fly - MACHINE {machine.name} - {len(corners)} CORNERS - FEED "
            f"{settings.feed:g} MM/MIN",
            "RUN IT FROM START TO END ONCE FOR EACH TARGET - STATION AND FEED - RECORDING ALL THE TIME",
            "SPINDLE OFF - MOVES ARE STRAIGHT LINES FROM CORNER TO CORNER: TRY IT AT LOW OVERRIDE",
            *assumptions(dialect, settings),
        ]
    )
    yield from form.stop("M0", "GO ON WHEN THE PATH TO THE FIRST CORNER IS CLEAR")
    yield form.move(axis_words(machine, corners[0] - offset), "START")
    yield from form.stop("M0", "START RECORDING AND GO ON")
    yield from form.dwell()
    for number, corner in enumerate(corners[1:], start=2):
        yield form.move(axis_words(machine, corner - offset), f"C{number}")
    yield from form.dwell()
    yield from form.end()


def assumptions(dialect: str, settings: ProgramSettings) -> list[str]:
    """Conditions that the program assumes of the control."""
    if settings.offset is None:
        code = {"heidenhain": "M91", "siemens": "SUPA"}.get(dialect, "G53")
        return [f"POSITIONS ARE MACHINE COORDINATES: {code} ON EVERY BLOCK", "NCOMP DOES NOT CORRECT SUCH MOVES"]
    name, values = settings.offset
    numbers = " ".join(f"{axis}{value:g}" for axis, value in values.items()) or "0"
    which = f"PRESET {name}" if name.isdigit() else name
    return [
        f"POSITIONS COUNT FROM {which}, WHICH MUST BE {numbers}",
        "TOOL LENGTH MUST BE 0: POSITIONS ARE THOSE OF THE AXES",
    ]


def _remarks(sequence: MeasuringSequence, settings: ProgramSettings, title: str) -> list[str]:
    machine = sequence.machine
    turns = " - DEG/MIN WHERE ONLY ROTARY AXES MOVE" if machine.rotary.any() else ""
    feed = "RAPID" if settings.rapid else f"FEED {settings.feed:g} MM/MIN{turns}"
    return [
        f"{title} - MACHINE {machine.name} - {len(sequence.positions)} OBSERVATIONS",
        f"{feed} - DWELL {settings.dwell_s:g} S AT EACH",
        "SPINDLE OFF - MOVES ARE STRAIGHT LINES FROM POINT TO POINT: TRY IT AT LOW OVERRIDE",
    ]


def axis_words(machine: Machine, positions: Array) -> dict[str, float]:
    """Positions `(axes,)`, mm and degrees, by axis, rounded as they are written."""
    return dict(zip(machine.names, (np.round(positions, 4) + 0.0).tolist(), strict=True))


def program_format(machine: Machine, settings: ProgramSettings, dialect: str) -> ProgramFormat:
    """The form of the program in a dialect; UserError if machine, dialect or `settings` do not allow a program."""
    for name in machine.names:
        if len(name) > 1:
            raise UserError(f"--nc: ncomp writes axes of one letter only, and the machine has the axis {name}")
    if machine.control.tcp_at_start and machine.rotary.any():
        raise UserError(
            f"--nc: the control of {machine.name} positions the tool point from the start (tcp_at_start); "
            "a plan gives axis positions, which such a control does not accept"
        )
    if dialect == "heidenhain":
        return _Klartext(settings)
    if dialect == "siemens":
        return _Siemens(settings)
    if dialect not in DIALECTS:
        raise UserError(f"--dialect {dialect}: expected one of {', '.join(DIALECTS)}")
    if dialect == "fanuc" and settings.offset is None:
        raise UserError(
            "a program for fanuc (--dialect, or family of the control): G53 of this control always moves in rapid; "
            "give the work offset that is active, --work-offset G54=x,y,z"
        )
    return _Iso(settings, dwell_word="X" if dialect == "fanuc" else "P")


@dataclass
class _Iso:
    """LinuxCNC, Fanuc."""

    settings: ProgramSettings
    dwell_word: str
    """P counts in s on LinuxCNC and in ms on Fanuc, where X counts in s."""

    def head(self, remarks: Sequence[str]) -> list[str]:
        """The lines before the first move; UserError for a work offset that is no G code."""
        offset = [self.settings.offset[0]] if self.settings.offset else []
        if offset and not re.fullmatch(r"G5[4-9](\.\d)?(P\d+)?|G154P\d+", offset[0]):
            raise UserError(f"--work-offset {offset[0]}=...: this control has work offsets by G code, e.g. G54=x,y,z")
        return ["%", *(f"({plain(text)})" for text in remarks), "G21 G17 G90 G94", "G40 G49 G80", *offset, "M5"]

    def move(self, words: Mapping[str, float], remark: str) -> str:
        code = "G0" if self.settings.rapid else "G1"
        frame = "" if self.settings.offset else "G53 "
        targets = " ".join(f"{name}{value:.4f}" for name, value in words.items())
        feed = "" if self.settings.rapid else f" F{_number(self.settings.feed)}"
        return f"{frame}{code} {targets}{feed}" + (f" ({plain(remark)})" if remark else "")

    def dwell(self) -> list[str]:
        return [f"G4 {self.dwell_word}{_number(self.settings.dwell_s)}"]

    def stop(self, code: str, remark: str) -> list[str]:
        return [f"({plain(remark)})", code]

    def end(self) -> list[str]:
        return ["M30", "%"]


@dataclass
class _Siemens:
    """Siemens 840D: SUPA suppresses all frames for its block, and D0 the tool length."""

    settings: ProgramSettings

    def head(self, remarks: Sequence[str]) -> list[str]:
        """The lines before the first move; UserError for a work offset that this control does not have."""
        start = [*(f"; {plain(text)}" for text in remarks), "G71 G17 G90 G94", "G40 TRAFOOF D0"]
        if self.settings.offset:
            name = self.settings.offset[0]
            if not re.fullmatch(r"G5(4|5|6|7|0[5-9]|[1-9]\d)", name):
                raise UserError(f"--work-offset {name}=...: a Siemens control has G54 to G57 and G505 to G599")
            start.append(name)
        return [*start, "M5"]

    def move(self, words: Mapping[str, float], remark: str) -> str:
        frame = "" if self.settings.offset else "SUPA "
        targets = " ".join(f"{name}{value:.4f}" for name, value in words.items())
        code, feed = ("G0", "") if self.settings.rapid else ("G1", f" F{self.settings.feed:g}")
        return f"{frame}{code} {targets}{feed}" + (f" ; {plain(remark)}" if remark else "")

    def dwell(self) -> list[str]:
        return [f"G4 F{self.settings.dwell_s:g}"]

    def stop(self, code: str, remark: str) -> list[str]:
        return [f"; {plain(remark)}", code]

    def end(self) -> list[str]:
        return ["M30"]


@dataclass
class _Klartext:
    """Heidenhain Klartext with numbered blocks."""

    settings: ProgramSettings
    name: str = "PLAN"
    block: int = -1

    def head(self, remarks: Sequence[str]) -> list[str]:
        """The lines before the first move: name of the program, remarks, preset; UserError for a preset by name."""
        start = [
            self._numbered(f"BEGIN PGM {self.name} MM"),
            *(self._numbered(f"; {plain(text)}") for text in remarks),
        ]
        if self.settings.offset:
            preset = self.settings.offset[0]
            if not preset.isdigit():
                raise UserError(f"--work-offset {preset}=...: a Heidenhain control has presets by number, e.g. 1=x,y,z")
            start.append(self._numbered(f"CYCL DEF 247 DATUM SETTING ~\n  Q339=+{preset} ;DATUM NUMBER"))
        return [*start, self._numbered("M5")]

    def move(self, words: Mapping[str, float], remark: str) -> str:
        targets = " ".join(f"{name}{value:+.4f}" for name, value in words.items())
        feed = "FMAX" if self.settings.rapid else f"F{self.settings.feed:g}"
        frame = "" if self.settings.offset else " M91"
        return self._numbered(f"L {targets} R0 {feed}{frame}" + (f" ; {plain(remark)}" if remark else ""))

    def dwell(self) -> list[str]:
        return [
            self._numbered("CYCL DEF 9.0 DWELL TIME"),
            self._numbered(f"CYCL DEF 9.1 DWELL {_number(self.settings.dwell_s)}"),
        ]

    def stop(self, code: str, remark: str) -> list[str]:
        return [self._numbered(f"; {plain(remark)}"), self._numbered("STOP" if code == "M0" else code)]

    def end(self) -> list[str]:
        return [self._numbered("M30"), self._numbered(f"END PGM {self.name} MM")]

    def _numbered(self, text: str) -> str:
        self.block += 1
        return f"{self.block} {text}"


def _number(value: float) -> str:
    """A number with a decimal point; without one, some controls read it in units of their smallest increment."""
    return f"{value:.3f}".rstrip("0") if value != int(value) else f"{value:.1f}"


def plain(text: str) -> str:
    """Text with only the characters that comments of all controls may have."""
    return re.sub(r"[^A-Z0-9 .,:+\-/=]", " ", text.upper()).strip()
