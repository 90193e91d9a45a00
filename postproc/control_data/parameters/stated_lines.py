"""The lines of rotary axes that a file states: a machine file, or the kinematic parameters of a control."""

from __future__ import annotations

import itertools
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from kinematics.machine import Machine
from kinematics.user_error import UserError
from postproc.control.codes import UNIT_NAMES
from postproc.control_data.format import parse_settings
from postproc.control_data.parameters.parameter_format import ParameterFormat
from postproc.control_data.readers.control_source import Source

SIGNS = {
    "linuxcnc-kinematics": re.compile(r"\b(xyz[ab]c-trt-kins|5axiskins)\."),
    "siemens-trafo5": re.compile(r"\$MC_TRAFO5_\w+?_(?P<transformation>\d+)\["),
    "siemens-tcarr": re.compile(r"\$TC_CARR\d+\[(?P<record>\d+)\]"),
    "heidenhain-transformations": re.compile(r"(?m)^\s*Trans\b|\bKEY\b.*\bCOORD\b"),
    "fanuc-kinematics": re.compile(r"\b1970[0-9]\b"),
}
"""What shows the format of a file, with the settings that its names contain."""
BEFORE = "_before."
"""What ncomp export adds to the name of a file with the values before."""
CONVENTIONAL = re.compile(r"conventional-directions\s*=?\s*(1|true|yes)\b", re.IGNORECASE)
"""LinuxCNC: the pin by which the axes turn by ISO 841."""


def stated_lines(machine: Machine, paths: Sequence[Path]) -> Machine:
    """The machine with the lines and senses of rotation of files.

    UserError for files of a kind that ncomp does not read, and of a machine with other axes.
    """
    from postproc.control_data.imported import texts_in

    name = ", ".join(map(str, paths))
    if any(path.suffix.lower() == ".toml" for path in paths):
        return _of_machine_file(machine, paths)
    texts, _ = texts_in(paths)
    if both := [before for before in texts if before != (after := before.replace(BEFORE, ".")) and after in texts]:
        raise UserError(
            f"{name} has the values before an export and those of the export, {both[0]} and "
            f"{both[0].replace(BEFORE, '.')}: give the file whose values are in the control"
        )
    found = {key: match for key, sign in SIGNS.items() for text in texts.values() if (match := sign.search(text))}
    if not found:
        raise UserError(
            f"{name}: no kinematics that ncomp reads: a machine file (.toml), lines setp of a HAL file, $MC_TRAFO5_... "
            "or $TC_CARR... of Siemens, rows Trans of HEIDENHAIN, or numbers 19700 to 19714 of FANUC"
        )
    key, match = next(iter(found.items()))
    settings = [f"{setting}={value}" for setting, value in match.groupdict().items()]
    if key == "linuxcnc-kinematics" and any(CONVENTIONAL.search(text) for text in texts.values()):
        settings = ["conventional=true"]
    return _read(machine, key, texts, settings)


def _of_machine_file(machine: Machine, paths: Sequence[Path]) -> Machine:
    from machines.given import load_machine

    if len(paths) != 1:
        raise UserError(f"{', '.join(map(str, paths))}: a machine file is given alone")
    found = load_machine(paths[0])
    if found.names != machine.names or found.chain != machine.chain:
        raise UserError(
            f"{paths[0]}: its chain is {found.chain}, and that of {machine.name} is {machine.chain}: compare machines "
            "with the same axes in the same order"
        )
    return found


def _read(machine: Machine, key: str, texts: Mapping[str, str], settings: Sequence[str]) -> Machine:
    """The lines by a format, for the senses of rotation that the file has: few of them differ from the machine's."""
    from postproc.control_data.formats import find_format

    form = find_format(key, ParameterFormat)
    texts = {name.replace(BEFORE, "."): text for name, text in texts.items()}
    rotary = [axis.name for axis in machine.axes if axis.rotary]
    fault: UserError | None = None
    choices = itertools.product((False, True), repeat=len(rotary))
    for turned in sorted(choices, key=sum):
        other = {name for name, differs in zip(rotary, turned, strict=True) if differs}
        own = _turned(machine, other)
        chosen = parse_settings(form.settings, settings)
        length = UNIT_NAMES[form.unit(chosen, machine.control)]
        try:
            return form.lines_in(Source(own, texts, "correction", chosen, length_mm=length))[0]
        except UserError as refused:
            fault = fault or refused
    assert fault is not None
    raise fault


def _turned(machine: Machine, names: set[str]) -> Machine:
    """The machine with some axes that turn the other way."""
    axes = []
    for axis in machine.axes:
        x, y, z = axis.direction
        axes.append(replace(axis, direction=(-x, -y, -z)) if axis.name in names else axis)
    return replace(machine, axes=tuple(axes))
