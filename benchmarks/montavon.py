"""Identifiability with Montavon's set-up: rank of the 276 parameters, and the null directions by name.

    python benchmarks/montavon.py

Chain Y-X-Z, 2.0 x 1.5 x 0.4 m, nodes every 100, 100 and 50 mm, 170 points on edges and 150 at random, one tracker. The
paper's condition (15), rank 276, cannot hold with one reflector; its pseudo-inverse hides that.
"""

from __future__ import annotations

import numpy as np

import machines
from calibration.fit.fit import fit
from calibration.fit.identifiability import identifiability
from calibration.instruments import LaserTracker
from calibration.measurement.measurement import Target
from calibration.observation.full_model import BasisChoice, rigid_model
from calibration.planning.strategies import plan
from calibration.simulation.simulate import observe, tracker_pose
from calibration.simulation.true_model import random_true_model
from kinematics.state import State

MACHINE = """
name = "montavon"
chain = "w b Y X Z t"
axes.X = { travel = [0, 2000] }
axes.Y = { travel = [0, 1500] }
axes.Z = { travel = [0, 400] }
"""
NODES = {"X": BasisChoice("b-spline", 21), "Y": BasisChoice("b-spline", 16), "Z": BasisChoice("b-spline", 9)}
VECTORS = ((0.0, 0.0, 0.0), (0.0, 0.0, -120.0), (90.0, 40.0, -120.0), (-60.0, 80.0, -60.0))


def main() -> None:
    """All numbers of tool vectors."""
    machine = machines.parse(MACHINE, "montavon")
    positions = plan(machine, "hexahedron+random", (170, 150)).positions
    for number in (1, 2, 3, 4):
        rng = np.random.default_rng(number)
        targets = {str(i + 1): Target(vector) for i, vector in enumerate(VECTORS[:number])}
        state = State(positions, target=rng.choice(list(targets), len(positions)))
        pose = {"1": tracker_pose((-1500.0, -1000.0, 300.0), rng)}
        tracker = LaserTracker(u_range_um_per_m=0.5, u_angle_um=3.0, u_angle_um_per_m=3.0)
        measured = observe(machine, random_true_model(machine, rng), state, tracker, rng, pose, targets)
        seen = identifiability(fit(measured, rigid_model(measured, NODES)))
        print(
            f"{number} tool vector(s): rank {seen.rank} of {seen.parameters}, {seen.rank_registered} after registration"
        )
        for unidentifiable in seen.unidentifiable:
            print(f"    {unidentifiable}")


if __name__ == "__main__":
    main()
