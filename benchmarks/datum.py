"""A part that was touched off on a machine with errors: its distance from the datum, cut with three programs.

    python benchmarks/datum.py

The tests' own virtual machine (tests/virtual_machine), which shares no code with ncomp, drives a probe until its tip
really is at the datum of the part, stores the work offset that it reads there, and cuts the part: by the program as it
is, corrected with the work offset taken for true, and corrected with it as probed. Errors are those of the part from
its datum, um, at 32 points of every feed move. Machines and programs: the DMU 50 with its demonstration calibration
and examples/box.nc; the same part without its five-axis moves on a gantry with random errors, with a probe twice as
long as the tool; and with the table turned to B 30, C 90 before it is touched off and cut.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from support.programs import load, random_model
from virtual_machine.calibrated import read_calibration
from virtual_machine.chain import load as chain_of
from virtual_machine.part import Shop

from kinematics.error_model.model import write_model

ROOT = Path(__file__).parents[1]
BOX = (ROOT / "examples" / "box.nc").read_text(encoding="utf-8")
FLAT = BOX.split("(begin operation: FiveAxis)")[0] + "M2\n"
LENGTH = 80.0
TURNED = FLAT.replace("G43 H1", "G0 B30 C90\nG43 H1")
ON_THE_GANTRY = {"X": 3000.0, "Y": 900.0, "Z": 500.0}
ON_THE_TABLE = {"X": -30.0, "Y": -20.0, "Z": 150.0}
DEMONSTRATION = ROOT / "machines" / "calibrations" / "dmu50.json"


class Case(NamedTuple):
    """A machine, a part, and how it was touched off."""

    name: str
    machine: str
    program: str
    place: dict[str, float]
    probe: float
    rotary: dict[str, float]
    datum: str


CASES = (
    Case("DMU 50, demonstration", "dmu50", BOX, ON_THE_TABLE, LENGTH, {}, "G54=probed"),
    Case("gantry, probe of 160 mm", "gantry", FLAT, ON_THE_GANTRY, 160.0, {}, "G54=probed@probe=160"),
    Case("DMU 50 at B 30, C 90", "dmu50", TURNED, ON_THE_TABLE, LENGTH, {"B": 30.0, "C": 90.0}, "G54=probed@B30,C90"),
)


def cut(case: Case, folder: Path) -> list[str]:
    """Rows of the table: how the program was made, and the largest and RMS error of the part, um."""
    calibration, part, out = DEMONSTRATION, folder / "part.nc", folder / "out.nc"
    if case.machine != "dmu50":
        calibration = folder / "cal.json"
        write_model(random_model(load(case.machine), 11, 30.0), calibration)
    part.write_text(case.program, encoding="utf-8")
    shop = Shop(chain_of(case.machine), read_calibration(calibration).errors, LENGTH)
    touched = shop.touched_off(case.place, case.probe, **case.rotary)
    offset = "G54=" + ",".join(f"{touched.offset[axis]:.6f}" for axis in "XYZ")
    command = [sys.executable, "-c", "from postproc.cli import run; run()", str(part), "-m", case.machine]
    command += ["-c", str(calibration), "--work-offset", offset, "--tool-length", f"T1={LENGTH:g}", "-o", str(out)]
    rows = []
    for way, datum in (
        ("uncorrected", ""),
        ("corrected, G54=true", "G54=true"),
        (f"corrected, {case.datum}", case.datum),
    ):
        if datum:
            subprocess.run([*command, "--datum", datum], check=True, capture_output=True, cwd=ROOT)
        program = out.read_text(encoding="utf-8") if datum else case.program
        _, errors = shop.cut(program, case.program, touched)
        rows.append(f"| {case.name} | {way} | {errors.max():.2f} | {np.sqrt(np.mean(errors**2)):.2f} |")
    return rows


def main() -> None:
    """Command line."""
    print("| machine | program | largest, um | RMS, um |\n|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        for case in CASES:
            print("\n".join(cut(case, Path(folder))), flush=True)


if __name__ == "__main__":
    main()
