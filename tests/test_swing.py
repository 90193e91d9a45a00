"""A swing of the tool with time: found with its period, and the model beside it learns nothing of it."""

from dataclasses import replace

import msgspec
import numpy as np
import pytest
from calibration.diagnosis.unseen.fast_swing import fast_swing
from calibration.diagnosis.unseen.swing import Swing
from calibration.reports.diagnosis_json import diagnosis_json
from shop_floor import exam
from support.effect_examples import DMU50, full_state
from support.pages import text_of
from support.tiers import EXAM, STATISTICAL, quick
from support.virtual_measurements import THREE, measured, positions, truth

import machines
from calibration.diagnosis.diagnose import diagnose
from calibration.diagnosis.search import evaluated_rows
from calibration.fit.acceptance import without_clamp
from calibration.reports.diagnosis import diagnosis_report
from kinematics.deviation import exact_deviation
from kinematics.effects import Backlash, Unnamed
from kinematics.forward import forward
from kinematics.state import State
from rendering.page import page as page_of

MACHINE = machines.load("cframe")
X = (0.0, 400.0)


def test_it_is_a_cosine_and_a_sine_of_its_period():
    state = full_state(DMU50, 60)
    terms, sizes = ((1, 1), (0, 2)), (4.0, -3.0)
    swing = Swing("Y", ("X", "time"), ((-200.0, 200.0), (0.0, 500.0)), terms, sizes, 500.0)
    ((_, _, values),) = swing.contributions(DMU50, state)
    x, phase = np.clip(state.position(DMU50, "X") / 200.0, -1, 1), 2 * np.pi * state.time / 500.0
    np.testing.assert_allclose(values, 1e-3 * (4.0 * x * np.cos(phase) - 3.0 * np.sin(phase)), atol=1e-12)


TRUE = truth(MACHINE, np.random.default_rng(0), 10.0)


def diagnosed(*effects, seed=1):
    rng = np.random.default_rng(seed)
    moved = msgspec.structs.replace(TRUE, effects=(*TRUE.effects, *effects))
    return diagnose(measured(MACHINE, positions(MACHINE, 200, rng), THREE, moved, rng))


def unseen_um(model):
    """Errors of the machine's own that a model leaves at positions that were not measured, um, RMS."""
    q = positions(MACHINE, 300, np.random.default_rng(99))
    state, tool = State(q, np.full(len(q), 0.0)), np.tile([0.0, 0.0, -120.0], (len(q), 1))
    real, found = (exact_deviation(MACHINE, q, each.errors(MACHINE, state), tool).position for each in (TRUE, model))
    less = without_clamp(forward(MACHINE, q).apply(tool))
    return float(np.sqrt(3.0 * np.mean((1e3 * less @ (real - found).reshape(-1)) ** 2)))


@pytest.fixture(scope="module")
def swung():
    """Y swings by 40 um, more at one end of X, every 700 s."""
    return diagnosed(Swing("Y", ("X", "time"), (X, (0.0, 700.0)), ((0, 1), (1, 1)), (20.0, 20.0), 700.0))


@pytest.fixture(scope="module")
def steady():
    """The same machine without the swing."""
    return diagnosed()


@pytest.mark.statistical
def test_its_period_is_found_and_said(swung):
    assert swung.swing.component == "Y"
    assert "X" in swung.swing.variables
    assert abs(swung.swing.period - 700.0) < 4.0 * swung.swing.u < 20.0
    assert swung.beside_function
    said = diagnosis_json(swung)["swing"]
    assert (said["direction"], said["period_s"], said["u_s"]) == ("Y", swung.swing.period, swung.swing.u)
    page = text_of(page_of(diagnosis_report(swung, "ncomp diagnose data.csv")).decode())
    said = f"Y of the tool swings with a period of {swung.swing.period:.5g} s +- "
    assert said in page.replace("\N{PLUS-MINUS SIGN}", "+-")


@pytest.mark.statistical
def test_what_is_said_of_it_agrees(swung, steady):
    """Beside the swing nothing is left that would be noise of an axis; that it goes with time is known."""
    assert swung.estimated_noise is None
    assert swung.noise_um < 1.1 * steady.noise_um
    assert swung.conclusion.dependence.endswith(f" and swing with a period of {swung.swing.period:.4g} s")
    assert swung.next_measurement.startswith("Let the machine rest for 35 min, and record Y of the tool")


@pytest.mark.statistical
def test_the_calibration_beside_it_is_nearly_as_good_as_without_it(swung, steady):
    assert steady.unexplained is None
    assert unseen_um(swung.model) < 1.3 * unseen_um(steady.model)


SLOW = Swing("Y", ("X", "time"), (X, (0.0, 1100.0)), ((0, 1), (1, 1)), (20.0, 20.0), 1100.0)


@pytest.mark.parametrize(
    "causes",
    [
        pytest.param((Backlash("Z", 8.0),), marks=STATISTICAL),
        pytest.param((Backlash("Y", 10.0), Backlash("X", 15.0)), marks=EXAM),
    ],
)
def test_a_cause_beside_a_swing_is_named_with_its_size(causes):
    """A smooth function of time imitates both; the swing alone leaves the cause."""
    found = diagnosed(*causes, SLOW)
    assert abs(found.swing.period - 1100.0) < 4.0 * found.swing.u
    assert {each.effect.name for each in found.causes} == {each.name for each in causes}
    assert found.after.held_out_um < found.before.held_out_um
    widths = {each.name: each.width for each in causes}
    for each in found.causes:
        assert abs(each.effect.width - widths[each.effect.name]) < 3.0 * each.effect.u[0]


