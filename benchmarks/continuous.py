"""Continuous-motion calibration against its paper (Miller et al. 2017): deviations of tables from the true errors.

    python benchmarks/continuous.py [--draws 300] [--only synthetic|spacing|feeds|steps|programs|slit|size]

synthetic: the paper's end-effect case, its three methods and the joint estimate side by side. spacing: its Table 1,
feeds: its Table 2, both on a virtual machine with known errors. steps: an error that coarse targets do not show.
programs: Table 1 once more, from the log to a corrected program by ncomp's commands alone. slit: the
log of a real axis at constant velocity, whose commands are known. size: seconds for long records. Figures are RMS over
the constant-velocity segment, in um, mean over draws; coverage is the share of rows whose error lies within 2 u.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from support.continuous_cases import MACHINE, Virtual, paper_case, quasi_of, virtual_case

import machines
from calibration.continuous.estimate import Estimate, estimate
from calibration.continuous.records import QuasiStatic, Record
from calibration.continuous.virtual import Laser, Motion, Targets, measure
from calibration.instruments import Interferometer
from calibration.measurement.readers import read_any
from kinematics.transforms import Array

PAPER = {"end point": "3.03", "two points": "0.48", "least squares": "0.14", "joint": "-"}
FEEDS = (500.0, 2000.0, 4000.0, 6000.0, 8000.0, 10_000.0)
TABLE_2 = ((0.5, 1.5), (0.5, 1.5), (0.6, 1.4), (0.6, 1.4), (0.7, 1.5), (0.9, 1.5))
"""Optimised and two-point, um, by feed."""
TABLE = (
    "quantised-compensation:axis=X,step=13,pitch=36,offset=20",
    "cyclic:component=X,axis=X,period=12,sine=[0.8],cosine=[0]",
)
WARMING = "thermal-scale:axis=X,rate=8"
SLIT = Path(__file__).parents[2] / "shared" / "data" / "slit_axis" / "axis1_resolver_openloop.log"
SLIT_HEADER = {
    "command": "IOC_TEST:Axis1-PosAct",
    "observed": "IOC_TEST:ec0-s4-EL7211-Enc-PosAct",
    "axis": "X",
    "u_um": "0.3",
}


def rms(values: Array) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(values**2)))


def synthetic(draws: int) -> None:
    """The paper's Fig. 5 to 9."""
    print(f"Synthetic end-effect case, {draws} draws; um RMS, mean over draws")
    print(f"{'u(run), u(targets)':>20} " + " ".join(f"{name:>14}" for name in (*PAPER, "coverage", "u")))
    print(f"{'paper':>20} " + " ".join(f"{value:>14}" for value in PAPER.values()))
    for noise, noise_quasi in ((0.15, 0.15), (0.1, 0.05), (0.1, 0.15), (0.1, 0.3)):
        rows = []
        for seed in range(draws):
            case = paper_case(seed, noise, noise_quasi)
            found = estimate([case.record], case.quasi)
            (compared,) = found.comparisons.values()
            table = found.table()
            inner = table.continuous
            off = table.error[inner] - case.truth(table.position[inner])
            methods = [rms(errors - case.truth(compared.x)) for errors in compared.errors.values()]
            rows.append([*methods, rms(off), np.mean(np.abs(off) < 2 * table.u[inner]), rms(table.u[inner])])
        mean = np.mean(rows, axis=0)
        print(f"{f'{noise}, {noise_quasi}':>20} " + " ".join(f"{value:14.3f}" for value in mean))


def off_truth(case: Virtual, found: Estimate) -> tuple[Array, Array]:
    """Error of the table, and its standard uncertainty, inside the segment."""
    table = found.table("forward")
    inner = table.continuous
    return table.error[inner] - case.truth(table.position[inner], 1), table.u[inner]


def first_run(quasi: QuasiStatic) -> QuasiStatic:
    """The first bidirectional run alone, as the paper uses it."""
    return quasi.rows(np.flatnonzero(quasi.run == "1"))


def spacing(draws: int) -> None:
    """The paper's Table 1: the same run fitted to targets every 5, 25 and 90 mm."""
    print(f"Table 1: fits to targets every 25 and 90 mm against that every 5 mm, {draws} draws (paper: 0.6 and 2.5)")
    methods: dict[str, list[list[float]]] = {"least squares": [], "joint": []}
    truths: list[list[float]] = []
    for seed in range(draws):
        fits, curves = [], []
        for step in (5.0, 25.0, 90.0):
            case = virtual_case(seed, (*TABLE, WARMING), targets=Targets(step, 5), u_um=0.3)
            found = estimate(case.measured.records, first_run(case.quasi), positions=np.arange(10.5, 440.0, 1.0))
            fits.append(found)
            curves.append(found.curve("forward")[0])
        compared = [next(iter(each.comparisons.values())).errors["least squares"] for each in fits]
        for name, values in (("least squares", compared), ("joint", curves)):
            methods[name].append([rms(values[i][: len(values[0])] - values[0][: len(values[i])]) for i in (1, 2)])
        truths.append([rms(off_truth(case, found)[0]) for found in fits])
    for name, differences in methods.items():
        print(f"{name:>16}  25 mm {np.mean(differences, axis=0)[0]:.2f}   90 mm {np.mean(differences, axis=0)[1]:.2f}")
    print("joint, against the truth: 5 mm {:.2f}   25 mm {:.2f}   90 mm {:.2f}".format(*np.mean(truths, axis=0)))


