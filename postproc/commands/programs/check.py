"""`ncomp check`: the lines of a program that a correction would change, leave or refuse."""

from __future__ import annotations

import sys
from pathlib import Path

from msgspec.structs import replace

import ncomp
from postproc.commands.options.program import NoTravelCheck, Program, SetUpOptions
from postproc.commands.options.shared import MachineName, ResultOptions, whole_results
from postproc.text.source import open_source

EPILOG = "Examples:\n\n`ncomp check part.nc --machine dmu50`\n\n`ncomp check part.mpf --machine mill.toml --json -`"


def check(
    *,
    program: Program,
    machine: MachineName,
    set_up: SetUpOptions,
    no_travel_check: NoTravelCheck,
    others: ResultOptions,
) -> None:
    """List the lines of a program that would be corrected, that pass unchanged, and that are refused, with the reason.

    No calibration is needed. The exit status is 2 when the program is refused.
    """
    from postproc.commands.show.terminal import show

    inputs: tuple[str | Path, ...] = (program, *set_up.tool_table)
    found = ncomp.load_machine(machine)
    source = open_source(program)
    setup = set_up.setup_of(program, found)
    with whole_results(*others.files) as files:
        findings = ncomp.check(source, found, dialect=set_up.dialect, setup=setup, travel_check=not no_travel_check)
        report = replace(findings.report(source.name), head=found.report.filled(machine=found.name))
        others.write(findings.json(), report, files, inputs)
    show(report, *others.files)
    if findings.refused:
        sys.exit(2)
