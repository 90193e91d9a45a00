"""Causes of one axis that another axis modulates: they imitate an error of both."""

import numpy as np
import pytest
from calibration.diagnosis.acceptance import against_learned
from calibration.diagnosis.residual.modulation import modulated, modulation
from calibration.diagnosis.residual.unexplained import in_lengths
from calibration.diagnosis.search.evaluation import WORTH, evaluate
from calibration.diagnosis.search.shapes.proposed_shapes import waves_of
from calibration.diagnosis.widening import UnseenErrors
from shop_floor.causes import Pitch
from shop_floor.outside_causes import StickSlip
from shop_floor.question import ask
from support.diagnosis_cases import selector

import machines
from calibration.measurement.file import read_measurement


def stage_with_a_wave(effect, folder):
    """The fit that has the strongest wave of Y besides error motions."""
    (folder / "data.csv").write_text(ask("random3", "none", "cframe", 0, 210001).having(effect).sheet())
    made = selector(read_measurement(folder / "data.csv", machines.load("cframe")), 7)
    best = evaluate(bare := made.stage([]).linearised, waves_of(bare, "Y", ("Y",)))[0]
    return made, made.stage([(best.candidate, best.score.size)])


def test_a_wave_of_a_screw_is_the_same_everywhere(tmp_path):
    _, stage = stage_with_a_wave(Pitch(10.0, axis="Y", period_mm=12.0), tmp_path)
    assert stage.accepted[0].score.delta_bic < WORTH
    assert modulated(stage) == []


def test_a_wave_whose_phase_depends_on_another_axis_is_an_error_of_both(tmp_path):
    made, stage = stage_with_a_wave(StickSlip(8.0, axis="Y", other="X", teeth=9.0, turns=0.5), tmp_path)
    assert stage.accepted[0].score.delta_bic < WORTH
    (found,) = modulated(stage)
    assert found.accepted is stage.accepted[0]
    assert found.axis == "X"
    linearised = made.stage([]).linearised
    dependence = modulation(linearised, found)
    assert dependence.variables == ("Y", "X")
    residual = linearised.in_lengths(linearised.residual)
    assert np.mean((residual - in_lengths(linearised, dependence)) ** 2) < 0.8 * np.mean(residual**2)


@pytest.mark.parametrize(("uncertain", "accepted"), [(10.0, True), (60.0, False)])
def test_an_improvement_must_exceed_the_uncertainty_of_an_unknown_error(uncertain, accepted):
    squares, without = np.array([40.0**2 + uncertain**2, 0.0, 0.0]), np.array([56.0**2, 0.0, 0.0])
    errors = UnseenErrors(squares, without, 40.0, 56.0, uncertain, recurs=True)
    assert (against_learned(errors) == "") == accepted
