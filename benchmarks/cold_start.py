"""Cold start: `python benchmarks/cold_start.py [runs]`.

A program of 200 five-axis blocks is corrected by the shipped DMU 50 in a process of its own, in turn with a process
that only imports NumPy, and with one in which Typer reads the same words first; medians of each, and of the ratios.
Python's compiled files are written before the first counted run, as an installation writes them.
"""

from __future__ import annotations

import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

BLOCKS = 200
RUNS = 9
WORDS = ("in.nc", "--machine", "dmu50", "--set-up-zero", "-o", "out.nc")
RUN = "from postproc.cli import run; run()"
JOB = ("-c", RUN, *WORDS)
BY_TYPER = (
    "-c",
    "import sys; from postproc.commands.tree import command_tree; "
    f"command_tree().get_command(None, 'correct').make_context('correct', sys.argv[1:]); {RUN}",
    *WORDS,
)
NUMPY = ("-c", "import numpy")


def program(blocks: int) -> str:
    """A smooth five-axis path, every block naming all axes with four decimals."""
    t = np.arange(blocks) / 400.0
    x, y, z = 60 * np.cos(t), 60 * np.sin(1.1 * t), 200 + 20 * np.sin(0.7 * t)
    rows = np.transpose([x, y, z, 20 + 10 * np.sin(0.3 * t), 180 + 90 * np.sin(0.2 * t)]).tolist()
    words = ["X{:.4f} Y{:.4f} Z{:.4f} B{:.4f} C{:.4f}".format(*row) for row in rows]
    body = "".join(f"N{10 * i} G1 {each} F1500.0\n" for i, each in enumerate(words, start=1))
    return f"%\nO0001 (FIVE AXES)\nG21 G17 G90 G40 G49 G80 G94 G54\nT1 M6\nG0 {words[0]}\n{body}M30\n%\n"


class Spent(NamedTuple):
    """Time of a process, s."""

    processor: float
    elapsed: float


def spent(arguments: tuple[str, ...], folder: str, environment: dict[str, str]) -> Spent:
    """The time of a process of Python with these arguments."""
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    subprocess.run([sys.executable, *arguments], cwd=folder, env=environment, check=True, capture_output=True)
    after, end = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    return Spent(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, end - start)


def measured(runs: int) -> tuple[list[Spent], ...]:
    """The times of ncomp's job, of the job with Typer, and of the import of NumPy, run by run in turn."""
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "in.nc").write_text(program(BLOCKS))
        environment = os.environ | {
            "PYTHONPATH": str(Path(__file__).parents[1]),
            "PYTHONPYCACHEPREFIX": f"{folder}/compiled",
            "PYTHONDONTWRITEBYTECODE": "",
        }
        each_run = [[spent(each, folder, environment) for each in (JOB, BY_TYPER, NUMPY)] for _ in range(runs + 1)]
    return tuple(map(list, zip(*each_run[1:], strict=True)))


def ratios(jobs: list[Spent], others: list[Spent]) -> list[Spent]:
    """Ratios of the times, run by run."""
    return [
        Spent(job.processor / other.processor, job.elapsed / other.elapsed)
        for job, other in zip(jobs, others, strict=True)
    ]


def table(runs: int) -> tuple[Sequence[str], list[Sequence[str]]]:
    """Head and rows: medians of the times, and of the ratios within a run."""
    jobs, by_typer, imports = measured(runs)
    columns = {
        f"ncomp, {BLOCKS} five-axis blocks": (jobs, 3),
        "the same, read by Typer": (by_typer, 3),
        "ratio": (ratios(jobs, by_typer), 2),
        "import numpy": (imports, 3),
        "ratio to import numpy": (ratios(jobs, imports), 2),
    }
    return ("process", "processor, s", "elapsed, s"), [
        (name, *(f"{statistics.median(times):.{digits}f}" for times in zip(*column, strict=True)))
        for name, (column, digits) in columns.items()
    ]


if __name__ == "__main__":
    head, rows = table(int(sys.argv[1]) if len(sys.argv) > 1 else RUNS)
    for name, *cells in (head, *rows):
        print(f"{name:<34}" + "".join(f"{cell:>14}" for cell in cells))
