"""Times of the rows: pauses, times that stand for several rows, and whose clock it is."""

from dataclasses import replace

import numpy as np
import pytest
from support.diagnosis_cases import CFRAME, data_with
from support.virtual_measurements import ONE, positions

from calibration.diagnosis.diagnose import diagnose
from calibration.diagnosis.library.causes import causes
from calibration.fit.calibrate import calibrate
from calibration.instruments import Part
from calibration.plausibility.checks import sanity
from calibration.plausibility.times import pauses
from calibration.simulation.simulate import observe
from kinematics.effects import StationShift, ThermalDrift, TrackerDrift
from kinematics.error_model.model import no_errors
from kinematics.state import State


def at_times(data, time):
    return replace(data, state=replace(data.state, time=np.asarray(time, float)))


def said(data):
    return [finding.message for finding in sanity(data) if finding.check == "times"]


def test_even_times_cause_no_finding():
    assert said(data_with()) == []
    assert len(pauses(data_with())) == 0


def test_a_pause_is_found_with_its_length_and_line():
    data = data_with()
    data = replace(data, lines=np.arange(10, 10 + len(data)))
    data = at_times(data, data.state.time + 5400.0 * (np.arange(len(data)) >= 40))
    assert pauses(data).tolist() == [40]
    (text,) = said(data)
    assert "paused for 90.2 min before virtual:50" in text


def test_a_slow_measurement_does_not_pause():
    """Steps of several minutes are its pace."""
    data = data_with()
    assert len(pauses(at_times(data, 400.0 * np.arange(len(data))))) == 0


@pytest.mark.parametrize(("time", "words"), [(0.0, "in all rows"), (600.0, "in steps of 600 s")])
def test_times_that_stand_for_several_rows_are_said(time, words):
    data = data_with()
    (text,) = said(at_times(data, time * (np.arange(len(data)) // 20)))
    assert words in text


def test_several_targets_of_one_stop_may_have_one_time():
    data = data_with(n=60)
    data = data.rows(np.repeat(np.arange(60), 2))
    assert said(replace(data, observed=data.observed + 1e-3 * np.arange(120)[:, None])) == []


def test_a_knock_in_a_pause_is_named_with_its_moment():
    data = data_with(StationShift("s1", (40.0, 0.0, 0.0), since_s=600.0), n=90)
    (cause,) = diagnose(at_times(data, data.state.time + 7200.0 * (data.state.time >= 600.0))).causes
    assert (cause.kind, cause.effect.since_s) == ("station-shift", 7800.0)


def part(time):
    rng = np.random.default_rng(2)
    q = positions(CFRAME, 120, rng)
    q[:, 2] = 100.0
    state = State(q, target=np.full(120, "1"), time=time)
    return observe(CFRAME, no_errors(CFRAME), state, Part(1.0, components=2), rng, None, ONE)


def test_the_clock_of_a_part_is_that_of_the_measuring_machine():
    """The machine tool's heat is no candidate with it; a drift of the part on the measuring machine is one."""
    found = causes(part(20.0 * np.arange(120)))
    assert any(isinstance(effect, TrackerDrift) for effect in found)
    assert not [effect for effect in found if effect.kind.startswith("thermal-")]
    of_machine = causes(data_with())
    assert any(isinstance(effect, ThermalDrift) for effect in of_machine)


def test_the_hint_on_a_drift_of_a_part_names_the_measuring_machine():
    data = part(20.0 * np.arange(120))
    drifting = replace(data, observed=data.observed + 2e-4 * np.arange(120)[:, None])
    (hint,) = [
        each.hint for each in calibrate(drifting, force=True, basis="legendre:1").dependences if each.variable == "time"
    ]
    assert "on the measuring machine" in hint


def test_a_drift_of_a_part_is_not_blamed_on_the_machine_tool():
    data = part(20.0 * np.arange(120))
    drifting = 2e-4 * np.arange(120)[:, None] * np.array([1.0, 0.0, 0.0])
    observed = data.observed + drifting[:, : data.observed.shape[1]]
    found = diagnose(replace(data, observed=observed, state=replace(data.state, observed=observed)), force=True)
    assert [(cause.kind, cause.where) for cause in found.causes] == [("tracker-drift", "instrument")]
