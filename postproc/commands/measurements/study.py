"""`ncomp study`: virtual calibrations of many virtual machines, to compare measuring methods."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from kinematics.user_error import UserError
from postproc.commands.options.declared import REQUIRED, argument, option
from postproc.commands.options.program import SetUpOptions, moves_of
from postproc.commands.options.shared import (
    DaskAddress,
    ResultOptions,
    check_files,
    number_of_workers,
    whole_results,
)

if TYPE_CHECKING:
    from calibration.design.volume import Volume
    from calibration.study.run import Draws
    from postproc.motion.motions import Motions

MANY = 3000
"""Largest number of moves of a program that are evaluated, evenly spread."""
EPILOG = (
    "Examples:\n\n"
    "`ncomp study my_study.toml -o results.csv --report study.html`\n\n"
    "`ncomp study my_study.toml -o results.csv --workers 8 --json results.json`\n\n"
    "`ncomp study my_study.toml -o results.csv --dask tcp://scheduler:8786`\n\n"
    "`ncomp study my_study.toml -o results.csv --program part.nc --tool-length T1=120`\n\n"
    "docs/study.md has all keys of a study. An interrupted study continues where it ended."
)


def study(
    *,
    definition: Path = argument("Definition of the study: methods to compare (docs/study.md).", "STUDY.toml"),
    output: str = option(
        "Table with one row for each case; `-` is standard output.", "RESULTS.csv", "-o", default=REQUIRED
    ),
    workers: int | None = option(
        "Number of processes; default: one for each core.", "N", "--workers", "-w", "--jobs", "-j", min=1
    ),
    dask: DaskAddress,
    program: str | None = option("NC program, along which the errors after correction are evaluated too.", "PART.nc"),
    set_up: SetUpOptions,
    others: ResultOptions,
) -> None:
    """Calibrate many virtual machines by each of several methods, and compare the errors that remain in their volume.

    Machines are drawn at random, measured by a virtual instrument with noise, fitted and evaluated. The results do not
    depend on the distribution of the work.
    """
    from calibration.reports.study import study_report
    from calibration.study.cases import read_cases, with_volume
    from calibration.study.definition import read_study
    from calibration.study.results import summary, write_results
    from calibration.study.run import Draws, run
    from calibration.study.spread import workers as team_of
    from calibration.study.store import Store
    from postproc.commands.show.terminal import console, show

    inputs = check_files((definition, program, *set_up.tool_table), {"--output": output, **others.by_option})
    number = number_of_workers(workers, dask, "--workers")
    defined = read_study(definition)
    with console.status("laying out the cases"):
        try:
            cases = read_cases(defined, definition.parent)
        except UserError as fault:
            raise UserError(f"study {definition}: {fault}") from None
    if program is not None:
        machine = cases[0].plan.machine
        moves = moves_of(program, machine, set_up.setup(machine), set_up.dialect)
        along = _ends(moves, program, defined.instrument.temperature)
        cases = [with_volume(case, along) for case in cases]
    draws_given = None if defined.draws == "adaptive" else defined.draws
    draws = Draws(draws_given, defined.tolerance_um, defined.most_draws)
    store = Store.beside(output)
    with team_of(number, dask) as team, _progress(draws, len(cases)) as progress:
        found = run(cases, draws, team, store, defined.check_draws, progress)
    report = study_report(found, defined, draws, f"ncomp study {definition}")
    with whole_results(*others.files, output) as (results, page, file):
        write_results(found, file)
        others.write(summary(found), report, (results, page), inputs)
    store.clear(case.key for case in cases)
    show(report, output, *others.files)


def _ends(motions: Motions, program: str, sensors: Iterable[str]) -> Volume:
    """The ends of the moves of a program, as a volume in which machines are evaluated."""
    import numpy as np

    from calibration.design.volume import Volume, standing

    rows = np.flatnonzero(motions.evaluated)
    if not len(rows):
        raise UserError(
            f"{program}: no move has known positions of all axes: the errors along the program cannot be evaluated"
        )
    if len(rows) > MANY:
        rows = rows[np.linspace(0, len(rows) - 1, MANY).astype(int)]
    return Volume.at(motions.machine, standing(motions.machine_target[rows], sensors), motions.tool[rows])


@contextmanager
def _progress(draws: Draws, cases: int) -> Iterator[Callable[[int], None]]:
    """Progress in draws; the number that an adaptive study takes is not known."""
    from postproc.commands.show.terminal import console, progress_of

    label = f"drawing machines for {cases} cases"
    if draws.number is not None:
        with progress_of(draws.number * cases, label, 0) as progress:
            yield progress
        return
    with console.status(label) as status:
        made = 0

        def count(done: int) -> None:
            nonlocal made
            made += done
            status.update(f"{label}: {made} draws")

        yield count
