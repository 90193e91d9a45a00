"""`ncomp verify`: two programs in, the tool point's error before and after out."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import ncomp
from kinematics.user_error import UserError
from postproc.commands.options.declared import MODEL, argument, option
from postproc.commands.options.files import file_of_calibration
from postproc.commands.options.program import ConditionsOptions, DatumOptions, Program
from postproc.commands.options.shared import CalibrationName, OptionalMachine, ResultOptions, whole_results
from postproc.text.source import open_source

if TYPE_CHECKING:
    from kinematics.machine import Machine
    from postproc.verification.verify_programs import Verification

EPILOG = (
    "Examples:\n\n`ncomp verify part.nc part_c.nc --machine dmu50 --json -`\n\n"
    "`ncomp verify part.nc part_c.nc --machine gantry --calibration new.json --old old.json`\n\n"
    "`ncomp verify part.nc part_c.nc --machine gantry --calibration cal.json --align after.json`  evaluates the "
    "correction by a calibration that was measured after the part was cut\n\n"
    "`ncomp verify part.nc part_c.nc --machine gantry --calibration new.json --accept calibration`  accepts a program "
    "that was corrected with another calibration\n\n"
    "`ncomp verify part_c.nc`  says by what a program was corrected, and whether it was edited since"
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
    corrected: str | None = argument(
        "The corrected program; without it IN.nc is one, and only its mark is read.", "OUT.nc", default=None, reads=True
    ),
    machine: OptionalMachine,
    calibration: CalibrationName,
    options: VerificationOptions,
    set_up: DatumOptions,
    at: ConditionsOptions,
    others: ResultOptions,
) -> None:
    """Compute the tool point error of a program before and after correction, from the two texts by the exact model.

    With one program alone: say by what it was corrected, and whether it was edited since.
    """
    if corrected is None:
        _refuse_unused(program, machine, calibration, options, set_up, at)
        _show_statement(program, others)
        return
    if machine is None:
        raise UserError("verify: --machine is missing: name of a machine, or path of its .toml file")
    from postproc.commands.show.terminal import say, say_assumed, show
    from postproc.verification.report import verification_report

    programs_and_models = (program, corrected, calibration, options.old, options.align)
    inputs = (*programs_and_models, *set_up.tool_table, at.log, at.log_columns)
    found = ncomp.load_machine(machine)
    done = _compared((program, corrected), found, calibration, options, set_up, at, traced=others.report is not None)
    for assumption in done.assumptions:
        say_assumed(assumption)
    for note in done.notes:
        say("note", note)
    report = verification_report(done, f"{Path(program).name} and {Path(corrected).name}", found)
    with whole_results(*others.files) as files:
        others.write(done.json(), report, files, inputs)
    show(report, *others.files)


def _compared(
    names: tuple[str, str],
    machine: Machine,
    calibration: str | None,
    options: VerificationOptions,
    set_up: DatumOptions,
    at: ConditionsOptions,
    *,
    traced: bool,
) -> Verification:
    """The second program, evaluated as a correction of the first."""
    from postproc.commands.show.terminal import progress_of

    model = ncomp.load_calibration(machine, calibration)
    setup, conditions = set_up.setup_of(names[0], machine), at.conditions()
    programs = open_source(names[0]), open_source(names[1])
    with progress_of(sum(source.size for source in programs), "verifying") as progress:
        return ncomp.verify(
            *programs,
            machine,
            model,
            dialect=set_up.dialect,
            setup=setup,
            conditions=conditions,
            traced=traced,
            progress=progress,
            **vars(options),
        )


def _refuse_unused(program: str, machine: str | None, calibration: str | None, *groups: Any) -> None:
    """UserError for options of a comparison, which needs two programs."""
    named = {"machine": machine, "calibration": calibration}
    named |= {each.name: _unlike(each.default, getattr(group, each.name)) for group in groups for each in fields(group)}
    given = [name.replace("_", "-") for name, value in named.items() if value]
    if given:
        raise UserError(
            f"verify {program}: --{given[0]} is for the comparison of two programs: give the original as well, "
            f"ncomp verify IN.nc {program}; without options ncomp verify {program} reads its mark"
        )


def _unlike(default: Any, value: Any) -> Any:
    """The value of an option, None for its default."""
    return None if value == default else value


def _show_statement(program: str, others: ResultOptions) -> None:
    """Read the mark of one program; UserError where it has none."""
    from postproc.commands.show.terminal import show
    from postproc.correct.mark import called_by_program, statement_in
    from postproc.verification.mark_report import mark_report, of_statement

    source = open_source(program)
    statement = statement_in(source)
    if statement is None:
        raise UserError(
            f"{source.name} has no mark of ncomp: it was not corrected, or its mark was removed; "
            f"ncomp verify IN.nc {program} --machine NAME compares it with its original"
        )
    called = [] if program == "-" else list(called_by_program(Path(program)))
    report = mark_report(statement, Path(program).name, called)
    with whole_results(*others.files) as files:
        others.write(of_statement(statement, called), report, files, (program,))
    show(report, *others.files)
