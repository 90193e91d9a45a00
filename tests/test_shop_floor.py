"""The second exam of diagnoses (tests/shop_floor): its machines, designs, hidden effects, scores and records."""

import json
import math

import numpy as np
import pytest
from shop_floor import causes, exam, outside_causes, sampling, summary
from shop_floor.chain import MACHINES, no_errors, nominal_points, rotation, tool_points, without_rigid_motion
from shop_floor.designs import BREAK_S, DESIGNS
from shop_floor.hidden import Answer
from shop_floor.question import CAUSES, TIMES_NOISE, VISIBLE, VISIBLE_SHARE, ask, earlier, kinds_of, signal_of
from shop_floor.scoring import score
from shop_floor.tracker import Noise, cartesian, noisy, polar
from support.tiers import quick
from virtual_machine import chain as first_exam

import machines
from calibration.measurement.file import read_measurement

UM = 1e-3


def errors_of(machine, **given):
    """Errors of one position, by names such as BX: mm and rad."""
    errors = no_errors(np.zeros((1, len(machine.axes))))
    for name, value in given.items():
        errors[0, machine.column(name[1]), "XYZABC".index(name[0])] = value
    return errors


def displaced(machine, position, errors, target=(0.0, 0.0, 0.0), tool=(0.0, 0.0, 0.0)):
    """Displacement of a target, mm, by the exact product."""
    q, arm = np.array([position], float), np.array([target], float)
    return (tool_points(machine, q, errors, np.array([tool], float), arm) - nominal_points(machine, q, arm))[0]


def test_nominal_positions_by_hand():
    """ISO 841: tool relative to workpiece, for axes that carry the workpiece too; B of the DMU 50 turns about its point."""
    for name in ("gantry", "cframe"):
        machine = MACHINES[name]
        np.testing.assert_allclose(
            nominal_points(machine, np.array([[30.0, 20, 10]]), np.array([[1.0, 2, -5]])), [[31, 22, 5]]
        )
    dmu50 = MACHINES["dmu50"]
    at_c90 = nominal_points(dmu50, np.array([[90.0, 0, 100, 0, 0]]), np.zeros((1, 3)))
    np.testing.assert_allclose(at_c90, [[0, 100, 0]], atol=1e-12)
    # half a turn about (0, 1, -1) exchanges y with -z: from the centre, (0, 0, -154.996) goes to (0, 154.996, 0)
    at_b180 = nominal_points(dmu50, np.array([[0.0, 180, 0, 0, 0]]), np.zeros((1, 3)))
    np.testing.assert_allclose(at_b180, [[0, 154.996, 154.996]], atol=1e-9)


def test_error_motions_by_hand():
    """An angular error acts with the arm from the moving component; exact, not to first order."""
    gantry, cframe = MACHINES["gantry"], MACHINES["cframe"]
    tip = displaced(gantry, (300, 0, 0), errors_of(gantry, BX=0.01), (0, 0, -100))
    np.testing.assert_allclose(tip, [-100 * math.sin(0.01), 0, 100 * (1 - math.cos(0.01))], atol=1e-12)
    # X carries the workpiece of the C-frame: its error turns all that is between it and the tool
    tip = displaced(cframe, (300, 0, 0), errors_of(cframe, CX=0.01))
    np.testing.assert_allclose(tip, [300 * (math.cos(0.01) - 1), 300 * math.sin(0.01), 0], atol=1e-12)
    np.testing.assert_allclose(displaced(gantry, (300, 0, 0), errors_of(gantry, CX=0.01)), [0, 0, 0], atol=1e-12)
    dmu50 = MACHINES["dmu50"]
    along = displaced(dmu50, (0, 0, 0, 0, 0), errors_of(dmu50, YB=0.01))
    np.testing.assert_allclose(along, np.array([0, 0.01, -0.01]) / math.sqrt(2), atol=1e-12)
    np.testing.assert_allclose(displaced(gantry, (0, 0, 0), errors_of(gantry), tool=(1, 2, 3)), [1, 2, 3], atol=1e-12)


