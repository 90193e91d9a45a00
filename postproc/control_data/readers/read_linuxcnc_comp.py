"""LinuxCNC: the INI file and the COMP_FILEs it names."""

from __future__ import annotations

import re
from collections.abc import Iterator

from kinematics.effects import Effect
from kinematics.user_error import UserError
from postproc.control import linuxcnc_ini
from postproc.control.linuxcnc_ini import IniFile, Line
from postproc.control_data.readers.control_source import Source, increasing, numbers, refusal

MOST_COMP_POINTS = 256
_JOINT = re.compile(r"JOINT_(0|[1-9]\d*)")

Rows = list[list[float]]


def read(source: Source) -> list[Effect]:
    """The table of every axis; lines that LinuxCNC would ignore without a message are refused."""
    ini = ini_of(source)
    own = source.in_units(*units_of(source, ini))
    joints = linuxcnc_ini.agreed(linuxcnc_ini.joint_letters(ini), source.settings.joints, ini, source.lettered)
    found: dict[str, tuple[Line, Rows]] = {}
    moved: dict[str, list[int]] = {}
    for number, line in _named(ini):
        if number >= len(joints):
            raise line.refusal(f"[JOINT_{number}] is not one of the joints {' '.join(joints)}")
        axis = joints[number]
        if axis not in source.machine.names:
            raise line.refusal(
                f"[JOINT_{number}] moves {axis} (the joints are {''.join(joints)}), and the machine has no such axis: "
                "give coordinates= of KINEMATICS in the INI file, or --set joints=, the letter of each joint"
            )
        rows = _corrections(source, ini, number, line)
        if axis in found and found[axis][1] != rows:
            raise line.refusal(f"another joint of {axis} has another table: {_RACKED}")
        found[axis] = line, rows
        moved.setdefault(axis, []).append(number)
    for axis, (line, _) in found.items():
        without = [n for n, letter in enumerate(joints) if letter == axis and n not in moved[axis]]
        if without:
            raise line.refusal(f"JOINT_{without[0]} moves {axis} as well, and has no table: {_RACKED}")
    return [table for axis, (_, rows) in found.items() for table in own.own(axis, rows)]


_RACKED = "the two ends of the axis are corrected differently, and ncomp has one table of an axis; give both the same"


def ini_of(source: Source) -> IniFile:
    """The INI file among the files; not one that another one includes."""
    names = [name for name in source.files if name.lower().endswith(".ini")]
    included = [name for each in names for name in IniFile(each, source.files).included] if len(names) > 1 else []
    name = source.only(".ini", "LinuxCNC", "the assignment of the tables to joints", included)
    ini = IniFile(name, source.files)
    source.used.update((name, *ini.included))
    return ini


def units_of(source: Source, ini: IniFile) -> tuple[float, float]:
    """The units of lengths, mm, and of angles, degrees, in the tables.

    Those of the INI file; where it states none, that of the machine file, and degrees. UserError where they differ.
    """
    stated, length = source.length_mm, linuxcnc_ini.length_unit_mm(ini)
    if length is not None and source.machine.control.unit and abs(length - stated) > 1e-6 * stated:
        line = ini.line("TRAJ", "LINEAR_UNITS")
        assert line is not None
        unit = source.machine.control.unit
        raise line.refusal(f'the machine file states unit = "{unit}" under [control]: correct one of them')
    if length is not None:
        source.with_unit.add(ini.name)
    return length or stated, linuxcnc_ini.angle_unit_deg(ini) or 1.0


def _named(ini: IniFile) -> Iterator[tuple[int, Line]]:
    """Number of each joint with a table, and the line that names it."""
    for section in ini.sections:
        lines = section.like("COMP_FILE")
        joint = _JOINT.fullmatch(section.name)
        if lines and joint is None:
            why = "LinuxCNC reads COMP_FILE in [JOINT_0], ..."
            raise lines[0].refusal(f"[{section.name}] is not one of the joints: {why}")
        line = ini.line(section.name, "COMP_FILE") if lines else None
        if line is not None and joint is not None:
            yield int(joint[1]), line


def _corrections(source: Source, ini: IniFile, joint: int, line: Line) -> Rows:
    """Position, and correction of each direction; UserError for a type that the numbers contradict."""
    file = line.text.partition("=")[2].strip()
    name = file.rsplit("/", 1)[-1]
    if name not in source.files:
        raise line.refusal(f"[JOINT_{joint}] names {file}, which is not among the files")
    source.used.add(name)
    kind = ini.value(f"JOINT_{joint}", "COMP_FILE_TYPE") or "0"
    if kind not in ("0", "1"):
        raise line.refusal(f"[JOINT_{joint}] COMP_FILE_TYPE {kind}: expected 0 or 1")
    values = _rows(name, source.files[name])
    differences = [[nominal, nominal - up, nominal - down] for nominal, up, down in values]
    rows, others = (differences, values) if kind == "0" else (values, differences)
    largest, smaller = (max(abs(value) for row in each for value in row[1:]) for each in (rows, others))
    if smaller < largest:
        raise UserError(
            f"{name}: with COMP_FILE_TYPE {kind} of [JOINT_{joint}] (0 where the entry is missing) its corrections "
            f"reach {largest:g}, with the other type {smaller:g}: correct the type, or the table"
        )
    return rows


def _rows(name: str, text: str) -> Rows:
    found: list[tuple[int, list[float]]] = []
    lines = text.rstrip().splitlines()
    for line, row in enumerate(lines, 1):
        words = row.split()
        if len(words) < 3:
            raise refusal(name, line, row, "expected three numbers: LinuxCNC stops reading at this line")
        found.append((line, numbers(words[:3], name, line, row)))
    if len(found) > MOST_COMP_POINTS:
        raise refusal(
            name, MOST_COMP_POINTS + 1, lines[MOST_COMP_POINTS], f"LinuxCNC reads at most {MOST_COMP_POINTS} rows"
        )
    if not found:
        raise UserError(f"{name}: the file has no rows")
    increasing(found, name)
    return [row for _, row in found]
