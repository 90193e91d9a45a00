"""`ncomp correct`, the main command: a program in, the corrected program out."""

from __future__ import annotations

from contextlib import nullcontext
from typing import Annotated

import typer

import ncomp
from postproc.commands.options.program import (
    ConditionsOptions,
    DatumOptions,
    DialectName,
    NoTravelCheck,
    Program,
)
from postproc.commands.options.shared import (
    CalibrationName,
    JsonFile,
    MachineName,
    check_apart,
    check_places,
    refuse_one_place,
    whole_results,
    write_json,
)
from postproc.commands.programs.in_place import backup_of, target_of
from postproc.text.source import open_source

EPILOG = (
    "Examples:\n\n"
    "`ncomp part.nc --machine dmu50 -o part_c.nc`\n\n"
    "`ncomp part.h --machine mill.toml --calibration cal.json --work-offset 1=12.5,-80,210 --tool-length T5=96.3 "
    "-o part_c.h`\n\n"
    "`ncomp part.nc --machine mill.toml --calibration cal.json --temperature spindle=31.5 --elapsed 3600 "
    "-o part_c.nc`\n\n"
    "`ncomp part.nc --machine mill.toml --calibration cal.json --max-correction-um 80 --accept stale,outside "
    "-o part_c.nc`  although the calibration is old and the part reaches beyond it\n\n"
    "`ncomp part.nc --machine dmu50 -o part_c.nc --report part.html`  with a page of figures to look at\n\n"
    "`ncomp - --machine gantry --calibration none < part.nc`  reads the program and writes it back, byte for byte"
)

ClassNames = Annotated[
    str | None,
    typer.Option("--classes", metavar="L-VOL,R-VOL,...", help="ISO/TR 16907 classes; default: all but FOR."),
]
Tolerance = Annotated[
    float,
    typer.Option("--tolerance-um", min=0.0, help="Split feed moves that would deviate more between their ends."),
]
MaxCorrection = Annotated[
    float | None,
    typer.Option(
        "--max-correction-um",
        metavar="N",
        min=0.0,
        max=5000.0,
        help="Refuse larger corrections of linear axes; default: twice the calibration's largest error, at most 500.",
    ),
]
Accept = Annotated[
    str | None,
    typer.Option(
        "--accept",
        metavar="NAME,...",
        help="Go on although it is not plausible: stale, future, temperature, outside, insignificant, worse "
        "(docs/safety.md).",
    ),
]


def correct(
    *,
    program: Program,
    machine: MachineName,
    output: Annotated[
        str | None,
        typer.Option("--output", "-o", metavar="OUT.nc", help="Corrected program; default: - for standard output."),
    ] = None,
    in_place: Annotated[
        bool, typer.Option("--in-place", help="Replace the input; a backup IN.nc.orig stays beside it.")
    ] = False,
    calibration: CalibrationName = None,
    dialect: DialectName = "auto",
    set_up: DatumOptions,
    no_travel_check: NoTravelCheck = False,
    classes: ClassNames = None,
    tolerance_um: Tolerance = 1.0,
    at: ConditionsOptions,
    max_correction_um: MaxCorrection = None,
    accept: Accept = None,
    unroll: Annotated[
        bool, typer.Option("--unroll", help="Write loops and calls out: every block as often as it runs.")
    ] = False,
    force: Annotated[bool, typer.Option("--force", help="Correct a program that ncomp has corrected already.")] = False,
    json: JsonFile = None,
    report: Annotated[
        str | None, typer.Option("--report", metavar="FILE.html", help="Page with figures; - for standard output.")
    ] = None,
) -> None:
    """Correct a program: every block ends at its nominal position, by the machine's error model.

    Only coordinate words change. Blocks are added where long moves are split and where backlash is taken up, and a
    comment names machine and calibration. A program that ncomp does not fully understand is refused: exit status 2, no
    output.
    """
    from postproc.commands.show.terminal import progress_of, show_report
    from postproc.correct.plausibility import parse_accepted

    target = target_of(program, output, in_place=in_place)
    refuse_one_place(json, target, "the program")
    check_apart({"--output": target, "--json": json, "--report": report})
    check_places((program, calibration, *set_up.files, at.log), (json, report))
    check_places((calibration, *set_up.files, at.log), (target,))
    parse_accepted(accept)
    found = ncomp.load_machine(machine)
    model = ncomp.load_calibration(found, calibration)
    source = open_source(program)
    known = source.hash
    setup = set_up.setup(found)
    conditions = at.conditions()
    with (
        progress_of(source.size, "correcting") as progress,
        backup_of(program, known) if in_place else nullcontext(),
        whole_results(json, report, target) as (results, page, file),
    ):
        done = ncomp.correct(
            source,
            found,
            model,
            dialect=dialect,
            setup=setup,
            conditions=conditions,
            classes=classes,
            tolerance_um=tolerance_um,
            max_correction_um=max_correction_um,
            accept=accept,
            travel_check=not no_travel_check,
            unroll=unroll,
            force=force,
            output=file,
            progress=progress,
            traced=report is not None,
        )
        write_json(done.report.json(), results)
        if done.trace is not None:
            from postproc.commands.show.job_page import job_page

            command = f"ncomp {program} --machine {machine} -o {target}"
            page.write(job_page(done.job, done.report, done.trace, command))
    show_report(done.report)
