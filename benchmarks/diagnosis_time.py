"""How long `ncomp diagnose` takes, with the whole table of effects: with causes that have a name, and with one without.

    python benchmarks/diagnosis_time.py [--rows 500 5000] [--machine gantry dmu50] [--times 3]

Data of the tests' own virtual machine (tests/virtual_machine): backlash of X, a cyclic error of Y, or an error outside
the table of effects, six times the noise of the mean. Times are of the whole command, its start included: the median of
several, and the longest.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from virtual_machine import draws, machine_causes
from virtual_machine.chain import load
from virtual_machine.designs import scattered
from virtual_machine.observe import scale_to

TIMES = 6.0
PASSES = 3
CAUSES = {
    "backlash": machine_causes.Backlash("X"),
    "cyclic": machine_causes.Cyclic("Y", 8.0, (1.0, 2.5)),
    "without a name": machine_causes.Unknown("Z"),
}


def sheet(name: str, rows: int, kind: str) -> str:
    """The measurement file."""
    rng, chain = np.random.default_rng(7), load(name)
    positions = rows // PASSES
    session = scattered(chain, rng, passes=PASSES, stations=1, with_references=False, positions=positions)
    setup = draws.with_machine(session, rng)
    cause = scale_to(setup, CAUSES[kind], TIMES)
    return draws.Draw(kind.replace(" ", "-"), setup, (cause,), [1, 2], times=(TIMES,)).sheet()


def seconds(name: str, rows: int, kind: str, folder: Path) -> float:
    """Times of one diagnosis."""
    data = folder / "data.csv"
    data.write_text(sheet(name, rows, kind))
    ncomp = [sys.executable, "-c", "from postproc.cli import run; run()"]
    start = time.perf_counter()
    subprocess.run(
        [*ncomp, "diagnose", str(data), "--machine", name, "-o", str(folder / "new.json")],
        check=True, capture_output=True,
    )  # fmt: skip
    return time.perf_counter() - start


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rows", type=int, nargs="+", default=[500, 5000])
    parser.add_argument("--machine", nargs="+", default=["gantry", "dmu50"])
    parser.add_argument("--times", type=int, default=3)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        for name in arguments.machine:
            for rows in arguments.rows:
                for kind in CAUSES:
                    spent = [seconds(name, rows, kind, Path(folder)) for _ in range(arguments.times)]
                    said = f"{np.median(spent):7.1f} s ({max(spent):.1f})"
                    print(f"{name:<8}{rows:>6} rows, {kind:<16}{said}", flush=True)


if __name__ == "__main__":
    main()
