"""The frame that candidates are judged in, against full fits of the same data."""

from dataclasses import replace

import msgspec
import numpy as np
import pytest
from calibration.diagnosis.improvement import figures, held_out_rows
from calibration.diagnosis.library.candidate import at_zero
from calibration.diagnosis.search.held_out import LIKELY
from calibration.diagnosis.search.linearised_fit import LinearisedFit
from calibration.diagnosis.search.score import GENEROUS
from calibration.diagnosis.search.shapes.proposed_shapes import waves
from support.diagnosis_cases import LEGENDRE, data_with, fitted, selector

from calibration.fit.fit import fit
from calibration.observation.correlation import correlation_length, lines_of
from calibration.observation.full_model import priors, rigid_model
from calibration.observation.normal_equations import residuals
from calibration.observation.stops_and_lines import held_out_blocks
from kinematics.effects import (
    AirScale,
    Backlash,
    DriftWithSensor,
    ErrorMotion,
    GrowthWithTime,
    LocationError,
    RangeOffset,
    StationShift,
    TargetOffset,
    ThermalDrift,
)

BACKLASH = Backlash("X", 12.0)
GROWTH = GrowthWithTime(axis="Y", rate=30.0)
DRIFT = ThermalDrift(component="Z", rate=20.0)
CANDIDATES = [
    at_zero(effect)
    for effect in (
        BACKLASH,
        Backlash("Z", 1.0),
        DRIFT,
        GROWTH,
        ThermalDrift(component="A", amplitudes=(1.0,), time_constants_s=(600.0,)),
        TargetOffset(target="2", offset_um=(0.0, 0.0, 0.0)),
    )
]


def objective(found):
    return found.chi2 + float(found.away @ found.away)


@pytest.fixture(scope="module")
def plain():
    """Data with backlash, growth and drift, fitted by a model without."""
    return fitted(data_with(BACKLASH, GROWTH, DRIFT))


@pytest.mark.parametrize("effect", CANDIDATES[:4], ids=lambda effect: effect.name)
def test_a_gain_is_the_fall_of_the_objective_in_a_full_fit(effect):
    """All rows at their whole weight: the noise is stated so large that none is weighted down."""
    data = data_with(Backlash("X", 4.0), ThermalDrift(component="Z", rate=6.0))
    data = replace(data, instrument=msgspec.structs.replace(data.instrument, u_range_um_per_m=2.0, u_angle_um=12.0))
    without, along = fitted(data), fitted(data, effect)
    assert without.kept.all()
    assert along.kept.all()
    linearised = LinearisedFit.of(without)
    assert linearised.weights.min() == 1.0
    projected = linearised.projected(linearised.columns(effect))
    along_it = projected.columns.T @ linearised.residual
    gain = float(along_it @ np.linalg.solve(projected.schur + GENEROUS**-2 * np.eye(len(projected.schur)), along_it))
    assert gain == pytest.approx(objective(without) - objective(along), rel=0.01, abs=1e-3)


def test_without_an_effect_is_the_fit_without_it(plain):
    linearised = LinearisedFit.of(fitted(plain.measurement, *map(at_zero, (BACKLASH, GROWTH, DRIFT))))
    assert linearised.weights.min() > 0.5
    count = len(linearised.fit.model.effects)
    for i, effect in enumerate((BACKLASH, GROWTH, DRIFT)):
        others = [at_zero(other) for other in (BACKLASH, GROWTH, DRIFT) if other is not effect]
        full = LinearisedFit.of(fitted(plain.measurement, *others))
        first_order = linearised.without(count - 3 + i)
        # the rows that the missing cause makes stand out have less weight in the full fit
        same = np.repeat(full.weights == 1.0, 3) & np.repeat(linearised.weights == 1.0, 3)
        assert same.mean() > 0.5
        misses = first_order.residual[same] - full.residual[same]
        assert np.sqrt(np.mean(misses**2)) < 0.1 * np.sqrt(np.mean(full.residual[same] ** 2))


