"""Logs of probing programs: the axis positions at each contact, by row of the plan.

A control writes `NCOMP PLAN n`, then `NCOMP P row T touch X.. Y.. Z..`, with rotary axes where it knows them.
LinuxCNC's PROBEOPEN writes nine numbers (X Y Z A B C U V W) for each touch: the first, quick one, and the second.
"""

from __future__ import annotations

import codecs
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibration.measurement.plan import Plan
from calibration.probing.touches import TOUCHES
from kinematics.files.mistaken import kind_of_file
from kinematics.machine import Machine
from kinematics.transforms import Array
from kinematics.user_error import UserError

LINUXCNC_AXES = "XYZABCUVW"
OFF_PLAN_DEG = 0.01
"""Largest difference of a rotary axis from its planned position, degrees."""
SECOND_MM = 0.5
"""Largest distance of both touches of LinuxCNC, mm."""
BLANK = " \t\0\x11\x12\x13\x14\x1a\x7f"
"""Blanks, and codes that a serial line puts around its lines: zeros, DC1 to DC4 (Fanuc's POPEN and PCLOS), end."""
_NUMBER = r"[+-]?\s*(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
_PLAN = re.compile(rf"NCOMP\s+PLAN\s*({_NUMBER})")
_TOUCH = re.compile(rf"NCOMP((?:\s*[A-Z]\s*{_NUMBER})+)")
_FIELD = re.compile(rf"([A-Z])\s*({_NUMBER})")


@dataclass(frozen=True)
class Contacts:
    """Contacts of a log: `m` whole rows of the plan with TOUCHES each."""

    row: np.ndarray
    """Number of the row `(m,)`, from 0."""
    positions: Array
    """Axis positions at the contacts `(m, TOUCHES, axes)`, mm and rad."""
    lines: np.ndarray
    """Line of the first contact of each row in the log `(m,)`."""
    notes: tuple[str, ...]


@dataclass(frozen=True)
class _Contact:
    """One contact with its line in the log."""

    line: int
    row: int
    touch: int
    values: dict[str, float]
    """Positions by axis, mm and degrees."""
    alone: bool = False
    """True for a contact of LinuxCNC with one line only: now and then it leaves one of two touches out."""


def log_text(data: bytes, source: str) -> str:
    """The text of a log, with or without a byte order mark; UserError for files that are no text, or another one."""
    if kind := kind_of_file(data):
        raise UserError(f"{source}: this is {kind}, no log: give the file that the probing program wrote")
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        raise UserError(f"{source} is UTF-16 text: save it as plain text (ASCII or UTF-8)")
    return data.decode("utf-8-sig", errors="replace")


def read_contacts(text: str, source: str, plan: Plan, plan_id: int | None) -> Contacts:
    """The contacts in the text of a log; UserError, with the line, for a text that is not the log of this plan."""
    lines = [(number, line.strip(BLANK)) for number, line in enumerate(text.splitlines(), start=1)]
    lines = [(number, line) for number, line in lines if line and line != "%"]
    notes = []
    if _is_cut_off([line for _, line in lines], text):
        notes.append(f"{source}, line {lines.pop()[0]}: the line is cut off, and not used")
    if not lines:
        raise UserError(f"{source}: the log is empty")
    with_names = any(line.upper().startswith("NCOMP") for _, line in lines)
    read = _named(lines, source, plan, plan_id) if with_names else _of_linuxcnc(lines, source)
    contacts = list(read)
    if with_names and not contacts:
        raise UserError(f"{source}: the log has no contact")
    found = _in_rows(contacts, source, plan)
    return replace(found, notes=(*notes, *found.notes))


def _is_cut_off(lines: Sequence[str], text: str) -> bool:
    """True where the text has no last line end, and its last number has fewer decimals than that of the line before.

    A contact of a copy that ended early would be wrong by some um to mm, without any other sign.
    """
    if len(lines) < 2 or text.rstrip(BLANK).endswith(("\n", "\r")):
        return False
    before, last = (re.findall(_NUMBER, line) for line in lines[-2:])
    return len(last) == len(before) > 0 and _decimals(last[-1]) < _decimals(before[-1])


def _decimals(number: str) -> int:
    return len(number.partition(".")[2])


def _expected(source: str, number: int, line: str, expected: str) -> UserError:
    """The refusal of a line that is none of a log, with a hint for decimal commas."""
    hint = "; write the decimal point as '.'" if re.search(r"\d,\d", line) else ""
    return UserError(f"{source}, line {number}: {line!r}: expected {expected}{hint}")


