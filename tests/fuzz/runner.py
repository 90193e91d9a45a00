"""Draw, judge, count and shrink."""

from __future__ import annotations

import signal
import sys
import traceback
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import NamedTuple

from tests.fuzz.case import Case, Examiner, Outcome, Verdict, examiner, save
from tests.fuzz.figures import Figures
from tests.fuzz.shrink import shrink

SECONDS = 60
"""Processor time for one examination."""
SHRUNK = 2
"""Differences of one class that are shrunk and written; all are counted."""
SEEDS = 1_000_000
"""Programs that a seed has before it meets those of the next."""


@dataclass
class Count:
    """The figures of a run."""

    programs: int = 0
    compared: int = 0
    refused: Counter[str] = field(default_factory=Counter)
    differences: Counter[str] = field(default_factory=Counter)
    files: list[Path] = field(default_factory=list)

    def add(self, outcome: Outcome) -> None:
        """Count one examination."""
        self.programs += 1
        match outcome.verdict:
            case Verdict.COMPARED:
                self.compared += 1
            case Verdict.REFUSED:
                self.refused[outcome.text] += 1
            case Verdict.DIFFERS:
                self.differences[outcome.kind] += 1

    def figures(self) -> Figures:
        """The figures, without their classes."""
        return Figures(self.programs, self.compared, self.refused.total(), self.differences.total())

    def line(self) -> str:
        """The figures in one line."""
        return (
            f"{self.programs} programs, {self.compared} compared, {self.refused.total()} refused, "
            f"{self.differences.total()} differences"
        )

    def text(self) -> str:
        """The figures with all classes."""
        classes = [f"  {n:6} refused: {reason}" for reason, n in self.refused.most_common()]
        classes += [f"  {n:6} DIFFER: {kind}" for kind, n in self.differences.most_common()]
        return "\n".join([self.line(), *classes, *(f"  {path}" for path in self.files)])


class Examined(NamedTuple):
    """One seed and its outcome."""

    seed: int
    outcome: Outcome


def run(name: str, programs: int, seed: int, jobs: int = 1, *, keep: bool = True) -> Count:
    """Examine programs `seed * SEEDS`, ... ; differences are shrunk and written unless `keep` is false."""
    count = Count()
    for examined in _all(name, range(seed * SEEDS, seed * SEEDS + programs), jobs):
        count.add(examined.outcome)
        if sys.stderr.isatty():
            print(f"\r{name}: {count.line()}", end="", file=sys.stderr, flush=True)
        kind = examined.outcome.kind
        if keep and examined.outcome.verdict is Verdict.DIFFERS and count.differences[kind] <= SHRUNK:
            count.files.append(_keep(name, examined))
    return count


def judge(module: Examiner, case: Case) -> Outcome:
    """Judge a case; an exception or a long time is a difference of its own."""
    try:
        with _limit(SECONDS):
            return module.judge(case)
    except TimeoutError:
        return Outcome(Verdict.DIFFERS, f"takes too long: {SECONDS} s")
    except Exception as error:
        place = traceback.extract_tb(error.__traceback__)[-1]
        where = f"{type(error).__name__} in {Path(place.filename).name}, {place.name}"
        return Outcome(Verdict.DIFFERS, f"{where}: {error}")


def _all(name: str, seeds: range, jobs: int) -> Iterator[Examined]:
    work = partial(_examine, name)
    if jobs == 1:
        yield from map(work, seeds)
        return
    with get_context("spawn").Pool(jobs) as pool:
        yield from pool.imap_unordered(work, seeds, chunksize=8)


def _examine(name: str, seed: int) -> Examined:
    module = examiner(name)
    return Examined(seed, judge(module, module.draw(seed)))


def _keep(name: str, examined: Examined) -> Path:
    module = examiner(name)
    case, kind = module.draw(examined.seed), examined.outcome.kind

    def differs(text: str) -> bool:
        outcome = judge(module, replace(case, program=text))
        return outcome.verdict is Verdict.DIFFERS and outcome.kind == kind

    small = replace(case, program=shrink(case.program, differs))
    return save(name, small, judge(module, small))


@contextmanager
def _limit(seconds: int) -> Iterator[None]:
    def late(*_: object) -> None:
        raise TimeoutError

    before = signal.signal(signal.SIGPROF, late)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, before)
