"""Calibrations of virtual machines, evaluated with their true errors: chi2, coverage of the stated uncertainties,
efficiency.

    python benchmarks/virtual_fits.py [--draws 200] [--prior size_of_machine=2 ...]

For each machine and draw: random errors, a noisy measurement, a fit; `--prior` states other priors of the machine.
Deviations are compared on a grid of positions that were not measured, after rigid alignment of the difference, since no
measurement from an unknown position shows a rigid shift.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from concurrent.futures import Executor, ProcessPoolExecutor
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

import machines
from calibration.evaluation.volumetric import aligned, deviation_on
from calibration.fit.calibrate import calibrate
from calibration.fit.fit import Fit
from calibration.instruments import LaserTracker
from calibration.measurement.measurement import Measurement, Target
from calibration.planning.strategies import evaluation_grid, plan
from calibration.simulation.simulate import observe, tracker_pose
from calibration.simulation.true_model import random_true_model
from kinematics.error_model.model import ErrorModel
from kinematics.error_transform import error_transform_with_tool
from kinematics.machine import Machine
from kinematics.state import State
from kinematics.transforms import Array

TOOLS = {"1": Target((0.0, 0.0, -150.0)), "2": Target((110.0, 60.0, -220.0)), "3": Target((-90.0, 100.0, -120.0))}


class Case(NamedTuple):
    """One set-up."""

    machine: str
    strategy: str
    points: tuple[int, ...]
    tracker: tuple[float, float, float]
    instrument: LaserTracker
    targets: dict[str, Target]


CASES = {
    "gantry": Case(
        "gantry",
        "hexahedron+random",
        (316, 304),
        (-1500.0, 1500.0, 300.0),
        LaserTracker(u_range_um_per_m=0.25, u_angle_um=10.0, u_angle_um_per_m=2.5),
        {"1": Target((0.0, 0.0, 0.0))},
    ),
    "C-frame": Case(
        "cframe",
        "hexahedron+random",
        (170, 150),
        (-1200.0, -900.0, 300.0),
        LaserTracker(u_range_um_per_m=0.5, u_angle_um=3.0, u_angle_um_per_m=2.0),
        TOOLS,
    ),
}


class Judged(NamedTuple):
    """One draw."""

    chi2: float
    before: float
    """RMS of the aligned deviation, um."""
    error: Array
    """Standard uncertainty of the prediction on the grid `(n, 3)`, um."""
    u: Array
    """Its stated standard uncertainty."""


def measure(case: Case, machine: Machine, truth: ErrorModel, rng: np.random.Generator) -> Measurement:
    """A noisy measurement by the case's strategy, targets in random turn."""
    positions = plan(machine, case.strategy, case.points).positions
    state = State(positions, target=rng.choice(list(case.targets), len(positions)))
    poses = {"1": tracker_pose(case.tracker, rng)}
    return observe(machine, truth, state, case.instrument, rng, poses, case.targets)


def judge(machine: Machine, truth: ErrorModel, found: Fit, grid: Array, tool: tuple[float, float, float]) -> Judged:
    """The fit against the true errors."""
    wanted, points = deviation_on(machine, truth, grid, tool)
    got, _ = deviation_on(machine, found.model, grid, tool)
    design = found.model.design(machine, State(grid), error_transform_with_tool(machine, grid, tool)[:, :3])
    n, _, p = design.shape
    columns = np.stack([aligned(design[:, :, k], points) for k in range(p)], axis=2).reshape(3 * n, p)
    u = np.sqrt(np.maximum(np.einsum("rp,pq,rq->r", columns, np.array(found.model.covariance), columns), 0.0))
    error = aligned(got - wanted, points)
    before = float(np.sqrt(np.mean(np.sum(aligned(wanted, points) ** 2, axis=1))) * 1e3)
    return Judged(found.chi2_reduced, before, error * 1e3, u.reshape(n, 3) * 1e3)


def one(name: str, draw: int, stated: Mapping[str, Any]) -> Judged:
    """One draw; stated: priors of the machine that differ from those of its kind."""
    case, rng = CASES[name], np.random.default_rng([20, draw])
    machine = machines.load(case.machine)
    machine = replace(machine, priors=replace(machine.priors, **stated))
    truth = random_true_model(machine, rng)
    measurement = measure(case, machine, truth, rng)
    found = calibrate(measurement, hold_out=False).fit
    tool = next(iter(case.targets.values())).position
    return judge(machine, truth, found, evaluation_grid(machine, 5), tool)


def run(name: str, draws: int, stated: Mapping[str, Any], pool: Executor) -> None:
    """All draws of one case."""
    judged = list(pool.map(one, [name] * draws, range(draws), [stated] * draws))
    chi2 = np.array([j.chi2 for j in judged])
    error, u = (np.stack([getattr(j, field) for j in judged]) for field in ("error", "u"))
    volumetric = np.sqrt(np.mean(np.sum(error**2, axis=2), axis=1))
    inside = np.abs(error) < 1.96 * u
    rms, stated = (float(np.sqrt(np.mean(a**2))) for a in (error, u))
    before = np.mean([j.before for j in judged])
    rows = {
        "points": f"{sum(CASES[name].points)} ({CASES[name].strategy})",
        "chi2/dof, mean (least, largest)": f"{chi2.mean():.3f} ({chi2.min():.3f}, {chi2.max():.3f})",
        "95 % intervals cover the true value in": f"{100 * inside.mean():.1f} % of {inside.size} deviations",
        "volumetric error before": f"{before:.2f} um (RMS, mean of {draws} draws)",
        "after (95 % of draws below)": f"{volumetric.mean():.2f} ({np.quantile(volumetric, 0.95):.2f}) um",
        "error per coordinate": f"{rms:.3f} um; as stated {stated:.3f}",
    }
    print(name)
    for what, value in rows.items():
        print(f"  {what:<36}{value}", flush=True)


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--draws", type=int, default=200)
    parser.add_argument("--prior", action="append", default=[], help="NAME=VALUE of [priors] in the machine file")
    given = parser.parse_args()
    stated = {name: float(value) for name, _, value in (each.partition("=") for each in given.prior)}
    with ProcessPoolExecutor() as pool:
        for name in CASES:
            run(name, given.draws, stated, pool)


if __name__ == "__main__":
    main()