def feeds(draws: int) -> None:
    """The paper's Table 2: feeds from 500 to 10,000 mm/min, RMS at the targets, and against the truth."""
    print(f"Table 2, {draws} draws: RMS at targets (paper), RMS against the truth in the segment")
    print("    feed  paper: fit, two    least squares   two points        joint    joint-truth  coverage  segment, mm")
    for feed, paper in zip(FEEDS, TABLE_2, strict=True):
        rows = []
        for seed in range(draws):
            laser = Laser(100.0 if feed <= 500.0 else 1000.0, 0.2, ((31.0, 0.4),), (18.0, 10.0, 0.1))
            case = virtual_case(seed, feed=feed, laser=laser, targets=Targets(50.0), u_um=0.5)
            found = estimate(case.measured.records, case.quasi)
            (compared,) = found.comparisons.values()
            order = np.argsort(compared.x)
            rows_in = found.fused.inside[case.quasi.direction[found.fused.inside] == 1]
            targets, readings = case.quasi.target[rows_in], case.quasi.deviation[rows_in]
            at = {
                name: rms(np.interp(targets, compared.x[order], errors[order]) - readings)
                for name, errors in compared.errors.items()
            }
            off, u = off_truth(case, found)
            ours = rms(np.interp(targets, found.fused.positions, found.curve("forward")[0]) - readings)
            low, high = found.segment
            rows.append(
                [at["least squares"], at["two points"], ours, rms(off), np.mean(np.abs(off) < 2 * u), low, high]
            )
        a, b, c, d, e, low, high = np.mean(rows, axis=0)
        print(
            f"{feed:8.0f}  {paper[0]:9.1f} {paper[1]:6.1f} {a:16.2f} {b:12.2f} {c:12.2f} {d:14.2f} {e:9.2f}  "
            f"{low:.1f} to {high:.1f}"
        )


def steps(draws: int) -> None:
    """Table steps of 13 um that targets every 90 mm miss."""
    print(f"Steps of 13 um every 36 mm, targets every 90 mm, {draws} draws")
    for seed in range(draws):
        case = virtual_case(seed, TABLE, targets=Targets(90.0), u_um=0.3)
        found = estimate(case.measured.records, case.quasi)
        jumps = found.by_direction[1].jumps
        rows = found.quasi.direction == 1
        smooth = np.polyfit(found.quasi.target[rows], found.quasi.deviation[rows], 3)
        seen = np.ptp(found.quasi.deviation[rows] - np.polyval(smooth, found.quasi.target[rows]))
        pitch = "no lattice" if jumps.pitch is None else f"every {jumps.pitch[0]:.3f} mm (u {jumps.pitch[1]:.3f})"
        off, u = off_truth(case, found)
        print(
            f"  draw {seed}: {len(jumps.positions_mm)} jumps of {np.mean(jumps.sizes_um):.2f} um, {pitch}; targets "
            f"show {seen:.1f} um about a cubic; table {np.median(np.abs(off)):.2f} um (median) from the truth, "
            f"coverage {np.mean(np.abs(off) < 2 * u):.2f}"
        )


def programs(_: int) -> None:
    """The machine of Table 1, calibrated, and a program corrected for it, by the commands; evaluated with the true
    errors.
    """
    print("Table 1 by commands: tool point error of a program at block ends by the truth, um RMS (max)")
    for step in (5, 25, 90):
        with tempfile.TemporaryDirectory() as folder:
            before, after, back = _by_commands(Path(folder), step)
        print(f"  targets every {step} mm: {before}; corrected {after}; by the tables that LinuxCNC has {back}")


def _by_commands(folder: Path, step: int) -> tuple[str, str, str]:
    """Errors before and after correction, and after that by tables that were exported and imported again."""
    rng = np.random.default_rng(0)
    moves = "".join(f"G1 X{x:.3f} Y{y:.3f} F500\n" for x, y in zip(*rng.uniform(5.0, 400.0, (2, 40)), strict=True))
    (folder / "part.nc").write_text(f"G21 G90 G17 G54\nT1 M6\nG0 X10. Y10. Z30.\n{moves}M30\n")
    effects = [word for effect in (*TABLE, WARMING, "backlash:axis=X,width=8") for word in ("--effect", effect)]
    axis = ("--axis", "X", "--start-mm", "0", "--end-mm", "450", "--both", "--errors", "none", "--end-effect", "4:20")
    targets = ("--spacing", str(step), "--runs", "5", "--u-um", "0.3")
    files = ("-o", "run.csv", "--quasistatic", "targets.csv", "--truth", "truth.json")
    _ncomp(folder, "simulate-continuous", *axis, *effects, *targets, *files)
    made = ("-o", "table.csv", "--write-calibration", "cal.json")
    _ncomp(folder, "continuous", "run.csv", "targets.csv", "--run", "1", *made)
    _ncomp(folder, "export", "-c", "cal.json", "--format", "linuxcnc", "-o", "tables")
    _ncomp(folder, "import", "tables", "--format", "linuxcnc", "-o", "back.json")
    found = []
    for calibration in ("cal.json", "back.json"):
        set_up = ("-c", calibration, "--work-offset", "G54=30,10,100", "--tool-length", "T1=100")
        _ncomp(folder, "correct", "part.nc", *set_up, "--accept", "worse", "-o", "out.nc")
        against = ("--align", "truth.json", "--elapsed", "0", "--json", "-")
        shown = json.loads(_ncomp(folder, "verify", "part.nc", "out.nc", *set_up, *against))["block_ends_um"]
        found.append([f"{shown[when]['rms']:.2f} ({shown[when]['max']:.2f})" for when in ("before", "after")])
    return found[0][0], found[0][1], found[1][1]


