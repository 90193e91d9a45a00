"""`python -m tests.golden --renew [NAME...]` stores the present answers and prints how they differ."""

from __future__ import annotations

import argparse
import sys

from tests.golden.comparison import differences
from tests.golden.run import answer, missing, stored
from tests.golden.runs import RUNS


def main() -> int:
    """Compare the runs of these names, or all; exit status 1 where an answer differs and is not renewed."""
    parser = argparse.ArgumentParser(prog="python -m tests.golden", description="Compare answers with the stored ones.")
    parser.add_argument("names", nargs="*", metavar="NAME", help="runs of tests/golden/runs.py, also the first letters")
    parser.add_argument("--renew", action="store_true", help="store the present answers")
    given = parser.parse_args()
    chosen = [run for run in RUNS if not given.names or run.name.startswith(tuple(given.names))]
    differing = 0
    for run in chosen:
        if absent := missing(run):
            print(f"{run.name}: left out, {absent[0]} is missing", file=sys.stderr)
            continue
        file, now = stored(run), answer(run)
        before = file.read_text(encoding="utf-8") if file.is_file() else ""
        if difference := differences(before, now, run.rounding):
            differing += 1
            print(
                f"{run.name}\n{difference}" if before else f"{run.name}: new, {len(now.splitlines())} lines", flush=True
            )
            if given.renew:
                file.write_text(now, encoding="utf-8")
    print(f"{len(chosen)} runs, {differing} {'renewed' if given.renew else 'differ'}")
    return int(differing > 0 and not given.renew)


if __name__ == "__main__":
    sys.exit(main())
