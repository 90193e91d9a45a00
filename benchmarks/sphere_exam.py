"""Touch probe and spheres on the shipped five-axis machines: location errors, error at other poses, coverage of U.

For each machine a plan by `ncomp plan spheres` (34 rotary positions, three spheres, the first one
again at the end), then draws of the machine: location errors uniform within 50 um and urad, error motions of rotary
axes as in `ncomp simulate`, those of linear axes a tenth of the virtual calibration paper's (--linear 0.1); spheres up
to 1 mm off, noise 1 um (k = 1). Each measurement is fitted as `ncomp fit` does, and the tip is evaluated at 200 other
poses inside the measured ranges, within 50 mm of the spheres, where the best rigid motion is left out of errors and
uncertainties: the datum of the calibration decides on it. "covered" is the share of predicted deviations, in x, y and
z, within U (k = 2) of the true ones; "seen" the same without the directions on which the prior outweighs the data.

    python benchmarks/sphere_exam.py [--draws 20] [--first 0] [--spheres 3] [--linear 0.1] [--design bk]
        [--machine dmu50 ...]
"""

import argparse
import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from support.probe_cases import AROUND, MIDDLE, TIP, covered, deviation_columns, in_datum

import machines
from calibration.evaluation.volumetric import volumetric_error_um
from calibration.fit.calibrate import calibrate
from calibration.fit.fit import Fit
from calibration.instruments import TouchProbe
from calibration.probing.bodies import Artefact, Probe
from calibration.probing.plan import ProbeRequest, probe_plan
from calibration.simulation.measure_plan import VirtualInstrument, measure_plan, streams
from calibration.simulation.true_model import (
    ROTARY,
    TABLE_1,
    model_of,
    random_location_errors,
    random_true_model,
)
from kinematics.deviation import exact_deviation
from kinematics.effects import LocationError
from kinematics.forward import tool_point
from kinematics.inverse import linear_positions
from kinematics.state import State
from kinematics.user_error import UserError

LOCATION_UM = 50.0
POSES = 200
NOTICED_UM = 0.02
"""RMS effect on the deviations, um, below which a direction of the parameters does not count."""


def half_widths(linear):
    """Half-widths of the error motions: rotary axes as usual, a share of them for linear axes."""
    small = {
        name: tuple(value * (1.0 if k in (2, 5) else linear) for k, value in enumerate(row))
        for name, row in TABLE_1.items()
    }
    return {**small, **ROTARY}


def true_model(machine, rng, linear=0.1):
    """A random machine."""
    motions = random_true_model(machine, rng, half_widths(linear)).effects
    return model_of(machine, [*random_location_errors(machine, rng, LOCATION_UM), *motions])


def other_poses(plan, rng):
    """Axis positions `(n, axes)` of the tip near the spheres, at rotary positions inside the measured ranges."""
    machine, spheres = plan.machine, np.array(list(plan.spheres.values()))
    low, high = plan.positions.min(axis=0), plan.positions.max(axis=0)
    q = low + rng.uniform(size=(20 * POSES, len(low))) * (high - low)
    middle = spheres.mean(axis=0)
    half = np.maximum(np.abs(spheres - middle).max(axis=0), 50.0)
    q = linear_positions(machine, q, middle + rng.uniform(-1.0, 1.0, (len(q), 3)) * half, TIP)
    return q[np.all((q >= low - 20.0) & (q <= high + 20.0), axis=1)][:POSES]


def unseen(found: Fit, machine, q):
    """Orthonormal directions `(3 n, k)` of deviations in which the prior outweighs the data."""
    values, vectors = np.linalg.eigh(found.solved.information)
    weak = deviation_columns(found.model, machine, q) @ (found.prior[:, None] * vectors[:, values < 1.0])
    u, sizes, _ = np.linalg.svd(weak, full_matrices=False)
    return u[:, sizes > NOTICED_UM * len(u) ** 0.5]


def examined(plan, seed, linear):
    """Location errors within U, error at other poses before and after, components within U; None for a refusal."""
    machine, draws = plan.machine, streams(seed, 4)
    model = true_model(machine, draws[0], linear)
    measured = measure_plan(plan, model, VirtualInstrument(TouchProbe(u_um=1.0)), draws[1:]).measurement
    try:
        found = calibrate(measured, hold_out=False, force=True)
    except UserError as refusal:
        print(f"  draw {seed}: {refusal}")
        return None
    true = in_datum(model, found.fit)
    got = {e.name: e for e in found.model.effects if isinstance(e, LocationError)}
    inside = [abs(e.value - true[name]) <= 2.0 * e.uncertainties[0] for name, e in got.items()]
    q = other_poses(plan, np.random.default_rng(seed + 1000))
    points = tool_point(machine, q, TIP)
    real, told = (exact_deviation(machine, q, m.errors(machine, State(q)), TIP).position for m in (model, found.model))
    return {
        "inside": np.array(inside),
        "before": volumetric_error_um(real, points).rms,
        "after": volumetric_error_um(real - told, points).rms,
        "covered": covered(found.model, model, machine, q),
        "seen": covered(found.model, model, machine, q, unseen(found.fit, machine, q)),
        "chi2": found.fit.chi2_reduced,
        "hidden": [" and ".join(e.effects) for e in found.identifiability.unidentifiable if len(e.effects) < 4],
    }


def main():
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--draws", type=int, default=20)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--spheres", type=int, default=3)
    parser.add_argument("--points", type=int, default=34)
    parser.add_argument("--linear", type=float, default=0.1)
    parser.add_argument("--design", default="optimised")
    parser.add_argument("--machine", nargs="*", default=list(MIDDLE))
    given = parser.parse_args()
    design = f"{given.design}, linear axes {given.linear:g}, {given.draws} draws from {given.first}"
    print(f"{given.spheres} spheres, {given.points} poses, {design}")
    print(
        "machine       centres  location within U   before    after   after/before (worst)  no worse  "
        "covered, x, y, z  seen, x, y, z  chi2"
    )
    for name in given.machine:
        machine, start = machines.load(name), time.perf_counter()
        spheres = {f"s{k + 1}": tuple((AROUND[k] + MIDDLE[name]).tolist()) for k in range(given.spheres)}
        plan = probe_plan(machine, ProbeRequest(Probe(TIP), Artefact(spheres), given.design, given.points)).plan
        drawn = [examined(plan, seed, given.linear) for seed in range(given.first, given.first + given.draws)]
        results = [each for each in drawn if each is not None]
        before, after = (np.array([each[key] for each in results]) for key in ("before", "after"))
        inside = np.concatenate([each["inside"] for each in results])
        covered, known = (np.concatenate([each[key] for each in results]) for key in ("covered", "seen"))
        by_axis, known_by_axis = (" ".join(f"{share:.1%}" for share in each.mean(axis=0)) for each in (covered, known))
        chi2 = np.mean([each["chi2"] for each in results])
        print(
            f"{name:13s} {len(plan):6d}   {inside.mean():6.1%} of {inside.size:4d}   {before.mean():6.1f}"
            f"   {after.mean():6.2f}   {np.sqrt(np.mean(after**2) / np.mean(before**2)):8.1%}"
            f" ({(after / before).max():6.1%})   {np.mean(after <= before):9.0%}   {covered.mean():6.1%} ({by_axis})"
            f"   {known.mean():6.1%} ({known_by_axis})  {chi2:5.2f}"
            f"   {len(drawn) - len(results)} refused, {time.perf_counter() - start:.0f} s",
            flush=True,
        )
        print("              not visible:", "; ".join(dict.fromkeys(h for each in results for h in each["hidden"])))


if __name__ == "__main__":
    main()
