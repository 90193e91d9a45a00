"""`ncomp check`: the lines of a program that a correction would change, leave or refuse."""

from __future__ import annotations

import sys
from pathlib import Path

from msgspec.structs import replace

import ncomp
from postproc.commands.options.program import NoTravelCheck, OptionalProgram, SetUpOptions
from postproc.commands.options.shared import MachineName, ResultOptions, whole_results
from postproc.commands.programs.check_kinematics import KinematicsOptions
from postproc.text.source import open_source

EPILOG = (
    "Examples:\n\n`ncomp check part.nc --machine dmu50`\n\n`ncomp check part.mpf --machine mill.toml --json -`\n\n"
    "`ncomp check --machine mill.toml --control-kinematics kinematics.hal --cam-kinematics cam.toml`  compares pivots "
    "and signs"
)


def check(
    *,
    program: OptionalProgram,
    machine: MachineName,
    set_up: SetUpOptions,
    no_travel_check: NoTravelCheck,
    kinematics: KinematicsOptions,
    others: ResultOptions,
) -> None:
    """List the lines of a program that would be corrected, that pass unchanged, and that are refused, with the reason.

    No calibration is needed. The exit status is 2 when the program is refused. Without a program, the lines of the
    rotary axes are compared: those of the machine file, of a calibration, of the control and of the CAM system.
    """
    if program is None or kinematics.given:
        kinematics.compare(machine, program, others)
    else:
        _check_program(program, machine, set_up, others, travel_check=not no_travel_check)


def _check_program(
    program: str, machine: str, set_up: SetUpOptions, others: ResultOptions, *, travel_check: bool
) -> None:
    """List the lines of a program by what would be done with them."""
    from postproc.commands.show.terminal import show

    inputs: tuple[str | Path, ...] = (program, *set_up.tool_table)
    found = ncomp.load_machine(machine)
    source = open_source(program)
    setup = set_up.setup_of(program, found)
    with whole_results(*others.files) as files:
        findings = ncomp.check(source, found, dialect=set_up.dialect, setup=setup, travel_check=travel_check)
        report = replace(findings.report(source.name), head=found.report.filled(machine=found.name))
        others.write(findings.json(), report, files, inputs)
    show(report, *others.files)
    if findings.refused:
        sys.exit(2)
