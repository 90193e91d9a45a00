"""`ncomp verify`: two programs in, the tool point's error before and after out."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import ncomp
from postproc.commands.options.declared import MODEL, argument, option
from postproc.commands.options.files import file_of_calibration
from postproc.commands.options.program import ConditionsOptions, DatumOptions, Program
from postproc.commands.options.shared import CalibrationName, MachineName, ResultOptions, whole_results
from postproc.text.source import open_source

EPILOG = (
    "Examples:\n\n`ncomp verify part.nc part_c.nc --machine dmu50 --json -`\n\n"
    "`ncomp verify part.nc part_c.nc --machine gantry --calibration new.json --old old.json`\n\n"
    "`ncomp verify part.nc part_c.nc --machine gantry --calibration cal.json --align after.json`  evaluates the "
    "correction by a calibration that was measured after the part was cut\n\n"
    "`ncomp verify part.nc part_c.nc --machine gantry --calibration new.json --accept calibration`  accepts a program "
    "that was corrected with another calibration"
)


@dataclass(frozen=True, kw_only=True)
class VerificationOptions:
    """Models and extent of the verification, by the names of the public interface."""

    PANEL: ClassVar[str] = MODEL

    old: str | None = option(
        "Earlier calibration, by which the errors are computed as well.", "CAL.json|none", reads=file_of_calibration
    )
    align: str | None = option(
        "Second calibration as the true errors: errors by its model, aligned at its own datum and by best fit.",
        "TRUE.json",
        reads=True,
    )
    classes: bool = option("Also show the errors that each choice of ISO/TR 16907 classes would leave.", default=False)
    tolerance_um: float = option(
        "Tolerance of the correction, um; an axis counts as reversed after more than half of it.",
        "um",
        default=1.0,
        min=0.0,
    )
    accept: str | None = option(
        "Differences to accept between verification and correction: calibration, set-up, datum.", "NAME,..."
    )


def verify(
    *,
    program: Program,
    corrected: str = argument("The corrected program.", "OUT.nc", reads=True),
    machine: MachineName,
    calibration: CalibrationName,
    options: VerificationOptions,
    set_up: DatumOptions,
    at: ConditionsOptions,
    others: ResultOptions,
) -> None:
    """Compute the tool point error of a program before and after correction, from the two texts by the exact model."""
    from postproc.commands.show.terminal import progress_of, say, say_assumed, show
    from postproc.verification.report import verification_report

    programs_and_models = (program, corrected, calibration, options.old, options.align)
    inputs = (*programs_and_models, *set_up.tool_table, at.log, at.log_columns)
    found = ncomp.load_machine(machine)
    model = ncomp.load_calibration(found, calibration)
    setup, conditions = set_up.setup_of(program, found), at.conditions()
    programs = open_source(program), open_source(corrected)
    with progress_of(sum(source.size for source in programs), "verifying") as progress:
        done = ncomp.verify(
            *programs,
            found,
            model,
            dialect=set_up.dialect,
            setup=setup,
            conditions=conditions,
            traced=others.report is not None,
            progress=progress,
            **vars(options),
        )
    for assumption in done.assumptions:
        say_assumed(assumption)
    for note in done.notes:
        say("note", note)
    report = verification_report(done, f"{Path(program).name} and {Path(corrected).name}", found)
    with whole_results(*others.files) as files:
        others.write(done.json(), report, files, inputs)
    show(report, *others.files)