@pytest.mark.parametrize("name", MACHINES)
def test_both_exams_have_the_same_machines(name):
    """Two programs that share nothing agree, also for large errors."""
    machine, other = MACHINES[name], first_exam.load(name)
    assert [(axis.name, axis.low, axis.high) for axis in machine.axes] == [(a.name, *a.travel) for a in other.axes]
    rng = np.random.default_rng(1)
    q = rng.uniform([axis.low for axis in machine.axes], [axis.high for axis in machine.axes], (20, len(machine.axes)))
    errors, tool, arms = (
        rng.normal(scale=1e-2, size=(*q.shape, 6)),
        rng.normal(size=(20, 3)),
        rng.normal(size=(20, 3)) * 99,
    )
    ours = tool_points(machine, q, errors, tool, arms)
    theirs = first_exam.tool_points(other, other.to_radians(q), errors, np.c_[tool, np.zeros((20, 3))], arms)
    np.testing.assert_allclose(ours, theirs, atol=1e-9)


def test_rigid_motions_are_taken_away():
    rng = np.random.default_rng(2)
    points = rng.uniform(-500, 500, (40, 3))
    turned = points @ rotation(np.array([[1e-5, -2e-5, 3e-5]]))[0].T + (0.1, 0.2, -0.3)
    bumps = rng.normal(scale=1e-3, size=(40, 3))
    np.testing.assert_allclose(without_rigid_motion(points, turned - points), 0, atol=1e-6)
    left = without_rigid_motion(points, turned - points + bumps)
    np.testing.assert_allclose(left, without_rigid_motion(points, bumps), atol=1e-6)


def test_noise_of_the_tracker():
    rng = np.random.default_rng(3)
    points = np.tile([[3000.0, 2000.0, 1500.0]], (20000, 1))
    azimuth, elevation, length = polar(points)
    np.testing.assert_allclose(cartesian(azimuth, elevation, length), points)
    read = polar(noisy(points, Noise(5.0), rng.normal(size=points.shape)))
    metres = length[0] * 1e-3
    across = 5.0 + metres
    assert np.std(read[2]) == pytest.approx(0.25 * metres * UM, rel=0.03)
    assert np.std(read[1]) * length[0] == pytest.approx(across * UM, rel=0.03)
    assert np.std(read[0]) * math.hypot(3000, 2000) == pytest.approx(across * UM, rel=0.03)


@pytest.fixture(scope="module")
def runs():
    rng = np.random.default_rng(4)
    return {name: DESIGNS[name](MACHINES["cframe"], rng, 0) for name in DESIGNS}


def test_lines_run_out_and_back(runs):
    run = runs["lines"]
    assert len(run) == 27 * 18 + 150
    for line in range(27):
        rows = run.positions[18 * line : 18 * line + 18]
        moving = np.ptp(rows, axis=0) > 0
        assert moving.sum() == 1
        np.testing.assert_allclose(rows, rows[::-1])
        assert len(np.unique(rows[:, moving])) == 9
    assert set(run.target[::2]) == {"t1"}
    assert set(run.target[1::2]) == {"t2"}
    once = runs["lines-once"]
    assert len(once) == 27 * 9 + 120
    assert np.all(np.diff(once.positions[:9, 0]) > 0)


def test_the_other_designs(runs):
    serpentine = runs["serpentine"].positions
    np.testing.assert_array_equal(serpentine, serpentine[::-1])
    assert np.all((np.diff(serpentine[:175], axis=0) != 0).sum(axis=1) == 1)
    stops = runs["random3"]
    assert len(stops) == 360
    assert np.bincount(stops.stop).tolist() == [3] * 120
    assert stops.target.reshape(-1, 3).tolist() == [["t1", "t2", "t3"]] * 120
    shares = np.stack([runs["faces"].share(axis) for axis in "XYZ"], axis=1)
    faces = shares.reshape(6, 49, 3)
    assert all(np.any(np.ptp(face, axis=0) == 0) for face in faces)
    diagonal = np.stack([runs["diagonals"].share(axis) for axis in "XYZ"], axis=1)[: 4 * 34]
    folded = np.minimum(diagonal, 1 - diagonal)
    np.testing.assert_allclose(folded, folded[:, [1, 2, 0]], atol=1e-6)
    assert len(runs["few"]) == 80
    assert len(runs["many"]) == 5000
    assert max(np.diff(runs["break"].clock)) == pytest.approx(BREAK_S, abs=20)
    assert np.ptp(runs["drifting-hall"].temperature) > 1.0
    assert np.ptp(runs["lines"].temperature) == 0.0
    assert set(runs["two-stations"].station) == {"s1", "s2"}
    assert set(runs["one-target"].target) == {"t1"}
    assert set(np.bincount(runs["three-targets"].stop)) <= {3, 6}
    assert runs["bad-repeat"].repeatability_um == 3.0
    assert {
        DESIGNS["wrong-noise"](MACHINES["cframe"], np.random.default_rng(0), draw).header_noise for draw in (0, 1)
    } == {
        0.5,
        2.0,
    }
    for run in runs.values():
        assert np.all(np.diff(run.clock) > 0)


