"""Calibration with a ballbar: files, observation equations, simulation, fit, diagnosis, mistakes."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.ballbar_cases import CENTRE, CFRAME, circles_of
from support.tiers import quick
from support.virtual_measurements import written

import machines
from calibration.diagnosis.diagnose import diagnose
from calibration.fit.calibrate import calibrate
from calibration.fit.cross_validation import cross_validate
from calibration.instruments import Ballbar
from calibration.instruments.ballbar import in_runs
from calibration.measurement.file import read_measurement
from calibration.measurement.joining import joined
from calibration.measurement.measurement import Target
from calibration.observation.full_model import priors
from calibration.observation.normal_equations import residuals
from calibration.plausibility.checks import sanity
from calibration.simulation.true_model import model_of
from kinematics.effects import Backlash, LateralPlay, ReversalSpike, Scale, ServoMismatch
from kinematics.error_model.model import no_errors
from kinematics.user_error import UserError

HEAD = (
    "# machine: cframe\n# instrument: ballbar\n# u_um: 0.3\n# length_mm: 150\n# target.t1: 0 0 -120\n"
    "# centre: 300 225 150\n"
)
ROWS = "X,Y,Z,run,feed,radius_mm\n450,225,270,a,1000,150.001\n449.9,230,270,a,1000,150.002\n449,240,270,a,1000,150\n"


@pytest.fixture
def read(tmp_path):
    def reading(text):
        path = tmp_path / "data.csv"
        path.write_text(text)
        return read_measurement(path, CFRAME)

    return reading


# ---- the file


def test_a_file_of_circles(read):
    measured = read(HEAD + "# length_u_um: 0.5\n" + ROWS)
    assert measured.instrument == Ballbar(u_um=0.3, length_mm=150.0, length_u_um=0.5)
    assert measured.targets == {"t1": Target((0.0, 0.0, -120.0))}
    assert measured.spheres == {"1": CENTRE}
    assert measured.observed[:, 0].tolist() == [150.001, 150.002, 150.0]
    assert not measured.notes
    np.testing.assert_allclose(measured.covariances, np.full((3, 1, 1), 9e-8))


def test_directions_follow_from_the_circle_also_in_its_first_row():
    """A circle that begins at the end of X: X comes forward in the overshoot and turns back; Y goes on."""
    measured, _ = circles_of(noise=0.0, feeds=(1000.0,))
    approach = measured.state.approach[:, [CFRAME.index("X"), CFRAME.index("Y")]]
    first = np.flatnonzero(measured.run == "XY F1000 cw")[0]
    assert approach[0].tolist() == [1.0, 1.0]
    assert approach[1].tolist() == [-1.0, 1.0]
    assert approach[first].tolist() == [1.0, -1.0]
    speed = np.linalg.norm(measured.state.velocity, axis=1)
    np.testing.assert_allclose(speed, 1000.0 / 60.0)


def test_runs_of_two_rows_have_directions():
    measured, _ = circles_of(noise=0.0)
    two = in_runs(measured.state.rows(np.arange(2)))
    assert two.approach[1, 0] == -1.0


@pytest.mark.parametrize("bar", [Ballbar(u_um=0.3), Ballbar(u_um=0.2, length_mm=100.0, length_u_um=0.5)])
def test_writing_and_reading_gives_the_same(tmp_path, bar):
    measured, _ = circles_of(Backlash("X", 10.0), bar=bar, step=5.0)
    path = written(measured, tmp_path / "data.csv")
    assert "dir_" not in path.read_text()
    other = read_measurement(path, CFRAME)
    assert other.instrument == bar
    assert other.spheres == measured.spheres
    np.testing.assert_array_equal(other.observed, measured.observed)
    np.testing.assert_array_equal(other.state.approach, measured.state.approach)
    np.testing.assert_allclose(other.state.velocity, measured.state.velocity)


REFUSED = {
    "length": (HEAD.replace("# length_mm: 150\n", "") + ROWS, "header line '# length_mm: 150' is missing"),
    "no length": (HEAD.replace("150\n", "1\n", 1) + ROWS, ":4 length_mm: 1 mm is no length of a ballbar"),
    "u of the length": (HEAD + "# length_u_um: 0\n" + ROWS, ":7 length_u_um: 0 is not above 0; without this line"),
    "centre": (HEAD.replace("# centre: 300 225 150\n", "") + ROWS, "header line '# centre: x y z' is missing"),
    "target": (HEAD.replace("# target.t1: 0 0 -120\n", "") + ROWS, "header line '# target.NAME: x y z' is missing"),
    "no uncertainty": (HEAD.replace("# u_um: 0.3\n", "") + ROWS, "(k=1) of the ballbar is missing: state u_um"),
    "standing": (HEAD + ROWS.replace("a,1000,150.002", "a,0,150.002"), ":9 column feed: is not above 0"),
    "reading": (HEAD + ROWS.replace("150.002", "-0.002"), ":9 column radius_mm: is not above 0"),
    "station": (HEAD + "X,Y,Z,station,run,feed,radius_mm\n1,2,3,s,a,1,150\n", ":8 column station: a file of a ballbar"),
    "no run": (HEAD + "X,Y,Z,feed,radius_mm\n1,2,3,1,150\n", "a ballbar: column run missing"),
}


@pytest.mark.parametrize(("text", "message"), REFUSED.values(), ids=REFUSED)
def test_refusals(read, text, message):
    with pytest.raises(UserError, match=r"data\.csv") as caught:
        read(text)
    assert message in str(caught.value)


def test_files_have_a_table_ball_each():
    one, _ = circles_of(step=10.0)
    other, _ = circles_of(step=10.0, centre=(280.0, 225.0, 150.0), seed=1)
    both = joined([replace(one, source="a.csv"), replace(other, source="b.csv")])
    assert both.spheres == {"a.csv:1": CENTRE, "b.csv:1": (280.0, 225.0, 150.0)}
    registration, _ = both.first_registration
    assert list(registration.poses) == ["a.csv:1", "b.csv:1"]
    assert list(registration.zeros) == ["length"]


# ---- observation equations


@given(st.lists(st.floats(-0.02, 0.02), min_size=4, max_size=4))
def test_derivatives_are_those_of_the_readings(step):
    measured, _ = circles_of(step=30.0, noise=0.0, planes=("XY", "ZX"))
    registration, _ = measured.first_registration
    model = no_errors(CFRAME)
    moved = registration.moved(np.array(step))
    change = residuals(measured, model, registration) - residuals(measured, model, moved)
    design = measured.instrument.registration_design(measured, registration)
    np.testing.assert_allclose(change, design @ step, atol=1e-5)
    stated = measured.instrument.stated_residuals(measured, registration) - measured.instrument.stated_residuals(
        measured, moved
    )
    np.testing.assert_allclose(stated, measured.instrument.stated_design(measured, registration) @ step, atol=1e-9)


def test_derivatives_by_errors_and_by_a_shift():
    measured, _ = circles_of(step=30.0, noise=0.0, planes=("XY", "YZ"))
    registration, _ = measured.first_registration
    transform = measured.instrument.transform(measured, registration)
    effect = Scale("X", 50.0)
    model, zero = model_of(CFRAME, [effect]), no_errors(CFRAME)
    change = residuals(measured, zero, registration) - residuals(measured, model, registration)
    errors = model.errors(CFRAME, measured.state).reshape(len(measured), -1)
    np.testing.assert_allclose(change[:, 0], np.einsum("np,np->n", transform[:, 0, :-3], errors), atol=2e-6)


def test_without_errors_the_readings_are_centre_and_length_alone():
    measured, model = circles_of(noise=0.0, planes=("XY", "ZX"))
    registration, trusted = measured.first_registration
    assert trusted.all()
    assert np.abs(residuals(measured, model, registration)).max() < 2e-5
    assert 0.0 < np.abs(registration.sphere_centres["1"] - CENTRE).max() < 0.03


def test_one_plane_leaves_the_centre_across_it_where_it_is_stated():
    measured, _ = circles_of(feeds=(1000.0,))
    registration, _ = measured.first_registration
    assert abs(registration.sphere_centres["1"][2] - CENTRE[2]) < 0.5


# ---- fit and diagnosis


@pytest.mark.statistical
def test_a_calibrated_length_shows_the_scale_and_a_fitted_one_the_difference_of_scales():
    bars = [Ballbar(u_um=0.3), Ballbar(u_um=0.3, length_u_um=0.2)]
    seen = []
    for bar in bars:
        measured, _ = circles_of(Scale("X", 80.0), Scale("Y", -60.0), bar=bar, step=3.0)
        found = calibrate(measured, hold_out=False).identifiability
        seen.append([each.remedy for each in found.unidentifiable])
    assert any("shows no scale" in text for text in seen[0])
    assert not any("shows no scale" in text for text in seen[1])


def test_the_scale_is_as_sure_as_the_length_of_the_bar():
    """Readings 12 um longer, a length that is known to 3 um, and typical scales of 11 um at the end: it is the scale."""
    bar = Ballbar(u_um=0.3, length_mm=150.0, length_u_um=3.0)
    measured, _ = circles_of(Scale("X", 80.0), Scale("Y", 80.0), bar=bar, step=6.0)
    model = calibrate(measured, hold_out=False, basis="legendre:1").model
    scales = {each.axis: each.parameters[1] for each, _ in model.error_motions if each.component == each.axis}
    for axis in "XY":
        assert 1e3 * scales[axis] / 150.0 == pytest.approx(80.0, abs=4.0)


CAUSES = {
    "backlash X": Backlash("X", 8.0),
    "lateral-play E_YX": LateralPlay("Y", "X", 8.0),
    "servo-mismatch X Y": ServoMismatch("X", "Y", 0.5),
    "reversal-spike Y": ReversalSpike("Y", 10.0, 0.3),
}


@pytest.mark.parametrize("name", quick(CAUSES, ["backlash X"]))
def test_causes_of_circles_are_named(name):
    measured, _ = circles_of(CAUSES[name], step=3.0)
    found = diagnose(measured)
    assert name in {cause.effect.name for cause in found.causes}


# ---- mistakes


def spoiled(change):
    measured, _ = circles_of(step=3.0, planes=("XY", "ZX"))
    return change(measured)


def moved_run(measured):
    q = measured.state.positions.copy()
    q[measured.run == "XY F1000 ccw", CFRAME.index("X")] += 2.0
    return replace(measured, state=replace(measured.state, positions=q))


def exchanged(measured):
    q = measured.state.positions.copy()
    q[:, [CFRAME.index("X"), CFRAME.index("Y")]] = q[:, [CFRAME.index("Y"), CFRAME.index("X")]]
    return replace(measured, state=replace(measured.state, positions=q))


def reversed_run(measured):
    """The first run with its last reading first; the table ball is 30 um from its stated centre."""
    observed = measured.observed.copy()
    first = np.flatnonzero(measured.run == measured.run[0])
    observed[first] = observed[first[::-1]]
    return replace(measured, observed=observed)


MISTAKES = {
    "a reversed run": (reversed_run, "the readings of run XY F1000 ccw"),
    "a run about another centre": (moved_run, "run XY F1000 ccw is about a point 2 mm from the centre"),
    "columns exchanged": (exchanged, "mm from its stated centre: correct the centre, or columns"),
    "length": (lambda m: replace(m, instrument=Ballbar(u_um=0.3, length_mm=100.0)), "but the bar is 100 mm long"),
    "inch": (lambda m: replace(m, observed=m.observed / 25.4), "the readings are in inch?"),
    "deviations": (lambda m: replace(m, observed=m.observed - 149.9), "the readings are deviations from it"),
    "radius of the program": (
        lambda m: replace(m, instrument=Ballbar(u_um=0.3, length_mm=100.0), observed=m.observed - 50.0),
        "the radius of the program or the unit of the axes is wrong",
    ),
}


@pytest.mark.parametrize(("change", "message"), MISTAKES.values(), ids=MISTAKES)
def test_mistakes_are_found(change, message):
    fatal = [finding.message for finding in sanity(spoiled(change)) if finding.fatal]
    assert any(message in text for text in fatal), fatal


def test_degrees_and_millimetres_exchanged_are_found():
    dmu50 = machines.load("dmu50")
    measured, _ = circles_of(machine=dmu50, step=3.0, centre=(0.0, 0.0, 100.0))
    q = measured.state.positions.copy()
    x, c = dmu50.index("X"), dmu50.index("C")
    q[:, [x, c]] = np.stack([np.degrees(q[:, c]), np.radians(q[:, x])], axis=1)
    bad = replace(measured, state=replace(measured.state, positions=q))
    assert any("columns in mm and in degrees" in finding.message for finding in sanity(bad) if finding.fatal)


def test_a_row_off_by_a_millimetre_is_noted_and_left_out():
    measured, _ = circles_of(Scale("X", 80.0), step=3.0)
    observed = measured.observed.copy()
    observed[40] += 1.0
    bad = replace(measured, observed=observed, lines=np.arange(len(measured)) + 8, source="c.csv")
    assert any("c.csv:48: radius_mm is +" in finding.message for finding in sanity(bad))
    found = calibrate(bad).fit
    assert not found.kept[40]
    assert np.count_nonzero(~found.kept) == 1


def test_a_feed_in_another_unit_than_positions_and_times_is_found():
    measured, _ = circles_of(step=3.0)
    slow = replace(measured, feed=measured.feed / 1000.0)
    (text,) = (finding.message for finding in sanity(slow) if finding.fatal)
    assert "column feed has 1 mm/min, but its positions and times give 1000 mm/min" in text
    assert not any(f.fatal for f in sanity(replace(slow, state=replace(slow.state, time=None))))


def test_held_out_regions_are_predicted_by_circles_that_leave_the_table_ball_free_across_them():
    """Its distance is not linear across the circle: the nominal machine has the same residuals as with all rows."""
    bar = Ballbar(u_um=0.3, length_mm=100.0, length_u_um=0.5)
    measured, _ = circles_of(
        Backlash("X", 12.0), machine=machines.load("gantry"), feeds=(2000.0,), bar=bar, seed=8,
        centre=(2500.0, 1500.0, 700.0),
    )  # fmt: skip
    none = no_errors(measured.machine)
    for row in (17, 240):
        held_out = cross_validate(measured.rows(np.delete(np.arange(len(measured)), row)), none, priors(none))
        assert held_out.rms_um < 8.0


def test_clean_circles_have_no_findings():
    measured, _ = circles_of(Backlash("X", 20.0), Scale("Y", 100.0), step=3.0, planes=("XY", "ZX"))
    assert not [finding for finding in sanity(measured) if finding.check in ("units", "radius", "centre", "outliers")]