def test_held_out_residuals_are_those_of_fits_by_blocks():
    found = fitted(data_with())
    linearised = LinearisedFit.of(found)
    assert linearised.weights.min() == pytest.approx(1.0, abs=0.6)
    labels, _ = held_out_blocks(found.measurement)
    told = linearised.cross_validation
    for label in np.unique(labels):
        inside = labels == label
        others = found.measurement.rows(np.flatnonzero(~inside))
        again = fit(others, rigid_model(found.measurement, LEGENDRE))
        missed = residuals(found.measurement, again.model, again.registration)[inside] * 1e3
        assert np.sqrt(np.mean((told.residual_um[inside] - missed) ** 2)) < 0.05 * np.sqrt(np.mean(missed**2))


def test_held_gains_are_those_of_fits_by_blocks():
    data = data_with(Backlash("X", 4.0), ThermalDrift(component="Z", rate=6.0))
    data = replace(data, instrument=msgspec.structs.replace(data.instrument, u_range_um_per_m=2.0, u_angle_um=12.0))
    linearised = LinearisedFit.of(fitted(data))
    labels, _ = held_out_blocks(data)
    base = rigid_model(data, LEGENDRE)

    def missed(effects, largest=0.0):
        model = msgspec.structs.replace(base, effects=(*base.effects, *effects))
        own = [largest * quantity.typical for each in effects for quantity in each.parameter_table]
        for label in np.unique(labels):
            inside = labels == label
            again = fit(data.rows(np.flatnonzero(~inside)), model, prior=np.concatenate([priors(base), own]))
            left = residuals(data, again.model, again.registration)[inside]
            yield float(np.sum((linearised.white[inside] @ left[:, :, None]) ** 2))

    bare = np.array(list(missed(())))
    for effect in (CANDIDATES[0], CANDIDATES[2]):
        size = linearised.score(linearised.candidate(effect)).size
        largest = max(LIKELY * np.sqrt(np.mean(size**2)), 1 / GENEROUS)
        full = bare - np.array(list(missed((effect,), largest)))
        gains = linearised.held_out_gains(linearised.candidate(effect))
        assert gains == pytest.approx(full, abs=0.05 * np.abs(full).max())


def test_what_the_registration_or_the_model_absorbs_is_not_visible(plain):
    linearised = LinearisedFit.of(plain)
    interval = next(e.basis for e in plain.model.effects if isinstance(e, ErrorMotion) and e.axis == "X")
    line = ErrorMotion("X", "X", interval, (0.0,) * interval.size, u=(0.0,) * interval.size)
    absorbed = [StationShift(station="s1"), LocationError("C", "Y", 0.0), line]
    for effect in absorbed:
        assert linearised.candidate(effect).visible < 0.12, effect.name  # what the prior leaves
    exact = LinearisedFit.of(replace(plain, prior=np.full(len(plain.prior), np.inf)))
    for effect in absorbed:
        assert exact.candidate(effect).visible < 1e-3, effect.name
    for effect in (RangeOffset(0.0), AirScale(0.0)):
        assert linearised.candidate(effect).visible < 0.2
    assert linearised.candidate(BACKLASH).visible > 0.6  # half of it is that of the positions, at random ones


@pytest.mark.parametrize("late", [3e4, 1e6, 1e9])
def test_visibility_does_not_depend_on_when_the_clock_began(plain, late):
    state = plain.measurement.state
    here = LinearisedFit.of(plain)
    data = replace(plain.measurement, state=replace(state, time=state.time + late))
    there = replace(here, fit=replace(plain, measurement=data))
    for effect in (ThermalDrift(component="Z", rate=0.0), GrowthWithTime(axis="X", rate=0.0)):
        assert there.candidate(effect).visible == pytest.approx(here.candidate(effect).visible, rel=0.02)


def test_visibility_does_not_depend_on_how_warm_it_was(plain):
    seen = []
    for degrees in (0.0, 40.0, 300.0):
        kelvin = degrees + np.linspace(0.0, 3.0, len(plain.measurement))
        state = replace(plain.measurement.state, temperatures={"spindle": kelvin})
        linearised = LinearisedFit.of(replace(plain, measurement=replace(plain.measurement, state=state)))
        seen.append(linearised.candidate(DriftWithSensor(component="Z", sensor="spindle", coefficient=0.0)).visible)
    assert seen[0] > 0.5
    assert seen == pytest.approx([seen[0]] * 3, rel=0.02)


