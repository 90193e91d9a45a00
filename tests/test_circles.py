"""Circular tests: the figures of ISO 230-4, the shares of the causes, and the command; the commands of docs/ballbar.md."""

import json
import re
import shlex
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.ballbar_cases import CFRAME, circles_of
from support.pages import panels
from support.tiers import quick
from support.virtual_measurements import written

from calibration.circles.circles import circles_of as read_circles
from calibration.circles.figures import circular_tests
from calibration.circles.shares import shares
from calibration.circles.spikes import kept
from calibration.instruments import Ballbar
from calibration.plausibility.checks import usable
from calibration.simulation.true_model import random_true_model
from kinematics.basis import Legendre
from kinematics.effects import (
    Backlash,
    Cyclic,
    ErrorMotion,
    LateralPlay,
    LocationError,
    ReversalSpike,
    Scale,
    ServoMismatch,
)
from kinematics.user_error import UserError

DRIVES = ("backlash", "lateral-play", "servo-mismatch", "reversal-spike", "cyclic")
PAGE = Path(__file__).parents[1] / "docs" / "ballbar.md"


def evaluated(*effects, **circles):
    measured, _ = circles_of(*effects, **circles)
    found = read_circles(measured)
    return circular_tests(measured, found), shares(measured, found)


def figure(tests, symbol):
    return next(each for each in tests[0].figures if each.symbol == symbol)


# ---- circles and figures


@pytest.mark.parametrize("plane", ["XY", "YZ", "ZX"])
def test_planes_directions_and_angles(plane):
    measured, _ = circles_of(planes=(plane,), step=5.0, noise=0.0)
    found = read_circles(measured)
    assert {each.plane for each in found} == {plane}
    assert [each.counter_clockwise for each in found] == [True, False] * 2
    assert [each.feed for each in found] == [1000.0, 1000.0, 3000.0, 3000.0]
    np.testing.assert_allclose(np.diff(np.unwrap(found[0].angles)), np.radians(5.0), atol=5e-5)


def test_a_perfect_machine_has_no_deviation():
    tests, found = evaluated(noise=0.0, step=5.0, bar=Ballbar(u_um=0.3, length_u_um=0.5))
    for symbol in ("G(ccw)", "G(cw)", "G(b)", "H"):
        assert figure(tests, symbol).value < 0.1
    assert abs(figure(tests, "D").value) < 3.0 * 0.5
    assert not found.causes


def test_the_ellipse_of_a_squareness_by_hand():
    """X to Y 90 deg + a: an ellipse at 45 deg with half axes r (1 +- a / 2): G is r a, and both directions agree."""
    tests, _ = evaluated(LocationError("C", "Y", 40.0), noise=0.0)
    for symbol in ("G(ccw)", "G(cw)", "G(b)"):
        assert figure(tests, symbol).value == pytest.approx(150.0 * 40e-3, abs=0.02)
    assert figure(tests, "H").value < 0.02


def test_servo_mismatch_turns_with_the_direction_by_hand():
    """Half the mismatch times the velocity on each axis: v dt sin(2 angle) / 2, opposite in the two directions."""
    tests, _ = evaluated(ServoMismatch("X", "Y", 0.3), noise=0.0)
    for test, feed in zip(tests, (1000.0, 3000.0), strict=True):
        values = {each.symbol: each.value for each in test.figures}
        assert values["G(ccw)"] == pytest.approx(0.3 * feed / 60.0, rel=0.01)
        assert values["H"] == pytest.approx(0.3 * feed / 60.0, rel=0.01)


def test_the_radius_is_known_with_a_calibrated_length_only():
    tests, _ = evaluated(step=5.0)
    assert {each.symbol for each in tests[0].figures} == {"G(ccw)", "G(cw)", "G(b)", "H"}
    both = [Scale("X", 100.0), Scale("Y", 100.0)]
    tests, _ = evaluated(*both, step=5.0, bar=Ballbar(u_um=0.1, length_u_um=0.5))
    assert abs(figure(tests, "D").value - 15.0) < figure(tests, "D").U * 1.5
    assert figure(tests, "Fmax").value >= figure(tests, "D").value >= figure(tests, "Fmin").value


@given(st.floats(-0.03, 0.03), st.floats(-0.03, 0.03))
@settings(max_examples=10)
def test_a_stated_centre_that_is_off_changes_nothing(x, y):
    measured, _ = circles_of(Backlash("X", 10.0), step=5.0)
    (centre,) = measured.spheres.values()
    other = replace(measured, spheres={"1": (centre[0] + x, centre[1] + y, centre[2])})
    one, two = (circular_tests(each, read_circles(each)) for each in (measured, other))
    for a, b in zip(one[0].figures, two[0].figures, strict=True):
        assert a.value == pytest.approx(b.value, abs=1e-3)