def test_the_first_approach_is_unknown_and_kept():
    run = DESIGNS["lines"](MACHINES["cframe"], np.random.default_rng(5), 0)
    first_move = int(np.argmax(np.diff(run.place("Y")) != 0)) + 1
    assert first_move > 50
    assert set(run.direction("Y")[:first_move]) == {float(run.came_from[1])}
    assert run.direction("X")[1] == 1.0
    at_turn = np.flatnonzero(np.diff(run.place("X")[:18]) == 0)[0] + 1
    assert run.direction("X")[at_turn] == run.direction("X")[at_turn - 1] == 1.0


def test_rows_of_a_stop_share_its_error():
    question = ask("bad-repeat", "none", "cframe", 1)
    stops = question.stops.reshape(-1, 3, 3)
    assert np.ptp(stops, axis=1).max() == 0.0
    assert np.std(stops) == pytest.approx(3.0 * UM, rel=0.15)
    assert not ask("random3", "none", "cframe", 1).stops.any()


@pytest.mark.parametrize("cause", quick((c for c in CAUSES if c != "none"), ["backlash", "outliers", "strange", "two"]))
def test_hidden_effects_have_the_size_that_they_say(cause):
    question = ask("random3", cause, "cframe", 2)
    assert len(question.hidden) == len(kinds_of(cause, 2)) == len(question.sizes)
    for effect, size in zip(question.hidden, question.sizes, strict=True):
        times, left, share = signal_of(question, effect)
        assert (times, left, share) == pytest.approx(tuple(size), rel=0.02)
        if not isinstance(effect, causes.Outliers):
            assert 0.99 * TIMES_NOISE[0] <= times <= 1.01 * TIMES_NOISE[1]
            assert left > 0.98 * VISIBLE
            assert share > 0.98 * VISIBLE_SHARE
    plain = ask("random3", "none", "cframe", 2)
    np.testing.assert_allclose(question.having().seen, plain.seen)
    np.testing.assert_array_equal(question.normal, plain.normal)
    assert question.sheet() != plain.sheet()


def test_effects_by_hand():
    question = ask("lines", "none", "cframe", 3)
    run = question.run
    backlash = causes.Backlash(10.0, axis="Y").errors(run)
    np.testing.assert_allclose(backlash[:, 1, 1], -0.005 * run.direction("Y"))
    drift = causes.Drift(20.0, towards=(0, 0, 1), time_constant_s=1000.0).tool(run)
    np.testing.assert_allclose(drift[:, 2], 0.02 * (1 - np.exp(-run.clock / 1000.0)))
    scale = causes.Scale(4.0, axis="X", time_constant_s=500.0)
    warm = scale.on_run(run)
    grown = 11.5e-6 * (warm.temperature - 20.0) * run.place("X")
    np.testing.assert_allclose(scale.errors(warm)[:, 0, 0], grown)
    sag = causes.Cross(30.0, axis="Y", component="Z", other="X", shape="sag").errors(run)[:, 1, 2]
    middle = (run.share("Y") == 0.5) & (run.share("X") == 1.0)
    np.testing.assert_allclose(sag[middle], 0.03)
    knock = causes.Knock(40.0, since_s=1000.0, towards=(0, 1, 0)).reading(run, question.seen) - question.seen
    np.testing.assert_allclose(knock[:, 1], 0.04 * (run.clock >= 1000.0))
    angle = causes.Encoder(10.0, circle="azimuth", harmonic=2, phase=0.3).reading(run, question.seen)
    azimuth = polar(question.seen)[0]
    np.testing.assert_allclose(polar(angle)[0] - azimuth, 1e-5 * np.sin(2 * azimuth + 0.3), atol=1e-12)
    crash = causes.Crash(30.0, axis="Y", component="X", since_s=0.0)
    np.testing.assert_allclose(crash.errors(run)[:, 1, 0], 0.03 / 450.0 * run.place("Y"))
    # E_C0Y is -E_XY per mm (docs/conventions.md): 30 um over 450 mm
    assert crash.answer(run).sizes["value_urad"] == pytest.approx(-30.0 / 0.45)
    assert crash.answer(run).component == "C"
    outliers = ask("lines", "outliers", "cframe", 3)
    rows = sorted(outliers.hidden[0].answer(run).rows)
    off = np.linalg.norm(outliers.seen - question.seen, axis=1)
    assert len(rows) == round(0.015 * len(run))
    np.testing.assert_allclose(off, 0.4 * np.isin(np.arange(len(run)), rows), atol=1e-9)
    swing = outside_causes.Swing(20.0, period_s=1600.0).tool(run)
    start = math.tanh(-3.0) * 1.0 * 0.02
    assert swing[0].tolist() == [0.0, pytest.approx(start), 0.0]
    teeth = outside_causes.StickSlip(5.0, axis="X", other="Y").errors(run)[:, 0, 0]
    assert 4.0 * UM < np.abs(teeth).max() <= 5.0 * UM


