"""Fresh questions for fit, diagnosis, NC programs, tables and speed, drawn by a seed: `make exam SEED=...`.

    python benchmarks/nightly_exam.py --seed 20261201 --size 1 [--history docs/exam_history.csv]

One line of figures is added to the history, and docs/evidence.md draws it. Size 1 takes some minutes, size 10 about an
hour. Questions are never tuned to: look at a failure for its kind, and at the chart for whether anything improves.
"""

from __future__ import annotations

import argparse
import csv
import json
import sys
import tempfile
import time
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import virtual_fits
from speed_inputs import _five_axes

sys.path.insert(0, str(Path(__file__).parents[1]))
sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from support.applied_tables import TOOL, calibration, missed, places, rms
from support.command import succeed
from support.programs import load, setup_of
from virtual_machine import draws, exam
from virtual_machine.calibrated import read_calibration
from virtual_machine.chain import load as chain_of
from virtual_machine.controls import control

import ncomp
from tests.fuzz.runner import run

EXAMINERS = ("contours", "cycles", "mutated_programs", "verified")
"""Fuzzers that need no other program."""
PROGRAMS, FITS, CAUSES, NOTHING, TABLES = 20, 1, 2, 1, 1
"""Questions of size 1: programs for each fuzzer, fits, causes, machines without one, and machines for each format."""
FORMATS = ("linuxcnc", "siemens-eec", "isg", "heidenhain")
LINES = 3_000
"""Lines of the program for the speed."""


def fits(seed: int, number: int) -> dict[str, Any]:
    """Calibrations of virtual gantries: chi2, and the share of errors that lie within U (k = 2), percent."""
    found = [virtual_fits.one("gantry", 1000 * seed + k) for k in range(number)]
    inside = np.concatenate([(np.abs(each.error) <= 2.0 * each.u).ravel() for each in found])
    chi2 = float(np.mean([each.chi2 for each in found]))
    return {"fits": number, "chi2": round(chi2, 3), "within_u_percent": round(100.0 * float(inside.mean()), 1)}


def diagnoses(seed: int, number: int, without: int) -> dict[str, Any]:
    """Hidden causes that are named with axis, and effects that are named and not there."""
    rng = np.random.default_rng([seed, 1])
    asked = [draws.draw([str(rng.choice(list(draws.KINDS)))], "gantry", 1000 * seed + k) for k in range(number)]
    found = [exam.ask(each) for each in [*asked, *(draws.nothing(1000 * seed + k) for k in range(without))]]
    named = sum(all(each.score.named) for each in found[:number])
    return {"causes": number, "named": named, "false_causes": sum(len(each.score.blamed) for each in found)}


def programs(seed: int, number: int) -> dict[str, Any]:
    """Random programs by each fuzzer, and differences."""
    found = [run(name, number, seed, keep=False) for name in EXAMINERS]
    for each in found:
        print("\n".join(f"{n} x {kind}" for kind, n in each.differences.items()), end="", file=sys.stderr)
    differences = sum(each.differences.total() for each in found)
    return {"programs": sum(each.programs for each in found), "differences": differences}


def tables(seed: int, number: int) -> dict[str, Any]:
    """Exports on virtual controls: largest share by which the remaining error differs from the sheet, percent."""
    apart = []
    for draw in range(number):
        for form in FORMATS:
            with tempfile.TemporaryDirectory() as name:
                folder = Path(name)
                calibration(load("cframe"), folder / "cal.json", (seed, draw))
                sign = () if form in ("linuxcnc", "isg") else ("--sign", "error")
                options = ("-m", "cframe", "--format", form, "-c", folder / "cal.json", *sign, "--tool-mm", 80)
                done = succeed("export", *options, "-o", folder / "tables", "--json", "-")
                told = json.loads(done.out)["errors"]["volume"]["tool_point_um"]["after_tables"]["rms"]
                chain = chain_of("cframe")
                commands, ways = places(chain)
                motors = control(form, folder / "tables", chain, "error", TOOL)(commands, ways)
                left = rms(missed(chain, read_calibration(folder / "cal.json"), motors, commands, ways))
                apart.append(abs(left - told) / told)
    return {"tables": len(apart), "sheet_apart_percent": round(100.0 * max(apart), 2)}


def speed() -> dict[str, Any]:
    """Lines of a five-axis program that are corrected in a second of the processor."""
    machine = load("dmu50")
    text = "".join(_five_axes(np.arange(LINES)))
    best = np.inf
    for _ in range(3):
        start = time.process_time()
        ncomp.correct(text, machine, dialect="iso", setup=setup_of(machine), travel_check=False)
        best = min(best, time.process_time() - start)
    return {"lines_per_s": round(LINES / best)}


def main() -> None:
    """Ask, print, and add a line to the history."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--size", type=int, default=1)
    parser.add_argument("--history", type=Path)
    given = parser.parse_args()
    seed, size = given.seed, given.size
    line = {"date": datetime.now(UTC).date().isoformat(), "seed": seed, "size": size}
    line |= fits(seed, FITS * size) | diagnoses(seed, CAUSES * size, NOTHING * size)
    line |= programs(seed, PROGRAMS * size) | tables(seed, TABLES * size) | speed()
    print(", ".join(f"{name} {value}" for name, value in line.items()))
    if given.history:
        new = not given.history.exists()
        with given.history.open("a", newline="") as out:
            writer = csv.DictWriter(out, list(line), lineterminator="\n")
            if new:
                writer.writeheader()
            writer.writerow(line)


if __name__ == "__main__":
    main()
