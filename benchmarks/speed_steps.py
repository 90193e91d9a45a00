"""Where the processor time of a correction goes: `python benchmarks/speed_steps.py [--page docs/speed.md]`.

A five-axis program is corrected in one process, and the time of each step is taken without that of the steps inside it.
Beside it stands the floor of this computer: what the same step costs if its text is only copied and its numbers are
only multiplied, as fast as NumPy does either. A bar is as long as its share of the whole time.

    --lines 200000 --rounds 3          moves of the program
"""

from __future__ import annotations

import argparse
import io
import statistics
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from functools import wraps
from pathlib import Path
from typing import Any

import numpy as np
from speed import as_markdown, conditions, page
from speed_inputs import CLOTHINGS, FIVE_AXES

import machines
import ncomp
from postproc.control.interpreter import Interpreter
from postproc.control.setup import make_setup
from postproc.correct.job import Job
from postproc.correct.pipeline import Pipeline
from postproc.correct.steps.checks import Checks
from postproc.correct.steps.correction import PartCorrection
from postproc.correct.steps.output import Output
from postproc.dialects import find_dialect
from postproc.evaluation.evaluation import Evaluation
from postproc.text.source import open_source
from postproc.write.writer import Writer

TITLE = "Steps of a correction"
READ, INTERPRET, CORRECT, CHECK, WRITE, REST = "read", "interpret", "correct", "check", "write", "rest"
METHODS: dict[str, tuple[tuple[type, str], ...]] = {
    INTERPRET: ((Interpreter, "read_to_refusal"),),
    CORRECT: ((PartCorrection, "corrected"),),
    CHECK: ((Checks, "programmed"), (Checks, "corrected"), (Evaluation, "add"), (Evaluation, "finish")),
    WRITE: ((Writer, "write"), (Output, "put"), (Output, "finish")),
}
"""Methods that are a step, without the steps that they call."""
MULTIPLICATIONS = {READ: 0, INTERPRET: 10, CORRECT: 480, CHECK: 240, WRITE: 10, REST: 0}
"""Of a move of five axes: a table of degree 6 for six error motions of each axis (180) and the chain (60) once for the
check, and twice for the correction, which iterates; two for each number that is scaled."""
WIDTH = 30
"""Characters of a bar for the whole time."""


class Clock:
    """Processor time of steps, s, each without the steps inside it."""

    def __init__(self) -> None:
        self.spent = dict.fromkeys((READ, INTERPRET, CORRECT, CHECK, WRITE, REST), 0.0)
        self._open, self._since = [REST], time.process_time()

    def _turn(self) -> None:
        now = time.process_time()
        self.spent[self._open[-1]] += now - self._since
        self._since = now

    @contextmanager
    def step(self, name: str) -> Iterator[None]:
        """Time in the context belongs to this step."""
        self._turn()
        self._open.append(name)
        try:
            yield
        finally:
            self._turn()
            self._open.pop()

    def each(self, items: Iterable[Any]) -> Iterator[Any]:
        """The items, whose making is reading."""
        iterator = iter(items)
        while True:
            with self.step(READ):
                item = next(iterator, None)
            if item is None:
                return
            yield item

    def method(self, step: str, plain: Callable[..., Any]) -> Callable[..., Any]:
        """A method that belongs to a step."""

        @wraps(plain)
        def timed(owner: Any, *given: Any, **named: Any) -> Any:
            if step == INTERPRET:
                given = (self.each(given[0]), *given[1:])
            with self.step(step):
                return plain(owner, *given, **named)

        return timed


def steps_of(program: Path) -> tuple[dict[str, float], int]:
    """Processor time of each step, s, and the size of the corrected program, bytes."""
    machine = machines.load("dmu50")
    source = open_source(str(program))
    dialect = find_dialect("auto", program.name, source.text_head)
    job = Job(source, dialect, machine, ncomp.load_calibration(machine), make_setup(machine, zero=True))
    plain = [(owner, name, getattr(owner, name)) for pairs in METHODS.values() for owner, name in pairs]
    out, clock = io.BytesIO(), Clock()
    try:
        for step, pairs in METHODS.items():
            for owner, name in pairs:
                setattr(owner, name, clock.method(step, getattr(owner, name)))
        with clock.step(REST):
            Pipeline(job).run(out, lambda _: None)
    finally:
        for owner, name, method in plain:
            setattr(owner, name, method)
    return clock.spent, len(out.getvalue())


def floors(moves: int, read: int, written: int) -> dict[str, float]:
    """Time of each step, s, at the speed of memory and of multiplications; sizes of the texts in bytes."""
    text, numbers = np.zeros(1 << 26, np.uint8), np.ones(1 << 14)
    per_byte = _seconds(text.copy) / text.size
    each = _seconds(lambda: np.multiply(numbers, numbers, out=numbers)) / numbers.size
    sizes = {READ: read, WRITE: written}
    return {step: per_byte * sizes.get(step, 0) + each * moves * count for step, count in MULTIPLICATIONS.items()}


def _seconds(work: Callable[[], object]) -> float:
    times = []
    for _ in range(50):
        start = time.process_time_ns()
        work()
        times.append((time.process_time_ns() - start) * 1e-9)
    return statistics.median(times)


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--lines", type=int, default=200_000)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--page", type=Path, metavar="FILE.md")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="ncomp-speed-") as folder:
        program = Path(folder) / "in.nc"
        CLOTHINGS[FIVE_AXES].write(program, given.lines)
        done = [steps_of(program) for _ in range(given.rounds)]
        lowest = floors(given.lines, program.stat().st_size, done[-1][1])
    times = {step: statistics.median(spent[step] for spent, _ in done) for step in lowest}
    whole, rows = sum(times.values()), []
    for step, own in times.items():
        over = f"{own / lowest[step]:.0f}" if lowest[step] else ""
        bar = "█" * round(WIDTH * own / whole)
        rows.append((step, f"{own:.2f}", f"{lowest[step]:.3f}", over, bar))
    rows.append(("all", f"{whole:.2f}", f"{sum(lowest.values()):.3f}", f"{whole / sum(lowest.values()):.0f}", ""))
    table = as_markdown((("step", "processor, s", "floor, s", "times the floor", "share"), rows))
    text = f"{given.lines:,} moves of five axes in one process.\n\n{table}\n\n{conditions(given.rounds)}"
    print(text)
    if given.page is not None:
        given.page.write_text(page({TITLE: text}, given.page))


if __name__ == "__main__":
    main()