@pytest.mark.parametrize("design", quick((design for design in DESIGNS if design != "many"), ["few", "random3"]))
def test_files_can_be_read(design, tmp_path):
    question = ask(design, "scale", "cframe", 1)
    assert question.sheet() == ask(design, "scale", "cframe", 1).sheet() != ask(design, "scale", "cframe", 2).sheet()
    (tmp_path / "data.csv").write_text(question.sheet(), encoding="utf-8")
    read = read_measurement(tmp_path / "data.csv", machines.load("cframe"))
    assert len(read) == len(question.run)
    np.testing.assert_allclose(read.state.time, question.run.clock)
    np.testing.assert_allclose(read.state.temperatures["scale"], question.logged.temperature - 20.0, atol=0.006)
    assert not [note for note in read.notes if "unknown" in note or "travel" in note]


def test_unseen_poses_are_those_of_the_machine():
    """At the mean time, from either side; instrument effects have no part in it, a rigid motion neither."""
    question = ask("lines", "backlash", "cframe", 1)
    run = question.unseen
    assert len(run) == 400
    assert set(run.clock) == {round(question.run.clock.mean(), 1)}
    nominal = nominal_points(run.machine, run.positions, run.tools)
    true = (question.true_points(run) - nominal) / UM
    assert np.abs(question.unseen_errors(true)).max() < 1e-6
    moved = true + 5.0 + np.cross((1e-3, 2e-3, 0), nominal)
    assert np.abs(question.unseen_errors(moved)).max() < 1e-6
    knocked = ask("lines", "shift", "cframe", 1)
    np.testing.assert_allclose(knocked.unseen_errors(true * 0), knocked.having().unseen_errors(true * 0))


def test_a_machine_is_the_same_when_it_is_measured_again():
    before, now = earlier("cframe", 0), ask("again", "none", "cframe", 0)
    q = now.run.positions[:5]
    np.testing.assert_array_equal(before.motions.errors(q), now.motions.errors(q))
    assert not np.array_equal(before.poses["s1"].origin, now.poses["s1"].origin)


def effect(kind, axis=None, verdict="strong", alternatives=(), **more):
    others = [{"kind": other, "axis": place} for other, place in alternatives]
    return {"kind": kind, "axis": axis, "verdict": verdict, "alternatives": others, **more}


def scored(effects, *answers, unexplained=None, **more):
    diagnosis = {"effects": effects, "unexplained": unexplained and {"variables": unexplained}}
    return score(diagnosis, answers, MACHINES["cframe"], **more)


BACKLASH = Answer(("backlash", "reversal"), frozenset("X"), sizes={"width_um": 10.0})


