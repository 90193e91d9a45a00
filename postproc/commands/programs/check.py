"""`ncomp check`: what correcting a program would do to it."""

from __future__ import annotations

import typer

from postproc.commands.options.program import (
    DialectName,
    NoTravelCheck,
    Program,
    SetUpZero,
    ToolLengths,
    ToolTable,
    WorkOffsets,
    setup_of,
)
from postproc.commands.options.shared import JsonFile, MachineName, check_places, machine_of, result, write_json

EPILOG = "Examples:\n\n`ncomp check part.nc --machine dmu50`\n\n`ncomp check part.mpf --machine mill.toml --json -`"


def check(
    program: Program,
    machine: MachineName,
    dialect: DialectName = "auto",
    work_offset: WorkOffsets = None,
    tool_length: ToolLengths = None,
    tool_table: ToolTable = None,
    set_up_zero: SetUpZero = False,
    no_travel_check: NoTravelCheck = False,
    json: JsonFile = None,
) -> None:
    """Say what would be corrected in a program, what passes as it is, and every line that is refused, with the reason.

    Needs no calibration. Exit status 2 when the program is refused.
    """
    from postproc.commands.show.terminal import show_findings
    from postproc.correct.check import check as check_program
    from postproc.dialects import find_dialect
    from postproc.text.source import open_source

    check_places((program, *(tool_table or ())), (json,))
    found = machine_of(machine)
    source = open_source(program)
    setup = setup_of(found, work_offset, tool_length, tool_table, zero=set_up_zero)
    language = find_dialect(dialect, source.name, source.text_head)
    with result(json) as results:
        findings = check_program(source, language, found, setup, travel_check=not no_travel_check)
        write_json(findings.json(), results)
    show_findings(findings, source.name, to_errors=json == "-")
    if findings.refused:
        raise typer.Exit(2)
