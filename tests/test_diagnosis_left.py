"""Errors without a name: they are no causes, and hide none."""

from dataclasses import replace

import msgspec
import numpy as np
import pytest
from shop_floor.question import ask
from support.diagnosis_cases import CFRAME, data_with
from support.tiers import EXAM, STATISTICAL, quick
from support.virtual_measurements import THREE, measured

import machines
from calibration.diagnosis.conclusion.result import Diagnosis
from calibration.diagnosis.diagnose import diagnose
from calibration.measurement.file import read_measurement
from calibration.measurement.measurement import Measurement
from kinematics.effects import (
    Backlash,
    Cyclic,
    Effect,
    GrowthWithSensor,
    LocationJump,
    StationShift,
    ThermalDrift,
    Unnamed,
)
from kinematics.error_model.model import no_errors

N = 240
X, SPAN = CFRAME.axes[CFRAME.index("X")].travel, (0.0, 15.0 * N)


def nameless(component: str, size: float) -> Unnamed:
    """A smooth function of X and time in one direction of the tool, um."""
    terms = tuple((i, j) for i in range(4) for j in range(1, 7))
    sizes = size * np.random.default_rng(0).normal(size=len(terms))
    return Unnamed(component, ("X", "time"), (X, SPAN), terms, tuple(sizes.tolist()))


def moved(data: Measurement, course: np.ndarray) -> Measurement:
    """The measurement with its readings shifted by a course `(n, 3)`, mm."""
    observed = data.observed + course
    return replace(data, observed=observed, state=replace(data.state, observed=observed))


def variables(found: Diagnosis) -> list[set[str]]:
    """Variables of each function without a name."""
    return [set(each.term.variables) for each in found.unexplained]


@pytest.mark.parametrize("seed", quick([3, 4, 5], [4], [3]))
def test_no_cause_is_blamed_for_a_function_without_a_name(seed):
    found = diagnose(data_with(nameless("Y", 3.0), n=N, seed=seed))
    assert not found.causes
    assert {"X", "time"} in variables(found)


def test_the_mean_of_what_has_no_name_is_no_drift():
    """A drift that is the mean over an axis of a larger error without a name."""
    strange = Unnamed("Z", ("X", "time"), (X, SPAN), ((0, 1), (1, 1), (2, 1), (3, 1)), (23.0, 40.0, 40.0, 40.0))
    found = diagnose(data_with(strange, n=N))
    assert not found.causes
    assert variables(found) == [{"X", "time"}]


@pytest.mark.statistical
@pytest.mark.parametrize("effect", [Cyclic("X", "X", 10.0, (12.0,), (9.0,)), Backlash("X", 25.0)])
def test_a_cause_beside_a_function_without_a_name_is_named(effect):
    found = diagnose(data_with(nameless("Y", 2.0), effect, n=N))
    (cause,) = found.causes
    assert (cause.kind, cause.axis) == (effect.kind, "X")
    assert cause.effect.parameters[0] == pytest.approx(effect.parameters[0], rel=0.15)
    assert {"X", "time"} in variables(found)


@pytest.mark.parametrize(("n", "um"), quick([(80, 12.0), (240, 6.0)], [(80, 12.0)]))
def test_a_walk_is_no_cause_and_depends_on_the_time(n, um):
    """From 80 rows an evidence of bases alone would choose a parameter for nearly every observation."""
    steps = np.random.default_rng(1).normal(scale=1e-3 * um, size=(n, 3))
    found = diagnose(moved(data_with(n=n, seed=1), np.cumsum(steps, axis=0)))
    assert not found.causes
    assert found.unexplained
    assert all("time" in each for each in variables(found))