@pytest.mark.parametrize("distance", [4.0, 1e6])
def test_a_row_that_is_far_out_changes_next_to_nothing(plain, distance):
    """One point 1 km away, or 4 mm, and what candidates bring stays what it was."""
    frames = []
    for away in (0.0, distance):
        observed = plain.measurement.observed.copy()
        observed[17] += [away, 0.0, 0.0]
        state = replace(plain.measurement.state, observed=observed)
        frames.append(LinearisedFit.of(fitted(replace(plain.measurement, observed=observed, state=state))))
    whole, spoilt = frames
    assert not spoilt.fit.kept[17]
    for effect in CANDIDATES[:4]:
        before, after = (linearised.score(linearised.candidate(effect)) for linearised in frames)
        assert after.gain == pytest.approx(before.gain, rel=0.15, abs=3.0)
    assert spoilt.squares == pytest.approx(whole.squares, rel=0.1)


def test_scores_of_pure_noise_are_worth_nothing():
    linearised = LinearisedFit.of(fitted(data_with(seed=8)))
    for effect in CANDIDATES:
        score = linearised.score(linearised.candidate(effect))
        assert score.delta_bic > -6.0
        assert 0.0 <= score.p_value <= 1.0
    for wave in waves(linearised, ("X",)):
        score = linearised.score(linearised.candidate(wave.effect), wave.shapes, wave.trials)
        assert score.p_value > 1e-3  # over all frequencies that were tried


def test_some_rows_judge_as_all_do_but_less_surely():
    effect = Backlash("X", 12.0)
    linearised = LinearisedFit.of(fitted(data_with(effect)))
    some = linearised.thinned(len(linearised.rows) // 2)
    assert len(some.rows) == len(some.weights) == len(linearised.rows) // 2
    candidate = Backlash("X", 0.0)
    whole, part = (each.score(each.candidate(candidate)) for each in (linearised, some))
    u = float(some.candidate(candidate).schur[0, 0]) ** -0.5
    assert part.size == pytest.approx(whole.size, abs=3 * u)
    assert part.gain < whole.gain


@pytest.mark.parametrize("rho", [0.0, 0.6, 0.95])
def test_the_correlation_length_is_that_of_an_autoregressive_process(rho):
    rng = np.random.default_rng(2)
    drawn = rng.standard_normal((4000, 3))
    for row in range(1, len(drawn)):
        drawn[row] = rho * drawn[row - 1] + np.sqrt(1.0 - rho**2) * drawn[row]
    assert correlation_length(drawn) == pytest.approx((1.0 + rho) / (1.0 - rho), rel=0.15)


def test_an_odd_function_of_single_rows_has_the_length_of_noise():
    assert correlation_length(np.zeros((50, 3))) == 1.0
    assert correlation_length((-1.0) ** np.arange(50)[:, None]) == 1.0
    assert correlation_length(np.ones((2, 3))) == 1.0


def test_lines_along_a_signal_have_no_sign():
    """Residuals that are correlated along a wave count as such, although the wave changes its sign."""
    wave = np.sin(np.arange(60.0))[:, None] * np.array([[3.0, 4.0]])
    assert np.abs(lines_of(wave)[1:]) == pytest.approx(np.tile([0.6, 0.8], (59, 1)))
    assert np.ptp(lines_of(wave)[1:], axis=0) == pytest.approx(0.0, abs=1e-12)


def test_held_out_residuals_of_two_fits_are_of_the_rows_that_both_predict():
    """In a long measurement each fit is evaluated at some of the rows, which differ."""
    stage = selector(data_with(n=120)).bare
    half = stage._replace(linearised=stage.linearised.of_rows(np.arange(60)))
    kept, both = np.ones(120, bool), held_out_rows(stage) & held_out_rows(half)
    assert both[:60].any()
    assert not both[60:].any()
    held = stage.linearised.cross_validation.residual_um[both]
    assert figures(stage, kept, both).heldout_rms_um == pytest.approx(np.sqrt(np.mean(held**2)))
    assert figures(stage, kept, both).rms_um == figures(stage, kept, kept).rms_um
