"""Error motions between few positions, and over a part of a turn: their curves and their uncertainty there."""

import msgspec
import numpy as np
import pytest
from support.interferometer_runs import runs
from support.probe_cases import in_datum, probed, spheres_of
from support.tiers import quick
from support.virtual_measurements import THREE, measured, positions, truth

import machines
from calibration.fit.calibrate import calibrate
from calibration.simulation.true_model import ROTARY, random_location_errors, random_true_model
from kinematics.basis import BSpline
from kinematics.deviation import exact_deviation
from kinematics.effects import AngleHarmonic, ErrorMotion, LocationError
from kinematics.error_model.model import no_errors
from kinematics.state import State

GANTRY = machines.load("gantry")
K_95 = 1.96


def curve(model, x):
    """Values and covariance, less their means, of the positioning error of X at positions, um."""
    effect = next(e for e in model.effects if isinstance(e, ErrorMotion))
    part = model.slices[model.effects.index(effect)]
    columns = effect.basis.columns(x)
    columns = columns - columns.mean(axis=0)
    return columns @ np.array(effect.parameters), columns @ np.array(model.covariance)[part, part] @ columns.T


def grid(counts=(7, 5, 5)):
    travel = GANTRY.travel
    axes = (np.linspace(low, high, n) for (low, high), n in zip(travel.T, counts, strict=True))
    q = np.stack([each.ravel() for each in np.meshgrid(*axes, indexing="ij")], axis=1)
    return np.concatenate([q, q[::-1]])


@pytest.mark.parametrize("waves", [0.5, 2.0, 4.5])
def test_intervals_cover_the_errors_between_seven_positions(waves):
    x, between = np.linspace(0.0, 3000.0, 7), np.linspace(0.0, 3000.0, 121)
    inside = []
    for seed in range(8):
        rng = np.random.default_rng(seed)
        a, b, slope = rng.normal(size=3) * [6.0, 6.0, 15.0]

        def error(q, a=a, b=b, slope=slope):
            u = q / 3000.0
            return slope * u + a * np.sin(waves * np.pi * u) + b * np.cos(waves * np.pi * u)

        found = calibrate(runs(error, x, rng), hold_out=False, force=True)
        true = error(between) - error(between).mean()
        values, covariance = curve(found.model, between)
        inside.append(np.mean(np.abs(values - true) <= K_95 * np.sqrt(np.diag(covariance))))
    assert np.mean(inside) > 0.85


def waving(model, axis, waves):
    """The model with other cosines of an axis' error motions."""
    effects = [
        ErrorMotion(e.component, axis, e.basis.__class__(e.basis.interval, waves), e.parameters, u=e.u)
        if isinstance(e, ErrorMotion) and e.axis == axis else e
        for e in model.effects
    ]  # fmt: skip
    return msgspec.structs.replace(model, effects=tuple(effects))


def unseen(model, true, rng, n=300):
    """RMS error, um, of a model at poses all over the travel, but for a rigid motion."""
    q = rng.uniform(*GANTRY.travel, (n, 3))
    tool = np.tile([0.0, 0.0, -120.0], (n, 1))
    own, wanted = (
        exact_deviation(GANTRY, q, each.errors(GANTRY, State(q)), tool).position * 1e3 for each in (model, true)
    )
    left, points = own - wanted, q - q.mean(axis=0)
    turns = np.cross(np.eye(3)[None], points[:, None])
    columns = np.concatenate([np.tile(np.eye(3), (n, 1, 1)), turns / 1e3], axis=1).transpose(0, 2, 1).reshape(-1, 6)
    left = left.reshape(-1) - columns @ np.linalg.lstsq(columns, left.reshape(-1), rcond=None)[0]
    return float(np.sqrt(np.mean(left**2)))


def test_a_grid_predicts_unseen_poses():
    rng = np.random.default_rng(3)
    model = waving(truth(GANTRY, rng, size=8.0), "X", (0.5, 5.0))
    measurement = measured(GANTRY, grid(), THREE, model, rng)
    found = calibrate(measurement, hold_out=False)
    assert unseen(found.model, model, rng) < 0.35 * unseen(no_errors(GANTRY), model, rng)


def test_among_many_positions_a_calibration_follows_what_a_coarse_basis_lacks():
    rng = np.random.default_rng(1)
    model = waving(truth(GANTRY, rng, size=8.0), "X", (0.5, 5.0))
    measurement = measured(GANTRY, rng.uniform(*GANTRY.travel, (120, 3)), THREE, model, rng)
    coarse, found = (calibrate(measurement, basis=b, hold_out=False) for b in ("X=cubic:5,Y=cubic:3,Z=cubic:3", "auto"))
    assert unseen(found.model, model, rng) < 0.5 * unseen(coarse.model, model, rng)


def test_a_stated_basis_stays():
    rng = np.random.default_rng(2)
    measurement = runs(lambda q: 5.0 * np.sin(q / 300.0), np.linspace(0.0, 3000.0, 9), rng)
    stated = calibrate(measurement, basis="b-spline:5")
    assert next(e for e in stated.model.effects if isinstance(e, ErrorMotion)).basis.size == 5


@pytest.mark.parametrize("seed", quick(range(3), [], [0]))
def test_other_effects_are_found_beside_the_curves(seed):
    """A wave of the tracker's circle, which looks like a line of an error motion."""
    rng, ends = np.random.default_rng(seed), np.array([-1.0, 1.0])
    lines = [
        ErrorMotion(
            component, axis, BSpline((low, high), 1), tuple((ends * rng.uniform(-40.0, 40.0)).tolist()), u=(0.0, 0.0)
        )
        for axis, low, high in zip("XYZ", *GANTRY.travel.tolist(), strict=True)
        for component in "XYZABC"
    ]
    circle = AngleHarmonic(circle="azimuth", harmonic=1, sine_urad=40.0, cosine_urad=20.0)
    model = msgspec.structs.replace(no_errors(GANTRY), effects=(*lines, circle))
    measurement = measured(GANTRY, positions(GANTRY, 200, rng), THREE, model, rng)
    found = calibrate(measurement, effects=[circle.with_parameters((0.0, 0.0))], hold_out=False)
    (own,) = (each for each in found.model.effects if each.name == circle.name)
    assert np.all(np.abs(np.array(own.parameters) - [40.0, 20.0]) < 3.0 * np.array(own.uncertainties))


@pytest.mark.statistical
def test_location_errors_of_a_part_of_a_turn_are_within_their_uncertainties():
    """One sphere, on a machine with two waves per turn of A."""
    off = []
    for seed in range(12):
        machine, rng = machines.load("trunnion_ac"), np.random.default_rng(seed)
        effects = [*random_location_errors(machine, rng, 50.0), *random_true_model(machine, rng, ROTARY).effects]
        data, true = probed("trunnion_ac", 34, spheres=spheres_of("trunnion_ac", 1), effects=effects, seed=seed)
        found = calibrate(data, hold_out=False, force=True)
        exact = in_datum(true, found.fit)
        own = {each.name: each for each in found.model.effects if isinstance(each, LocationError)}
        off += [(own[name].value - exact[name]) / own[name].uncertainties[0] for name in ("E_Z0A", "E_B0A")]
    assert np.mean(np.abs(off) <= 2.0) >= 0.9
