"""The folder in which mistakes are made, and the end of each: `python -m tests.mistakes` prints all of them."""

from __future__ import annotations

import re
import shutil
from collections.abc import Iterator
from contextlib import chdir
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import ncomp
from calibration.instruments import LaserTracker
from calibration.measurement.plan_file import write_plan
from calibration.measurement.written_file import write_measurement
from calibration.simulation.measure_plan import VirtualInstrument
from calibration.simulation.true_model import random_true_model
from kinematics.error_model.model import write_model
from tests.mistakes import folders, job_files, machine_files, measurements, numbers, options, programs, strange_files
from tests.mistakes.mistake import PROGRAM, Mistake
from tests.support.command import run_command
from tests.support.programs import load, shifted

KINDS: dict[str, tuple[Mistake, ...]] = {
    "program": programs.MISTAKES,
    "option": options.MISTAKES,
    "machine file": machine_files.MISTAKES,
    "measurement": measurements.MISTAKES,
    "job file": job_files.MISTAKES,
    "file or folder": folders.MISTAKES,
    "number or type": numbers.MISTAKES,
    "strange file": strange_files.MISTAKES,
}
"""All mistakes, by the kind of the file or text."""
MILL = """\
name = "mill"
description = "Trunnion mill in hall 3"
chain = "w C B b X Y Z t"

[axes.C]
point = [0, 0, 154.996]
travel = [0, 360]

[axes.B]
point = [0, 0, 154.996]
travel = [-110, 110]

[axes.X]
travel = [-250, 250]

[axes.Y]
travel = [-225, 225]

[axes.Z]
travel = [0, 400]
home = 400

[control]
family = "fanuc"

[work_offsets]
G54 = { X = -12.5, Y = 80, Z = 210 }

[tools]
5 = 96.3
"""
JOB = """\
machine = "gantry"
calibration = "cal.json"

[work_offsets]
G54 = { X = 10, Y = 20, Z = 0, datum = "probed" }

[tools]
1 = 80.0

[correction]
tolerance_um = 1.0

[programs]
"in.nc" = "out/out.nc"
"""


@dataclass(frozen=True)
class End:
    """The end of a command with a mistake."""

    message: str
    faults: tuple[str, ...]
    """Parts of a good end that are missing."""


def furnish(folder: Path) -> None:
    """Write the good files: a program, a corrected one, a calibration, a machine, a plan, its measurement, a job."""
    (folder / "in.nc").write_text(PROGRAM)
    (folder / "other.nc").write_text("G21 G90\nG0 X1. Y1. Z1.\n")
    (folder / "mill.toml").write_text(MILL)
    (folder / "job.toml").write_text(JOB)
    (folder / "empty").mkdir()
    model = shifted(load("gantry"), X=-10.0)
    write_model(model, folder / "cal.json")
    setup = ncomp.set_up("gantry", datum=["G54=true"], zero=True)
    (folder / "done.nc").write_text(ncomp.correct(folder / "in.nc", "gantry", model, setup=setup).text)
    plan = ncomp.plan("gantry", "grid", 125)
    with (folder / "plan.csv").open("wb") as file:
        write_plan(plan, file)
    tracker = VirtualInstrument(LaserTracker(u_range_um_per_m=0.25, u_angle_um=10.0, u_angle_um_per_m=2.5))
    made = ncomp.simulate(plan, random_true_model(plan.machine, np.random.default_rng(1)), tracker, seed=1)
    with (folder / "data.csv").open("wb") as file:
        write_measurement(made.measurement, file)


def end_of(mistake: Mistake, good: Path, folder: Path) -> End:
    """Make a mistake in a new copy of the good files, and judge how the command ends."""
    shutil.copytree(good, folder)
    mistake.write(folder)
    before = _content(folder)
    with chdir(folder):
        done = run_command(*mistake.words)
    faults = [
        *(["exit status"] if done.status != 2 else []),
        *(["standard output"] if done.out else []),
        *(["one line"] if not re.fullmatch("ncomp: [^\n]+\n", done.err) else []),
        *(["no output file"] if _content(folder) != before else []),
        *(name for name in ("place", "cause", "cure") if getattr(mistake, name) not in done.err),
    ]
    return End(done.err.strip(), tuple(faults))


def _content(folder: Path) -> dict[Path, bytes | None]:
    return {path: path.read_bytes() if path.is_file() else None for path in folder.rglob("*")}


def all_mistakes() -> Iterator[tuple[str, Mistake]]:
    """All mistakes with their kinds."""
    for kind, mistakes in KINDS.items():
        for each in mistakes:
            yield kind, each
