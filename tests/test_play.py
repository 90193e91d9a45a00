"""Axes with play: the play operator, turning points along paths, and corrected programs on machines with play."""

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.backlash_paths import play, played, with_backlash
from support.programs import correct, load, model_of, read
from support.tiers import quick

from kinematics.effects import Backlash, LateralPlay
from kinematics.error_model.play import InPlay, PlayLimits, PlayOperator
from kinematics.state import State
from postproc.compensation.conditions import Conditions
from postproc.motion.path_points import axis_positions, turning_points_inside
from tests.fuzz.case import Case, Outcome, Verdict
from tests.fuzz.drives import ACCEPT, Machine, Reading, judge
from tests.fuzz.ncomp import correct as command
from tests.fuzz.runner import run

LIMITS = PlayLimits(np.array([1e-5]), np.array([5e-4]))


def operator():
    return PlayOperator((0,), LIMITS)


@given(st.lists(st.floats(-0.05, 0.05), min_size=1, max_size=40), st.floats(0.001, 0.04))
def test_the_axis_stays_until_it_is_pushed(commands, width):
    drive = np.array([[0.0], *[[command] for command in commands]])
    found = operator().follow(drive, np.full_like(drive, width / 2), np.ones(drive.shape, bool))
    assert (drive - found.behind)[:, 0] == pytest.approx(play(drive[:, 0], width), abs=1e-12)
    assert found.side * width / 2 == pytest.approx(found.behind, abs=1e-12)


@given(st.lists(st.floats(-0.05, 0.05), min_size=2, max_size=20), st.sampled_from((0.0, 0.004, -0.01)))
def test_one_step_is_that_of_the_operator(commands, half):
    drive = np.array(commands)[:, None]
    halves, known = np.full_like(drive, half), np.ones(drive.shape, bool)
    follower = operator()
    for i in range(1, len(drive)):
        before = follower.follow(drive[i - 1 : i], halves[:1], known[:1])
        after = follower.follow(drive[i : i + 1], halves[:1], known[:1])
        again = LIMITS.moved(InPlay(*before), drive[i : i + 1], halves[:1])
        for column, other in zip(after, again, strict=True):
            assert column == pytest.approx(other, abs=1e-15)


@given(st.lists(st.floats(-0.05, 0.05), min_size=4, max_size=30), st.integers(1, 3))
def test_the_operator_goes_on_from_chunk_to_chunk(commands, size):
    drive = np.array(commands)[:, None]
    half, known = np.full_like(drive, 0.01), np.ones(drive.shape, bool)
    whole, parts = operator().follow(drive, half, known), operator()
    chunks = [slice(i, i + size) for i in range(0, len(drive), size)]
    found = [parts.follow(drive[chunk], half[chunk], known[chunk]) for chunk in chunks]
    assert (np.concatenate([part.side for part in found]) == whole.side).all()


def test_errors_inside_the_play_are_in_proportion():
    """The tables of error motions hold three directions."""
    machine = load("dmu50")
    model = with_backlash(machine, 3)
    rng = np.random.default_rng(4)
    low, high = np.clip(machine.travel, -300.0, 300.0) * machine.scale
    q, approach = rng.uniform(low, high, (500, len(low))), rng.uniform(-1.0, 1.0, (500, len(low)))
    approach[::3] = np.rint(approach[::3])
    found = Conditions().errors(machine, model).at(q, approach)
    assert found == pytest.approx(model.errors(machine, State(q, approach)), abs=1e-10)


def test_an_axis_without_play_reverses_beyond_the_dead_band():
    """Play across its guide has no width along it."""
    drive = np.array([0.0, 1.0, 0.9996, 0.9994, 0.9997, 1.1])[:, None]
    found = operator().follow(drive, np.zeros_like(drive), np.ones(drive.shape, bool))
    assert found.side[:, 0].tolist() == [0.0, 1.0, 1.0, -1.0, -1.0, 1.0]


def test_an_unknown_position_before_leaves_the_axis_in_the_middle():
    drive, known = np.array([[0.0], [1.0], [0.5]]), np.array([[True], [True], [False]])
    found = operator().follow(drive, np.full_like(drive, 0.005), known)
    assert found.side[:, 0].tolist() == [0.0, 1.0, 0.0]


HEAD = "G21 G90 G17 F500\nG54\nG43.4 H1\n"
TURNS = {
    "the last eighth": "G0 X40.5 Y0 Z20 B0 C-30\nG1 X40.6 C2\n",
    "a whole turn": "G0 X20 Y10 Z5 B0 C0\nG1 X25 Y12 C350\n",
    "two axes turn": "G0 X60 Y-40 Z15 B-80 C-170\nG1 X-30 Y50 Z5 B100 C170\n",
    "micrometres": "G0 X-0.06 Y100 Z0 B0 C0\nG1 X0.42 C-0.26\n",
    "arcs": "G0 X0 Y0 Z0 B10 C0\nG2 X10 Y0 I5 J0\nG3 X10 Y0 I-7 J0\n",
}


