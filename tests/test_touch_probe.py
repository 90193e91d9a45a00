"""Calibration with a touch probe and spheres: files, simulation, fit, identifiability, mistakes."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.probe_cases import MIDDLE, TIP, in_datum, poses, probed, shifted_rows, spheres_of, unseen_um
from support.tiers import quick
from support.virtual_measurements import written

import machines
from calibration.diagnosis.diagnose import diagnose
from calibration.fit.calibrate import calibrate
from calibration.fit.calibrate import in_datum as fitted_in_datum
from calibration.fit.set_up.drift import repeat_findings
from calibration.fit.set_up.explained import coarse_fit
from calibration.fit.set_up.moved_spheres import moved_spheres
from calibration.instruments import TouchProbe
from calibration.instruments.distances import distance_design, distance_residuals
from calibration.instruments.touch_probe import TIP as PROBE
from calibration.measurement.file import read_measurement
from calibration.measurement.joining import joined
from calibration.measurement.measurement import Distance, Target
from calibration.measurement.written_file import write_measurement
from calibration.observation.full_model import parse_basis, with_effects
from calibration.observation.mean_lines import mean_line
from calibration.observation.normal_equations import NormalEquations, residuals
from calibration.plausibility.checks import sanity
from calibration.simulation.measure_plan import VirtualInstrument, measure_plan, streams
from calibration.simulation.touch_probe import PLACED_MM, Spheres
from calibration.simulation.true_model import model_of, random_location_errors, random_true_model
from kinematics.basis import BSpline
from kinematics.effects import Backlash, ErrorMotion, LocationError, StationShift, ThermalDrift
from kinematics.forward import forward, tool_point
from kinematics.inverse import linear_positions
from kinematics.transforms import turn
from kinematics.user_error import UserError

DMU50 = machines.load("dmu50")
HEAD = (
    "# machine: dmu50\n# instrument: touch-probe\n# u_um: 1.5\n# probe: 0 0 -150\n"
    "# sphere.s1: 130 20 60\n# sphere.s2: -110 60 50\n"
)
ROWS = "X,Y,Z,B,C,sphere\n130.1,20.2,210.3,0,0,s1\n-110,60,200.5,0,0,s2\n"


@pytest.fixture
def read(tmp_path):
    def reading(text):
        path = tmp_path / "data.csv"
        path.write_text(text)
        return read_measurement(path, DMU50)

    return reading


# ---- the file


def test_a_file_of_centres(read):
    measured = read(HEAD + "# distance.s1.s2: 300.0012 0.0005\n" + ROWS)
    assert measured.instrument == TouchProbe(u_um=1.5)
    assert measured.targets == {"probe": Target(TIP)}
    assert measured.groups.tolist() == ["s1", "s2"]
    assert measured.spheres == {"s1": (130.0, 20.0, 60.0), "s2": (-110.0, 60.0, 50.0)}
    assert measured.distances == (Distance("s1", "s2", 300.0012, 0.0005),)
    assert not measured.observed.any()
    assert not measured.notes
    np.testing.assert_allclose(measured.covariances, np.tile(2.25e-6 * np.eye(3), (2, 1, 1)))


def test_readings_of_an_r_test_point_from_the_tip_to_the_centre_in_the_directions_of_the_tool(read):
    """At B = 90 deg the table has turned by 90 deg about (0, 1, -1): the tool's x is no longer the workpiece's."""
    measured = read(HEAD + "X,Y,Z,B,C,sphere,dx,dy,dz\n10,20,210,90,30,s1,0.1,-0.2,0.3\n")
    rotation = forward(DMU50, measured.state.positions).rotation[0]
    np.testing.assert_allclose(measured.observed[0], -rotation @ [0.1, -0.2, 0.3])
    assert abs(rotation[0, 0]) < 0.9


@pytest.mark.parametrize("readings", [False, True])
def test_writing_and_reading_gives_the_same(tmp_path, readings):
    measured, _ = probed("dmu50", 10, spheres=spheres_of("dmu50", 3, {("s1", "s2"): 0.0005}))
    if readings:
        rng = np.random.default_rng(0)
        measured = replace(measured, observed=rng.normal(0.0, 0.1, measured.observed.shape))
    other = read_measurement(written(measured, tmp_path / "data.csv"), DMU50)
    np.testing.assert_allclose(other.state.positions, measured.state.positions, rtol=4e-16)
    np.testing.assert_allclose(other.observed, measured.observed, atol=1e-14)
    np.testing.assert_array_equal(other.groups, measured.groups)
    for field in ("instrument", "targets", "spheres", "distances"):
        assert getattr(other, field) == getattr(measured, field)
    square = replace(measured, instrument=TouchProbe(u_um=1.0, squareness_urad=7.5))
    assert read_measurement(written(square, tmp_path / "data.csv"), DMU50).instrument == square.instrument
    np.testing.assert_array_equal(other.state.approach, measured.state.approach)


REFUSED = {
    "no tip": (HEAD.replace("# probe: 0 0 -150\n", "") + ROWS, "header line '# probe: x y z' is missing"),
    "tip": (HEAD.replace("0 0 -150", "-150") + ROWS, ":4 probe: expected 3 numbers"),
    "no uncertainty": (HEAD.replace("# u_um: 1.5\n", "") + ROWS, "(k=1) of the touch-probe is missing: state u_um"),
    "no column": (HEAD + "X,Y,Z,B,C\n1,2,3,4,5\n", ":7 a touch probe: column sphere missing"),
    "unknown sphere": (HEAD + ROWS.replace(",s2", ",s9"), ":9 column sphere: 's9' is not in the header, which has s1"),
    "name of a sphere": (HEAD + "# sphere.a.b: 1 2 3\n" + ROWS, ":7 sphere.a.b: expected sphere.NAME"),
    "target": (HEAD + "# target.t: 0 0 1\n" + ROWS, ":7 target.t: a touch probe has one target, its tip"),
    "target column": (HEAD + "X,Y,Z,B,C,sphere,target\n1,2,3,4,5,s1,t\n", ":7 column target: a touch probe has one"),
    "station": (HEAD + "X,Y,Z,B,C,sphere,station\n1,2,3,4,5,s1,t\n", ":7 column station: a touch probe has its spheres"),
    "distance": (HEAD + "# distance.s1: 1 2\n" + ROWS, ":7 distance.s1: expected distance.A.B"),
    "distance to itself": (HEAD + "# distance.s1.s1: 1 2\n" + ROWS, ":7 distance.s1.s1: expected distance.A.B"),
    "distance to nothing": (HEAD + "# distance.s1.s7: 9 1\n" + ROWS, ":7 distance.s1.s7: sphere 's7' is not"),
    "certain distance": (HEAD + "# distance.s1.s2: 9 0\n" + ROWS, ":7 distance.s1.s2: expected the distance and its"),
    "distance twice": (
        HEAD + "# distance.s1.s2: 9 1\n# distance.s2.s1: 9 1\n" + ROWS, ":8 distance.s2.s1: the distance of these",
    ),
    "squareness": (HEAD + "# squareness_urad: -1\n" + ROWS, ":7 squareness_urad: -1 urad is no size of squareness"),
    "readings": (HEAD + "X,Y,Z,B,C,sphere,dx\n1,2,3,4,5,s1,0\n", ":7 the readings of an R-test: columns dy, dz missing"),
    "points": (HEAD + "X,Y,Z,B,C,sphere,x,y,z\n1,2,3,4,5,s1,0,0,0\n", ":7 column x: not known"),
}  # fmt: skip


@pytest.mark.parametrize(("text", "message"), REFUSED.values(), ids=REFUSED)
def test_refusals(read, text, message):
    with pytest.raises(UserError, match=r"data\.csv") as caught:
        read(text)
    assert message in str(caught.value)


def test_files_with_tips_of_different_lengths_are_joined():
    one, _ = probed("dmu50", 6, spheres=spheres_of("dmu50", 2, {("s1", "s2"): 0.001}))
    other = replace(one, targets={PROBE: Target((0.0, 0.0, -200.0))}, source="long.csv")
    both = joined([replace(one, source="short.csv"), other])
    assert list(both.targets) == ["short.csv:probe", "long.csv:probe"]
    assert both.state.target.tolist() == ["short.csv:probe"] * len(one) + ["long.csv:probe"] * len(one)
    assert list(both.spheres) == ["short.csv:s1", "short.csv:s2", "long.csv:s1", "long.csv:s2"]
    assert set(both.groups.tolist()) == set(both.spheres)
    assert [each[:2] for each in both.distances] == [("short.csv:s1", "short.csv:s2"), ("long.csv:s1", "long.csv:s2")]


# ---- simulation


@pytest.mark.parametrize("name", MIDDLE)
def test_the_actual_tip_is_in_the_actual_centre(name):
    """All error motions and backlash; without noise, to the rounding of the recorded positions."""
    machine = machines.load(name)
    effects = [*random_true_model(machine, np.random.default_rng(1)).effects, Backlash("X", 20.0)]
    measured, model = probed(name, 8, effects=effects, noise=0.0)
    tips = tool_point(machine, measured.state.positions, measured.tool, model.errors(machine, measured.state))
    for sphere, stated in measured.spheres.items():
        mine = tips[measured.groups == sphere]
        assert np.ptp(mine, axis=0).max() < 4e-5
        assert np.abs(mine.mean(axis=0) - stated).max() < PLACED_MM + 1e-5


def test_noise_is_that_of_the_instrument():
    measured, model = probed("dmu50", 300, u_um=5.0)
    off = residuals(measured, model, measured.first_registration[0])
    for sphere in measured.spheres:
        off[measured.groups == sphere] -= off[measured.groups == sphere].mean(axis=0)
    assert np.std(off) * 1e3 == pytest.approx(5.0, rel=0.1)


def test_outliers_are_in_the_recorded_positions():
    machine, draws = machines.load("dmu50"), streams(0, 3)
    virtual = VirtualInstrument(TouchProbe(u_um=1.0), spheres=spheres_of("dmu50"))
    plan, model = poses(machine, 10), model_of(machine, [])
    good = measure_plan(plan, model, virtual, draws).measurement
    faults = replace(virtual.faults, outliers=0.1, outlier_mm=(0.2, 0.2))
    bad = measure_plan(plan, model, replace(virtual, faults=faults), streams(0, 3)).measurement
    assert not bad.observed.any()
    apart = np.linalg.norm(tool_point(machine, bad.state.positions) - tool_point(machine, good.state.positions), axis=1)
    assert np.flatnonzero(apart > 1e-4).size == 3
    np.testing.assert_allclose(apart[apart > 1e-4], 0.2, atol=1e-4)


# ---- equations


def test_distances_are_rows_of_the_normal_equations():
    measured, _ = probed("dmu50", 5, spheres=spheres_of("dmu50", 3, {("s1", "s2"): 0.01, ("s3", "s1"): 0.02}))
    registration, _ = measured.first_registration
    design = distance_design(measured.distances, registration)
    before = distance_residuals(measured.distances, registration)
    for k in range(design.shape[1]):
        step = np.zeros(design.shape[1])
        step[k] = 1e-4
        change = before - distance_residuals(measured.distances, registration.moved(step))
        np.testing.assert_allclose(change / 1e-4, design[:, k], atol=1e-3)
    normal = NormalEquations.zero(design.shape[1] + 2)
    normal.add_stated(measured, registration)
    np.testing.assert_allclose(normal.matrix[:-2, :-2], design.T @ design)
    assert not normal.matrix[-2:].any()


# ---- fit


DRAWS = [(name, seed) for name in MIDDLE for seed in range(3)]


@pytest.mark.parametrize(("name", "seed"), quick(DRAWS, [], [("dmu50", 0), *((name, 1) for name in MIDDLE)]))
def test_location_errors_are_found(name, seed):
    """Within U, but for a few that one tip does not show and the prior holds; the error of other poses falls to 5 %."""
    measured, model = probed(name, 34, seed=seed)
    found = calibrate(measured, hold_out=False)
    true = in_datum(model, found.fit)
    got = {e.name: e for e in fitted_in_datum(found.fit).effects if isinstance(e, LocationError)}
    assert got.keys() == true.keys()
    inside = [abs(effect.value - true[name]) <= 2.0 * effect.uncertainties[0] + 0.01 for name, effect in got.items()]
    assert np.mean(inside) >= 0.7
    before, after = unseen_um(found.model, model)
    assert after < 0.1 * before
    assert found.fit.chi2_reduced == pytest.approx(1.0, abs=0.35)
    for sphere, centre in found.fit.registration.sphere_centres.items():
        assert np.abs(centre - measured.spheres[sphere]).max() < PLACED_MM + 0.1


def expansion(found):
    return [each for each in found.identifiability.unidentifiable if each.effects == ("E_XX", "E_YY", "E_ZZ")]


def test_spheres_without_a_distance_have_no_scale():
    """A common expansion of the linear axes enlarges the positions of all spheres alike."""
    (unseen,) = expansion(calibrate(probed("dmu50", 30)[0], basis="legendre:1", hold_out=False))
    assert unseen.directions == 1
    assert "calibrated distance of two spheres (# distance.A.B: mm u) would show it" in unseen.remedy


def test_a_distance_shows_the_scale():
    effects = [LocationError("C", "Y", 30.0), *scale_errors(0.1)]
    measured, _ = probed("dmu50", 34, spheres=spheres_of("dmu50", 3, {("s1", "s2"): 0.0005}), effects=effects)
    found = calibrate(measured, basis="legendre:1", hold_out=False)
    assert not expansion(found)
    for axis in "XYZ":
        (motion,) = (e for e in found.fit.model.effects if e.name == f"E_{axis}{axis}")
        low, high = motion.basis.interval
        slope = np.ptp(motion.basis.columns(np.array([low, high])) @ motion.parameters) / (high - low)
        assert slope == pytest.approx(0.1, rel=0.15)


def scale_errors(um_per_mm):
    """The positioning errors of a common expansion of the linear axes."""
    for axis in "XYZ":
        low, high = DMU50.axes[DMU50.index(axis)].travel
        yield ErrorMotion(axis, axis, BSpline((low, high), 1), (0.0, um_per_mm * (high - low)))


@pytest.mark.statistical
def test_one_sphere_is_no_worse_than_none():
    measured, _ = probed("dmu50", 34, spheres=spheres_of("dmu50", 1))
    found = calibrate(measured)
    assert found.accepted
    assert found.cross_validation.gains.better
    assert any({"E_XX", "E_YY", "E_ZZ"} <= set(each.effects) for each in found.identifiability.unidentifiable)
    assert any("a second sphere" in each.remedy for each in found.identifiability.unidentifiable)


def test_a_row_that_is_off_by_a_millimetre_is_left_out():
    measured, _ = probed("dmu50", 34)
    positions = measured.state.positions.copy()
    positions[17, DMU50.index("X")] += 1.0
    found = calibrate(at(measured, positions), basis="legendre:1", hold_out=False)
    assert found.fit.outliers.tolist() == [17]


def of_two_tips(stated=-230.0):
    """Two files with probes of 150 and 230 mm; `stated`: z of the longer tip in its header."""
    short, model = probed("dmu50", 30)
    long, _ = probed("dmu50", 30, effects=model.effects, tip=(0.0, 0.0, -230.0))
    long = replace(long, targets={PROBE: Target((0.0, 0.0, stated))})
    return joined([replace(short, source="short.csv"), replace(long, source="long.csv")])


def test_two_lengths_of_the_probe_show_tilts_and_the_scale():
    found = calibrate(of_two_tips(), basis="legendre:1", hold_out=False)
    assert [each.effects for each in found.identifiability.unidentifiable] == [("E_CY",), ("E_CZ",)]
    assert not found.findings


def test_a_wrong_length_shows_beside_another_probe():
    (finding,) = calibrate(of_two_tips(-230.05), basis="legendre:1", hold_out=False).findings
    assert "target long.csv:probe: its position on the tool differs by" in finding.message
    assert "0.05" in finding.message


def of_turned_spindle(runout=0.015):
    """Two files, the second with the spindle turned by 180 degrees; the tip is `runout`, mm, off its axis in x."""
    one, model = probed("dmu50", 24, tip=(runout, 0.0, -150.0))
    other, _ = probed("dmu50", 24, effects=model.effects, tip=(-runout, 0.0, -150.0))
    stated = (Target((0.0, 0.0, -150.0)), Target((0.0, 0.0, -150.0), spindle_deg=180.0))
    files = [replace(m, targets={PROBE: tip}) for m, tip in zip((one, other), stated, strict=True)]
    return joined([replace(m, source=name) for m, name in zip(files, ("0.csv", "180.csv"), strict=True)])


def test_a_turned_spindle_shows_the_runout_of_the_tip():
    """Half of the difference for each: the location errors do not take up the rest."""
    found = calibrate(of_turned_spindle(), basis="legendre:1", hold_out=False)
    assert [each.name for each in found.targets] == ["0.csv:probe", "180.csv:probe"]
    for each, sign in zip(found.targets, (1.0, -1.0), strict=True):
        np.testing.assert_allclose(each.offset, (sign * 0.015, 0.0, 0.0), atol=3e-4)
    assert [f.message.partition(" +-")[0] for f in found.findings] == [
        "target 0.csv:probe: runout of the tip from its stated position (0.015, 0.000, 0.000) mm",
        "target 180.csv:probe: runout of the tip from its stated position (-0.015, -0.000, -0.000) mm",
    ]
    assert not calibrate(of_turned_spindle(0.0), basis="legendre:1", hold_out=False).findings


@pytest.mark.parametrize(
    ("angle", "turned"), [(180.0, (-0.015, 0.002)), (90.0, (0.002, 0.015)), (-90.0, (-0.002, -0.015))]
)
def test_the_angle_of_the_spindle_is_read_as_written(angle, turned, tmp_path):
    one, _ = probed("dmu50", 4)
    tip = Target((*turned, -150.0), spindle_deg=angle)
    with (tmp_path / "data.csv").open("wb") as file:
        write_measurement(replace(one, targets={PROBE: tip}), file)
    text = (tmp_path / "data.csv").read_text()
    assert f"# probe: 0.015 -0.002 -150.0\n# spindle_deg: {angle}\n" in text
    assert read_measurement(tmp_path / "data.csv", DMU50).targets == {PROBE: tip}


@pytest.mark.statistical
def test_a_knocked_sphere_is_named():
    knocked = StationShift("s2", (20.0, -10.0, 5.0), (0.0, 0.0, 0.0), 800.0)
    machine = machines.load("dmu50")
    effects = [*random_location_errors(machine, np.random.default_rng(0), 50.0), knocked]
    measured, _ = probed("dmu50", 34, effects=effects)
    (cause,) = diagnose(measured).causes
    assert (cause.effect.kind, cause.effect.station, cause.verdict) == ("station-shift", "s2", "strong")
    np.testing.assert_allclose(cause.effect.shift_um, (20.0, -10.0, 5.0), atol=1.5)


def test_distances_that_contradict_each_other_are_named():
    pairs = [("s1", "s2"), ("s2", "s3"), ("s1", "s3")]
    measured, _ = probed("dmu50", 34, spheres=spheres_of("dmu50", 3, dict.fromkeys(pairs, 0.0005)))
    found = calibrate(measured, basis="legendre:1", hold_out=False)
    assert not any(finding.check == "distances" for finding in found.findings)
    wrong = measured.distances[0]._replace(length=measured.distances[0].length + 0.02)
    measured = replace(measured, distances=(wrong, *measured.distances[1:]))
    texts = [f.message for f in calibrate(measured, basis="legendre:1", hold_out=False).findings]
    assert any("distance of spheres s1 and s2 is +" in text for text in texts)


# ---- mistakes


def at(measured, positions):
    return replace(measured, state=replace(measured.state, positions=positions))


def columns_exchanged(measured):
    degrees = measured.state.positions / DMU50.scale
    i, j = DMU50.index("X"), DMU50.index("B")
    degrees[:, [i, j]] = degrees[:, [j, i]]
    return at(measured, degrees * DMU50.scale)


def from_a_row_on(measured, axis, size):
    """An axis farther by a size, mm, from row 51 on."""
    behind = np.arange(len(measured)) >= 50
    moved = at(measured, measured.state.positions + size * np.outer(behind, np.equal(DMU50.names, axis)))
    return replace(moved, source="d.csv", lines=np.arange(len(moved)) + 8)


def moved_sphere(measured):
    tips = tool_point(DMU50, measured.state.positions, measured.tool)
    tips[(measured.groups == "s1") & (np.arange(len(measured)) > 40)] += [1.2, 0.4, -0.3]
    return at(measured, linear_positions(DMU50, measured.state.positions, tips, measured.tool))


def another_sphere(measured):
    station = measured.state.station.copy()
    station[0], station[1] = station[1], station[0]
    return replace(measured, state=replace(measured.state, station=station))


def reversed_readings(measured):
    tips = tool_point(DMU50, measured.state.positions, measured.tool)
    centres = np.array([measured.spheres[name] for name in measured.groups.tolist()])
    offset = turn(forward(DMU50, measured.state.positions).rotation, np.array([2.0, 1.0, 3.0]))
    commanded = linear_positions(DMU50, measured.state.positions, centres + offset, measured.tool)
    shifted = tool_point(DMU50, commanded, measured.tool) - tips
    return replace(at(measured, commanded), observed=-shifted)


MISTAKES = {
    "length of the probe": (
        lambda m: replace(m, targets={PROBE: Target((0.0, 0.0, -153.0))}), True, "with target probe at (0.0",
    ),
    "length of the probe in m": (
        lambda m: replace(m, targets={PROBE: Target((0.0, 0.0, -0.15))}), True, "with target probe at (0.",
    ),
    "distance": (
        lambda m: replace(m, distances=(Distance("s1", "s2", 250.0, 0.0005),)), True, "but by the data 24",
    ),
    "degrees for millimetres": (columns_exchanged, True, "with columns B and X exchanged (mm and degrees)"),
    "inch": (
        lambda m: at(m, np.where(DMU50.rotary, m.state.positions, m.state.positions / 25.4)), True, "multiplied by 25.4",
    ),
    "micrometres": (
        lambda m: at(m, np.where(DMU50.rotary, m.state.positions, m.state.positions * 1e3)), True,
        "commands of linear axes multiplied by 0.001",
    ),
    "column of B missing": (
        lambda m: at(m, np.where(np.equal(DMU50.names, "B"), 0.0, m.state.positions)), True,
        "is its column missing?",
    ),
    "work offset changed": (lambda m: from_a_row_on(m, "X", 2.0), True, "with the tip moved by 1.97 mm before d.csv:58"),
    "tool length changed": (lambda m: from_a_row_on(m, "Z", 0.3), False, "mm before d.csv:58 (did a work offset"),
    "moved sphere": (moved_sphere, True, "with sphere s1 moved by 1.3"),
    "name of the sphere": (another_sphere, False, "from the centre of sphere s2: it is in sphere s1. Correct the name"),
    "reversed readings": (reversed_readings, True, "with the signs of dx, dy and dz reversed"),
    "spheres of the header": (
        lambda m: replace(m, spheres={**m.spheres, "s1": m.spheres["s2"], "s2": m.spheres["s1"]}), False,
        "from its stated position, where sphere s2 is",
    ),
    "one sphere": (
        lambda m: replace(m, state=replace(m.state, station=np.where(np.arange(len(m)) % 2, "s1", "s2"))), False,
        "spheres s1 and s2 are at the same position",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", MISTAKES)
def test_mistakes_are_found(name):
    spoil, fatal, text = MISTAKES[name]
    good, _ = probed("dmu50", 30, spheres=spheres_of("dmu50", 1 if name == "one sphere" else 3))
    assert not sanity(good)
    found = sanity(spoil(good))
    assert any(text in finding.message and finding.fatal == fatal for finding in found), found


MOVES = [
    ("trunnion_ac", 3, 34, 0.05, 17),
    ("head_head", 2, 30, 0.2, 2),
    ("head_table", 3, 12, 0.05, 9),
    ("trunnion_bc", 1, 24, 0.02, 12),
    ("dmu50", 1, 24, 5.0, 2),
]


@pytest.mark.parametrize(("name", "spheres", "count", "size", "moment"), MOVES)
def test_a_sphere_that_moved_is_named_with_its_row(name, spheres, count, size, moment):
    """Smaller steps than the errors of the machine, near the first, middle and last rows."""
    measured, _ = probed(name, count, spheres=spheres_of(name, spheres), seed=7)
    measured = replace(measured, source="d.csv", lines=np.arange(len(measured)) + 8)
    assert not moved_spheres(measured)
    first = np.flatnonzero(measured.groups == "s1")[moment]
    behind = (measured.groups == "s1") & (np.arange(len(measured)) >= first)
    text = moved_spheres(shifted_rows(measured, behind, size * np.array([0.6, -0.64, 0.48])))
    assert f"before d.csv:{first + 8}: its clamping is loose" in text
    number = float(text.removeprefix("sphere s1 moved by ").partition(" ")[0])
    assert number == pytest.approx(1e3 * size, rel=0.06)


def test_spheres_that_moved_together_are_named():
    measured, _ = probed("trunnion_ac", 30)
    text = moved_spheres(shifted_rows(measured, np.arange(len(measured)) >= 45, [0.03, 0.0, 0.04]))
    assert text.startswith("spheres s1, s2, s3 moved by 5")


def test_a_moved_sphere_is_refused_and_fitted_by_its_other_name():
    measured, _ = probed("trunnion_ac", 30)
    rows = (measured.groups == "s2") & (np.arange(len(measured)) > 50)
    moved = shifted_rows(measured, rows, [0.0, 0.08, 0.0])
    with pytest.raises(UserError, match="sphere s2 moved by 80 um"):
        calibrate(moved, basis="legendre:1", hold_out=False)
    renamed = np.where(rows, "s2b", measured.groups)
    again = calibrate(replace(moved, state=replace(moved.state, station=renamed)), basis="legendre:1", hold_out=False)
    assert again.accepted
    assert not again.fit.outliers.size


@pytest.mark.parametrize(
    "drift", [{"rate": 60.0}, {"amplitudes": (40.0,), "time_constants_s": (600.0,)}], ids=["linear", "exponential"]
)
def test_a_drift_is_no_move(drift):
    machine = machines.load("trunnion_ac")
    effects = random_location_errors(machine, np.random.default_rng(1), 50.0)
    measured, _ = probed("trunnion_ac", 34, effects=[*effects, ThermalDrift("Z", **drift)])
    assert not moved_spheres(measured)


@pytest.mark.parametrize("count", [1, 2])
def test_a_drift_shows_at_the_first_centre_measured_again(count):
    measured, _ = probed("dmu50", 20, spheres=spheres_of("dmu50", count))
    again = measured.rows(np.append(np.arange(len(measured)), 0))
    last = np.arange(len(again)) == len(measured)
    assert not list(repeat_findings(coarse_fit(measured)))
    assert not list(repeat_findings(coarse_fit(shifted_rows(again, last, [0.001, -0.001, 0.001]))))
    (finding,) = repeat_findings(coarse_fit(shifted_rows(again, last, [0.002, -0.004, 0.008])))
    assert not finding.fatal
    assert "the centre of sphere s1 is (+2.0, -4.0, +8.0) um +- " in finding.message
    assert "ncomp diagnose separates a drift" in finding.message
    untimed = replace(again, state=replace(again.state, time=None))
    (finding,) = repeat_findings(coarse_fit(shifted_rows(untimed, last, [0.002, -0.004, 0.008])))
    assert "ncomp diagnose, with a column time_s, separates" in finding.message


@pytest.mark.parametrize(("name", "count"), [("trunnion_ac", 1), ("head_head", 3)])
def test_a_length_of_the_probe_wrong_by_tenths_is_noted(name, count):
    """Less than the millimetres that are refused; a machine with location errors alone gets no note."""
    measured, _ = probed(name, 30, spheres=spheres_of(name, count))
    assert not [finding for finding in sanity(measured) if finding.check == "targets"]
    (finding,) = sanity(replace(measured, targets={PROBE: Target((0.0, 0.0, -150.2))}))
    assert (finding.check, finding.fatal) == ("targets", False)
    length = float(finding.message.split("with target probe at (")[1].split(",")[2].split(")")[0])
    assert length == pytest.approx(-150.0, abs=0.08)
    assert "Measure the length of the probe again" in finding.message


@pytest.mark.parametrize(("name", "spheres", "count"), [("trunnion_bc", 1, 24), ("head_head", 2, 30)])
@pytest.mark.parametrize("row", [0, 11, -1])
def test_a_row_that_is_off_by_less_than_the_errors_is_found_before_the_bases(name, spheres, count, row):
    """Fine bases would reach it."""
    measured, _ = probed(name, count, spheres=spheres_of(name, spheres), seed=3)
    assert coarse_fit(measured).kept.all()
    off = np.arange(len(measured)) == np.arange(len(measured))[row]
    kept = coarse_fit(shifted_rows(measured, off, [0.03, 0.04, 0.0])).kept
    assert np.array_equal(kept, ~off)


@pytest.mark.statistical
@pytest.mark.parametrize("u_um", [0.1, 1000.0])
def test_a_wrong_uncertainty_in_the_header_is_stated(u_um):
    measured, _ = probed("trunnion_bc", 24, spheres=spheres_of("trunnion_bc", 1), seed=3)
    found = calibrate(replace(measured, instrument=TouchProbe(u_um=u_um)))
    assert not 0.5 < found.fit.chi2_reduced < 2.0
    assert found.fit.rms_um < 3.0
    assert found.cross_validation.gains.better


# ---- the commands

SIMULATE = [
    "simulate", "--machine", "dmu50", "--strategy", "random", "--points", "34", "--rotary", "random",
    "--instrument", "touch-probe", "--target", "t=0,0,-150", "--sphere", "s1=130,20,60", "--sphere", "s2=-110,60,50",
    "--errors", "none", "--location", "50",
]  # fmt: skip


def test_simulate_fit_and_predict(ncomp):
    done = ncomp(*SIMULATE, "--distance", "s1.s2=0.5", "-o", "data.csv", "--truth", "truth.json")
    assert done.status == 0, done.err
    assert "observations by touch-probe" in done.err
    measured = read_measurement(Path("data.csv"), DMU50)
    assert list(measured.spheres) == ["s1", "s2"]
    assert len(measured.distances) == 1
    done = ncomp(
        "fit", "data.csv", "--machine", "dmu50", "--basis", "legendre:1", "-o", "cal.json", "--json", "fit.json"
    )
    assert done.status == 0, done.err
    assert "one tip" in json.dumps(json.loads(Path("fit.json").read_text()))
    done = ncomp("predict", "data.csv", "--machine", "dmu50", "-c", "cal.json", "-o", "predicted.csv")
    assert done.status == 0, done.err
    assert Path("predicted.csv").read_text().splitlines()[-1].count(",") == len(DMU50.axes) + 8


DIAGNOSED = {
    "length of the probe": (3, MISTAKES["length of the probe"][0], 2, "with target probe at (0.0"),
    "degrees for millimetres": (3, columns_exchanged, 2, "with columns B and X exchanged (mm and degrees)"),
    "moved sphere": (3, lambda m: moved_rows(m, "s1"), 0, "Station-shift s1 (instrument): shift x"),
    "moved sphere, one": (1, lambda m: moved_rows(m, "s1"), 0, "Station-shift s1 (instrument): shift x"),
    "row off": (3, lambda m: shifted_rows(m, np.arange(len(m)) == 7, [1.0, 0.0, 0.0]), 0, "data.csv:17: outlier"),
}  # fmt: skip


def moved_rows(measured, name):
    """The measurement in whose second half a sphere is 0.5 mm from its centre before."""
    return shifted_rows(
        measured, (measured.groups == name) & (np.arange(len(measured)) >= len(measured) // 2), [0.3, 0.4, 0.0]
    )


@pytest.mark.parametrize("name", quick(DIAGNOSED, ["length of the probe", "degrees for millimetres"]))
def test_diagnose_finds_mistakes(ncomp, name):
    spheres, spoil, status, text = DIAGNOSED[name]
    measured, _ = probed("dmu50", 24 if spheres > 1 else 60, spheres=spheres_of("dmu50", spheres))
    written(spoil(measured), Path("data.csv"))
    done = ncomp("diagnose", "data.csv", "--machine", "dmu50", "-o", "new.json", "--json", "diagnosis.json")
    assert (done.status, Path("new.json").exists()) == (status, status == 0), done.err
    assert text in " ".join((done.err + done.out.decode()).split())


def test_a_base_that_is_none_of_a_probe_is_ignored_as_the_note_says(ncomp):
    assert ncomp(*SIMULATE, "-o", "data.csv").status == 0
    on_bed = Path("data.csv").read_text().replace("# probe:", "# stands_on: bed\n# probe:")
    Path("bed.csv").write_text(on_bed)
    fitted = {}
    for name in ("data", "bed"):
        done = ncomp("fit", f"{name}.csv", "--machine", "dmu50", "-o", f"{name}.json")
        assert done.status == 0, done.err
        fitted[name] = json.loads(Path(f"{name}.json").read_text())["effects"]
    assert fitted["bed"] == fitted["data"]


BAD = {
    "no sphere": (["--instrument", "touch-probe"], "the spheres are missing: state --sphere NAME=x,y,z"),
    "sphere of a tracker": (["--sphere", "s1=1,2,3"], "--sphere is no option of --instrument laser-tracker"),
    "tracker": (
        ["--instrument", "touch-probe", "--sphere", "s=0,0,0", "--tracker", "1,2,3"],
        "--tracker: no option of",
    ),
    "base": (
        ["--instrument", "touch-probe", "--sphere", "s=0,0,60", "--stands-on", "bed"],
        "--stands-on: no option of --instrument touch-probe",
    ),
    "base of a part": (["--instrument", "part", "--stands-on", "bed"], "--stands-on is no option of --instrument part"),
    "beyond": (["--instrument", "touch-probe", "--sphere", "s=9000,0,0"], "--sphere: no sphere is within the travel"),
    "distance": (
        ["--instrument", "touch-probe", "--sphere", "s=0,0,60", "--distance", "s.t=1"],
        "there is no sphere 't'",
    ),
    "name": (["--instrument", "touch-probe", "--sphere", "a.b=0,0,60"], "--sphere a.b=0,0,60: expected s1=x,y,z"),
}


@pytest.mark.parametrize(("options", "message"), BAD.values(), ids=BAD)
def test_bad_options(ncomp, options, message):
    done = ncomp("simulate", "-m", "dmu50", "--strategy", "random", "--points", "3", *options, "-o", "data.csv")
    assert (done.status, Path("data.csv").exists()) == (2, False)
    assert message in " ".join(done.err.split())


def test_spheres_are_stated_to_the_simulation():
    assert Spheres({}, {}) == VirtualInstrument(TouchProbe(u_um=1.0)).spheres


@pytest.mark.statistical
def test_the_stated_size_of_the_errors_holds_for_what_spheres_do_not_show():
    """Without a distance, the scale of the linear axes has the uncertainty of its prior: 3 um over the measured range."""
    found = calibrate(probed("dmu50", 14)[0], prior_scale=0.1, hold_out=False)
    assert np.all(found.relative_deviation.u_between < 3.0)


@pytest.mark.parametrize("basis", ["legendre:1", "legendre:4", "b-spline:2", "b-spline:5", "cubic:3", "fourier:1"])
def test_squareness_has_its_own_size(basis):
    """Standard deviation of the slopes by the prior: that of the header; without it 0.1 of the usual size counts."""
    measured, _ = probed("head_table", 6, spheres=spheres_of("head_table", 1))
    bases = dict.fromkeys(measured.machine.names, parse_basis(basis))
    found = {}
    for size in (0.0, 300.0):
        own = replace(measured, instrument=TouchProbe(u_um=1.0, squareness_urad=size))
        model, prior = with_effects(own, bases, (), 0.1)
        for effect, part in zip(model.effects, model.slices, strict=True):
            slope = mean_line(effect.basis).slope * prior[part] * 1e3
            found[effect.name, size] = float(np.linalg.norm(slope))
    for name in ("E_XY", "E_XZ", "E_YZ"):
        assert found[name, 0.0] < 150.0
        assert 300.0 <= found[name, 300.0] * (1.0 + 1e-9) < 320.0
    for name in ("E_YX", "E_ZX", "E_ZY", "E_XX", "E_AY"):
        assert found[name, 0.0] == found[name, 300.0]


@pytest.mark.statistical
def test_squareness_of_good_linear_axes_lies_within_its_uncertainty_with_one_sphere():
    """Squareness up to 50 urad beside error motions of linear axes of zero: the prior of these is small."""
    basis, inside = "X=legendre:1,Y=legendre:1,Z=legendre:1,B=fourier:1,C=fourier:1", []
    for seed in range(6):
        measured, model = probed("head_table", 24, spheres=spheres_of("head_table", 1), seed=seed)
        found = calibrate(measured, basis=basis, hold_out=False, prior_scale=0.03).fit
        true = in_datum(model, found)
        locations = [e for e in fitted_in_datum(found).effects if isinstance(e, LocationError)]
        inside += [abs(e.value - true[e.name]) <= 2.0 * e.uncertainties[0] for e in locations]
    assert len(inside) == 66
    assert np.mean(inside) >= 0.9