def test_scores():
    right = effect("backlash", "X", parameters={"width_um": 10.5}, u={"width_um": 0.3})
    assert scored([right], BACKLASH) == (1, 0, 0, (), 1, 1)
    assert scored([{**right, "u": {"width_um": 0.2}}], BACKLASH) == (1, 0, 0, (), 0, 1)
    assert scored([effect("reversal", "X")], BACKLASH)[:4] == (1, 0, 0, ())
    assert scored([], BACKLASH)[:4] == (0, 0, 1, ())
    assert scored([effect("backlash", "Y")], BACKLASH)[:4] == (0, 0, 1, ("backlash Y strong",))
    assert scored([right, effect("cyclic", "X")], BACKLASH).false == ("cyclic X strong",)
    tied = effect("settling", "X", "tied", [("backlash", "X")])
    assert scored([tied], BACKLASH)[:4] == (0, 1, 0, ())
    assert scored([{**tied, "verdict": "strong"}], BACKLASH)[:4] == (0, 0, 1, ("settling X strong",))
    assert scored([right, tied], BACKLASH).false == ("settling X tied",)
    assert scored([effect("outliers")])[:4] == (0, 0, 0, ("outliers strong",))


def test_scores_of_directions_periods_rows_and_pairs_of_axes():
    drift = causes.Drift(20.0, towards=(0.1, 0.0, 1.0)).answer(ask("few", "none", "cframe", 0).run)
    both = [effect("thermal-drift", "Z"), effect("thermal-drift", "X")]
    assert scored(both, drift)[:4] == (1, 0, 0, ())
    assert scored(both[1:], drift)[:3] == (0, 0, 1)
    assert scored([*both, effect("thermal-drift", "Y")], drift).false == ("thermal-drift Y strong",)
    pitch = Answer(("cyclic",), frozenset("X"), sizes={"period_mm": 10.0})
    assert scored([effect("cyclic", "X", parameters={"period_mm": 10.01})], pitch).named == 1
    assert scored([effect("cyclic", "X", parameters={"period_mm": 7.0})], pitch).false == ("cyclic X strong",)
    rows = Answer(("outliers",), rows=frozenset({3, 8, 11}))
    assert scored([effect("outliers", rows=[3, 8, 11, 40])], rows).named == 1
    assert scored([effect("outliers", rows=[3, 40, 41])], rows)[:3] == (0, 0, 1)
    sag = Answer(("cross-axis",), frozenset("YZ"), component="Z", sizes={"P2 Y": -20.0})
    found = effect("cross-axis", "Z", component="Z", other="Y")
    file = {
        **found, "own_interval": [0, 500], "other_interval": [0, 225], "own_degree": 1, "other_degree": 2,
        "coefficients": [0, 0, 0, -5.2], "u": [1, 1, 1, 0.15],
    }  # fmt: skip
    assert scored([found], sag, calibration={"effects": [file]}) == (1, 0, 0, (), 1, 1)
    assert scored([{**found, "other": "X"}], sag).named == 0


def test_scores_of_vectors_and_harmonics():
    knock = causes.Knock(40.0, towards=(0.0, 0.6, 0.8)).answer(ask("few", "none", "cframe", 0).run)
    u = {"shift_um": [1.0, 1.0, 1.0]}
    assert scored([effect("station-shift", parameters={"shift_um": [0.5, -23.0, -31.0]}, u=u)], knock)[4:] == (3, 3)
    assert scored([effect("station-shift", parameters={"shift_um": [0.5, 23.0, -31.0]}, u=u)], knock)[4:] == (2, 3)
    angle = causes.Encoder(10.0, harmonic=2, phase=0.0).answer(ask("few", "none", "cframe", 0).run)
    read = {
        "circle": "azimuth",
        "parameters": {"sine_urad": 9.0, "cosine_urad": 3.0},
        "u": {"sine_urad": 1, "cosine_urad": 1},
    }
    assert scored([effect("tracker-angle", **read, harmonic=2)], angle) == (1, 0, 0, (), 1, 2)
    assert scored([effect("tracker-angle", **read, harmonic=1)], angle) == (1, 0, 0, (), 0, 0)


def test_scores_of_effects_without_a_name():
    swing = Answer(variables=frozenset({"X", "Z", "time"}))
    assert scored([], swing, unexplained=["X", "time"])[:4] == (1, 0, 0, ())
    assert scored([effect("unnamed", "Y")], swing)[:4] == (1, 0, 0, ())
    assert scored([], swing, unexplained=["Y"]).missed == 1
    assert scored([effect("cyclic", "X")], swing, unexplained=["X"])[:4] == (1, 0, 0, ("cyclic X strong",))
    assert scored([effect("unnamed", "Y")]).false == ("unnamed Y strong",)
    walk = Answer(relatives=("thermal-drift",), variables=frozenset({"time"}))
    assert scored([effect("thermal-drift", "Z")], walk)[:4] == (0, 0, 1, ())
    waves = [Answer(("higher-frequency",), frozenset("X"))]
    assert scored([effect("higher-frequency", "X")], allowed=waves).false == ()


