"""Waves whose period the positions of their axis do not determine, and errors between few positions."""

from dataclasses import replace

import msgspec
import numpy as np
import pytest
from calibration.diagnosis.acceptance import against_positions
from calibration.diagnosis.residual.undetermined_periods import at_positions, undetermined
from calibration.diagnosis.search.evaluation import WORTH, evaluate
from calibration.diagnosis.search.shapes.proposed_shapes import waves_of
from calibration.diagnosis.search.start_model import Base
from support.diagnosis_cases import CFRAME, selector
from support.virtual_measurements import THREE, measured, positions

from calibration.fit.acceptance import nominal_residuals
from calibration.observation.full_model import BasisChoice, priors, rigid_model
from calibration.observation.stops_and_lines import inner_positions
from kinematics.basis import Legendre
from kinematics.effects import Cyclic, ErrorMotion
from kinematics.error_model.model import no_errors

LEVELS = np.array([3.0, 58.0, 117.0, 180.0, 239.0, 303.0, 361.0, 422.0, 487.0, 540.0, 596.0])
SLOPE = ErrorMotion("Y", "X", Legendre((0.0, 600.0), 2), (0.0, 40.0, 25.0))
WAVE = Cyclic("X", "X", 16.0, (60.0,), (20.0,))


def points(*effects, levels=None, n=90, seed=4):
    """Random positions of the C-frame, X at some levels or anywhere, its errors just these effects."""
    rng = np.random.default_rng(seed)
    q = positions(CFRAME, n, rng)
    if levels is not None:
        q[:, 0] = levels[np.arange(n) % len(levels)]
    return measured(CFRAME, q, THREE, msgspec.structs.replace(no_errors(CFRAME), effects=effects), rng)


def with_a_wave(data):
    """The fit of error motions without and with the strongest wave of X."""
    made = selector(data, 5)
    best = evaluate((bare := made.stage([])).linearised, waves_of(bare.linearised, "X", ("X",)))[0]
    return bare, made.stage([(best.candidate, best.score.size)])


def test_irregular_positions_determine_the_period_of_a_wave():
    _, stage = with_a_wave(points(SLOPE, WAVE))
    assert stage.accepted[0].candidate.effect.period == pytest.approx(16.0, abs=0.02)
    assert undetermined(stage) == []


def test_at_few_positions_waves_of_many_periods_explain_the_errors():
    bare, stage = with_a_wave(points(SLOPE, WAVE, levels=LEVELS))
    assert stage.accepted[0].score.delta_bic < WORTH
    (found,) = undetermined(stage)
    assert found.accepted is stage.accepted[0]
    assert found.periods[0] == found.effect.period
    assert len(found.periods) > 1
    dependence = at_positions(bare.linearised, found)
    assert dependence.variables == ("X",)
    assert dependence.periods == found.periods
    left, noise = bare.linearised.residual - dependence.shape.reshape(-1), bare.linearised.degrees_of_freedom
    assert left @ left - noise < 0.05 * (bare.linearised.squares - noise)


@pytest.mark.statistical
def test_of_weak_waves_at_many_positions_only_the_right_period_is_determined():
    weak = msgspec.structs.replace(WAVE, sine=(5.0,), cosine=(0.0,))
    periods, doubted = [], []
    for seed in range(8):
        bare, stage = with_a_wave(points(SLOPE, weak, seed=seed))
        periods.append(stage.accepted[0].candidate.effect.period)
        doubted += [(bare, found) for found in undetermined(stage)]
    known = set(periods) - {found.effect.period for _, found in doubted}
    assert list(known) == [pytest.approx(16.0, rel=0.01)]
    assert any(found.effect.period < 6.0 and max(found.periods) > 15.0 for _, found in doubted)
    for bare, found in doubted:
        dependence = at_positions(bare.linearised, found)
        left = bare.linearised.residual - dependence.shape.reshape(-1)
        assert 0.0 < bare.linearised.squares - left @ left == pytest.approx(found.accepted.score.squares, rel=0.3)


def test_errors_between_few_positions_must_be_predicted():
    bare, _ = with_a_wave(points(SLOPE, WAVE, levels=LEVELS))
    reason, count = against_positions(bare, nominal_residuals(bare.fit)), len(LEVELS)
    assert "held-out positions of X" in reason
    assert f"the {count} positions of X do not show the errors between them; measure at about {2 * count - 1}" in reason
    bare, _ = with_a_wave(points(SLOPE, levels=LEVELS))
    assert against_positions(bare, nominal_residuals(bare.fit)) == ""


@pytest.mark.statistical
def test_curves_that_predict_some_positions_better_by_chance_are_no_improvement():
    q = np.round(np.linspace(3.0, 596.0, 6) + np.random.default_rng(3).uniform(-12.0, 12.0, 6), 1)
    data = points(SLOPE, WAVE, levels=q)
    model = rigid_model(data, {axis: BasisChoice("b-spline", 6 if axis == "X" else 2) for axis in "XYZ"})
    curved = replace(selector(data), base=Base(model, priors(model), "refitted", curves=True)).stage([])
    assert "held-out positions of X" in against_positions(curved, nominal_residuals(curved.fit))


def test_only_positions_inside_the_range_are_held_out():
    labels = inner_positions(points(levels=LEVELS), "X")
    assert (labels[:11] < 0).tolist() == [True, *[False] * 9, True]
    assert len(np.unique(labels[1:10])) == 8
    assert inner_positions(points(), "X") is None
    assert inner_positions(points(levels=LEVELS[:4]), "X") is None
