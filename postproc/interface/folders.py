"""The public functions that correct the programs of a folder or of a job file."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, overload

from kinematics.running.caller import public
from kinematics.user_error import UserError
from postproc.interface.programs import conditions as make_conditions
from postproc.interface.programs import correct, own_set_up, set_up_of
from postproc.interface.programs import set_up as make_set_up

if TYPE_CHECKING:
    from kinematics.error_model.model import ErrorModel
    from kinematics.machine import Machine
    from postproc.control.setup import Setup
    from postproc.folders.checked import Checked
    from postproc.folders.summary import Summary
    from postproc.interface.request import CalibrationOfNow, Request
    from postproc.interface.watching import Folder, JobFile

OF_ONE = ("output", "traced", "one_of_several", "beside", "shared")
"""Arguments of `correct` that several programs cannot share."""


@public
def batch(
    folder: str | Path,
    output: str | Path,
    machine: str | Path | Machine,
    calibration: str | Path | ErrorModel | None = None,
    *,
    glob: Sequence[str] = (),
    jobs: Annotated[int, 1, None] = 1,
    dask: str | None = None,
    setup: Setup | None = None,
    progress: Callable[[int], None] = lambda _: None,
    **correction: Any,
) -> Summary:
    """Correct every program of a folder, each into a file of another one; `outcomes` of the result has their ends.

    glob: patterns of the programs' names instead of the usual suffixes. jobs: number of processes; a script that sets
    it must guard its main part by `if __name__ == "__main__"`. dask: address of a Dask scheduler, or `local`.
    setup: that of all programs; without it each program has the set-up of its file NAME.toml (docs/job.md), if there is
    one. progress: called with the number of bytes of each program that is done. correction: the other arguments of
    `correct`, which are common to all programs.

    A program that is refused has no output and does not stop the others. UserError, before any program is corrected,
    for an argument that cannot be used, and for an output that would replace an input.
    """
    from kinematics.running.arguments import checked
    from machines.given import load_calibration, load_machine
    from postproc.folders.programs import check_targets, programs_of
    from postproc.folders.sets import Sets
    from postproc.folders.summary import correct_all

    _refuse_of_one("batch", OF_ONE, correction)
    found = load_machine(machine)
    model = load_calibration(found, calibration)
    given = {"setup": setup or make_set_up(found), **correction}
    checked(correct, ("", found, model), given)
    found_there = programs_of(Path(folder), Path(output), glob)
    programs = Sets(correction.get("dialect", "auto")).main_programs(found_there, given["setup"])
    if setup is None:
        each = [(program, *own_set_up(program.path, found)) for program in programs]
        programs = [replace(program, setup=own, own_names=tuple(names)) for program, own, names in each]
    else:
        set_up_of("", found, setup)
    check_targets(programs, (), {})
    one = partial(correct, machine=found, calibration=model, one_of_several=True, **given)
    return correct_all(programs, found, model, one, jobs, dask, progress)


@overload
def job(
    file: str | Path,
    *,
    check: Literal[False] = False,
    jobs: int = 1,
    dask: str | None = None,
    progress: Callable[[int], None] = ...,
) -> Summary: ...
@overload
def job(file: str | Path, *, check: Literal[True]) -> Checked: ...
@public
def job(
    file: str | Path,
    *,
    check: bool = False,
    jobs: Annotated[int, 1, None] = 1,
    dask: str | None = None,
    progress: Callable[[int], None] = lambda _: None,
) -> Summary | Checked:
    """Correct the programs of a job file (docs/job.md), or check them.

    The result is a `Summary`, whose `outcomes` has the end of each program, and `json` its results; with check=True it
    is a `Checked`, whose `findings` has those of each program, and nothing is written. jobs, dask and progress: of a
    correction, as for `batch`. The results and the page that the file names are written by the command alone.

    A program that is refused has no output and does not stop the others. UserError, with file and line, for an entry
    of the job file that cannot be used.
    """
    from machines.given import load_machine
    from postproc.folders.checked import Checked
    from postproc.interface.job_file import read_job

    found = read_job(Path(file))
    request = found.request
    if check:
        return Checked(load_machine(request.machine), dict(request.checks(found.programs)))
    several = len(found.programs) > 1
    return request.corrected(found.programs, {}, jobs, dask, progress, of_several=several)


def watched(
    folder: str | Path,
    output: str | Path | None,
    job: str | Path | None,
    glob: Sequence[str],
    given: Mapping[str, Any],
    following: CalibrationOfNow | None,
) -> Folder | JobFile:
    """The source of the programs of `ncomp.watch`; UserError for arguments that cannot be used together.

    given: machine, calibration, set_up, conditions, and the arguments of `correct`. following: the calibration of now.
    """
    from postproc.interface.job_file import is_job_file, read_job
    from postproc.interface.request import with_calibration
    from postproc.interface.watching import Folder, JobFile

    file = Path(folder) if is_job_file(Path(folder)) else job
    if file is not None and (name := next((name for name, value in given.items() if value is not None), None)):
        raise UserError(f"watch(): {name} is an entry of the job file {file}: change it there")
    if file is not None and file is not job:
        if output is not None or job is not None or glob or following is not None:
            raise UserError(
                f"{file} is a job file, which has its programs and outputs: give no output, job, glob or drift"
            )
        return JobFile(Path(file))
    if output is None:
        raise UserError("watch(): output is missing: folder of the corrected programs")
    if job is None and given["machine"] is None:
        raise UserError("watch(): machine is missing: name of a machine, or path of its .toml file")
    request = None if job is not None else _request(**given)

    def now() -> Request:
        return request or read_job(Path(str(job)), there=False).request

    requests = with_calibration(now, following)
    return Folder(Path(folder), Path(output), glob, requests, None if job is None else Path(job))


def _request(
    machine: str | Path,
    calibration: str | Path | None,
    set_up: Mapping[str, object] | None,
    conditions: Mapping[str, object] | None,
    **correction: object,
) -> Request:
    """The request of these arguments; UserError for one that cannot be used."""
    from postproc.interface.request import Request

    _refuse_of_one("watch", ("setup", "jobs", *OF_ONE), correction)
    alone = {"work_offset": (), "datum": (), "tool_length": ()}
    return Request(
        machine=str(machine),
        calibration=None if calibration is None else str(calibration),
        set_up={**alone, **_named(make_set_up, set_up or {}, str(machine))},
        conditions=_named(make_conditions, conditions or {}),
        correction=_named(correct, correction, "", str(machine)),
    )


def _refuse_of_one(function: str, names: Iterable[str], given: Mapping[str, object]) -> None:
    """UserError for the first of these arguments that is given to a function for several programs."""
    for name in (each for each in names if each in given):
        cure = "give its values as set_up={...}, because its files are read anew" if name == "setup" else "leave it out"
        raise UserError(f"{function}(): {name} is an argument for one program alone: {cure}")


def _named(function: Callable[..., object], given: Mapping[str, object], *first: str) -> dict[str, Any]:
    """The named arguments of a function, converted."""
    from kinematics.running.arguments import checked

    return dict(checked(function, first, given).kwargs)