def test_calibrations_are_drawn_from_their_covariance(tmp_path):
    effects = [
        {"kind": "location", "value": 5.0, "units": {"value": "urad"}},
        {"kind": "error-motion", "parameters": [1.0, 2.0], "units": {"parameters": "um"}},
    ]
    covariance = [[4.0, 1.0, 0.0], [1.0, 1.0, 0.0], [0.0, 0.0, 0.0]]
    assert not sampling.write_samples({"effects": effects, "covariance": None}, tmp_path)
    assert sampling.write_samples({"effects": effects, "covariance": covariance}, tmp_path)
    samples = [json.loads(file.read_text())["effects"] for file in sorted(tmp_path.iterdir())]
    drawn = np.array([[first["value"], *second["parameters"]] for first, second in samples])
    assert len(drawn) == sampling.SAMPLES
    np.testing.assert_allclose(np.cov(drawn.T), covariance, atol=1.5)
    np.testing.assert_allclose(drawn[:, 2], 2.0)
    assert effects[0]["value"] == 5.0


def record(cause, draw, after, **more):
    return {
        "design": "lines", "cause": cause, "machine": "cframe", "draw": draw, "seed": 0, "hidden": [], "times_noise": [],
        "named": 1, "tied": 0, "missed": 0, "false": [], "found": [], "unexplained": None, "inside": 1, "sizes": 1,
        "accepted": True, "written": True, "reason": "", "heldout_um": [3.0, 2.5], "unseen_um": [9.0, after],
        "covered": 0.94, "covered_in_datum": 0.99, "seconds": 60.0, **more,
    }  # fmt: skip


def test_the_table(tmp_path):
    records = [
        record("none", 0, 1.0), record("backlash", 0, 1.2, false=["cyclic X weak"], heldout_um=[3.0, 3.2]),
        {**{key: record("backlash", 1, 0)[key] for key in exam.Key._fields}, "not_asked": "not visible"},
    ]  # fmt: skip
    file = tmp_path / "records.jsonl"
    file.write_text("\n".join(map(json.dumps, records)) + '\n{"design": "li', encoding="utf-8")
    assert exam.read_records(file) == records
    lines = list(summary.table(records))
    assert lines[2].split()[:10] == ["lines", "backlash", "1", "1", "0", "0", "1", "1", "0", "1"]
    assert "1.20" in lines[2]
    assert lines[2].endswith("1 not asked")
    assert list(summary.false_causes(records)) == ["   1 cyclic weak: lines backlash 1"]
    assert "WORSE" in summary.line(records[1])


@pytest.mark.statistical
def test_questions_are_answered_by_the_command():
    answers = [
        exam.answer(exam.Key("few", cause, "cframe", 0, 0), timeout=600) for cause in ("none", "backlash", "drift")
    ]
    for found in answers:
        assert "failure" not in found, found["failure"]
        assert found["unseen_um"][1] < found["unseen_um"][0]
        assert found["covered"] > 0.8
    nothing, *hidden = answers
    assert nothing["found"] == []
    assert [found["named"] + found["tied"] for found in hidden] == [1, 1]
    assert all(summary.relative(found, {summary._twin(nothing): nothing}) < 2.0 for found in hidden)


@pytest.mark.exam
def test_a_cause_is_searched_where_the_noise_of_an_axis_hides_it():
    """Stops at random positions: a sag that the scatter of Z from stop to stop holds leaves residuals that are white."""
    found = exam.answer(exam.Key("random3", "cross", "gantry", 0, 4003), timeout=600)
    assert "failure" not in found, found["failure"]
    assert found["named"] + found["tied"] == 1


@pytest.mark.exam
def test_few_positions_name_no_period_and_no_basis_of_the_search():
    """A warped frame at 40 positions, and a machine whose X has finer errors than the search's basis of X."""
    warped = exam.answer(exam.Key("few", "product", "cframe", 0, 70001), timeout=600)
    assert not any(found.startswith(("cyclic", "quantised")) for found in warped["found"])
    assert exam.answer(exam.Key("random3", "none", "gantry", 0, 90001), timeout=600)["found"] == []
