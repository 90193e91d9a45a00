"""Carries out a run of the table by the command line, in this process, and collects its answer."""

from __future__ import annotations

import os
import re
import shlex
import tempfile
from contextlib import chdir
from functools import cache
from pathlib import Path

os.environ["COLUMNS"] = "200"  # consoles take their width once, when they are imported

from tests.golden.runs import RECIPES, Run
from tests.golden.text_form import lines_of
from tests.golden.volatile import masked
from tests.support.command import Done, run_command
from tests.support.real_data import REAL_DATA

ROOT = Path(__file__).parents[2]
ANSWERS = Path(__file__).parent / "answers"


def missing(run: Run) -> list[Path]:
    """The files of real data that a run needs and that are not beside the repository."""
    return [path for path in map(_stored, run.data) if path is not None and not path.is_file()]


def answer(run: Run) -> str:
    """What the run prints and writes, as lines of text; the exit status where it is not 0."""
    with tempfile.TemporaryDirectory() as name, chdir(name):
        for data in run.data:
            for file, content in _input(data).items():
                Path(file).write_bytes(content)
        given = _files()
        done = run_command(*shlex.split(run.line))
        shown = [
            *_shown(done),
            *(line for file in sorted(_files() - given) for line in ("", f"== {file}", *lines_of(file))),
        ]
    return masked("\n".join([f"$ ncomp {run.line}", *shown])) + "\n"


def stored(run: Run) -> Path:
    """The file that holds the answer of a run."""
    return ANSWERS / f"{run.name}.txt"


def _files() -> set[Path]:
    return {path for path in Path().rglob("*") if path.is_file()}


def _shown(done: Done) -> list[str]:
    status = [f"exit status {done.status}"] if done.status else []
    return [*status, "", "== shown", *done.shown.splitlines()]


def _stored(data: str) -> Path | None:
    """A file beside the repository (`shared:`), or of it; None of a recipe."""
    place, _, name = data.partition(":")
    return {"shared": REAL_DATA / name, "file": ROOT / name, "few-draws": ROOT / name}.get(place)


@cache
def _input(data: str) -> dict[str, bytes]:
    """The content of input files by their names."""
    if (path := _stored(data)) is not None:
        content = path.read_bytes()
        return {
            path.name: re.sub(rb"^draws = \d+", b"draws = 2", content, flags=re.M)
            if data.startswith("few-draws")
            else content
        }
    with tempfile.TemporaryDirectory() as name, chdir(name):
        for line in RECIPES[data]:
            done = run_command(*shlex.split(line))
            assert done.status == 0, done.shown
        return {str(path): path.read_bytes() for path in _files()}
