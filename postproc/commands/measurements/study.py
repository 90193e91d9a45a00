"""`ncomp study`: virtual calibrations of many virtual machines, to compare measuring methods."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import ncomp
from postproc.commands.options.declared import argument, option, output_option
from postproc.commands.options.program import SetUpOptions
from postproc.commands.options.shared import DaskAddress, ResultOptions, number_of_workers, whole_results

if TYPE_CHECKING:
    from calibration.study.run import Draws

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
    definition: Path = argument(
        "Definition of the study: methods to compare (docs/study.md).", "STUDY.toml", reads=True
    ),
    output: str = output_option("Table with one row for each case; `-` is standard output.", "RESULTS.csv"),
    workers: int | None = option(
        "Number of processes; default: one for each core.", "N", "--workers", "-w", "--jobs", "-j", min=1
    ),
    dask: DaskAddress,
    program: str | None = option(
        "NC program, along which the errors after correction are evaluated too.", "PART.nc", reads=True
    ),
    set_up: SetUpOptions,
    others: ResultOptions,
) -> None:
    """Calibrate many virtual machines by each of several methods, and compare the errors that remain in their volume.

    Machines are drawn at random, measured by a virtual instrument with noise, fitted and evaluated. The results do not
    depend on the distribution of the work.
    """
    from calibration.reports.study import study_report
    from calibration.study.results import write_results
    from calibration.study.store import Store
    from calibration.study.studied import Study
    from postproc.commands.show.terminal import console, say_assumed, show

    inputs = (definition, program, *set_up.tool_table)
    number = number_of_workers(workers, dask, "--workers")
    with console.status("laying out the cases"):
        planned = Study.read(definition)
    if program is not None:
        planned, assumption = ncomp.study_along(planned, program, set_up.setup(planned.machine), set_up.dialect)
        say_assumed(assumption)
    with _progress(planned.draws, len(planned.cases)) as progress:
        found = planned.run(number, dask, Store.beside(output), progress)
    report = study_report(found.results, found.definition, found.draws, f"ncomp study {definition}")
    with whole_results(*others.files, output) as (results, page, file):
        write_results(found.results, file)
        others.write(found.json(), report, (results, page), inputs)
    found.clear()
    show(report, output, *others.files)


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
