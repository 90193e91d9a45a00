"""The program of a measurement on spheres: moves at the feed, touches, and a line in a log for each touch.

Positions are those of the axes. A touch is made twice: at the probing feed to find the surface, and at the measuring
feed, which counts. A control writes `NCOMP PLAN n`, and `NCOMP P row T touch X.. Y.. Z..` with the axis positions at
the contact, mm; LinuxCNC's PROBEOPEN writes nine numbers for each of both touches instead.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Protocol

import numpy as np

from kinematics.machine import Machine
from kinematics.transforms import Array
from kinematics.user_error import UserError
from postproc.probing.iso import Fanuc, LinuxCnc
from postproc.probing.klartext import Klartext, mask
from postproc.probing.sequence import SERVO_CYCLE_MS, ProbingSequence, ProbingSettings, Touch
from postproc.probing.siemens import Siemens

CONTROLS = ("linuxcnc", "fanuc", "heidenhain", "siemens")
NOT_TRIED = ("fanuc", "heidenhain", "siemens")
"""Controls on which no program of ncomp has run."""
PROBING_DECIMALS = 4


class ProbingFormat(Protocol):
    """The form of a program in a dialect."""

    def head(self, remarks: Sequence[str], park: Mapping[str, float]) -> list[str]:
        """The lines up to the parking position, the stop for the operator, and the opening of the log."""

    def move(self, words: Mapping[str, float], remark: str) -> list[str]:
        """A straight move of all axes."""

    def touch(self, touch: Touch) -> list[str]:
        """Both touches, and their line in the log; the tip stays at the contact."""

    def end(self) -> list[str]:
        """The lines at the end, with the stop for a touch without contact."""


def probing_program(sequence: ProbingSequence, settings: ProbingSettings, control: str, title: str) -> Iterator[str]:
    """The lines of the program; UserError for a machine or a control for which it cannot be written."""
    form = _form(sequence, settings, control)
    machine = sequence.machine
    words = [_words(machine, each) for each in sequence.positions]
    yield from form.head(_remarks(sequence, settings, control, title), words[0])
    row = 0
    for k in range(1, len(words)):
        name = sequence.rows[sequence.row[k] - 1] if sequence.row[k] != row else ""
        row = int(sequence.row[k])
        if sequence.touch[k]:
            yield from form.touch(
                _touch(machine, (row, int(sequence.touch[k])), words[k - 1], words[k], settings.back_mm)
            )
        else:
            yield from form.move(words[k], name)
    yield from form.end()


def mask_of(control: str, machine: Machine) -> str | None:
    """The mask of FN 16 by which a Heidenhain control writes its log; None for other controls."""
    return mask(machine) if control == "heidenhain" else None


def _form(sequence: ProbingSequence, settings: ProbingSettings, control: str) -> ProbingFormat:
    machine = sequence.machine
    if {"X", "Y", "Z"} - set(machine.names) or any(len(name) > 1 for name in machine.names):
        raise UserError("--nc: a probing program needs the axes X, Y and Z, and axes of one letter only")
    if machine.control.tcp_at_start:
        raise UserError(
            f"--nc: the control of {machine.name} positions the tool point from the start (tcp_at_start); a probing "
            "program needs axis positions"
        )
    if machine.control.family in ("grbl", "mach3") and control == "linuxcnc":
        raise UserError(
            f"--nc: {machine.control.family} has neither the variables nor the log that a probing program needs: probe "
            "by hand or by the sender, and write the positions into a measurement file"
        )
    forms: dict[str, Callable[[ProbingSequence, ProbingSettings], ProbingFormat]] = {
        "linuxcnc": LinuxCnc,
        "fanuc": Fanuc,
        "heidenhain": Klartext,
        "siemens": Siemens,
    }
    if control not in forms:
        raise UserError(f"--dialect {control}: for a probing program expected one of {', '.join(CONTROLS)}")
    if (settings.offset is None) == (control == "fanuc"):
        raise UserError(
            "a program for fanuc (--dialect, or family of the control): G53 of this control always moves in rapid; "
            "give the work offset that is active, --work-offset G54=x,y,z"
            if control == "fanuc"
            else f"--work-offset: a probing program for {control} uses machine coordinates"
        )
    return forms[control](sequence, settings)


def _touch(
    machine: Machine, number: tuple[int, int], start: dict[str, float], end: dict[str, float], back_mm: float
) -> Touch:
    linear = [axis.name for axis in machine.axes if not axis.rotary]
    path = np.array([end[name] - start[name] for name in linear])
    back = np.round(-path / np.linalg.norm(path) * back_mm, PROBING_DECIMALS) + 0.0
    return Touch(*number, start, end, dict(zip(linear, back.tolist(), strict=True)))


def _words(machine: Machine, positions: Array) -> dict[str, float]:
    return dict(zip(machine.names, (np.round(positions, PROBING_DECIMALS) + 0.0).tolist(), strict=True))


def _remarks(sequence: ProbingSequence, settings: ProbingSettings, control: str, title: str) -> list[str]:
    machine, touches = sequence.machine, int(np.count_nonzero(sequence.touch))
    way, u = settings.contact_um, settings.contact_um / 12.0**0.5  # uniform within a cycle
    untried = [f"NOT TRIED ON A CONTROL: CHECK IT BLOCK BY BLOCK BEFORE THE FIRST RUN - {control}"]
    return [
        f"{title} - MACHINE {machine.name} - PLAN {sequence.plan_id}",
        *(untried if control in NOT_TRIED else []),
        f"{len(sequence.rows)} CENTRES OF SPHERES - {touches} TOUCHES",
        f"FEED {settings.feed:g} - PROBING {settings.probing:g} - MEASURING {settings.measuring:g} MM/MIN"
        + (" - DEG/MIN WHERE ONLY ROTARY AXES MOVE" if machine.rotary.any() else ""),
        f"A CONTACT IS READ ONCE IN A SERVO CYCLE: AT {settings.measuring:g} MM/MIN AND {SERVO_CYCLE_MS:g} MS "
        f"{way:.2g} UM - U {u:.2g} UM - THE SCATTER OF THE CONTACTS HOLDS IT",
        "POSITIONS ARE AXIS POSITIONS - MM AND DEG - SIGNS BY ISO 841: TOOL RELATIVE TO WORKPIECE",
        "MOVES AVOID SPHERES - STEMS AND TABLE OF THE PLAN: CLAMPS AND HOUSING ARE NOT KNOWN",
        "SPINDLE OFF AND ORIENTED - TOOL LENGTH 0 - TRY IT AT LOW OVERRIDE WITH A HAND ON THE STOP",
    ]
