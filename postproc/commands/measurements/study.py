"""`ncomp study`: virtual calibrations of many virtual machines, to compare measuring methods."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from kinematics.user_error import UserError
from postproc.commands.options.declared import REQUIRED, argument, option
from postproc.commands.options.program import DialectName, SetUpOptions, moves_of
from postproc.commands.options.shared import ResultOptions, check_files, whole_results, write_json

if TYPE_CHECKING:
    from rich.console import Console

    from calibration.design.volume import Volume
    from calibration.study.run import Draws, Result
    from postproc.motion.motions import Motions

MANY = 3000
"""Largest number of moves of a program that are evaluated, evenly spread."""
DOUBTFUL = 0.1
"""Largest difference between linear and exact fits without a warning, as a share of the error."""
EPILOG = (
    "Examples:\n\n"
    "`ncomp study examples/studies/trajectory.toml -o trajectory.csv --report trajectory.html`\n\n"
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
    workers: int | None = option("Number of processes; default: one for each core.", "N", "-w", min=1),
    dask: str | None = option("Address of a Dask scheduler, whose cluster does the work instead.", "ADDRESS"),
    program: str | None = option("NC program, along which the errors after correction are evaluated too.", "PART.nc"),
    dialect: DialectName,
    set_up: SetUpOptions,
    others: ResultOptions,
) -> None:
    """Calibrate many virtual machines by each of several methods, and compare the errors that remain in their volume.

    Machines are drawn at random, measured by a virtual instrument with noise, fitted and evaluated. The results do not
    depend on the distribution of the work.
    """
    from calibration.study.cases import read_cases, with_volume
    from calibration.study.definition import read_study
    from calibration.study.results import summary, write_results
    from calibration.study.run import Draws, run
    from calibration.study.spread import workers as team_of
    from calibration.study.store import Store
    from postproc.commands.show.terminal import console
    from postproc.commands.show.terminal import output as screen

    check_files((definition, program, *set_up.tool_table), {"--output": output, **others.by_option})
    if dask is not None and workers is not None:
        raise UserError("--workers and --dask exclude each other: give one of them")
    wanted = read_study(definition)
    with console.status("laying out the cases"):
        cases = read_cases(wanted, definition.parent)
    if program is not None:
        machine = cases[0].plan.machine
        moves = moves_of(program, dialect, machine, set_up.setup(machine))
        along = _ends(moves, program, wanted.instrument.temperature)
        cases = [with_volume(case, along) for case in cases]
    number = None if wanted.draws == "adaptive" else wanted.draws
    draws = Draws(number, wanted.tolerance_um, wanted.most_draws)
    store = Store.beside(output)
    with team_of(workers or os.cpu_count() or 1, dask) as team, _progress(draws, len(cases)) as progress:
        found = run(cases, draws, team, store, wanted.check_draws, progress)
    with whole_results(*others.files, output) as (results, shown, file):
        write_results(found, file)
        write_json(summary(found), results)
        if others.report is not None:
            from calibration.pages.study import study_page

            shown.write(study_page(found, wanted, f"ncomp study {definition}"))
    store.clear(case.key for case in cases)
    _show(found, draws, console if "-" in (output, *others.files) else screen)


def _ends(motions: Motions, program: str, sensors: Iterable[str]) -> Volume:
    """The ends of the moves of a program, as a volume in which machines are evaluated."""
    import numpy as np

    from calibration.design.volume import Volume, standing

    rows = np.flatnonzero(motions.evaluated)
    if not len(rows):
        raise UserError(f"{program}: no move says all axes that place the tool: there is nothing to judge")
    if len(rows) > MANY:
        rows = rows[np.linspace(0, len(rows) - 1, MANY).astype(int)]
    return Volume.at(motions.machine, standing(motions.machine_target[rows], sensors), motions.tool[rows])


@contextmanager
def _progress(draws: Draws, cases: int) -> Iterator[Callable[[int], None]]:
    """Progress in draws; the number that an adaptive study takes is not known."""
    from postproc.commands.show.terminal import console

    if not console.is_terminal:
        yield lambda _: None
        return
    from rich.progress import Progress

    with Progress(console=console, transient=True) as bar:
        task = bar.add_task("drawing", total=None if draws.number is None else draws.number * cases)
        yield lambda done: bar.advance(task, done)


def _show(found: Sequence[Result], draws: Draws, to: Console) -> None:
    """Show the results for people."""
    from rich.table import Table

    from calibration.study.results import standard_errors
    from calibration.study.stopping import estimates
    from postproc.commands.show.terminal import say

    places = ["volumetric error", "along the program"][: len(found[0].before)]
    table = Table("case", "points", "min", "draws", *(f"{what}, um" for place in places for what in _columns(place)))
    for each in found:
        numbers = []
        for k in range(len(places)):
            before, after = estimates(each.before[k]), estimates(each.after[k])
            own = f" ± {2 * standard_errors(each.after[0])[0]:.2f}" if k == 0 else ""
            numbers += [f"{before.mean:.2f}", f"{after.mean:.2f}{own}", f"{after.quantile:.2f}"]
        table.add_row(each.case.name, str(each.points), f"{each.minutes:.0f}", str(each.after.shape[1]), *numbers)
    to.print(table)
    to.print("RMS over the volume after rigid alignment; mean and 95 % quantile over draws; ± is k = 2, of the draws")
    for each in found:
        for note in each.notes:
            say("note", f"case {each.case.name}: {note}")
        if not each.converged:
            say(
                "not settled",
                f"case {each.case.name}: {draws.most} draws do not settle it to {draws.tolerance_um:g} um",
            )
    checked = [each.check for each in found if each.check is not None]
    if checked:
        largest = max(check.difference for check in checked)
        to.print(f"check        {len(checked[0].exact)} draws a case by the exact kinematics: within {largest:.2g} um")
        if any(check.difference > DOUBTFUL * float(check.exact.mean()) for check in checked):
            say("doubtful", "errors so large are not linear: results differ from exact fits by more than a tenth")


def _columns(place: str) -> tuple[str, str, str]:
    return f"{place} before", "after, mean", "95 %"
