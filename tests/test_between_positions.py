"""Error motions between few positions: their curves, their uncertainty there, and the words about it."""

import json
from pathlib import Path

import msgspec
import numpy as np
import pytest
from scipy.stats import multivariate_normal
from support.interferometer_runs import runs
from support.probe_cases import probed
from support.tiers import quick
from support.virtual_measurements import THREE, measured, positions, truth, written

import machines
from calibration.fit.calibrate import calibrate
from calibration.fit.curves.between_positions import with_curves_between
from calibration.fit.curves.line_shares import line_shares
from calibration.fit.curves.smooth_process import CORRELATIONS, PROCESS_SIZES_UM, Process, Processes, _Evidence
from calibration.fit.fit import fit
from calibration.observation.full_model import BasisChoice, priors, rigid_model, with_effects
from kinematics.basis import BSpline
from kinematics.deviation import exact_deviation
from kinematics.effects import AngleHarmonic, ErrorMotion
from kinematics.error_model.model import no_errors
from kinematics.state import State

GANTRY = machines.load("gantry")
K_95 = 1.96
FEW = {"X": BasisChoice("cubic", 5), "Y": BasisChoice("cubic", 3), "Z": BasisChoice("cubic", 3)}


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


def fitted(measurement, bases=FEW):
    return fit(measurement, rigid_model(measurement, bases))


def test_the_evidence_is_that_of_the_normal_distribution():
    rng = np.random.default_rng(0)
    x, noise = np.linspace(0.0, 600.0, 6), 0.8
    values = rng.normal(size=12) * 5.0
    processes = Processes.about(x, (30.0, 20.0), [("positioning", values[:6]), ("angular", values[6:])])
    tried = [
        Process(correlation, length, {"positioning": size, "angular": size - 3})
        for correlation in CORRELATIONS
        for length, size in ((0.5, 8), (2.0, 12))
    ]
    found = _Evidence(processes, np.eye(12) / noise**2, values / noise**2).of(tried)
    for value, process in zip(found, tried, strict=True):
        roots = [processes.root(process, motion) for motion in range(2)]
        own = sum(
            multivariate_normal(np.zeros(6), root @ root.T + noise**2 * np.eye(6)).logpdf(part)
            for root, part in zip(roots, np.split(values, 2), strict=True)
        )
        bare = multivariate_normal(np.zeros(12), noise**2 * np.eye(12)).logpdf(values)
        assert value + processes.away(process) == pytest.approx(own - bare, abs=1e-6)


@pytest.mark.parametrize(("true", "least", "most"), [(90.0, 2.0, 3.0), (30.0, 0.8, 1.5), (3.0, 0.3, 0.8)])
def test_lines_of_one_class_show_their_size_together(true, least, most):
    """Also that of an axis of which nothing is seen; others keep the size of their prior."""
    x, noise, u = np.linspace(0.0, 600.0, 7), 0.5, np.linspace(-1.0, 1.0, 7)
    processes, right = {}, []
    for axis, a, b in (("X", 1.2, -0.9), ("Y", -0.7, 1.1), ("Z", 0.9, 0.8)):
        values = [true * (a + b * u), true * (b - a * u)]
        processes[axis] = Processes.about(x, (30.0, 30.0), [("positioning", values[0]), ("angular", values[1])])
        right += [value / noise**2 * (axis != "Z") for value in values]
    seen = np.repeat([1.0, 1.0, 0.0], 14) / noise**2
    free = dict.fromkeys(processes, np.array([True, False]))
    shares = line_shares(processes, free, np.diag(seen), np.concatenate(right))
    assert least <= shares["Z"][0] <= most
    assert shares["X"][0] == shares["Z"][0]
    assert {own[1] for own in shares.values()} == {1.0}


def test_known_values_leave_no_uncertainty_at_them():
    x = np.linspace(0.0, 600.0, 7)
    size = int(np.argmin(np.abs(PROCESS_SIZES_UM - 10.0)))
    rough, smooth = (
        Processes(
            x,
            (30.0,),
            ("positioning",),
            possible=((1.0, Process(next(iter(CORRELATIONS)), length, {"positioning": size})),),
        )
        for length in (0.5, 4.0)
    )
    assert rough.between(0) > 5.0
    assert smooth.between(0) < 0.1


@pytest.mark.parametrize("waves", [0.5, 2.0, 4.5])
def test_intervals_cover_the_errors_between_seven_positions(waves):
    x, between = np.linspace(0.0, 3000.0, 7), np.linspace(0.0, 3000.0, 121)
    inside, before = [], []
    for seed in range(8):
        rng = np.random.default_rng(seed)
        a, b, slope = rng.normal(size=3) * [6.0, 6.0, 15.0]

        def error(q, a=a, b=b, slope=slope):
            u = q / 3000.0
            return slope * u + a * np.sin(waves * np.pi * u) + b * np.cos(waves * np.pi * u)

        measurement = runs(error, x, rng)
        found = fitted(measurement, {"X": BasisChoice("targets", 7)})
        true = error(between) - error(between).mean()
        for model, shares in ((found.model, before), (with_curves_between(found)[0].model, inside)):
            values, covariance = curve(model, between)
            shares.append(np.mean(np.abs(values - true) <= K_95 * np.sqrt(np.diag(covariance))))
    assert np.mean(inside) > 0.85
    assert waves < 1.0 or np.mean(inside) > np.mean(before) + 0.2


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


def test_a_grid_predicts_unseen_poses_better():
    rng = np.random.default_rng(3)
    model = waving(truth(GANTRY, rng, size=8.0), "X", (0.5, 5.0))
    found = fitted(measured(GANTRY, grid(), THREE, model, rng))
    curved, between = with_curves_between(found)
    assert [(each.axis, each.positions) for each in between] == [("X", 7), ("Y", 5), ("Z", 5)]
    assert all(isinstance(e.basis, BSpline) and len(e.basis.nodes) in (9, 13) for e in curved.model.effects)
    assert unseen(curved.model, model, rng) < 0.9 * unseen(found.model, model, rng)


