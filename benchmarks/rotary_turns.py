"""Rotary axes over several turns, by the commands a user gives: `python benchmarks/rotary_turns.py [--draws 20]`.

1. **Turns.** A DMU 50 whose C has a travel of -720 to 720 degrees, and trunnion_ac, whose C is endless. `simulate`,
   then `fit` or `three-points`, with C from 0 to 360; a program at 300 random positions is corrected and verified
   against the true errors (`verify --align`): C in 0 to 360, and the same positions in other turns.
2. **Draws.** Random machines with a table C that turns fully on a trunnion A or B, and with C on the table and B in
   the head: `three-points` from four stations, one round from each. Deviations of the tool point, 100 mm below the
   spindle nose, at 2000 positions of all axes, C from -720 to 720, RMS and largest, best aligned. The data of a head
   do not show a shift of the tool in it: given as it is, and with the tool set anew.
3. **An arc.** C of trunnion_ac measured from 0 to 340 in steps of 5 degrees: the error left inside and in the gap, its
   standard uncertainty in the report of the correction, and the refusal of `ncomp PROGRAM`.

Errors are those of the virtual calibration paper, Table 1, and those of rotary axes in
`calibration.simulation.true_model`.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import machines
from calibration.evaluation.volumetric import deviation_on, rigid_columns
from kinematics.error_model.model import ErrorModel, read_model
from kinematics.forward import forward
from kinematics.machine import Machine
from kinematics.transforms import Array

SEED = 20261122
TOOL = (0.0, 0.0, -100.0)
SETUP = ("--work-offset", "G54=0,0,0", "--tool-length", "T1=100")
TRACKER = ("u_range_um=0.25", "u_range_um_per_m=0.25", "u_angle_um=5", "u_angle_um_per_m=1")
STATIONS = ("1200,-1250,-650", "-1200,1250,-650", "1250,1200,950", "-1250,-1200,950")
TARGETS = {"P": "80,10,-50", "Q": "-60,60,-20", "K": "-30,-75,-80"}
TABLE = {"TP": "150,20,20", "TQ": "-80,120,60", "TK": "-60,-110,110"}
TURNS = {"0..360": (0,), "-720..0": (-1, -2), "360..720": (1,)}
TILTS = {"B": (0.0, 180.0), "A": (-110.0, 20.0)}


@dataclass(frozen=True)
class Bench:
    """A folder in which commands are run, and their machine."""

    folder: Path
    machine: str
    seed: int

    def run(self, *arguments: str) -> subprocess.CompletedProcess[str]:
        """An ncomp command."""
        call = [sys.executable, "-c", "from postproc.cli import run; run()", *arguments, "--machine", self.machine]
        return subprocess.run(call, capture_output=True, text=True, cwd=self.folder, check=False)

    def do(self, *arguments: str) -> None:
        """A command that must succeed."""
        done = self.run(*arguments)
        if done.returncode:
            raise SystemExit(f"{' '.join(arguments)}: {done.stderr}")

    def simulate(self, *where: str, data: str) -> None:
        """A measurement of the machine with the random errors of its seed."""
        u = [part for each in TRACKER for part in ("-u", each)]
        self.do("simulate", *where, *u, "--seed", str(self.seed), "-o", data, "--truth", "true.json")

    def fit(self) -> str:
        """A calibration of 500 random positions, from a tracker on the table."""
        targets = [f"--target={name}={at}" for name, at in TARGETS.items()]
        where = ("--strategy", "random", "--points", "500", "--rotary", "random", "--range", "C=0:360")
        self.simulate(*where, *targets, "--tracker", "50,80,900", data="fit.csv")
        self.do("fit", "fit.csv", "-o", "fit.json")
        return "fit.json"

    def three_points(self, turn: str, rotary_points: int) -> str:
        """A calibration of one axis at a time, from four stations on the floor."""
        targets = [f"--target={name}={at}" for name, at in TARGETS.items()]
        targets += [f"--target=table.{name}={at}" for name, at in TABLE.items()]
        stations = ["--stands-on=bed", *(f"--tracker={at}" for at in STATIONS)]
        way = ("--strategy", "axes", "--rotary", "swept", "--rotary-points", str(rotary_points))
        self.do("plan", *way, "--range", f"C={turn}", *targets, "-o", "plan.csv")
        self.simulate("--strategy", "plan.csv", *stations, data="three.csv")
        self.do("three-points", "three.csv", "-o", "three.json")
        return "three.json"

    def left(self, calibration: str, program: str) -> tuple[float, float, float]:
        """Error of a program relative to the datum at block ends, um RMS, before and after, and its u as reported."""
        (self.folder / "p.nc").write_text(program)
        with_it = ("--calibration", calibration, *SETUP)
        accepted = ("--accept", "outside,insignificant", "--force", "-o", "pc.nc")
        self.do("p.nc", *with_it, *accepted, "--json", "report.json")
        self.do("verify", "p.nc", "pc.nc", *with_it, "--align", "true.json", "--json", "verified.json")
        found = json.loads((self.folder / "verified.json").read_text())["block_ends_um"]
        report = json.loads((self.folder / "report.json").read_text())
        return (
            found["before"]["rms"],
            found["after"]["rms"],
            report["predicted_error_um"]["standard_uncertainty_of_prediction"]["rms"],
        )

    def model(self, name: str) -> ErrorModel:
        """A calibration that was written."""
        return read_model(self.folder / name, machines.load(self.machine))


def program(tilt: str, low: float, high: float, turns: Sequence[int]) -> str:
    """Moves to 300 random positions, the same for all turns of C."""
    rng = np.random.default_rng(SEED)
    lines = ["G21 G90 G54 T1 M6", "G0 Z250"]
    for i in range(300):
        x, y, z = rng.uniform([-150, -150, 20], [150, 150, 150])
        b, c = rng.uniform(*TILTS[tilt]), rng.uniform(low, high) + 360.0 * turns[i % len(turns)]
        lines += [f"G0 X{x:.3f} Y{y:.3f} Z{z:.3f} {tilt}{b:.3f} C{c:.3f}", f"G1 X{x + 2:.3f} F2000"]
    return "\n".join([*lines, "M30", ""])


def two_turns(folder: Path) -> str:
    """The machine file of a DMU 50 whose C travels two turns to either side."""
    text = (Path(machines.__file__).parent / "dmu50.toml").read_text()
    assert "travel = [0, 360]" in text
    path = folder / "dmu50_two_turns.toml"
    path.write_text(text.replace("travel = [0, 360]", "travel = [-720, 720]").replace('"dmu50"', '"dmu50_two_turns"'))
    return str(path)


def turns(folder: Path) -> None:
    """Print the error after correction in each turn."""
    print("1. program at 300 positions, error relative to the datum at block ends, um RMS")
    print(f"{'':22}{'before':>8}" + "".join(f"{name:>10}" for name in TURNS))
    for machine, tilt in ((two_turns(folder), "B"), ("trunnion_ac", "A")):
        bench = Bench(folder, machine, 4)
        for how, calibration in (("fit", bench.fit()), ("three-points", bench.three_points("0:360", 25))):
            found = [bench.left(calibration, program(tilt, 0.0, 360.0, turn)) for turn in TURNS.values()]
            cells = "".join(f"{after:10.3f}" for _, after, _ in found)
            print(f"{how + ', ' + Path(machine).stem[:11]:26}{found[0][0]:4.1f}{cells}", flush=True)


def random_machine(rng: np.random.Generator, *, head: bool) -> str:
    """The text of a machine file: C on a trunnion, or C on the table and B in the head, linear axes in any order."""
    tilt = "B" if head else str(rng.choice(["A", "B"]))
    linear = [str(name) for name in rng.permutation(["X", "Y", "Z"])]
    carried = int(rng.integers(0, 3))
    rotary, tool = (["C"], [tilt]) if head else (["C", tilt], [])
    lines = [f'chain = "{" ".join(["w", *rotary, *linear[:carried], "b", *linear[carried:], *tool, "t"])}"']
    c = [[-720, 720], [0, 360], [-360, 360], [-180, 180]][int(rng.integers(4))]
    size = {name: int(rng.integers(300, 700)) for name in linear}
    travels = {"C": c, tilt: [-int(rng.integers(80, 115)), int(rng.integers(20, 115))]}
    travels |= {name: [0, each] if name == "Z" else [-each // 2, each // 2] for name, each in size.items()}
    for name, travel in travels.items():
        point = f"point = {np.round(rng.uniform(-60, 60, 3), 1).tolist()}\n" if name in "ABC" else ""
        lines.append(f"[axes.{name}]\n{point}travel = {travel}")
    return "\n".join(['name = "drawn"', *lines, ""])


def deviations_left(machine: Machine, truth: ErrorModel, model: ErrorModel, *, mounted: bool) -> tuple[float, ...]:
    """RMS before, RMS and largest after, um, less the shift and turn of the workpiece, and of the tool if `mounted`."""
    rng = np.random.default_rng(SEED)
    low, high = machine.travel.copy()
    low[machine.index("C")], high[machine.index("C")] = -4 * np.pi, 4 * np.pi
    q = rng.uniform(low, high, (2000, len(low)))
    true, points = deviation_on(machine, truth, q, TOOL)
    found, _ = deviation_on(machine, model, q, TOOL)
    columns = rigid_columns(points)
    if mounted:
        columns = np.hstack([columns, np.broadcast_to(forward(machine, q).rotation, (len(q), 3, 3)).reshape(-1, 3)])
    lengths = [_length(1e3 * d.reshape(-1), columns) for d in (true, true - found)]
    before, after = (float(np.sqrt(np.mean(each**2))) for each in lengths)
    return before, after, float(lengths[1].max())


def _length(deviation: Array, columns: Array) -> Array:
    left = deviation - columns @ np.linalg.lstsq(columns, deviation, rcond=1e-10)[0]
    return np.asarray(np.linalg.norm(left.reshape(-1, 3), axis=1))


def draws(folder: Path, count: int, *, head: bool) -> None:
    """Print the error after a correction by three points on random machines."""
    kind = "C on the table, B in the head" if head else "C on a trunnion"
    print(f"\n2. {kind}: {count} machines, um: RMS before, RMS and largest after", flush=True)
    every = []
    for draw in range(count):
        rng = np.random.default_rng([SEED, draw, head])
        file = folder / f"drawn_{draw}_{head}.toml"
        file.write_text(random_machine(rng, head=head))
        bench, machine = Bench(folder, str(file), draw), machines.load(str(file))
        low = round(float(rng.uniform(*np.rad2deg(machine.travel[:, machine.index("C")]) - [0, 360])), 1)
        calibration = bench.three_points(f"{low}:{low + 345}", int(rng.choice([24, 16, 13])))
        models = bench.model("true.json"), bench.model(calibration)
        figures = deviations_left(machine, *models, mounted=False)
        figures += deviations_left(machine, *models, mounted=True)[1:] if head else ()
        cells = "".join(f"{value:8.2f}" for value in figures)
        print(f"{machine.chain:20} C from {low:7.1f}{cells}", flush=True)
        every.append(figures)
    print(f"{'median':34}" + "".join(f"{value:8.2f}" for value in np.median(every, axis=0)))
    print(f"{'largest':34}" + "".join(f"{value:8.2f}" for value in np.max(every, axis=0)))


def arc(folder: Path) -> None:
    """Print the error after correction where a part of the turn was not measured, and the refusal."""
    print("\n3. C measured from 0 to 340: um RMS before, after, and u as reported")
    bench = Bench(folder, "trunnion_ac", 4)
    calibration = bench.three_points("0:340", 69)
    for name, low, high in (("0..340", 0.0, 340.0), ("340..360", 340.0, 360.0)):
        for turn in (0, 1):
            figures = bench.left(calibration, program("A", low, high, (turn,)))
            print(f"{name + (' + 360' if turn else ''):16}" + "".join(f"{value:8.2f}" for value in figures), flush=True)
    done = bench.run("p.nc", "--calibration", calibration, *SETUP, "-o", "refused.nc")
    print(f"without --accept outside: exit {done.returncode}, {' '.join(done.stderr.split())[:150]} ...")


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--draws", type=int, default=20)
    count = parser.parse_args().draws
    with tempfile.TemporaryDirectory() as name:
        turns(Path(name))
        draws(Path(name), count, head=False)
        draws(Path(name), max(count // 4, 1), head=True)
        arc(Path(name))


if __name__ == "__main__":
    main()
