"""The virtual gantry: volumetric error, speed and memory of simulating it: `python benchmarks/simulation.py`.

Errors by the virtual calibration paper, Table 1, on a 9 x 9 x 9 grid; then tracker points of random positions.
"""

from __future__ import annotations

import time
import tracemalloc

import numpy as np

import machines
from calibration.evaluation.volumetric import deviation_on, volumetric_error_um
from calibration.instruments import LaserTracker
from calibration.planning.strategies import evaluation_grid, plan
from calibration.simulation.simulate import observe, tracker_pose
from calibration.simulation.true_model import random_true_model

DRAWS, POINTS = 1000, 500_000


def main() -> None:
    """Print both."""
    gantry, rng = machines.load("gantry"), np.random.default_rng(0)
    grid = evaluation_grid(gantry)
    raw, left = np.empty(DRAWS), np.empty(DRAWS)
    for k in range(DRAWS):
        deviation, points = deviation_on(gantry, random_true_model(gantry, rng), grid)
        raw[k], left[k] = volumetric_error_um(deviation).rms, volumetric_error_um(deviation, points).rms
    for what, values in (("raw", raw), ("aligned", left)):
        print(f"VE0 {what:<8} {values.mean():.1f} um (standard error {values.std() / DRAWS**0.5:.2f}, {DRAWS} draws)")

    state = plan(gantry, "random", POINTS).state
    tracker = LaserTracker(u_range_um_per_m=0.25, u_angle_um=10.0, u_angle_um_per_m=2.5)
    poses = {"1": tracker_pose((-1500.0, 1500.0, 300.0), rng)}
    model = random_true_model(gantry, rng)
    start = time.perf_counter()
    observe(gantry, model, state, tracker, rng, poses)
    print(f"{POINTS} tracker points in {time.perf_counter() - start:.2f} s")
    tracemalloc.start()
    for n in (POINTS // 5, POINTS):
        part = state.rows(slice(0, n))
        tracemalloc.reset_peak()
        before = tracemalloc.get_traced_memory()[0]
        observe(gantry, model, part, tracker, rng, poses)
        peak = tracemalloc.get_traced_memory()[1] - before
        print(f"{n} points: {peak / 1e6:.0f} MB on top, {peak / n:.0f} bytes a point")


if __name__ == "__main__":
    main()
