"""`ncomp check`: the lines of a program that a correction would change, leave or refuse."""

from __future__ import annotations

import sys

import ncomp
from postproc.commands.options.program import NoTravelCheck, Program, SetUpOptions
from postproc.commands.options.shared import JsonFile, MachineName, check_files, result, write_json
from postproc.text.source import open_source

EPILOG = "Examples:\n\n`ncomp check part.nc --machine dmu50`\n\n`ncomp check part.mpf --machine mill.toml --json -`"


def check(
    *,
    program: Program,
    machine: MachineName,
    set_up: SetUpOptions,
    no_travel_check: NoTravelCheck,
    json: JsonFile,
) -> None:
    """List the lines of a program that would be corrected, that pass unchanged, and that are refused, with the reason.

    No calibration is needed. The exit status is 2 when the program is refused.
    """
    from postproc.commands.show.terminal import show

    check_files((program, *set_up.tool_table), {"--json": json})
    found = ncomp.load_machine(machine)
    source = open_source(program)
    setup = set_up.setup(found)
    with result(json) as results:
        findings = ncomp.check(source, found, dialect=set_up.dialect, setup=setup, travel_check=not no_travel_check)
        write_json(findings.json(), results)
    show(findings.report(source.name), json)
    if findings.refused:
        sys.exit(2)
