"""Times of the rows: pauses, times that stand for several rows, and whose clock it is."""

from dataclasses import replace

import numpy as np
import pytest
from calibration.diagnosis.search.linearised_fit import LinearisedFit
from calibration.diagnosis.search.shapes.change_points import breaks
from calibration.diagnosis.verdict import notes
from support.diagnosis_cases import CFRAME, data_with, framed
from support.virtual_measurements import ONE, positions

from calibration.diagnosis.library.causes import causes
from calibration.fit.calibrate import calibrate
from calibration.fit.fit import fit
from calibration.instruments import Part
from calibration.observation.full_model import BasisChoice, rigid_model
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


def test_a_jump_after_a_pause_is_the_likelier_one():
    """Its moment was not searched among all rows."""
    data = data_with(StationShift("s1", (40.0, 0.0, 0.0), since_s=600.0), n=90)
    later = 7200.0 * (data.state.time >= 600.0)
    data = at_times(data, data.state.time + later)
    model = rigid_model(data, dict.fromkeys("XYZ", BasisChoice("legendre", 3)))
    linearised = LinearisedFit.of(fit(data, model))
    shifts = [each for each in breaks(linearised) if isinstance(each.effect, StationShift)]
    assert [each.trials for each in shifts] == [90.0, 1.0]
    assert shifts[1].effect.since_s == 7800.0


def test_without_a_pause_there_is_one_moment():
    found = [each for each in breaks(framed(n=90)) if isinstance(each.effect, StationShift)]
    assert len(found) == 1


def part(time):
    rng = np.random.default_rng(2)
    q = positions(CFRAME, 120, rng)
    q[:, 2] = 100.0
    state = State(q, target=np.full(120, "1"), time=time)
    return observe(CFRAME, no_errors(CFRAME), state, Part(1.0, components=2), rng, None, ONE)


def test_the_clock_of_a_part_is_that_of_the_measuring_machine():
    """The machine tool's heat is no candidate with it; a drift of the part on the measuring machine is one."""
    found = [cause.effect for cause in causes(part(20.0 * np.arange(120)))]
    assert any(isinstance(effect, TrackerDrift) for effect in found)
    assert not [effect for effect in found if effect.kind.startswith("thermal-")]
    of_machine = [cause.effect for cause in causes(data_with())]
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
    linearised = LinearisedFit.of(fit(data, rigid_model(data, dict.fromkeys("XY", BasisChoice("legendre", 1)))))
    (note,) = notes(linearised, TrackerDrift((5.0, 0.0, 0.0)))
    assert "the machine tool has no part in it" in note
