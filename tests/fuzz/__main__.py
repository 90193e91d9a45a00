"""`python -m tests.fuzz EXAMINER --programs N --seed S --jobs J`; exit status 1 where something differs."""

from __future__ import annotations

import argparse
import sys

from tests.fuzz import EXAMINERS
from tests.fuzz.case import examiner
from tests.fuzz.figures import PROGRAMS, record
from tests.fuzz.runner import run


def main() -> int:
    """Run one examiner, or all of them."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description="Examine random programs.")
    parser.add_argument("examiner", choices=[*EXAMINERS, "all"])
    parser.add_argument("--programs", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--record", action="store_true", help="enter the figures in figures.csv, for the evidence page")
    given = parser.parse_args()
    names = EXAMINERS if given.examiner == "all" else (given.examiner,)
    differences = 0
    for name in names:
        most = getattr(examiner(name), "MOST", given.programs) if given.examiner == "all" else given.programs
        count = run(name, min(most, given.programs), given.seed, given.jobs)
        print(f"\r{name}, seed {given.seed}: {count.text()}", flush=True)
        if given.record:
            record(PROGRAMS, name, given.seed, count.figures())
        differences += count.differences.total()
    return int(differences > 0)


if __name__ == "__main__":
    sys.exit(main())