def test_among_many_positions_the_curves_follow_what_a_coarse_basis_lacks():
    rng = np.random.default_rng(1)
    model = waving(truth(GANTRY, rng, size=8.0), "X", (0.5, 5.0))
    found = fitted(measured(GANTRY, rng.uniform(*GANTRY.travel, (120, 3)), THREE, model, rng))
    curved, between = with_curves_between(found)
    assert between == ()
    assert unseen(curved.model, model, rng) < 0.5 * unseen(found.model, model, rng)


def test_finer_splines_than_curves_stay():
    x = np.linspace(0.0, 3000.0, 121)
    measurement = runs(lambda q: 5.0 * np.sin(q / 30.0), x, np.random.default_rng(2))
    found = fitted(measurement, {"X": BasisChoice("cubic", 40)})
    assert with_curves_between(found) == (found, ())


def test_a_stated_basis_stays():
    rng = np.random.default_rng(2)
    measurement = runs(lambda q: 5.0 * np.sin(q / 300.0), np.linspace(0.0, 3000.0, 9), rng)
    stated, automatic = calibrate(measurement, basis="b-spline:5"), calibrate(measurement)
    assert not stated.between_positions
    assert [each.axis for each in automatic.between_positions] == ["X"]
    assert next(e for e in stated.model.effects if isinstance(e, ErrorMotion)).basis.size == 5


@pytest.mark.statistical
def test_the_report_names_the_axis(ncomp):
    rng = np.random.default_rng(4)
    written(measured(GANTRY, grid((5, 4, 4)), THREE, truth(GANTRY, rng), rng), Path("grid.csv"))
    done = ncomp("fit", "grid.csv", "-m", "gantry", "-o", "cal.json", "--json", "fit.json")
    assert done.status == 0, done.err
    found = json.loads(Path("fit.json").read_text())["between_positions"]
    assert {axis: own["positions"] for axis, own in found.items()} == {"X": 5, "Y": 4, "Z": 4}
    assert all(own["u_um"] > 0.0 and own["u_urad"] > 0.0 for own in found.values())
    assert "between the 5 measured positions of X its errors may differ from the new calibration" in done.shown
    again = ncomp(
        "diagnose", "grid.csv", "-m", "gantry", "--calibration", "cal.json", "-o", "new.json", "--json", "d.json"
    )
    assert again.status == 0, again.err
    diagnosed = json.loads(Path("d.json").read_text())
    assert "the calibration was made from these data" in json.dumps(diagnosed["sanity"])
    assert not diagnosed["effects"]


@pytest.mark.statistical
def test_the_expected_size_of_a_curve_is_that_of_its_own_error_motion():
    """Spheres: squareness is expected from assembly, and makes no other error motion of its axis larger."""
    measurement, _ = probed("head_head", 20)
    kinds = {name: BasisChoice("b-spline" if name in "XYZ" else "fourier", 2 - (name in "BC")) for name in "XYZBC"}
    model, prior = with_effects(measurement, kinds, (), 0.1, 0.2)
    found = fit(measurement, model, prior=prior)
    curved, _ = with_curves_between(found)
    sizes = {
        effect.name: curved.prior[part].max()
        for effect, part in zip(curved.model.effects, curved.model.slices, strict=True)
    }
    others = [sizes[name] for name in ("E_XX", "E_ZZ", "E_AX")]
    # a tenth of the typical 30 um, or less where the data show that it is
    assert 0.25 < min(others) <= max(others) < 4.5
    assert min(sizes["E_XY"], sizes["E_XZ"]) > 2.0 * sizes["E_ZZ"]


@pytest.mark.statistical
def test_rotary_axes_as_splines_keep_the_size_of_their_own_prior():
    """Spheres: it is chosen apart from that of linear axes, whose lines show their size together."""
    measurement, _ = probed("trunnion_ac", 20)
    model, prior = with_effects(measurement, {name: BasisChoice("b-spline", 2) for name in "XYZAC"}, (), 0.1, 1.0)
    curved, _ = with_curves_between(fit(measurement, model, prior=prior))
    sizes = {
        effect.name: curved.prior[part].max()
        for effect, part in zip(curved.model.effects, curved.model.slices, strict=True)
    }
    assert min(size for name, size in sizes.items() if name[-1] == "A") > 28.0
    assert max(sizes[name] for name in ("E_XX", "E_YY", "E_ZZ")) < 4.5


@pytest.mark.parametrize("seed", quick(range(3), [], [0]))
def test_other_effects_are_found_again_beside_the_curves(seed):
    """A basis pays for a line with each of its parameters, and leaves a part of it to a wave of the tracker's circle."""
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
    base = rigid_model(measurement, dict.fromkeys("XYZ", BasisChoice("cubic", 9)))
    start = circle.with_parameters((0.0, 0.0))
    first = msgspec.structs.replace(base, effects=(*base.effects, start))
    found = fit(measurement, first, prior=np.concatenate([priors(base), [100.0, 100.0]]))
    before, after = (_of_circle(each) for each in (found, with_curves_between(found)[0]))
    assert np.all(np.abs(after[0] - [40.0, 20.0]) < 2.5 * after[1])
    assert np.all(after[1] < before[1])


def _of_circle(found):
    """Parameters of the last effect of a fit, and their standard uncertainties."""
    own = found.model.slices[-1]
    return np.array(found.model.parameters)[own], np.sqrt(np.diag(np.array(found.model.covariance))[own])
