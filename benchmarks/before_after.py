"""Commands of two checkouts, timed in turn: `python benchmarks/before_after.py BEFORE [--only fit verify]`.

BEFORE is another checkout of the repository (`git worktree add ../before COMMIT`); this one is the state after. Both
work on the same inputs, which this one makes. Each command runs as a process of its own, once in each checkout a
round; the table has medians, and the median of the ratios within a round. `same` compares the outputs, without lines
that hold a time, a version or a calibration's name.
"""

from __future__ import annotations

import argparse
import os
import re
import statistics
import sys
import tempfile
from pathlib import Path

import numpy as np
from processes import Spent, spent
from speed_inputs import CLOTHINGS, FIVE_AXES, path

HERE = Path(__file__).parents[1]
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
    "verify": "verify in.nc corrected.nc --machine dmu50 --set-up-zero --json {out}.json",
    "predict": "predict points.csv --machine dmu50 -o {out}.csv",
    "export": "export --machine dmu50 --format siemens-eec -o {out}",
    "fit": "fit data.csv --machine gantry -o {out}.json",
    "plan on the fly": (
        "plan --machine gantry --strategy on-the-fly --target t=0,0,-100 --length-m 21 --feed 2500 -o {out}.csv"
    ),
    "diagnose": "diagnose few.csv --machine gantry -o {out}.json --json {out}.results",
}


def ncomp(checkout: Path, words: str, folder: Path) -> Spent:
    """A command of a checkout, in a folder."""
    accepted = (0, 2) if words.startswith(NOT_ACCEPTED) else (0,)
    return spent((*NCOMP, *words.split()), os.environ | {"PYTHONPATH": str(checkout)}, folder, accepted)


def prepare(folder: Path, blocks: int, points: int, rows: int, few: int) -> None:
    """The inputs of the commands."""
    CLOTHINGS[FIVE_AXES].write(folder / "in.nc", blocks)
    ncomp(HERE, "correct in.nc --machine dmu50 --set-up-zero -o corrected.nc", folder)
    states = path(np.arange(points))
    np.savetxt(folder / "points.csv", states, "%.4f", delimiter=",", header="X,Y,Z,B,C", comments="")
    for name, number in (("data.csv", rows), ("few.csv", few)):
        ncomp(HERE, f"{SIMULATED} --points {number // 6}+{number // 6} -o {name}", folder)


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("before", type=Path)
    parser.add_argument("--only", nargs="+", default=list(COMMANDS), choices=list(COMMANDS), metavar="NAME")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--blocks", type=int, default=20_000, help="blocks of the program")
    parser.add_argument("--rows", type=int, default=10_000, help="rows of fit")
    parser.add_argument("--points", type=int, default=100_000, help="rows of predict")
    parser.add_argument("--few", type=int, default=300, help="rows of diagnose")
    given = parser.parse_args()
    times: dict[str, list[tuple[Spent, Spent]]] = {name: [] for name in given.only}
    with tempfile.TemporaryDirectory(prefix="ncomp-before-after-") as made:
        folder = Path(made)
        prepare(folder, given.blocks, given.points, given.rows, given.few)
        for number in range(given.rounds):
            for name in given.only:
                print(f"round {number + 1}: {name}", file=sys.stderr, flush=True)
                times[name].append((run(given.before, name, folder, "before"), run(HERE, name, folder, "after")))
        same = {name: outputs(folder, name, "before") == outputs(folder, name, "after") for name in given.only}
    print(f"medians of {given.rounds} rounds, processor seconds; load {os.getloadavg()[0]:.1f} at the end")
    print(f"{'':18}{'before':>9}{'after':>9}{'ratio':>8}{'elapsed':>10}{'':>9}{'MB':>8}{'':>6}  same")
    for name, pairs in times.items():
        before, after = ([pair[k] for pair in pairs] for k in (0, 1))
        ratio = statistics.median(a.processor / b.processor for a, b in pairs)
        print(f"{name:18}{median(before, 1):9.2f}{median(after, 1):9.2f}{ratio:8.2f}", end="")
        print(
            f"{median(before, 0):10.2f}{median(after, 0):9.2f}{median(before, 2):8.0f}{median(after, 2):6.0f}", end=""
        )
        print(f"  {'yes' if same[name] else 'no'}")


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
