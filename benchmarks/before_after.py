"""Commands of two checkouts, timed in turn: `python benchmarks/before_after.py BEFORE [--only fit verify]`.

BEFORE is another checkout of the repository (`git worktree add ../before COMMIT`); this one is the state after. Both
work on the same inputs, which this one makes. Each command runs as a process of its own, once in each checkout a
round; the table has medians, and the median of the ratios within a round. `same` compares the outputs, without lines
that hold a time, a version or a calibration's name. `benchmarks/speed.py --before BEFORE` writes the table to its page.
"""

from __future__ import annotations

import argparse
import compileall
import os
import re
import statistics
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
from diagnosis_time import sheet
from processes import Spent, spent
from speed_inputs import CLOTHINGS, FIVE_AXES, path

HERE = Path(__file__).parents[1]
PACKAGES = ("calibration", "kinematics", "machines", "postproc", "rendering")
NCOMP = (sys.executable, "-c", "from postproc.cli import run; run()")
NOT_ACCEPTED = ("fit", "diagnose")
"""Commands that may end with 2, after all of their work: a calibration that is not accepted."""
PASSING = re.compile(rb"made_at|made_by|version|NCOMP|seconds|calibration|model|\d{4}-\d\d-\d\dT|before/|after/")
SIMULATED = (
    "simulate --machine gantry --strategy hexahedron+random --target t1=0,0,-120 --target t2=90,40,-180 "
    "--target t3=-90,100,-120 --effect backlash:axis=X,width=12"
)
COMMANDS = {
    "correct": "correct in.nc --machine dmu50 --set-up-zero -o {out}.nc",
    "verify": "verify long.nc corrected.nc --machine dmu50 --set-up-zero --json {out}.json",
    "predict": "predict points.csv --machine dmu50 -o {out}.csv",
    "export": "export --machine dmu50 --format siemens-eec -o {out}",
    "fit": "fit data.csv --machine gantry -o {out}.json",
    "plan on the fly": (
        "plan --machine gantry --strategy on-the-fly --target t=0,0,-100 --length-m 21 --feed 2500 -o {out}.csv"
    ),
    "diagnose": "diagnose few.csv --machine gantry -o {out}.json --json {out}.results",
    "diagnose, a cause without a name": "diagnose unnamed.csv --machine gantry -o {out}.json --json {out}.results",
}


def ncomp(checkout: Path, words: str, folder: Path) -> Spent:
    """A command of a checkout, in a folder."""
    accepted = (0, 2) if words.startswith(NOT_ACCEPTED) else (0,)
    return spent((*NCOMP, *words.split()), os.environ | {"PYTHONPATH": str(checkout)}, folder, accepted)


@dataclass(frozen=True)
class Sizes:
    """Sizes of the inputs."""

    blocks: int = 20_000
    """Blocks of the program of `correct`."""
    long: int = 200_000
    """Blocks of each program of `verify`."""
    points: int = 100_000
    """Rows of `predict`."""
    rows: int = 3_000
    """Rows of `fit`."""
    few: int = 300
    """Rows of `diagnose`."""


def prepare(folder: Path, sizes: Sizes) -> None:
    """The inputs of the commands."""
    CLOTHINGS[FIVE_AXES].write(folder / "in.nc", sizes.blocks)
    CLOTHINGS[FIVE_AXES].write(folder / "long.nc", sizes.long)
    ncomp(HERE, "correct long.nc --machine dmu50 --set-up-zero -o corrected.nc", folder)
    states = path(np.arange(sizes.points))
    np.savetxt(folder / "points.csv", states, "%.4f", delimiter=",", header="X,Y,Z,B,C", comments="")
    for name, number in (("data.csv", sizes.rows), ("few.csv", sizes.few)):
        ncomp(HERE, f"{SIMULATED} --points {number // 6}+{number // 6} -o {name}", folder)
    (folder / "unnamed.csv").write_text(sheet("gantry", sizes.few, "without a name"))


Pairs = dict[str, list[tuple[Spent, Spent]]]


def write_bytecode(before: Path) -> None:
    """Python's compiled files of both checkouts: one without them would compile in each run."""
    for checkout in (before, HERE):
        for package in PACKAGES:
            compileall.compile_dir(checkout / package, quiet=1)


def measured(before: Path, names: Sequence[str], rounds: int, sizes: Sizes) -> tuple[Pairs, dict[str, bool]]:
    """Time and memory of the commands in both checkouts, by round; and whether their outputs are the same."""
    times: Pairs = {name: [] for name in names}
    write_bytecode(before)
    with tempfile.TemporaryDirectory(prefix="ncomp-before-after-") as made:
        folder = Path(made)
        prepare(folder, sizes)
        for number in range(rounds):
            for name in names:
                print(f"round {number + 1}: {name}", file=sys.stderr, flush=True)
                times[name].append((run(before, name, folder, "before"), run(HERE, name, folder, "after")))
        return times, {name: outputs(folder, name, "before") == outputs(folder, name, "after") for name in names}


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("before", type=Path)
    parser.add_argument("--only", nargs="+", default=list(COMMANDS), choices=list(COMMANDS), metavar="NAME")
    parser.add_argument("--rounds", type=int, default=3)
    for each in fields(Sizes):
        parser.add_argument(f"--{each.name}", type=int, default=each.default)
    given = parser.parse_args()
    sizes = Sizes(**{each.name: getattr(given, each.name) for each in fields(Sizes)})
    times, same = measured(given.before, given.only, given.rounds, sizes)
    print(f"medians of {given.rounds} rounds, processor seconds; load {os.getloadavg()[0]:.1f} at the end")
    print(f"{'':34}{'before':>9}{'after':>9}{'ratio':>8}{'elapsed':>10}{'':>9}{'MB':>8}{'':>6}  same")
    for name, pairs in times.items():
        before, after = ([pair[k] for pair in pairs] for k in (0, 1))
        print(f"{name:34}{median(before, 1):9.2f}{median(after, 1):9.2f}{ratio(pairs):8.2f}", end="")
        print(
            f"{median(before, 0):10.2f}{median(after, 0):9.2f}{median(before, 2):8.0f}{median(after, 2):6.0f}", end=""
        )
        print(f"  {'yes' if same[name] else 'no'}")


def ratio(pairs: Sequence[tuple[Spent, Spent]]) -> float:
    """Median of the ratios of processor time before to after."""
    return statistics.median(before.processor / after.processor for before, after in pairs)


def run(checkout: Path, name: str, folder: Path, stage: str) -> Spent:
    """One run of a command, into a folder of its own."""
    output = folder / stage / name.replace(" ", "_")
    output.mkdir(parents=True, exist_ok=True)
    for old in sorted(output.rglob("*"), reverse=True):
        old.rmdir() if old.is_dir() else old.unlink()
    return ncomp(checkout.resolve(), COMMANDS[name].replace("{out}", f"{output}/out"), folder)


def median(spent: list[Spent], column: int) -> float:
    """Median of elapsed time (0), processor time (1) or memory (2)."""
    return statistics.median(each[column] for each in spent)


def outputs(folder: Path, name: str, stage: str) -> dict[str, list[bytes]]:
    """The lines of all outputs of a command that do not differ from run to run."""
    found = folder / stage / name.replace(" ", "_")
    return {
        path.relative_to(found).as_posix(): [
            line for line in path.read_bytes().splitlines() if not PASSING.search(line)
        ]
        for path in sorted(found.rglob("*"))
        if path.is_file()
    }


if __name__ == "__main__":
    main()