# ---- shares

CAUSES = {
    "backlash X": (Backlash("X", 8.0), {"width_plus_um": 8.0, "width_minus_um": 8.0}),
    "backlash Y": (Backlash("Y", 6.0, 20.0), {"width_plus_um": 6.0 + 0.375 * 20.0, "width_minus_um": 6.0 + 1.5}),
    "reversal-spike Y": (ReversalSpike("Y", 8.0, 0.3), {"height_plus_um": 8.0, "height_minus_um": 8.0}),
    "lateral-play E_YX": (LateralPlay("Y", "X", 6.0), {"play_um": 6.0}),
    "cyclic X": (Cyclic("X", "X", 10.0, (2.0,), (1.0,)), {"sine_um": 2.0, "cosine_um": 1.0}),
    "squareness X Y": (LocationError("C", "Y", 30.0), {"angle_urad": 30.0}),
    "scale-mismatch X Y": (Scale("X", 40.0), {"difference_um_per_m": 40.0}),
    "straightness E_YX": (ErrorMotion("Y", "X", Legendre((150.0, 450.0), 2), (0.0, 0.0, 5.0)), {"bow_um": 7.5}),
    "servo-mismatch X Y": (ServoMismatch("X", "Y", 0.3), {"lag_ms": 0.3}),
}


@pytest.mark.parametrize("name", quick(CAUSES, list(CAUSES)[::3]))
def test_a_cause_is_named_with_its_size(name):
    effect, sizes = CAUSES[name]
    _, found = evaluated(effect, step=0.5, seed=3)
    assert [cause.name for cause in found.causes] == [name]
    (cause,) = found.causes
    for key, size in sizes.items():
        assert abs(cause.parameters[key] - size) < max(1.5 * cause.U[key], 0.01 * size)
    assert 0.8 < cause.share <= 1.0
    assert found.unexplained_um == pytest.approx(0.3, rel=0.1)


def test_three_causes_at_once():
    effects = [Backlash("Y", 5.0), LocationError("C", "Y", -30.0), ServoMismatch("X", "Y", 0.2)]
    _, found = evaluated(*effects, step=1.0)
    assert {cause.name for cause in found.causes} == {"backlash Y", "squareness X Y", "servo-mismatch X Y"}
    assert sum(cause.share for cause in found.causes) < 1.0


def test_two_feeds_and_directions_part_servo_mismatch_from_squareness():
    measured, _ = circles_of(LocationError("C", "Y", 40.0), step=2.0)
    (cause,) = shares(measured, read_circles(measured)).causes
    assert not cause.tied_with
    one_way = measured.rows(np.flatnonzero(measured.run == "XY F1000 ccw"))
    (cause,) = shares(one_way, read_circles(one_way)).causes
    assert {cause.name, *cause.tied_with} >= {"squareness X Y", "servo-mismatch X Y"}


def test_a_bow_is_tied_with_curved_positioning_of_the_other_axis():
    _, found = evaluated(CAUSES["straightness E_YX"][0], step=1.0)
    assert found.causes[0].tied_with == ("positioning-curve E_YY",)


@pytest.mark.parametrize("seed", quick(range(4), [0]))
def test_other_errors_of_the_machine_are_no_spikes_and_no_waves(seed):
    """All error motions of a random machine, whose shapes the list does not have: none of them is a cause of a drive.

    Its residuals are smooth along the circle: the rows are not independent.
    """
    effects = random_true_model(CFRAME, np.random.default_rng(seed)).effects
    _, found = evaluated(*effects, step=2.0, seed=seed)
    assert [cause.name for cause in found.causes if cause.kind in DRIVES] == []


def test_a_row_off_by_a_millimetre_and_one_off_by_little_are_left_out():
    measured, _ = circles_of(Backlash("X", 8.0), step=2.0)
    observed = measured.observed.copy()
    observed[[50, 200]] += [[1.0], [0.03]]
    bad = replace(measured, observed=observed)
    found = read_circles(bad)
    assert shares(bad, found).left_out == 1
    assert 50 not in np.concatenate([each.rows for each in found])


def test_refused():
    measured, _ = circles_of(step=30.0)
    with pytest.raises(UserError, match="has 13 rows, a circle needs 24"):
        read_circles(measured)


# ---- the command and its page


