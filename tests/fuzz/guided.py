"""Coverage-guided fuzzing of every reader of files, with Atheris (https://github.com/google/atheris, Apache-2.0).

    make fuzz-readers INPUTS=2000
    python -m tests.fuzz.guided [KIND ...] --inputs 2000 --seconds 600 --seed 1

Inputs grow from real and valid files; those that run new code of ncomp are kept and changed further. A reader gives a
result, or a refusal in words that names the file, within 5 s of the processor and 1 GB; anything else is written to
`found/`, as `python -m tests.fuzz` does.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import cast

from tests.fuzz.case import Case, Examiner, Outcome, Verdict, save
from tests.fuzz.figures import READERS, Figures, record
from tests.fuzz.mutate import files_changes, mutated

PACKAGES = ("calibration", "grammars", "history", "kinematics", "machines", "postproc", "ncomp")
PROGRAMS = {"NC iso": "iso", "NC siemens": "siemens", "NC heidenhain": "heidenhain"}
LONGEST = 20_000
"""Bytes of an input."""
MEMORY_MB = 1_500
"""Memory of a process: 1 GB above that of the libraries."""
SECONDS = 300
"""Seconds of the clock for one input, after which libFuzzer ends: the judges limit the time of the processor."""
FOUND_MOST = 2
"""Inputs of one class of failure that are written; all are counted."""


def kinds() -> list[str]:
    """The readers, by name."""
    from tests.fuzz.mutated_files import READERS

    return [*PROGRAMS, *READERS]


def seeds(kind: str) -> list[Case]:
    """Valid inputs of a reader."""
    from tests.fuzz import mutated_files, mutated_programs

    if kind in PROGRAMS:
        rng = random.Random(0)
        named = mutated_programs.by_dialect()[PROGRAMS[kind]]
        name = f"part{mutated_programs.ENDINGS[PROGRAMS[kind]][0]}"
        return [
            Case(mutated_programs.section(each, rng), name, "gantry", "0", (PROGRAMS[kind],))
            for each in named
            for _ in range(3)
        ]
    return [
        Case(file.text.encode("latin-1", "replace").decode("latin-1"), file.name, options=(kind, *file.more))
        for file in mutated_files.files()[kind]
    ]


def judge_of(kind: str) -> Callable[[Case], Outcome]:
    """The examination of a reader's input."""
    from tests.fuzz import mutated_files, mutated_programs

    return mutated_programs.judge if kind in PROGRAMS else mutated_files.judge


def fuzz(kind: str, inputs: int, seconds: float, seed: int) -> None:
    """Fuzz one reader in this process, and print the figures as JSON; the process ends here."""
    import atheris  # type: ignore[import-not-found,import-untyped,unused-ignore]

    with atheris.instrument_imports(include=list(PACKAGES)):
        known = seeds(kind)
        judge = judge_of(kind)
        for case in known:
            judged(judge, case)  # imports what it needs
    until, counts = time.monotonic() + seconds, dict.fromkeys(("inputs", "read", "refused"), 0)
    failures: dict[str, int] = {}

    def one(data: bytes) -> None:
        case = case_of(data, known)
        outcome = judged(judge, case)
        counts["inputs"] += 1
        counts["read"] += outcome.verdict is Verdict.COMPARED
        counts["refused"] += outcome.verdict is Verdict.REFUSED
        if outcome.verdict is Verdict.DIFFERS:
            failures[outcome.kind] = failures.get(outcome.kind, 0) + 1
            if failures[outcome.kind] <= FOUND_MOST:
                save("mutated_programs" if kind in PROGRAMS else "mutated_files", case, outcome)
        if counts["inputs"] >= inputs or time.monotonic() > until:
            print(json.dumps({"kind": kind, **counts, "failures": failures}), flush=True)
            os._exit(0)

    def changed(data: bytes, most: int, number: int) -> bytes:
        """One half of the changes are those of texts, the other those of libFuzzer."""
        rng = random.Random(number)
        if rng.random() < 0.5 or len(data) < 2:
            return bytes(atheris.Mutate(data, most))
        other = rng.choice(known).program
        text = mutated(data[1:].decode("latin-1"), other, rng, None if kind in PROGRAMS else files_changes())
        return (data[:1] + text.encode("latin-1", "replace"))[:most]

    with tempfile.TemporaryDirectory(prefix="ncomp-guided-") as folder:
        for number, case in enumerate(known):
            (Path(folder) / f"{number:04}").write_bytes(bytes([number % 256]) + case.program.encode("latin-1"))
        limits = (f"-max_len={LONGEST}", f"-rss_limit_mb={MEMORY_MB}", f"-timeout={SECONDS}", "-verbosity=0")
        atheris.Setup(["fuzz", *limits, f"-seed={seed}", folder], one, custom_mutator=changed)
        atheris.Fuzz()


def case_of(data: bytes, known: list[Case]) -> Case:
    """The first byte chooses name and arguments among the valid inputs, the others are the text."""
    case = known[data[0] % len(known)] if data else known[0]
    return Case(data[1:].decode("latin-1"), case.name, case.machine, case.calibration, case.options)


def judged(judge: Callable[[Case], Outcome], case: Case) -> Outcome:
    """The outcome; an exception is a failure, named by its class and place."""
    from tests.fuzz.runner import judge as guarded

    return guarded(cast("Examiner", SimpleNamespace(judge=judge)), case)


def main() -> int:
    """Fuzz readers one after the other, each in a process of its own; status 1 where one failed."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz.guided", description="Fuzz the readers of files.")
    parser.add_argument("kinds", nargs="*", help="readers, by name; without it all")
    parser.add_argument("--inputs", type=int, default=2000, help="inputs for each reader")
    parser.add_argument("--seconds", type=float, default=600.0, help="longest time for each reader")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--here", action="store_true", help="in this process: one reader, figures as JSON")
    parser.add_argument("--record", action="store_true", help="enter the figures in readers.csv, for the evidence page")
    given = parser.parse_args()
    if given.here:
        fuzz(given.kinds[0], given.inputs, given.seconds, given.seed)
    failed = total = 0
    print("| reader | inputs | read | refused in words | other |\n|---|---|---|---|---|", flush=True)
    for kind in given.kinds or kinds():
        options = ("--inputs", given.inputs, "--seconds", given.seconds, "--seed", given.seed, "--here")
        command = [sys.executable, "-m", "tests.fuzz.guided", kind, *map(str, options)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        lines = [line for line in done.stdout.splitlines() if line.startswith('{"kind"')]
        if not lines:
            print(f"| {kind} | ended: {(done.stderr.strip() or done.stdout).splitlines()[-3:]} | | | 1 |", flush=True)
            failed += 1
            continue
        found = json.loads(lines[-1])
        other = sum(found["failures"].values())
        if given.record:
            record(READERS, kind, given.seed, Figures(found["inputs"], found["read"], found["refused"], other))
        failed, total = failed + other, total + found["inputs"]
        print(f"| {kind} | {found['inputs']} | {found['read']} | {found['refused']} | {other} |", flush=True)
        for failure, number in found["failures"].items():
            print(f"{number} x {failure}", file=sys.stderr, flush=True)
    print(f"{total} inputs, {failed} failures", flush=True)
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main())