@pytest.mark.statistical
def test_a_knock_is_no_walk():
    data = data_with(n=N)
    found = diagnose(moved(data, 0.06 * (np.arange(N)[:, None] >= N // 2) * np.ones(3)))
    (knock,) = found.causes
    assert isinstance(knock.effect, StationShift)
    assert knock.effect.since_s == pytest.approx(data.state.time[N // 2], abs=45.0)
    assert not found.unexplained


@pytest.mark.statistical
def test_a_jump_beside_a_small_wandering_is_named():
    """The wandering makes neighbours alike, so that they count as few; the jump is hundreds of times as large."""
    rng, (x, y, z) = (
        np.random.default_rng(3),
        (np.linspace(*axis.travel, n) for axis, n in zip(CFRAME.axes, (5, 24, 4), strict=True)),
    )
    q = np.array([(a, b, c) for c in z for i, a in enumerate(x) for b in (y if i % 2 else y[::-1])])
    jump = LocationJump("C", "Y", 3000.0, 15.0 * 0.55 * len(q))
    data = measured(CFRAME, q, THREE, msgspec.structs.replace(no_errors(CFRAME), effects=(jump,)), rng)
    found = diagnose(moved(data, np.cumsum(rng.normal(scale=0.004, size=(len(q), 3)), axis=0)))
    (cause,) = found.causes
    assert (cause.effect.name, cause.verdict) == (jump.name, "strong")
    assert cause.effect.parameters[0] == pytest.approx(3000.0, rel=0.02)


def test_a_wave_in_time_is_not_a_drift_and_a_jump_back():
    sizes = (3.0, -9.0, 8.0, 6.0, -9.0, 5.0)
    found = diagnose(data_with(Unnamed("X", ("time",), (SPAN,), tuple((k,) for k in range(1, 7)), sizes), n=N))
    assert not found.causes
    assert variables(found) == [{"time"}]


@pytest.mark.statistical
@pytest.mark.xfail(
    strict=True,
    reason="what the model cannot do: two causes are together likelier than a walk (by 9 in the log posterior), but "
    "either alone is not, and no move leads from one term without a name to two causes",
)
def test_a_drift_and_a_jump_back_are_not_a_walk():
    found = diagnose(data_with(ThermalDrift("X", rate=120.0), LocationJump("X", "X", -40.0, 700.0), n=N))
    assert {cause.kind for cause in found.causes} == {"thermal-drift", "location-jump"}


def test_a_growth_with_temperature_in_data_without_times_is_no_walk():
    warm = GrowthWithSensor(axis="X", sensor="scale", coefficient=11.5)
    data = data_with(warm, n=N, temperatures={"scale": np.linspace(0.0, 6.0, N)})
    found = diagnose(replace(data, state=replace(data.state, time=None)))
    (cause,) = found.causes
    assert cause.effect.name == warm.name
    assert not found.unexplained


def jumped(*effects: Effect) -> Diagnosis:
    return diagnose(data_with(*effects, n=120))


MOMENT = 15.0 * 60


@pytest.mark.statistical
@pytest.mark.parametrize(
    ("hidden", "kind"),
    [
        ((StationShift("s1", (15.0, -12.0, 0.0), (15.0, 10.0, -10.0), MOMENT),), "station-shift"),
        ((LocationJump("X", "X", 15.0, MOMENT), LocationJump("C", "Y", 90.0, MOMENT)), "location-jump"),
    ],
)
def test_jumps_at_one_moment_are_a_knock_only_where_one_explains_them(hidden, kind):
    assert {cause.kind for cause in jumped(*hidden).causes} == {kind}


@pytest.mark.statistical
@pytest.mark.parametrize("windup", [None, 400.0])
def test_a_backlash_is_wound_up_only_where_the_data_show_it(windup):
    (cause,) = jumped(Backlash("X", 200.0, windup)).causes
    width, *length = cause.effect.parameters
    assert width == pytest.approx(200.0, rel=0.1)
    assert length == ([] if windup is None else [pytest.approx(windup, rel=0.2)])


@pytest.mark.parametrize(
    ("question", "kinds", "variables"),
    [
        # a pad that gives way under Y, by a single target: the fit imitates most of each term of the function
        pytest.param(("one-target", "floor", "cframe", 1, 71001), set(), {"Y", "time"}, marks=STATISTICAL),
        # a guide that holds and lets go at positions that depend on another axis: it has no period
        pytest.param(("lines", "stick-slip", "gantry", 0, 73001), set(), {"Y"}, marks=EXAM),
        # stops that shift by 3 um look like a function of time and positions, and of the tracker's readings
        pytest.param(("bad-repeat", "two", "cframe", 1, 72001), {"station-shift", "cross-axis"}, set(), marks=EXAM),
        # the pad beside such stops: a jump imitates it
        pytest.param(("bad-repeat", "floor", "cframe", 0, 75001), set(), {"Y", "time"}, marks=EXAM),
    ],
    ids=lambda value: "-".join(map(str, value)) if isinstance(value, tuple) else "",
)
def test_causes_are_neither_blamed_for_a_nameless_error_nor_hidden_by_noise(tmp_path, question, kinds, variables):
    (tmp_path / "data.csv").write_text(ask(*question).sheet())
    found = diagnose(read_measurement(tmp_path / "data.csv", machines.load(question[2])))
    assert {each.kind for each in found.causes} == kinds
    assert bool(found.unexplained) == bool(variables)
    assert all(variables <= set(each.term.variables) for each in found.unexplained)
    assert found.held_out.with_all <= found.held_out.geometry