def _named(lines: Sequence[tuple[int, str]], source: str, plan: Plan, plan_id: int | None) -> Iterator[_Contact]:
    """Contacts of lines with fields."""
    names = {"P", "T", *plan.machine.names}
    for number, line in lines:
        where = f"{source}, line {number}"
        head = _PLAN.fullmatch(line.upper())
        if head:
            logged = round(_value(head[1]))
            if plan_id is not None and logged != plan_id:
                raise UserError(f"{where}: this is the log of plan {logged}, not of {plan_id}")
            continue
        if not _TOUCH.fullmatch(line.upper()):
            raise _expected(source, number, line, "NCOMP P row T touch X.. Y.. Z..")
        fields = [(name, _value(value)) for name, value in _FIELD.findall(line.upper().removeprefix("NCOMP"))]
        values = dict(fields)
        for name in values:
            if name not in names:
                raise UserError(f"{where}: {line!r}: field {name} is unknown; known are {', '.join(sorted(names))}")
        linear = [axis.name for axis in plan.machine.axes if not axis.rotary]
        missing = [name for name in ("P", "T", *linear) if name not in values]
        if missing or len(values) < len(fields):
            what = f"{missing[0]} is missing" if missing else "a field is given twice"
            raise UserError(f"{where}: {line!r}: {what}")
        row, touch = round(values.pop("P")), round(values.pop("T"))
        yield _Contact(number, row - 1, touch, values)


def _of_linuxcnc(lines: Sequence[tuple[int, str]], source: str) -> Iterator[_Contact]:
    """Contacts of PROBEOPEN: the second line of each touch."""
    read: list[tuple[int, dict[str, float]]] = []
    for number, line in lines:
        cells = line.split()
        try:
            values = [float(cell) for cell in cells]
        except ValueError:
            values = []
        if len(values) != len(LINUXCNC_AXES) or not np.isfinite(values).all():
            raise _expected(source, number, line, "the nine numbers of PROBEOPEN, or NCOMP P row T touch ...")
        read.append((number, dict(zip(LINUXCNC_AXES, values, strict=True))))
    groups: list[list[tuple[int, dict[str, float]]]] = []
    for number, at in read:
        last = groups[-1][-1][1] if groups else None
        if last is not None and np.linalg.norm([at[name] - last[name] for name in "XYZ"]) < SECOND_MM:
            groups[-1].append((number, at))
        else:
            groups.append([(number, at)])
    for k, group in enumerate(groups):
        if len(group) > 2:
            raise UserError(f"{source}, line {group[2][0]}: a third touch at the same contact: two are expected")
        number, at = group[-1]
        yield _Contact(number, k // TOUCHES, k % TOUCHES + 1, at, alone=len(group) == 1)


def _in_rows(contacts: Sequence[_Contact], source: str, plan: Plan) -> Contacts:
    """The contacts by row of the plan; UserError for contacts out of order or of another plan."""
    n = len(plan)
    for k, each in enumerate(contacts):
        where = f"{source}, line {each.line}"
        if (each.row, each.touch) != (k // TOUCHES, k % TOUCHES + 1):
            raise UserError(
                f"{where}: row {each.row + 1}, touch {each.touch}, but row {k // TOUCHES + 1}, touch {k % TOUCHES + 1} "
                "comes next"
            )
        if each.row >= n:
            raise UserError(f"{where}: the log has more contacts than the plan: is it the log of several runs?")
    whole = len(contacts) // TOUCHES
    positions = np.repeat(plan.positions[:whole, None], TOUCHES, axis=1)
    for each in contacts[: whole * TOUCHES]:
        _set(positions[each.row, each.touch - 1], each, source, plan.machine)
    if not whole:
        raise UserError(f"{source}: the log has no complete centre of {TOUCHES} touches")
    notes = [f"{source}, line {each.line}: this contact has one touch, not two" for each in contacts if each.alone]
    if len(notes) > len(contacts) / 10.0:
        raise UserError(f"{notes[0]}: {len(notes)} of {len(contacts)} contacts are like this")
    notes += [f"the log ends after {whole} of {n} centres"] if whole < n else []
    lines = np.array([contacts[k * TOUCHES].line for k in range(whole)])
    return Contacts(np.arange(whole), positions, lines, tuple(notes))


def _set(position: Array, contact: _Contact, source: str, machine: Machine) -> None:
    """Put the linear axes of a contact into a planned position `(axes,)`; UserError for other rotary positions."""
    for i, axis in enumerate(machine.axes):
        logged = contact.values.get(axis.name)
        if not axis.rotary:
            if logged is None:
                raise UserError(f"{source}, line {contact.line}: axis {axis.name} is missing")
            position[i] = logged
        elif logged is not None:
            planned = float(position[i] / machine.scale[i])
            off = (logged - planned + 180.0) % 360.0 - 180.0
            if abs(off) > OFF_PLAN_DEG:
                raise UserError(
                    f"{source}, line {contact.line}: {axis.name} is at {logged:g} deg, but the plan has {planned:g} "
                    f"deg in row {contact.row + 1}: is it the log of another plan?"
                )


def _value(text: str) -> float:
    return float(re.sub(r"\s", "", text))
