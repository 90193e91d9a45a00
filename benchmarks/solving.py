"""Solving large calibrations: time and memory, against the pseudo-inverse that the papers take.

    python benchmarks/solving.py [--rows 500000]

Both get the same measurement of a gantry with 300 parameters. One step is compared with one pseudo-inverse, at sizes
that it can still do; the whole fit takes several steps, finds outliers and the covariance.
"""

from __future__ import annotations

import argparse
import resource
import statistics
import time
from collections.abc import Callable

import numpy as np

import machines
from calibration.fit.fit import fit
from calibration.fit.problem import Problem
from calibration.instruments import LaserTracker
from calibration.measurement.estimated_noise import Decorrelation
from calibration.measurement.measurement import Measurement, Target
from calibration.observation.full_model import BasisChoice, priors, rigid_model
from calibration.observation.normal_equations import derivatives
from calibration.simulation.simulate import observe, tracker_pose
from calibration.simulation.true_model import random_true_model
from kinematics.state import State

BASES = {"X": BasisChoice("cubic", 16), "Y": BasisChoice("cubic", 14), "Z": BasisChoice("cubic", 14)}
TARGETS = {"1": Target((0.0, 0.0, -150.0)), "2": Target((110.0, 60.0, -220.0)), "3": Target((-90.0, 100.0, -120.0))}
TRACKER = LaserTracker(u_range_um_per_m=0.25, u_angle_um=10.0, u_angle_um_per_m=2.5)
REPEATS = 3


def simulated(rows: int) -> Measurement:
    """Random positions all over a gantry."""
    machine, rng = machines.load("gantry"), np.random.default_rng(0)
    state = State(rng.uniform(*machine.travel, (rows, 3)), target=rng.choice(list(TARGETS), rows))
    poses = {"1": tracker_pose((-1500.0, 1500.0, 300.0), rng)}
    return observe(machine, random_true_model(machine, rng), state, TRACKER, rng, poses, TARGETS)


def seconds(work: Callable[[], object]) -> float:
    """Median time of a few runs."""
    times = []
    for _ in range(REPEATS):
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return statistics.median(times)


def against_pinv(rows: int) -> None:
    """Both methods at a size that the pseudo-inverse can solve; only the own one has to build its design."""
    measurement = simulated(rows)
    model = rigid_model(measurement, BASES)
    registration, _ = measurement.first_registration
    problem = Problem.of(measurement, model, priors(model))
    point = problem.point(np.array(model.parameters), registration)

    by_unknowns = derivatives(measurement, model, registration)
    assert by_unknowns is not None
    whitened = by_unknowns.whitened(measurement.whiteners, Decorrelation())
    dense = np.stack([whitened.times(unit).reshape(-1) for unit in np.eye(len(whitened.order))], axis=1)
    pinv = seconds(lambda: np.linalg.pinv(dense) @ problem.whitened(point.residual).reshape(-1))
    own = seconds(lambda: problem.solve(point, np.ones(rows), 1.0))
    whole = seconds(lambda: fit(measurement, model))
    size = f"{3 * rows} x {len(model.parameters)}"
    times = f"pinv {pinv:6.2f} s   one step {own:6.3f} s   ratio {pinv / own:5.1f}   whole fit {whole:6.2f} s"
    print(f"{size:>14}  {times}", flush=True)


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rows", type=int, default=500_000)
    rows = parser.parse_args().rows
    for smaller in (320, 2_000, 10_000):
        against_pinv(smaller)
    measurement = simulated(rows)
    model = rigid_model(measurement, BASES)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    start = time.perf_counter()
    found = fit(measurement, model)
    spent = time.perf_counter() - start
    after = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    print(
        f"{found.observations} observations, {len(model.parameters)} parameters: {spent:.1f} s, "
        f"{(after - before) / 1e3:.0f} MB more than the data; the design alone would take "
        f"{found.observations * len(model.parameters) * 8e-9:.1f} GB; chi2/dof {found.chi2_reduced:.3f}"
    )


if __name__ == "__main__":
    main()
