"""Measurements that could follow others: their rows, times, temperatures and moves."""

from dataclasses import replace

import numpy as np
import pytest
from support.bench import BENCH, by_interferometer, five_axes, in_motion, planned, seen, swept
from support.tiers import quick

from calibration.follow_up.design import MOST_DESIGN_ROWS
from calibration.follow_up.designs import follow_up_designs
from calibration.instruments import Part
from calibration.observation.normal_equations import residuals
from calibration.simulation.simulate import observe
from kinematics.error_model.model import no_errors
from kinematics.state import State


def names_after(data):
    """Names of the designs that may follow a measurement."""
    registration, _ = data.first_registration
    return {design.name for design in follow_up_designs(data, registration)}


MANY = np.random.default_rng(7).uniform(0.0, 450.0, (1500, 3))
CASES = {
    "standing": (lambda: seen(swept()), {"retrace", "shuffled", "cold start", "other side", "move lengths", "finer X", "bar"}),
    "five axes": (five_axes, {"retrace", "second station across the volume", "fixed references", "target below", "finer B", "bar"}),
    "in motion": (in_motion, {"retrace", "second feed", "second station across the volume", "bar"}),
    "many rows": (lambda: seen(MANY), {"retrace"}),
    "interferometer": (by_interferometer, {"retrace", "shuffled", "other side", "move lengths", "finer X"}),
}  # fmt: skip


@pytest.mark.parametrize("case", quick(CASES, ["standing", "interferometer"]))
def test_a_design_is_a_measurement_that_follows_the_data(case):
    make, expected = CASES[case]
    data = make()
    registration, _ = data.first_registration
    found = list(follow_up_designs(data, registration))
    assert expected <= {design.name for design in found}
    assert len({design.name for design in found}) == len(found)
    for design in found:
        more = design.measurement
        assert design.minutes > 0.0
        assert 0 < len(more) <= 2 * MOST_DESIGN_ROWS
        assert set(registration.names) <= set(design.registration.names)
        assert set(np.unique(more.groups)) <= {*design.registration.poses, *(g for g in design.registration.zeros)}
        missed = residuals(more, no_errors(data.machine), design.registration)
        assert np.abs(missed).max() < 1e-9
        if more.state.time is not None and not design.name.startswith("cold start"):
            assert more.state.time.min() > data.state.time.max()


def test_nothing_is_planned_after_a_part():
    part = observe(BENCH, no_errors(BENCH), State(swept()), Part(u_um=2.0), np.random.default_rng(9))
    assert not names_after(part)


def test_what_is_in_motion_is_not_asked_to_stand():
    assert not {"shuffled", "other side", "move lengths"} & names_after(in_motion())


def test_a_second_feed_changes_the_velocity_and_not_the_path():
    data = in_motion()
    more = planned(data, "second feed").measurement
    assert np.array_equal(more.state.positions, data.state.positions)
    assert more.state.velocity == pytest.approx(0.5 * data.state.velocity)
    assert np.ptp(more.state.time) == pytest.approx(2.0 * np.ptp(data.state.time))


def test_a_retrace_comes_from_where_the_machine_went():
    data = seen(swept())
    more = planned(data, "retrace").measurement
    assert np.array_equal(more.state.positions, data.state.positions[::-1])
    moved = np.diff(data.state.positions, axis=0)[::-1]
    assert np.array_equal(more.state.last_move[1:][moved != 0.0], -moved[moved != 0.0])


def test_from_cold_the_machine_warms_up_as_it_did():
    data = seen(swept())
    kelvin = 5.0 * (1.0 - np.exp(-data.state.time / 900.0))
    data = replace(data, state=replace(data.state, temperatures={"frame": kelvin}))
    for name in ("cold start", "cold start, fewer"):
        state = planned(data, name).measurement.state
        assert state.temperatures["frame"] == pytest.approx(5.0 * (1.0 - np.exp(-state.time / 900.0)), abs=0.01)
    later = planned(data, "retrace").measurement.state
    half = len(kelvin) // 2
    slope = np.polyfit(data.state.time[half:], kelvin[half:], 1)[0]
    assert np.diff(later.temperatures["frame"]) == pytest.approx(slope * np.diff(later.time))


def test_a_few_of_the_positions_take_less_time():
    data = seen(swept())
    whole, some = planned(data, "retrace"), planned(data, "retrace, fewer")
    assert "all 180 positions" in whole.does
    assert "60 of the positions" in some.does
    assert (whole.minutes, some.minutes) == pytest.approx((45.0, 15.0))
