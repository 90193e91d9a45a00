"""How long `ncomp diagnose` takes, with the whole table of effects: with causes that have a name, and with one without.

    python benchmarks/diagnosis_time.py [--rows 500 5000] [--machine gantry dmu50 robot] [--times 3]

Data of the tests' own virtual machine (tests/virtual_machine): backlash of X, a cyclic error of Y, a drift, or
an error outside the table of effects, six times the noise of the mean. `robot`: six rotary axes whose links are off by
tenths of mm and which were logged before they had settled (tests/support/robot.py). Times are those of the whole
command on the processor, its start included: the median of several, and the longest; then the largest memory.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from support import robot
from virtual_machine import draws, machine_causes
from virtual_machine.chain import load
from virtual_machine.designs import scattered
from virtual_machine.observe import scale_to

TIMES = 6.0
PASSES = 3
CAUSES = {
    "backlash": machine_causes.Backlash("X"),
    "cyclic": machine_causes.Cyclic("Y", 8.0, (1.0, 2.5)),
    "drift": machine_causes.Drift("Z"),
    "without a name": machine_causes.Unknown("Z"),
}
LAG = 2e-4
"""Share of the last move by which the joints of a robot are late when they are logged."""


def sheet(name: str, rows: int, kind: str) -> str:
    """The measurement file."""
    rng, chain = np.random.default_rng(7), load(name)
    positions = rows // PASSES
    session = scattered(chain, rng, passes=PASSES, stations=1, with_references=False, positions=positions)
    setup = draws.with_machine(session, rng)
    cause = scale_to(setup, CAUSES[kind], TIMES)
    return draws.Draw(kind.replace(" ", "-"), setup, (cause,), [1, 2], times=(TIMES,)).sheet()


def robot_sheet(rows: int) -> str:
    """The measurement file of a robot."""
    joints = robot.random_joints(rows)
    reached = joints - LAG * np.diff(joints, axis=0, prepend=joints[:1])
    columns = {f"A{i + 1}": column for i, column in enumerate(joints.T)}
    columns |= dict(zip("xyz", robot.measured(reached).T, strict=True))
    target = " ".join(f"{x:.6f}" for x in robot.target())
    head = ["machine: robot", "instrument: laser-tracker", "stands_on: bed", "u_range_um: 10", "u_angle_um: 10"]
    return "".join(f"# {line}\n" for line in [*head, f"target.t1: {target}"]) + robot.table(columns)


def spent(data: str, machine: str, folder: Path) -> tuple[float, float]:
    """Time on the processor, s, and largest memory, MB, of one diagnosis."""
    (folder / "data.csv").write_text(data)
    ncomp = [sys.executable, "-c", "from postproc.cli import run; run()"]
    process = subprocess.Popen(
        [*ncomp, "diagnose", str(folder / "data.csv"), "--machine", machine, "-o", str(folder / "new.json")],
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    _, status, used = os.wait4(process.pid, 0)
    if os.waitstatus_to_exitcode(status) not in (0, 2):
        raise RuntimeError(f"ncomp diagnose ended with status {os.waitstatus_to_exitcode(status)}")
    return used.ru_utime + used.ru_stime, used.ru_maxrss / 1024.0


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rows", type=int, nargs="+", default=[500, 5000])
    parser.add_argument("--machine", nargs="+", default=["gantry", "dmu50"])
    parser.add_argument("--times", type=int, default=3)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "robot.toml").write_text(robot.toml())
        for machine in arguments.machine:
            for rows in arguments.rows:
                for kind in ("settling",) if machine == "robot" else CAUSES:
                    data = robot_sheet(rows) if machine == "robot" else sheet(machine, rows, kind)
                    chain = str(folder / "robot.toml") if machine == "robot" else machine
                    runs = [spent(data, chain, folder) for _ in range(arguments.times)]
                    seconds, memory = zip(*runs, strict=True)
                    times = f"{np.median(seconds):7.1f} s ({max(seconds):.1f})"
                    print(f"{machine:<8}{rows:>6} rows, {kind:<16}{times} {max(memory):6.0f} MB", flush=True)


if __name__ == "__main__":
    main()
