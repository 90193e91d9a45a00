"""`ncomp codes`: what the codes of a control mean to ncomp."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal

import ncomp
from kinematics.user_error import UserError
from postproc.commands.options.declared import MACHINE, argument, option
from postproc.commands.options.files import machine_file
from postproc.commands.options.shared import JsonFile, machine_names, provenance, whole_results, write_json
from rendering.report import Report, Section, Table

if TYPE_CHECKING:
    from postproc.code_tables.search import Codes

EPILOG = (
    "Examples:\n\n`ncomp codes G43.4`\n\n`ncomp codes spline`\n\n`ncomp codes G76 --family linuxcnc`\n\n"
    "`ncomp codes --dialect heidenhain`"
)
OptionalMachine = Annotated[
    str | None,
    option(
        "Machine whose file states the family of its control, and pass_through.",
        "NAME",
        "-m",
        default=None,
        complete=machine_names,
        reads=machine_file,
        panel=MACHINE,
    ),
]


def codes(
    *,
    text: tuple[str, ...] = argument(
        "A code (G43.4, CYCLE81, FN 18, cycle 200), or words of its meaning; without it all codes.",
        "TEXT",
        default=None,
    ),
    machine: OptionalMachine,
    family: Literal["any", "fanuc", "linuxcnc", "grbl", "mach3"] | None = option(
        "Family of ISO controls.", panel=MACHINE
    ),
    dialect: Literal["iso", "siemens", "heidenhain"] | None = option("One dialect only."),
    json: JsonFile,
) -> None:
    """List what codes mean to ncomp: followed, passed unchanged, or refused and why.

    The lists are those by which programs are read. A code that ncomp does not know is refused; --pass-through accepts
    one that moves nothing.
    """
    from postproc.commands.show.terminal import show

    if machine is not None and family is not None:
        raise UserError(f"--family {family}: the machine file states the family: leave --family or --machine out")
    searched, named = " ".join(text), None if machine is None else ncomp.load_machine(machine)
    found = ncomp.codes(searched, named, family=family, dialect=dialect)
    report = _report(found)
    with whole_results(json) as (file,):
        if json is not None:
            inputs = () if machine is None else (machine_file(machine),)
            write_json({**found.json(), "provenance": provenance(report.head, inputs)}, file)
    show(report, json)


def _report(found: Codes) -> Report:
    """The codes by dialect."""
    from postproc.code_tables.entries import ANY_OTHER, CONTROLS, VERDICTS

    sections = []
    for dialect, each in found.found.items():
        rows = [
            (
                code.entry.code,
                VERDICTS[code.entry.verdict],
                code.entry.meaning.replace("`", ""),
                code.only_with if code.entry.verdict != "refused" else "",
            )
            for code in each
        ]
        if rows or found.unknown:
            text = f"For {CONTROLS[dialect]}." + (f" {ANY_OTHER[dialect]}" if found.unknown or not found.text else "")
            head = ("code", "ncomp", "meaning, or reason", "only with family")
            sections.append(Section(dialect, text, Table(head, rows) if rows else None))
    verdict = ""
    if found.unknown:
        verdict = (
            f"{found.text}: in none of the lists. If it moves nothing and changes no mode on this control: "
            "--pass-through, or pass_through in the machine file."
        )
    elif not sections:
        verdict = f"No code has {found.text!r} in its name or its meaning."
    return Report("Codes", "", sections, verdict)
