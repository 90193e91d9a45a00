"""Errors judged position by position, against whole columns; tails and cores against their definitions."""

from dataclasses import replace

import numpy as np
import pytest
from calibration.diagnosis.residual.whiteness import pearson_beyond
from calibration.diagnosis.search.linearised_fit import LinearisedFit
from calibration.diagnosis.search.row_sensitivity import RowSensitivity
from calibration.diagnosis.search.shapes.sensitivity import Sensitivity
from scipy import stats
from support.diagnosis_cases import data_with, fitted, framed, with_stops

from calibration import cores
from calibration.fit.noise import with_estimated_noise
from kinematics.basis import BSpline
from kinematics.effects import Backlash, Cyclic, ErrorMotion, QuantisedCompensation, Unnamed

ZEROS = (0.0,) * 8
EFFECTS = (
    Cyclic(component="Y", axis="X", period=12.0, sine=(0.0, 0.0), cosine=(0.0, 0.0)),
    ErrorMotion("B", "Z", BSpline(tuple(np.linspace(-200.0, 0.0, 6).tolist()), 3), ZEROS, u=ZEROS),
    QuantisedCompensation(axis="Y", step=0.0, pitch=25.0, offset=3.0),
)


@pytest.fixture(scope="module")
def linearised():
    return framed(Backlash(axis="Y", width=5.0))


@pytest.mark.parametrize("effect", EFFECTS, ids=lambda effect: effect.kind)
def test_a_lever_says_what_whole_columns_say(linearised, effect):
    sensitivity = Sensitivity.of(linearised, effect.axis, getattr(effect, "component", effect.axis))
    sizes, projected = sensitivity.sizes(effect), linearised.projected(linearised.columns(effect))
    np.testing.assert_allclose(
        sensitivity.schur(sizes), projected.schur, rtol=1e-7, atol=1e-9 * np.trace(projected.schur)
    )
    here, there = sensitivity.score(sizes, 1), linearised.score(projected, 1)
    assert here.gain == pytest.approx(there.gain, rel=1e-6)
    assert here.delta_bic == pytest.approx(there.delta_bic, rel=1e-6)
    np.testing.assert_allclose(here.size, there.size, rtol=1e-5, atol=1e-9)


def test_a_lever_needs_no_spanned_columns(linearised):
    anew = replace(linearised)
    assert linearised.spanned.size
    known, found = (Sensitivity.of(each, "X", "Z").response.through for each in (linearised, anew))
    assert not anew.has_spanned
    np.testing.assert_allclose(found, known, atol=1e-9 * np.abs(known).max())


def test_gains_of_waves_are_what_the_best_sum_of_sine_and_cosine_gains(linearised):
    sensitivity = Sensitivity.of(linearised, "X", "Z")
    phase = 2 * np.pi * sensitivity.x[:, None] / np.array([7.0, 11.0, 30.0])
    sines, cosines = np.sin(phase), np.cos(phase)
    both = sensitivity.wave_gains(sines, cosines)
    for i, found in enumerate(both):
        pair = np.stack([sines[:, i], cosines[:, i]], axis=1)
        along = pair.T @ sensitivity.along
        assert found == pytest.approx(along @ np.linalg.solve(sensitivity.schur(pair), along), rel=1e-5)
    assert np.all(both >= sensitivity.gains(sines) * (1.0 - 1e-6))


def test_effects_together_are_projected_as_one_by_one(linearised):
    for together, effect in zip(linearised.responses(EFFECTS), EFFECTS, strict=True):
        alone = linearised.projected(linearised.columns(effect))
        np.testing.assert_allclose(together.schur, alone.schur, rtol=1e-9, atol=1e-9 * np.trace(alone.schur))
        np.testing.assert_allclose(together.columns, alone.columns)


@pytest.mark.parametrize("skew", [-1.5, -0.3, -1e-7, 0.0, 1e-4, 0.02, 0.8, 3.0])
@pytest.mark.parametrize("z", [-3.0, -0.4, 0.0, 1.0, 4.0])
def test_tails_against_scipy(z, skew):
    assert pearson_beyond(z, skew) == pytest.approx(float(stats.pearson3.sf(z, skew)), rel=1e-4, abs=1e-12)


def test_each_keeps_the_order_and_what_goes_wrong():
    assert cores.each(lambda i: i * i, range(50)) == [i * i for i in range(50)]
    assert cores.each(abs, []) == []
    with pytest.raises(ZeroDivisionError):
        cores.each(lambda i: 1 / i, [2, 1, 0])


def test_all_rows_of_a_state_are_the_state_itself():
    state = data_with(n=30).state
    assert state.rows(slice(None)) is state
    assert state.rows(np.arange(30)) is state
    assert state.rows(np.arange(30)[::-1]) is not state
    np.testing.assert_array_equal(state.rows(np.arange(30)[::-1]).positions, state.positions[::-1])
    assert len(state.rows(np.arange(30) > 20)) == 9


def test_the_rest_of_a_residual_without_a_block_is_that_of_a_fit_of_the_other_rows(linearised):
    """Also at positions that only the block has."""
    sensitivity = Sensitivity.of(linearised, "X", "Z")
    without = sensitivity.without_each()
    sines = np.sin(2 * np.pi * sensitivity.x[:, None] / np.array([7.0, 11.0, 30.0]))
    for number, block in enumerate(linearised.blocks):
        inside = block.rows.reshape(len(linearised.rows), -1)[:, 0]
        others = Sensitivity.of(linearised.of_rows(np.flatnonzero(~inside)), "X", "Z")
        there = np.searchsorted(sensitivity.x, others.x)
        np.testing.assert_allclose(without(number).gains(sines), others.gains(sines[there]), rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("stops", [False, True], ids=["rows", "stops"])
def test_functions_row_by_row_say_what_whole_columns_say(linearised, stops):
    """Also where the rows of a stop share its error, and some have no weight."""
    if stops:
        noisy = with_estimated_noise(fitted(with_stops(3, {0: 0.025})))
        linearised = LinearisedFit.of(fitted(noisy))
        assert linearised.decorrelation.stops
    rows = np.arange(len(linearised.rows))
    effect = Unnamed("Z", ("X",), ((-200.0, 200.0),), ((0,), (1,), (4,)), (0.0,) * 3)
    tool = RowSensitivity.of_tool(linearised, "Z")
    assert tool.columns(tool.values(effect)) == pytest.approx(linearised.columns(effect), abs=1e-9)
    for values in (tool.values(effect), 0.01 * np.cos(rows[:, None] / np.array([3.0, 8.0, 50.0]))):
        columns = tool.columns(values)
        schur, along = tool.parts(values)
        expected = linearised.projected(columns).schur
        np.testing.assert_allclose(schur, expected, rtol=1e-7, atol=1e-9 * np.trace(expected))
        np.testing.assert_allclose(along, columns.T @ linearised.residual, rtol=1e-7, atol=1e-7)
