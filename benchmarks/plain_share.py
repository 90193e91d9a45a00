"""Share of the lines of NC programs that are corrected in bulk: `python benchmarks/plain_share.py FOLDER [MACHINE]`.

A line is corrected in bulk if it is read, moved and written in columns, together with the lines around it. Every other
line is read and written by itself: comments, M functions, cycles, and lines whose meaning needs more than their words.
All lines of a program count, those without coordinates too. A program that is refused has no such line.
"""

from __future__ import annotations

import io
import sys
from collections.abc import Sequence
from pathlib import Path
from unittest.mock import patch

import machines
import ncomp
from kinematics.error_model.model import ErrorModel
from kinematics.machine import Machine
from kinematics.user_error import UserError
from machines import default_calibration
from postproc.control.setup import make_setup
from postproc.correct.job import Job
from postproc.correct.pipeline import Pipeline
from postproc.dialects import find_dialect
from postproc.execution import Part, StreamedProgram
from postproc.text.block import Block
from postproc.text.source import open_source
from postproc.write.plain_texts import PlainText

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from support.programs import random_model

WITH_A, FOR_A = "trunnion_ac", ("five_axis_ac",)
"""Machine for the real programs with an axis A, and their folders."""
LONG = 100
"""Lines of a program that has a row of its own in the table."""


def machine_of(path: Path) -> str:
    """The shipped machine for a real program."""
    return WITH_A if path.parent.name in FOR_A else "dmu50"


def errors_of(machine: Machine) -> ErrorModel:
    """The calibration of a shipped machine; random errors for a machine without one."""
    return ncomp.load_calibration(machine) if default_calibration(machine) else random_model(machine, 1, 30.0)


def lines_in_bulk(path: Path, machine: Machine, model: ErrorModel) -> tuple[int, int]:
    """Number of lines that are corrected in bulk, and of all lines; UserError for a program that is refused."""
    found = 0

    class Counted(StreamedProgram):
        def finished(self, part: Part, texts: list[str | PlainText]) -> tuple[Sequence[Block], list[str | PlainText]]:
            nonlocal found
            found += sum(text.lines for text in texts if isinstance(text, PlainText))
            return super().finished(part, texts)

    source = open_source(str(path))
    dialect = find_dialect("auto", source.name, source.text_head)
    job = Job(source, dialect, machine, model, make_setup(machine, zero=True), travel_check=False)
    with patch("postproc.correct.pipeline.StreamedProgram", Counted):
        Pipeline(job).run(io.BytesIO(), lambda _: None)
    return found, len(path.read_bytes().splitlines())


def main(folder: Path, name: str) -> None:
    """Count and print."""
    bulk = lines = refused = 0
    for path in sorted(path for path in folder.rglob("*") if path.is_file()):
        machine = machines.load(name or machine_of(path))
        try:
            own, of = lines_in_bulk(path, machine, errors_of(machine))
        except UserError:
            refused += 1
            continue
        bulk, lines = bulk + own, lines + of
        if of >= LONG:
            print(f"{path.name:32}{own:7} of {of:7} lines in bulk ({own / of:6.1%})")
    print(f"{'all that are corrected':32}{bulk:7} of {lines:7} lines in bulk ({bulk / max(lines, 1):6.1%})")
    print(f"{refused} files are refused")


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2] if len(sys.argv) > 2 else "")