def test_the_command(ncomp, tmp_path):
    measured, _ = circles_of(Backlash("X", 8.0), ServoMismatch("X", "Y", 0.2), step=3.0)
    path = written(measured, tmp_path / "circles.csv")
    done = ncomp("ballbar", str(path), "-m", "cframe", "--json", "c.json", "--report", "c.html")
    assert done.status == 0, done.err
    assert b"Circular deviation" in done.out
    assert "does not remove them" in " ".join(done.out.decode().split())
    found = json.loads(Path("c.json").read_text())
    assert {cause["kind"] for cause in found["causes"]} == {"backlash", "servo-mismatch"}
    assert {"value_um", "U_um"} == set(found["tests"][0]["figures"]["G(b)"])
    assert sum(cause["share"] for cause in found["causes"]) == pytest.approx(1.0, abs=0.05)
    page = Path("c.html").read_text()
    assert len(panels(page)) == 3
    assert "counter-clockwise" in page


def test_the_command_shows_no_uncertainty_as_zero(ncomp, tmp_path):
    """Of a bar that is stated to be nearly exact."""
    measured, _ = circles_of(Backlash("X", 8.0), bar=Ballbar(u_um=0.003), step=3.0)
    path = written(measured, tmp_path / "circles.csv")
    done = ncomp("ballbar", str(path), "-m", "cframe")
    assert done.status == 0, done.err
    (centre,) = re.findall(r"table ball from the stated centre .*", done.out.decode())
    assert centre.count(" ± 0.00") >= 2
    assert not re.search(r"± 0\.0+(?![0-9])", done.out.decode())


def test_circles_in_one_direction_are_noted(ncomp, tmp_path):
    measured, _ = circles_of(Backlash("X", 8.0), step=3.0)
    one_way = measured.rows(np.flatnonzero(np.char.find(measured.run.astype(str), " ccw") > 0))
    done = ncomp("ballbar", str(written(one_way, tmp_path / "c.csv")), "-m", "cframe")
    assert done.status == 0, done.err
    assert "plane XY was measured in one direction only" in " ".join(done.err.split())


def test_the_command_refuses_another_instrument(ncomp):
    Path("part.csv").write_text("# machine: cframe\n# instrument: part\n# u_um: 1\nnominal_x,nominal_y,x,y\n0,0,0,0\n")
    done = ncomp("ballbar", "part.csv", "-m", "cframe")
    assert done.status == 2
    assert "need the measurement of a ballbar" in done.err


def test_the_command_names_a_mistake_before_any_figure(ncomp, tmp_path):
    measured, _ = circles_of(step=5.0)
    path = written(replace(measured, observed=measured.observed / 25.4), tmp_path / "circles.csv")
    done = ncomp("ballbar", str(path), "-m", "cframe", "--json", "c.json")
    assert done.status == 2
    assert "the readings are in inch?" in done.err
    assert not Path("c.json").exists()


def test_simulate_refuses_wrong_options(ncomp):
    common = ("simulate", "--machine", "cframe", "--instrument", "ballbar", "-o", "x.csv")
    centre = ("--centre", "300,225,150")
    for options, words in (
        ((), "the table ball is missing: state --centre"),
        (("--centre", "1,2,3"), "--centre: the circles leave the travel of"),
        ((*centre, "--plane", "XX"), "--plane XX: expected one of XY"),
        ((*centre, "--bar", "0"), "--bar 0: expected mm or mm:um"),
        ((*centre, "--arc", "0:400"), "--arc 0:400: expected low:high"),
        ((*centre, "--strategy", "grid"), "--strategy does not apply to --instrument ballbar"),
        ((*centre, "--target", "a=0,0,1", "--target", "b=0,0,2"), "a ballbar has one target"),
    ):
        done = ncomp(*common, *options)
        assert done.status == 2
        assert words in done.err
    done = ncomp("simulate", "--machine", "cframe", "--strategy", "grid", "--centre", "1,2,3", "-o", "x.csv")
    assert "--centre is no option of --instrument laser-tracker" in done.err


@pytest.mark.statistical
def test_the_commands_of_the_page_run_and_find_its_causes(ncomp):
    """In the order of the page, in one folder."""
    commands = re.findall(r"^    ncomp (.*)$", PAGE.read_text(), re.MULTILINE)
    assert [command.split()[0] for command in commands] == ["simulate", "ballbar", "diagnose"]
    for command in commands:
        done = ncomp(*shlex.split(command))
        assert done.status == 0, done.err
    found = json.loads(Path("circles.json").read_text())
    assert {f"{cause['kind']} {cause['where']}" for cause in found["causes"]} == {"backlash X", "squareness X Y"}
    diagnosed = json.loads(Path("diagnosis.json").read_text())
    assert "backlash" in {effect["kind"] for effect in diagnosed["effects"]}