def _ncomp(folder: Path, *words: str) -> bytes:
    """Standard output of a command."""
    call = "from postproc.cli import run; run()"
    done = subprocess.run(
        [sys.executable, "-c", call, *words, "--machine", MACHINE.name], cwd=folder, capture_output=True, check=False
    )
    if done.returncode:
        sys.exit(f"ncomp {' '.join(words)}: {done.stderr.decode()}")
    return done.stdout


def slit_case(every_mm: float) -> tuple[Record, QuasiStatic, Callable[[Array], Array]]:
    """The slit axis as a run without its commands, readings at some of its targets, and the true errors."""
    measured = read_any(
        SLIT, machines.load(str(Path(__file__).parents[1] / "examples/single_axis.toml")), header=SLIT_HEADER
    )
    x, error, stamps = measured.state.positions[:, 0], measured.observed[:, 0] * 1e3, measured.state.time
    assert stamps is not None
    record = Record("1 forward", 1, stamps, x + 1e-3 * error, float(x[0]), float(x[-1]), 15.0, "slit axis")
    at = np.arange(np.ceil(x[0] / every_mm), np.floor(x[-1] / every_mm) + 1.0) * every_mm
    nearest = np.array([int(np.argmin(np.abs(x - target))) for target in at])
    ones = np.ones(len(at), int)
    quasi = QuasiStatic(np.round(x[nearest], 6), error[nearest], ones, ones.astype(str), 0.3, source="targets")
    return record, quasi, lambda where: np.interp(where, x, error)


def slit(_: int) -> None:
    """The real slit axis: its error rebuilt from displacement against time and a few readings."""
    if not SLIT.is_file():
        print("slit axis: the data (../shared/data/slit_axis) are not beside this repository")
        return
    print("Slit axis of the ESS, 15 mm/min, 100 Hz; truth: its own commands, sample by sample")
    for every in (0.4, 1.0, 2.0):
        record, quasi, truth = slit_case(every)
        found = estimate([record], quasi)
        table = found.table()
        inner = table.continuous
        off = table.error[inner] - truth(table.position[inner])
        first = found.by_direction[1].waves[0]
        print(
            f"  readings every {every:g} mm ({len(quasi)}) show {np.ptp(quasi.deviation):.1f} um, the joint table "
            f"{np.ptp(table.error):.1f} um; RMS {rms(off):.2f} um, largest {np.abs(off).max():.2f} um from the truth, "
            f"coverage {np.mean(np.abs(off) < 2 * table.u[inner]):.2f}; cyclic {first.period_mm:.5f} mm "
            f"(u {first.u_period_mm:.1g}), {first.amplitude_um:.2f} um"
        )


def size(_: int) -> None:
    """Seconds for records of one run over 250 mm."""
    model = virtual_case(0).model
    motion, targets, instrument = Motion(0.0, 250.0, 500.0), Targets(25.0), Interferometer(u_um=0.3)
    for samples in (30_000, 500_000):
        laser = Laser(samples / 32.2)
        measured = measure(MACHINE, model, "X", motion, laser, targets, instrument, np.random.default_rng(1))
        begin = time.perf_counter()
        estimate(measured.records, quasi_of(measured.quasi))
        print(f"{sum(map(len, measured.records))} samples: {time.perf_counter() - begin:.1f} s")


PARTS: dict[str, tuple[Callable[[int], None], int]] = {
    "synthetic": (synthetic, 1),
    "spacing": (spacing, 15),
    "feeds": (feeds, 15),
    "steps": (steps, 60),
    "programs": (programs, 300),
    "slit": (slit, 1),
    "size": (size, 1),
}
"""Part of the benchmark, and divisor of its draws."""


def main() -> None:
    """All parts, or one."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--draws", type=int, default=300)
    parser.add_argument("--only", choices=list(PARTS))
    asked = parser.parse_args()
    for name, (part, fewer) in PARTS.items():
        if asked.only in (None, name):
            part(max(asked.draws // fewer, 1))


if __name__ == "__main__":
    main()
