"""The noise of the instrument from repeats, against its sheet."""

from dataclasses import replace

import msgspec
import numpy as np
import pytest
from calibration.diagnosis.repeatability import repeats
from support.virtual_measurements import ONE, THREE, TRACKER, measured, positions, truth

import machines
from calibration.instruments import Interferometer, LaserTracker
from calibration.measurement.measurement import with_moves
from calibration.simulation.simulate import observe
from kinematics.effects import Backlash
from kinematics.error_model.model import no_errors
from kinematics.state import State

GANTRY = machines.load("gantry")
STRETCHED = LaserTracker(u_range_um_per_m=1.0, u_angle_um=3.0, u_angle_um_per_m=3.0)


def tracked(times=3, n=60, seed=1, tracker=TRACKER, targets=ONE, together=True):
    """Every place `times` times, one after the other or in rounds, each from the same side."""
    rng = np.random.default_rng(seed)
    q = positions(GANTRY, n, rng)
    index = np.repeat(np.arange(n), times) if together else np.tile(np.arange(n), times)
    m = measured(GANTRY, q[index], targets, truth(GANTRY, rng), rng, tracker=tracker)
    side = np.ones(q[index].shape)
    return replace(m, state=replace(m.state, approach=side))


def everything(m):
    return np.ones(len(m), bool)


def test_noise_of_the_sheet_is_found():
    found = repeats(tracked(times=5), everything(tracked(times=5)))
    assert found is not None
    assert (found.states, found.degrees_of_freedom, found.apart) == (60, 60 * 4 * 3, False)
    assert abs(found.factor - 1.0) < 4 * np.sqrt(2 / found.degrees_of_freedom)
    assert found.p_value > 1e-3
    assert [c.name for c in found.components] == ["range", "azimuth", "elevation"]
    for component in found.components:
        assert component.unit == "um"
        assert component.noise == pytest.approx(component.specified, rel=0.15)
    assert found.text.startswith("from 60 positions measured again, soon after one another: range ")


def test_p_value_is_uniform_where_the_sheet_holds():
    p = [repeats(m, everything(m)).p_value for m in (tracked(n=12, seed=seed) for seed in range(60))]
    assert 0.25 < np.mean(np.array(p) < 0.5) < 0.75
    assert np.mean(np.array(p) < 0.05) < 0.2


def test_a_sheet_that_promises_too_much_in_range():
    """Noise in range twice what the sheet says: found there, and there alone."""
    m = tracked(times=5, tracker=STRETCHED)
    found = repeats(replace(m, instrument=TRACKER), everything(m))
    by_name = {c.name: c.noise / c.specified for c in found.components}
    assert by_name["range"] == pytest.approx(2.0, rel=0.15)
    assert by_name["azimuth"] == pytest.approx(1.0, rel=0.15)
    assert by_name["elevation"] == pytest.approx(1.0, rel=0.15)
    assert found.p_value < 1e-6
    assert found.factor == pytest.approx(2.0, rel=0.15)


def test_drift_between_rounds_is_not_noise():
    """Two rounds with 0.2 mm between them; where each place is seen twice in a round, only that counts."""
    for twice in (False, True):
        rng, n = np.random.default_rng(1), 40
        q = np.tile(np.repeat(positions(GANTRY, n, rng), 2 if twice else 1, axis=0), (2, 1))
        m = measured(GANTRY, q, ONE, no_errors(GANTRY), rng)
        m = replace(m, state=replace(m.state, approach=np.ones(q.shape)))
        later = (np.arange(len(m)) >= len(m) // 2)[:, None]
        found = repeats(replace(m, observed=m.observed + 0.2 * later), everything(m))
        assert found.states == n
        assert found.apart == (not twice)
        if twice:
            assert found.degrees_of_freedom == 2 * n * 3
            assert found.factor == pytest.approx(1.0, abs=5 * np.sqrt(2 / found.degrees_of_freedom))
        else:
            assert found.factor > 10
            assert "far apart in time, with all drifts in them" in found.text


def test_rows_that_are_not_kept_and_other_targets_do_not_count():
    m = tracked(times=2, n=20, targets=THREE)
    same = m.state.target[::2] == m.state.target[1::2]
    found = repeats(m, everything(m))
    assert found.states == same.sum()
    kept = np.tile([True, False], 20)
    assert repeats(m, kept) is None
    assert repeats(m, ~everything(m)) is None


def test_two_ways_of_approach_are_two_places():
    m = tracked(times=2, n=20)
    approach = m.state.approach.copy()
    approach[::2] *= -1
    assert repeats(replace(m, state=replace(m.state, approach=approach)), everything(m)) is None


def test_random_positions_have_no_repeats():
    rng = np.random.default_rng(0)
    m = measured(GANTRY, positions(GANTRY, 50, rng), ONE, no_errors(GANTRY), rng)
    assert repeats(m, everything(m)) is None


@pytest.mark.parametrize("scale", [1.0, 3.0])
def test_an_interferometer_whose_runs_have_zeros(scale):
    """Zeros of runs, drawn anew, are no noise; degrees of freedom are counted with them."""
    rng, runs, there = np.random.default_rng(7), 6, np.linspace(0.0, 2000.0, 21)
    x = np.tile(np.concatenate([there, there[::-1]]), runs)
    q = np.zeros((len(x), 3))
    q[:, GANTRY.index("X")] = x
    approach = np.zeros(q.shape)
    approach[:, GANTRY.index("X")] = np.tile(np.repeat([1.0, -1.0], 21), runs)
    run = np.repeat(np.arange(runs), 42)
    model = msgspec.structs.replace(no_errors(GANTRY), effects=(Backlash("X", 12.0),))
    m = observe(
        GANTRY, model, with_moves(State(q), approach), Interferometer(u_um=0.5), rng,
        axis=np.full(len(x), "X"), run=run.astype(str), noise_scale=scale,
    )  # fmt: skip
    m = replace(m, observed=m.observed + rng.normal(0.0, 0.01, runs)[run, None])
    found = repeats(m, everything(m))
    assert found.apart
    assert (found.states, found.degrees_of_freedom) == (42, 42 * runs - 42 - (runs - 1))
    assert found.factor == pytest.approx(scale**2, rel=5 * np.sqrt(2 / found.degrees_of_freedom))
    assert (found.p_value > 1e-3) == (scale == 1.0)
    (component,) = found.components
    assert (component.name, component.unit, component.specified) == ("deviation", "um", pytest.approx(0.5))
    assert component.noise == pytest.approx(0.5 * scale, rel=0.2)
