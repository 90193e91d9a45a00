"""A swing of the tool with time: found with its period, and the model beside it learns nothing of it."""

from dataclasses import replace

import msgspec
import numpy as np
import pytest
from shop_floor import exam
from support.tiers import EXAM, STATISTICAL, quick
from support.virtual_measurements import THREE, measured, positions, truth

import machines
from calibration.diagnosis.diagnose import diagnose
from calibration.fit.acceptance import without_clamp
from kinematics.deviation import exact_deviation
from kinematics.effects import Backlash, Unnamed
from kinematics.forward import forward
from kinematics.state import State

MACHINE = machines.load("cframe")
X = (0.0, 400.0)
TRUE = truth(MACHINE, np.random.default_rng(0), 10.0)


def data_of(*effects, seed=1, n=200):
    rng = np.random.default_rng(seed)
    moved = msgspec.structs.replace(TRUE, effects=(*TRUE.effects, *effects))
    return measured(MACHINE, positions(MACHINE, n, rng), THREE, moved, rng)


def swinging(period, *effects):
    """Y swings by 40 um, more at one end of X."""
    data = data_of(*effects)
    share = data.state.position(MACHINE, "X") / X[1]
    wave = 0.04 * share * np.cos(2.0 * np.pi * data.state.time / period)
    observed = data.observed + wave[:, None] * [0.0, 1.0, 0.0]
    return replace(data, observed=observed, state=replace(data.state, observed=observed))


def periods(found):
    """Periods of the swings of a diagnosis, s."""
    names = [each.term.name for each in found.unexplained if each.term.kind == "swing"]
    return [float(name.partition("periodic in time (")[2].partition(" s")[0]) for name in names]


def unseen_um(model):
    """Errors of the machine's own that a model leaves at positions that were not measured, um, RMS."""
    q = positions(MACHINE, 300, np.random.default_rng(99))
    state, tool = State(q, time=np.zeros(len(q))), np.tile([0.0, 0.0, -120.0], (len(q), 1))
    real, found = (exact_deviation(MACHINE, q, each.errors(MACHINE, state), tool).position for each in (TRUE, model))
    less = without_clamp(forward(MACHINE, q).apply(tool))
    return float(np.sqrt(3.0 * np.mean((1e3 * less @ (real - found).reshape(-1)) ** 2)))


@pytest.mark.parametrize(
    "period", [pytest.param(700.0, marks=STATISTICAL), pytest.param(250.0, marks=EXAM), pytest.param(120.0, marks=EXAM)]
)
def test_its_period_is_found_and_the_calibration_is_nearly_as_good_as_without_it(period):
    swung, steady = diagnose(swinging(period)), diagnose(data_of())
    assert periods(swung)
    assert periods(swung) == pytest.approx([period] * len(periods(swung)), rel=0.02)
    assert not swung.causes
    assert max(swung.not_repeating.values(), default=0.0) < 2.0
    assert swung.noise_um < 1.1 * steady.noise_um
    assert not steady.unexplained
    assert unseen_um(swung.model) < 1.3 * unseen_um(steady.model)


@pytest.mark.parametrize(
    "causes",
    [
        pytest.param((Backlash("Z", 8.0),), marks=STATISTICAL),
        pytest.param((Backlash("Y", 10.0), Backlash("X", 15.0)), marks=EXAM),
    ],
)
def test_a_cause_beside_a_swing_is_named_with_its_size(causes):
    """A smooth function of time imitates both; the swing alone leaves the cause."""
    found = diagnose(swinging(1100.0, *causes))
    assert {each.effect.name for each in found.causes} == {each.name for each in causes}
    assert found.figures[1].heldout_rms_um < found.figures[0].heldout_rms_um
    widths = {each.name: each.width for each in causes}
    for each in found.causes:
        assert abs(each.effect.width - widths[each.effect.name]) < 3.0 * each.effect.u[0]


def grid():
    """Lines of equal duration along X."""
    x = np.tile(np.concatenate([np.linspace(0.0, 400.0, 26), np.linspace(400.0, 0.0, 26)]), 12)
    return x, np.repeat(np.linspace(0.0, 300.0, 12), 52), np.repeat(np.linspace(50.0, 250.0, 4), 156)


def out_and_back():
    """Once along X, with random positions of the others."""
    rng = np.random.default_rng(6)
    x = np.concatenate([np.linspace(0.0, 400.0, 100), np.linspace(400.0, 0.0, 100)])
    return x, rng.uniform(0.0, 300.0, 200), rng.uniform(50.0, 250.0, 200)


OUT_AND_BACK = pytest.mark.xfail(
    strict=True, reason="what the model cannot do: an error of three periods over a travel that another axis modulates"
)


@pytest.mark.parametrize(
    "path", [pytest.param(grid, marks=STATISTICAL), pytest.param(out_and_back, marks=[EXAM, OUT_AND_BACK])]
)
def test_an_error_of_positions_that_come_at_equal_times_is_no_swing(path):
    """A wave of the axis is one of the time too."""
    x, y, z = path()
    q = np.stack([{"X": x, "Y": y, "Z": z}[axis.name] for axis in MACHINE.axes], axis=1)
    data = measured(MACHINE, q, THREE, TRUE, np.random.default_rng(5))
    wave = np.cos(2.0 * np.pi * x / 400.0 * 3.0) * (y / 150.0 - 1.0)
    observed = data.observed + 0.02 * wave[:, None] * [0.0, 1.0, 0.0]
    found = diagnose(replace(data, observed=observed, state=replace(data.state, observed=observed)))
    assert periods(found) == []


@pytest.mark.statistical
def test_what_moves_without_a_period_is_no_cause():
    course = Unnamed("Y", ("X", "time"), (X, (0.0, 3000.0)), ((0, 2), (1, 3)), (60.0, 60.0))
    found = diagnose(data_of(course))
    assert found.unexplained
    assert not found.causes


@pytest.mark.exam
def test_a_part_of_a_swing_is_no_cause():
    """Without the noise that the swing leaves, settling of X explains a part of it."""
    found = exam.answer(exam.Key("lines", "swing", "gantry", 0, 77001), timeout=600)
    assert (found["named"], found["false"]) == (1, [])


@pytest.mark.parametrize("design", quick(["lines-once", "three-targets"], [], []))
def test_a_pad_that_gives_way_faster_and_faster_is_no_jump(design):
    """The model imitates all terms of a function that explains far more than a jump about A late in the run."""
    found = exam.answer(exam.Key(design, "floor", "cframe", 0, 82001), timeout=600)
    assert (found["named"], found["false"]) == (1, [])