@pytest.mark.parametrize("name", TURNS)
def test_between_turning_points_axes_go_one_way(name):
    machine = load("trunnion_bc")
    motions = read(HEAD + TURNS[name], machine, tools=["T1=80"])
    linear = list(machine.translators)
    rows, shares = turning_points_inside(motions, linear)
    n = 20000
    for row in range(1, len(motions)):
        even = np.linspace(0.0, 1.0, n + 1)
        path = axis_positions(motions, np.full(n + 1, row), even)[:, linear]
        slopes = np.diff(path, axis=0)
        slopes[:, np.ptp(path, axis=0) < 1e-6] = 0.0  # nothing but rounding
        reversals = np.flatnonzero(((slopes[1:] > 0) != (slopes[:-1] > 0)).any(axis=1)) + 1
        own = np.sort(shares[rows == row])
        own = own[(own > 2 / n) & (own < 1 - 2 / n)]
        assert np.unique(np.round(own * n)) == pytest.approx(np.unique(reversals), abs=1.5)


PLAY_X = played(load("trunnion_bc"), X=14.0)
HEADS = "G21 G90 G17 G94\nT1 M6\nG54\n"
TURN = HEADS + "G43.4 H1\nG0 X40. Y0. Z20. B0. C-30.\nG1 X40.5 F500\nG1 X40.6 C2.\nG1 X41.\nM30\n"
"""X turns in the last eighth of the third move, and has gone back by less than its play at the end."""
WITHIN = (
    HEADS + "G43 H1\nG0 X0. Y0. Z20. B0. C0.\nG1 X10. B5. F500\nG1 X20. B10.\nG1 X18. B12.\nG1 Y10. B5.\nG1 Y20. B2.\n"
    "G1 X30.\nM30\n"
)
"""X has to go by less than its play where B reverses."""


def case(program, machine, place, *effects):
    content = [
        {"kind": "backlash", "axis": axis, "width": width, "units": {"width": "urad" if axis in "ABC" else "um"}}
        for axis, width in effects
    ]
    from tests.fuzz.drives import calibration_of

    options = ("--work-offset", f"G54={place}", "--tool-length", "T1=80", "--datum", "G54=true", "--accept", ACCEPT)
    return Case(program, "part.nc", machine, calibration_of(machine, content), (*options, "--no-travel-check"))


CASES = {
    "a turn of the tool point": (TURN, "trunnion_bc", "0,0,110", ("X", 14.0)),
    "rotary and linear play": (WITHIN, "head_table", "0,0,200", ("X", 12.0), ("B", 30.0)),
}


@pytest.mark.parametrize("name", CASES)
def test_ends_are_reached_by_machines_with_play(name):
    program, machine, place, *effects = CASES[name]
    one = case(program, machine, place, *effects)
    done = command(one)
    mechanics = Machine(machine, json.loads(one.calibration)["effects"], place)
    nominal, corrected = (Reading(mechanics).run(text) for text in (program, done.text))
    actual = mechanics.actual(np.array(corrected.drive_ends), np.array(corrected.axis_ends))
    errors = 1e3 * np.linalg.norm(actual - mechanics.points(np.array(nominal.drive_ends)), axis=1)
    assert errors.max() < 0.1
    assert done.report["predicted_error_um"]["after"]["max"] == pytest.approx(errors.max(), abs=0.02)


@pytest.mark.parametrize("programs", quick([2, 10], [2]))
def test_random_programs_on_five_machines(programs):
    count = run("drives", programs, seed=7, keep=False)
    assert not count.differences, count.text()
    assert count.compared >= 0.9 * programs


def test_what_the_examiner_of_drives_sees(monkeypatch):
    """A claim that is too small, and one that is too large."""
    one = case(*CASES["a turn of the tool point"])
    assert judge(one) == Outcome(Verdict.COMPARED)
    done = command(one)
    for factor, kind in ((0.01, "unclaimed before"), (1.5, "claim before")):
        claims = json.loads(json.dumps(done.report))
        for key in ("max", "rms"):
            claims["predicted_error_um"]["before"][key] *= factor
        monkeypatch.setattr("tests.fuzz.drives.correct", lambda _, claims=claims: done._replace(report=claims))
        assert judge(one).kind == kind


def test_play_across_a_guide_moves_the_target_of_another_axis():
    """Y goes on by a micrometre where X reverses and shifts it by more: Y reverses too."""
    machine = load("gantry")
    model = model_of(machine, Backlash("X", 20.0), Backlash("Y", 10.0), LateralPlay("Y", "X", -8.0))
    text = "G21 G90 F500\nG0 X0 Y0 Z0\nG1 X10 Y10\nG1 X20 Y20\nG1 X10 Y20.001\nM30\n"
    lines = correct(text, machine, model).text.splitlines()
    assert lines[-2] == "G1 X9.9900 Y19.9920", lines
