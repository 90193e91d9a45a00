"""`python -m tests.code_mutants --mutants N --seed S --jobs J`; exit status 1 where a fault stays unnoticed."""

from __future__ import annotations

import argparse
import random
import sys
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor, as_completed
from pathlib import Path

from tests.code_mutants.argued import ARGUED
from tests.code_mutants.modules import MODULES, files, modules_of_tests
from tests.code_mutants.operators import SIGNS_AND_UNITS, Mutant, mutants_of
from tests.code_mutants.reach import reach_of
from tests.code_mutants.runner import MORE_SECONDS, MOST_TIME, ROOT, Run, prepare, run


def drawn(mutants: int, seed: int, words: list[str]) -> list[Mutant]:
    """Random faults: one half of signs and units, the other of all other kinds."""
    known = [each for area in MODULES for file in files(area) for each in mutants_of(ROOT, file)]
    known = [each for each in known if not words or any(word in each.file for word in words)]
    halves = [[each for each in known if (each.kind in SIGNS_AND_UNITS) is wanted] for wanted in (True, False)]
    print(f"{len(halves[0])} faults of signs and units, {len(halves[1])} others", flush=True)
    rng = random.Random(seed)
    return [each for half in halves for each in rng.sample(half, min(mutants // 2, len(half)))]


def judged(mutants: list[Mutant], jobs: int) -> Iterator[tuple[Mutant, Run]]:
    """Each fault, and how the tests that run its code ended, the quickest first."""
    reach = reach_of(modules_of_tests(), {file for area in MODULES for file in files(area)}, jobs)

    def judge(mutant: Mutant) -> tuple[Mutant, Run]:
        found = sorted((each for each in reach if each.has(mutant)), key=lambda each: each.seconds)
        if not found:
            return mutant, Run(False, "no test runs it", 0.0)
        seconds = sum(each.seconds for each in found)
        return mutant, run(mutant, [each.test for each in found], MOST_TIME * seconds + MORE_SECONDS)

    with ThreadPoolExecutor(jobs) as pool:
        for done in as_completed([pool.submit(judge, mutant) for mutant in mutants]):
            yield done.result()


def main() -> int:
    """Draw faults, run the tests with each, and count those that a test noticed."""
    parser = argparse.ArgumentParser(prog="python -m tests.code_mutants", description=__doc__)
    parser.add_argument("words", nargs="*", help="only modules with one of these words in their path")
    parser.add_argument("--mutants", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--again", type=Path, help="printed by an earlier run: only the faults that it left unnoticed")
    given = parser.parse_args()
    prepare()
    all_, noticed, argued = Counter[str](), Counter[str](), Counter[str]()
    left = []
    mutants = drawn(given.mutants, given.seed, given.words)
    if given.again:
        text = given.again.read_text()
        mutants = [each for each in mutants if f"UNNOTICED {each.text()} " in text]
    for mutant, done in judged(mutants, given.jobs):
        all_[mutant.kind] += 1
        reason = ARGUED.get(mutant.key)
        noticed[mutant.kind] += done.failed
        if not done.failed:
            argued[mutant.kind] += reason is not None
            left += [mutant] * (reason is None)
        verdict = "noticed" if done.failed else "argued" if reason else "UNNOTICED"
        print(f"{verdict:9} {mutant.text()}  ({done.how}, {done.seconds:.0f} s)", flush=True)
    print(f"\n{'kind':9} {'faults':>7} {'noticed':>8} {'argued':>7} {'left':>5}")
    for kind in [*sorted(all_, key=lambda each: (each not in SIGNS_AND_UNITS, each)), "all"]:
        counts = [count.total() if kind == "all" else count[kind] for count in (all_, noticed, argued)]
        print(f"{kind:9} {counts[0]:7} {counts[1]:8} {counts[2]:7} {counts[0] - counts[1] - counts[2]:5}")
    return int(bool(left))


if __name__ == "__main__":
    sys.exit(main())
