"""Waves whose period the positions of their axis do not determine, and errors between few positions."""

import msgspec
import numpy as np
import pytest
from support.diagnosis_cases import CFRAME
from support.tiers import quick
from support.virtual_measurements import THREE, measured, positions

from calibration.diagnosis.diagnose import diagnose
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


def test_irregular_positions_determine_the_period_of_a_wave():
    (cause,) = diagnose(points(SLOPE, WAVE)).causes
    assert (cause.kind, cause.axis) == ("cyclic", "X")
    assert cause.effect.period == pytest.approx(16.0, abs=0.02)


@pytest.mark.parametrize("period", quick([9.3, 16.0, 23.7, 41.0], [], [9.3, 16.0]))
def test_at_few_positions_a_wave_has_its_own_period_or_no_name(period):
    """Waves of many periods go through the errors at eleven positions."""
    wave = msgspec.structs.replace(WAVE, period=period)
    found = diagnose(points(SLOPE, wave, levels=LEVELS))
    named = [cause.effect for cause in found.causes]
    assert all(isinstance(effect, Cyclic) for effect in named)
    assert [effect.period for effect in named] == pytest.approx([period] * len(named), rel=0.01)


@pytest.mark.statistical
def test_a_period_that_is_named_is_the_right_one():
    """Of weak waves."""
    weak = msgspec.structs.replace(WAVE, sine=(5.0,), cosine=(0.0,))
    found = [diagnose(points(SLOPE, weak, seed=seed)).causes for seed in range(8)]
    assert [cause.kind for causes in found for cause in causes] == ["cyclic"] * sum(map(len, found))
    assert [cause.effect.period for (cause,) in filter(None, found)] == pytest.approx(
        [16.0] * sum(map(len, found)), rel=0.01
    )