@pytest.mark.parametrize(
    ("period", "terms"),
    [
        pytest.param(250.0, ((0, 1), (1, 1)), marks=STATISTICAL),
        pytest.param(120.0, ((0, 1), (1, 1)), marks=EXAM),
        pytest.param(400.0, ((0, 2),), marks=EXAM),
    ],
)
def test_a_swing_that_no_smooth_function_follows_is_found(period, terms):
    """It would be taken for non-repeatability of Y, which it is not."""
    found = diagnosed(Swing("Y", ("X", "time"), (X, (0.0, period)), terms, (20.0,) * len(terms), period))
    assert abs(found.swing.period - period) < 4.0 * found.swing.u < 0.01 * period
    assert (found.causes, found.estimated_noise) == ((), None)


def grid():
    """Lines of equal duration along X."""
    x = np.tile(np.concatenate([np.linspace(0.0, 400.0, 26), np.linspace(400.0, 0.0, 26)]), 12)
    return x, np.repeat(np.linspace(0.0, 300.0, 12), 52), np.repeat(np.linspace(50.0, 250.0, 4), 156)


def out_and_back():
    """Once along X, with random positions of the others."""
    rng = np.random.default_rng(6)
    x = np.concatenate([np.linspace(0.0, 400.0, 100), np.linspace(400.0, 0.0, 100)])
    return x, rng.uniform(0.0, 300.0, 200), rng.uniform(50.0, 250.0, 200)


@pytest.mark.parametrize("path", quick([grid, out_and_back], [], [grid]))
def test_an_error_of_positions_that_come_at_equal_times_is_no_swing(path):
    """A wave of the axis is one of the time too."""
    x, y, z = path()
    q = np.stack([{"X": x, "Y": y, "Z": z}[axis.name] for axis in MACHINE.axes], axis=1)
    data = measured(MACHINE, q, THREE, TRUE, np.random.default_rng(5))
    wave = np.cos(2.0 * np.pi * x / 400.0 * 3.0) * (y / 150.0 - 1.0)
    found = diagnose(replace(data, observed=data.observed + 0.02 * wave[:, None] * [0.0, 1.0, 0.0]))
    assert found.swing is None
    assert fast_swing(found.before.linearised, None) is None


@pytest.mark.statistical
def test_what_moves_without_a_period_is_no_swing():
    course = Unnamed("Y", ("X", "time"), (X, (0.0, 3000.0)), ((0, 2), (1, 3)), (60.0, 60.0))
    found = diagnosed(course)
    assert found.unexplained is not None
    assert found.swing is None
    assert diagnosis_json(found)["swing"] is None


@pytest.mark.parametrize(
    ("design", "machine", "draw", "seed"),
    [
        pytest.param("lines", "gantry", 0, 72001, marks=EXAM),
        pytest.param("lines", "cframe", 1, 73001, marks=EXAM),
        pytest.param("random3", "cframe", 1, 73001, marks=EXAM),
        pytest.param("one-target", "cframe", 1, 73001, marks=EXAM),
        pytest.param("diagonals", "dmu50", 1, 72001, marks=EXAM),
    ],
)
def test_a_calibration_beside_a_swing_is_as_good_as_without_one(design, machine, draw, seed):
    """Errors at unseen poses but for the swing itself, relative to the same data with nothing hidden."""
    swing, none = (
        exam.answer(exam.Key(design, cause, machine, draw, seed), timeout=600) for cause in ("swing", "none")
    )
    assert swing["accepted"], swing["reason"]
    assert swing["unseen_nameable_um"] < 1.35 * none["unseen_um"][1]


@pytest.mark.exam
def test_a_part_of_a_swing_is_no_cause():
    """Without the noise that the swing leaves, settling of X explains a part of it."""
    found = exam.answer(exam.Key("lines", "swing", "gantry", 0, 77001), timeout=600)
    assert (found["named"], found["false"]) == (1, [])


@pytest.mark.statistical
def test_of_many_rows_it_is_found_by_some_of_them(monkeypatch):
    """The model beside the swing has another number of parameters, and is evaluated at other rows."""
    monkeypatch.setattr(evaluated_rows, "LEAST_ROWS", 100)
    monkeypatch.setattr(evaluated_rows, "ENTRIES", 50_000)
    found = diagnosed(SLOW)
    assert len(found.after.linearised.rows) < len(found.measurement)
    assert abs(found.swing.period - SLOW.period) < 4.0 * found.swing.u


@pytest.mark.parametrize("design", quick(["lines-once", "three-targets"], [], []))
def test_a_pad_that_gives_way_faster_and_faster_is_no_jump(design):
    """The model imitates all terms of a function that explains far more than a jump about A late in the run."""
    found = exam.answer(exam.Key(design, "floor", "cframe", 0, 82001), timeout=600)
    assert (found["named"], found["false"]) == (1, [])
