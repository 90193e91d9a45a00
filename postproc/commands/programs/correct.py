"""`ncomp correct`, the main command: a program in, the corrected program out."""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import dataclass

import ncomp
from postproc.commands.options.declared import option
from postproc.commands.options.program import (
    ConditionsOptions,
    DatumOptions,
    NoTravelCheck,
    Program,
)
from postproc.commands.options.shared import (
    CalibrationName,
    MachineName,
    ResultOptions,
    check_files,
    number_of_workers,
    whole_results,
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
    "-o part_c.nc`  accepts an old calibration, and positions outside the calibrated volume\n\n"
    "`ncomp part.nc --machine dmu50 -o part_c.nc --report part.html`  also writes a page of figures\n\n"
    "`ncomp - --machine gantry --calibration none < part.nc`  writes the program unchanged, byte for byte"
)


@dataclass(frozen=True, kw_only=True)
class CorrectionOptions:
    """Extent and limits of the correction, by the names of the public interface."""

    classes: str | None = option("ISO/TR 16907 classes of errors to correct; default: all but FOR.", "L-VOL,R-VOL,...")
    tolerance_um: float = option(
        "Largest deviation of a feed move from its path, um; moves that deviate more are split.",
        "um",
        default=1.0,
        min=0.0,
    )
    max_correction_um: float | None = option(
        "Largest correction of a linear axis, um; a program that needs more is refused. Default: twice the "
        "calibration's largest error, at most 500.",
        "um",
        min=0.0,
        max=5000.0,
    )
    accept: str | None = option(
        "Implausible conditions to accept: stale, future, temperature, outside, insignificant, worse (docs/safety.md).",
        "NAME,...",
    )
    unroll: bool = option("Write out loops and calls: each block as many times as it runs.", default=False)
    force: bool = option("Correct a program that ncomp has already corrected.", default=False)


def correct(
    *,
    program: Program,
    machine: MachineName,
    output: str | None = option("Corrected program; default: `-`, standard output.", "OUT.nc", "-o"),
    in_place: bool = option("Replace the input, and keep a backup IN.nc.orig beside it.", default=False),
    calibration: CalibrationName,
    set_up: DatumOptions,
    no_travel_check: NoTravelCheck,
    jobs: int | None = option(
        "Number of cores for a long program, which uses at most two; default: all of them.", "N", "-j", min=1
    ),
    correction: CorrectionOptions,
    at: ConditionsOptions,
    others: ResultOptions,
) -> None:
    """Correct a program: every block ends at its nominal position, by the machine's error model.

    Only coordinate words change. Blocks are added where long moves are split and where backlash is taken up, and a
    comment names machine and calibration. A program that ncomp does not fully understand is refused: exit status 2, no
    output.
    """
    from postproc.commands.show.terminal import progress_of, show
    from postproc.correct.report import correction_report

    target = target_of(program, output, in_place=in_place)
    check_files((calibration, *set_up.tool_table, at.log), {"--output": target, **others.by_option})
    check_files((program,), others.by_option)
    found = ncomp.load_machine(machine)
    model = ncomp.load_calibration(found, calibration)
    source = open_source(program)
    known = source.hash
    setup, conditions = set_up.setup(found), at.conditions()
    with (
        progress_of(source.size, "correcting") as progress,
        backup_of(program, known) if in_place else nullcontext(),
        whole_results(*others.files, target) as (results, page, file),
    ):
        done = ncomp.correct(
            source,
            found,
            model,
            dialect=set_up.dialect,
            setup=setup,
            conditions=conditions,
            travel_check=not no_travel_check,
            output=file,
            progress=progress,
            traced=others.report is not None,
            jobs=number_of_workers(jobs, None, "--jobs"),
            **vars(correction),
        )
        command = f"ncomp {program} --machine {machine} -o {target}"
        shown = correction_report(done.job, done.report, done.trace, command)
        others.write(done.report.json(), shown, (results, page))
    show(shown, "-")