@pytest.mark.statistical
def test_uncertainties_cover_the_true_sizes():
    """Four causes at once, 40 draws: 95 % of the sizes within U (k = 2)."""
    effects = Backlash("X", 6.0), LocationError("C", "Y", 30.0), ServoMismatch("X", "Y", 0.2), Scale("Y", 40.0)
    true = {
        "width_plus_um": 6.0,
        "width_minus_um": 6.0,
        "angle_urad": 30.0,
        "lag_ms": 0.2,
        "difference_um_per_m": -40.0,
    }
    inside = []
    for seed in range(40):
        _, found = evaluated(*effects, step=3.0, seed=seed)
        parameters = {key: (value, cause.U[key]) for cause in found.causes for key, value in cause.parameters.items()}
        inside += [abs(parameters[key][0] - size) <= parameters[key][1] for key, size in true.items()]
    assert 0.91 < np.mean(inside) < 0.99


@pytest.mark.parametrize("seed", range(3))
def test_a_machine_with_all_error_motions_is_no_moved_table_ball(seed):
    """Circles in one plane show no shift across it: none is reported."""
    effects = random_true_model(CFRAME, np.random.default_rng(seed)).effects
    measured, _ = circles_of(*effects, step=5.0, seed=seed, bar=Ballbar(u_um=0.3, length_u_um=0.5))
    assert usable(measured) == []


def test_drive_causes_beside_all_other_error_motions():
    """Each is named with its size, and no other cause of a drive."""
    beside = random_true_model(CFRAME, np.random.default_rng(2)).effects
    effects = [Backlash("X", 4.0), LateralPlay("X", "Y", -3.0), ServoMismatch("X", "Y", 0.2)]
    _, found = evaluated(*effects, *beside, step=2.0, seed=2)
    own = {cause.name: cause for cause in found.causes if cause.kind in DRIVES}
    assert set(own) == {"backlash X", "lateral-play E_XY", "servo-mismatch X Y"}
    assert any(cause.kind == "other-error-motions" for cause in found.causes)
    for name, key, size in (
        ("backlash X", "width_plus_um", 4.0),
        ("lateral-play E_XY", "play_um", -3.0),
        ("servo-mismatch X Y", "lag_ms", 0.2),
    ):
        assert abs(own[name].parameters[key] - size) < 1.5 * own[name].U[key]


def timed_spike(tau_ms, step=0.5, seed=5):
    """A spike of X that keeps its time at 1000 and 3000 mm/min."""
    measured, _ = circles_of(step=step, seed=seed)
    observed = measured.observed.copy()
    for feed in (1000.0, 3000.0):
        way = (feed * tau_ms / 6e4) ** 2 / (2.0 * 150.0)
        own, _ = circles_of(ReversalSpike("X", 8.0, way), step=step, seed=seed)
        observed[measured.feed == feed] = own.observed[measured.feed == feed]
    return replace(measured, observed=observed)


def test_a_spike_that_keeps_its_time_and_one_that_keeps_its_way():
    measured = timed_spike(150.0)
    (cause,) = shares(measured, read_circles(measured)).causes
    assert cause.name == "reversal-spike X"
    assert kept(cause.by_feed) == "time"
    for each in cause.by_feed:
        assert abs(each.time_ms - 150.0) < 1.5 * each.U_time
    _, found = evaluated(ReversalSpike("Y", 8.0, 0.3), step=0.5, seed=3)
    assert kept(found.causes[0].by_feed) == "way"
    assert all(abs(each.way_mm - 0.3) < 1.5 * each.U_way for each in found.causes[0].by_feed)
    _, one = evaluated(ReversalSpike("Y", 8.0, 0.3), step=0.5, seed=3, feeds=(1000.0,))
    assert kept(one.causes[0].by_feed) == ""


@pytest.mark.statistical
def test_a_spike_shorter_than_the_rows_is_not_parted():
    """40 ms at 1000 mm/min are 1.5 um of way, and the first row behind the reversal is 6 um away."""
    measured = timed_spike(40.0)
    (cause,) = shares(measured, read_circles(measured)).causes
    assert kept(cause.by_feed) == "both"
    assert cause.by_feed[0].U_time > 0.3 * cause.by_feed[0].time_ms


@pytest.mark.parametrize(
    ("name", "make"),
    [
        ("backlash X", lambda size: Backlash("X", size)),
        pytest.param("servo-mismatch X Y", lambda size: ServoMismatch("X", "Y", size), marks=pytest.mark.statistical),
        pytest.param("lateral-play E_YX", lambda size: LateralPlay("Y", "X", size), marks=pytest.mark.statistical),
    ],
)
def test_detection_limits(name, make):
    """A cause of twice its limit is found, one of half its limit is not."""
    _, empty = evaluated(step=2.0, seed=1)
    limit = next(each for each in empty.limits if each.name == name)
    for factor, there in ((2.0, True), (0.5, False)):
        _, found = evaluated(make(factor * limit.largest), step=2.0, seed=1)
        assert (name in [cause.name for cause in found.causes]) == there
