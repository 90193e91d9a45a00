"""A drift between the touches of one sphere: the side that `fit` names, and coverage of U at other poses.

For each draw a machine with location errors uniform within 50 um and urad, and error motions of rotary axes as in
`ncomp simulate`, with one and two waves per turn; one sphere at 34 random rotary positions, 40 s apart, the first one
again at the end, noise 1 um (k = 1). In turn the tool point or the workpiece drifts exponentially, by about 10 um in
space at the end. "stated" is `--prior-scale 0.1 --basis X=legendre:1,Y=legendre:1,Z=legendre:1,B=fourier:1,...`, which
lacks the second wave; "auto" leaves the bases to the evidence. The true deviations are those without the drift.

    python benchmarks/drift_of_spheres.py [--draws 20] [--first 0] [--waves 2] [--machine dmu50 ...] [--bases stated]
"""

import argparse
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from support.probe_cases import AROUND, MIDDLE, TIP, covered, poses

import machines
from calibration.fit.calibrate import calibrate
from calibration.instruments import TouchProbe
from calibration.simulation.measure_plan import VirtualInstrument, measure_plan, streams
from calibration.simulation.touch_probe import Spheres
from calibration.simulation.true_model import ROTARY, model_of, random_location_errors, random_true_model
from kinematics.effects import ThermalDrift, WorkpieceDrift
from kinematics.inverse import linear_positions
from kinematics.user_error import UserError

DRIFT_UM = (6.0, -5.0, 6.0)
END = 1.0 - np.exp(-3.0)
SIDES = {"tool point": ThermalDrift, "workpiece": WorkpieceDrift}


def measured_with(machine, kind, seed, waves):
    """A measurement under a drift, and the true model without it."""
    draws = streams(seed, 4)
    motions = random_true_model(machine, draws[0], {name: row[: 2 + 3 * waves] for name, row in ROTARY.items()})
    effects = [*random_location_errors(machine, draws[0], 50.0), *motions.effects]
    plan = poses(machine, 34, seed)
    again = np.append(np.arange(len(plan)), 0)
    state = replace(plan.state.rows(again), time=40.0 * np.arange(len(again)))
    plan = replace(plan, state=state, names=plan.names[again], run=plan.run[again], before=None)
    centre = tuple((AROUND[0] + MIDDLE[machine.name]).tolist())
    virtual = VirtualInstrument(TouchProbe(u_um=1.0), spheres=Spheres({"s1": centre}, {}))
    constant = (float(np.ptp(state.time)) / 3.0,)
    drift = [
        kind(letter, amplitudes=(um / END,), time_constants_s=constant)
        for letter, um in zip("XYZ", DRIFT_UM, strict=True)
    ]
    measured = measure_plan(plan, model_of(machine, [*effects, *drift]), virtual, draws[1:]).measurement
    return measured, model_of(machine, effects)


def other_poses(machine):
    """Axis positions `(200, axes)` of the tip near the sphere that were not measured."""
    points = np.add(MIDDLE[machine.name], AROUND[0]) + np.random.default_rng(9).uniform(-50.0, 50.0, (200, 3))
    return linear_positions(machine, poses(machine, len(points), seed=99).positions, points, TIP)


def side_of(messages):
    """The side that a report names: "tied" for both, "none" without an estimate."""
    text = " ".join(messages)
    named = [side for side in SIDES if f"as a drift of the {side}" in text]
    return named[0] if named else "tied" if "which side drifts" in text else "none"


def examined(machine, seed, waves, bases):
    """True side, named side, and share of predicted deviations within U."""
    side = list(SIDES)[seed % 2]
    measured, true = measured_with(machine, SIDES[side], seed, waves)
    rotary = [axis.name for axis in machine.axes if axis.rotary]
    basis = ",".join([*(f"{axis}=legendre:1" for axis in "XYZ"), *(f"{axis}=fourier:1" for axis in rotary)])
    stated = {"basis": basis, "prior_scale": 0.1} if bases == "stated" else {}
    try:
        found = calibrate(measured, hold_out=False, force=True, **stated)
    except UserError as refusal:
        print(f"  draw {seed}: {refusal}")
        return None
    inside = covered(found.model, true, machine, other_poses(machine))
    return side, side_of([each.message for each in found.findings if each.check == "drift"]), float(inside.mean())


def main():
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--draws", type=int, default=20)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--waves", type=int, default=2)
    parser.add_argument("--bases", nargs="*", default=["stated", "auto"])
    parser.add_argument("--machine", nargs="*", default=["dmu50", "trunnion_ac"])
    given = parser.parse_args()
    print(f"{given.draws} draws from {given.first}, machine with {given.waves} waves per turn")
    print("machine      bases    right  tied  wrong  none   covered (worst draw)")
    for name in given.machine:
        machine = machines.load(name)
        for bases in given.bases:
            drawn = [examined(machine, given.first + k, given.waves, bases) for k in range(given.draws)]
            results = [each for each in drawn if each is not None]
            named = [("right" if each[1] == each[0] else each[1]) for each in results]
            counts = [named.count("right"), named.count("tied"), sum(each in SIDES for each in named)]
            inside = [each[2] for each in results]
            print(
                f"{name:12s} {bases:7s} {counts[0]:5d} {counts[1]:5d} {counts[2]:6d} {named.count('none'):5d}"
                f"   {np.mean(inside):7.1%} ({min(inside):.1%})   {' '.join(f'{share:.2f}' for share in inside)}",
                flush=True,
            )


if __name__ == "__main__":
    main()
