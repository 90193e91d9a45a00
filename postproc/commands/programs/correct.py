"""`ncomp correct`, the main command: a program in, the corrected program out."""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from kinematics.files.inputs import allow_to_replace
from kinematics.user_error import UserError
from postproc.commands.options.declared import option
from postproc.commands.options.files import check_files
from postproc.commands.options.program import (
    ConditionsOptions,
    CorrectionOptions,
    DatumOptions,
    NoTravelCheck,
    Programs,
)
from postproc.commands.options.recorded import RecordedOptions, program_entry
from postproc.commands.options.shared import (
    CalibrationName,
    OptionalMachine,
    number_of_workers,
    whole_results,
)
from postproc.commands.programs.given import GivenForAll, JobOption, own_in
from postproc.commands.programs.in_place import backup_of, target_of
from postproc.text.source import open_source

if TYPE_CHECKING:
    from postproc.folders.own_set_up import OwnSetUp
    from postproc.interface.request import Request

EPILOG = (
    "Examples:\n\n"
    "`ncomp part.nc --machine dmu50 -o part_c.nc`\n\n"
    "`ncomp part.h --machine mill.toml --calibration cal.json --work-offset 1=12.5,-80,210 --tool-length T5=96.3 "
    "-o part_c.h`\n\n"
    "`ncomp part.nc --machine mill.toml --calibration cal.json --temperature spindle=31.5 --elapsed 3600 "
    "-o part_c.nc`\n\n"
    "`ncomp part.nc --machine mill.toml --calibration cal.json --max-correction-um 80 --accept stale,outside "
    "-o part_c.nc`  accepts an old calibration, and positions outside the calibrated volume\n\n"
    "`ncomp roughing.nc finishing.nc --machine dmu50 -o corrected`  writes the outputs into the folder corrected\n\n"
    "`ncomp part.nc --machine dmu50 -o part_c.nc --report part.html`  also writes a page of figures\n\n"
    "`ncomp - --machine gantry --calibration none < part.nc`  writes the program unchanged, byte for byte"
)


def correct(
    *,
    programs: Programs,
    machine: OptionalMachine,
    job: JobOption,
    output: str | None = option(
        "Corrected program; default: `-`, standard output. Folder of the outputs for several programs.",
        "OUT.nc",
        "-o",
        writes="any",
        may_replace="programs",
    ),
    in_place: bool = option("Replace the input, and keep a backup IN.nc.orig beside it.", default=False),
    calibration: CalibrationName,
    set_up: DatumOptions,
    no_travel_check: NoTravelCheck,
    jobs: int | None = option(
        "Number of cores for a long program, which uses at most two; default: all of them.", "N", "-j", min=1
    ),
    correction: CorrectionOptions,
    at: ConditionsOptions,
    others: RecordedOptions,
) -> None:
    """Correct programs: every block ends at its nominal position, by the machine's error model.

    Only coordinate words change. Blocks are added where long moves are split and where backlash is taken up, and a
    comment names machine and calibration. A program that ncomp does not fully understand is refused: exit status 2, no
    output.
    """
    request = GivenForAll(machine, calibration, set_up, no_travel_check, correction, at).request("correct", job)
    if len(programs) == 1:
        own = None if job is None else own_in(job, Path(programs[0]))
        correct_one(programs[0], request, others, output=output, in_place=in_place, jobs=jobs, own=own)
        return
    from postproc.commands.programs.several import correct_several, listed_programs

    if in_place:
        raise UserError(f"--in-place replaces one program, and {len(programs)} are given: give -o FOLDER instead")
    command = f"ncomp {' '.join(programs)} --machine {request.machine} -o {output}"
    listed = listed_programs(programs, output, request.machine)
    if job is not None:
        listed = [replace(each, own=own_in(job, each.path)) for each in listed]
    correct_several(listed, request, others, jobs=jobs, dask=None, command=command)


def correct_one(
    program: str,
    request: Request,
    others: RecordedOptions,
    *,
    output: str | None,
    in_place: bool = False,
    jobs: int | None = None,
    own: OwnSetUp | None = None,
) -> None:
    """Correct one program into the file `output`, and show its report; own: its set-up in the entry of a job file."""
    from machines.given import load_machine
    from postproc.commands.show.terminal import progress_of, show
    from postproc.correct.report import correction_report
    from postproc.folders.called import files_beside

    target = _checked_target(program, request, others, output, in_place=in_place)
    _, _, correction = request.for_program(Path(program), own)[0].prepared()
    source, beside = open_source(program), dict[Path, bytes]()
    with (
        progress_of(source.size, "correcting") as progress,
        backup_of(program, source.hash) if in_place else nullcontext(),
        others.recorded(load_machine(request.machine)) as record,
        whole_results(*others.files, target, beside=beside) as (results, page, file),
    ):
        done = correction(
            source,
            output=file,
            progress=progress,
            traced=others.report is not None,
            jobs=number_of_workers(jobs, None, "--jobs"),
            beside=target != "-" and not in_place,
        )
        beside |= files_beside(Path(target), done)
        command = f"ncomp {program} --machine {request.machine} -o {target}"
        shown = correction_report(done.job, done.report, done.trace, command)
        others.write(done.report.json(), shown, (results, page), (*request.inputs, program))
        record(program_entry(done.report.json(), None, () if in_place else (*request.inputs, program)))
    show(shown, "-")


def _checked_target(
    program: str, request: Request, others: RecordedOptions, output: str | None, *, in_place: bool
) -> str:
    """The file of the corrected program; UserError where it, or another result, would replace an input."""
    target = target_of(program, output, in_place=in_place)
    check_files(request.files, {"--output": target, **others.by_option})
    check_files((program,), others.by_option)
    if in_place:
        allow_to_replace(target)
    return target
