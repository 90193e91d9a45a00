"""Never worse: a calibration is written only if it predicts held-out blocks better than the present one and than none."""

import json
import re
from dataclasses import replace

import msgspec
import numpy as np
import pytest
from support.virtual_measurements import THREE, measured, positions, truth, written

import machines
from calibration.diagnosis.diagnose import diagnose
from calibration.fit.acceptance import nominal_residuals, not_better
from calibration.fit.calibrate import NotAccepted, calibrate
from calibration.fit.cross_validation import CrossValidation, Gains
from calibration.fit.fit import fit
from kinematics.effects import StationShift, Unnamed
from kinematics.error_model.model import no_errors

MACHINE = machines.load("cframe")


def test_worse_beside_a_smaller_figure_names_the_unit():
    worse = CrossValidation(11.0, 30.0, 4, "lines", 11.1, -0.2, gains([1, -1, 2, -1], [-9, -8, -10, -9]))
    assert not_better("the new model", worse, "the old one") == (
        "the new model predicts held-out lines worse (11 um RMS) than the old one does (11.1 um), in units of the "
        "instrument's uncertainty"
    )
    assert not_better("the new model", worse._replace(rms_um=12.0), "the old one").endswith("does (11.1 um)")


def gains(um, noise=None):
    return Gains(np.array(um, float), np.array(um if noise is None else noise, float))


@pytest.mark.parametrize(
    ("um", "noise", "better", "worse"),
    [
        ([9, 8, 10, 9], None, True, False),
        ([100, 1, 2, 1, 0.5, 1, 3, 1], None, True, False),  # one block holds most of the squares
        ([100, -1, -2, -1, -1, -1, -1, -1], None, False, False),  # one block gains, all others lose
        ([1, -1, 1, -1, 1.1, -1], None, False, False),
        ([-9, -8, -10, -9], None, False, True),
        ([1, -1, 1, -1], [9, 8, 10, 9], True, False),
        ([-9, -8, -10, -9], [9, 8, 10, 9], False, False),  # better in one unit, worse in the other
        ([0, 0, 0], None, False, False),
        ([5], None, False, False),
    ],
)
def test_a_difference_counts_beyond_its_spread_over_the_blocks(um, noise, better, worse):
    assert (gains(um, noise).better, gains(um, noise).worse) == (better, worse)


def data(seed=1, size=20.0, n=120, model=None, stations=1):
    """A machine with errors of this size, um and urad, and the readings of a tracker."""
    rng = np.random.default_rng(seed)
    model = truth(MACHINE, np.random.default_rng(0), size) if model is None else model
    return model, measured(MACHINE, positions(MACHINE, n, rng), THREE, model, rng, stations=stations)


def test_a_machine_without_errors_gets_no_calibration(command, tmp_path):
    _, perfect = data(model=no_errors(MACHINE))
    with pytest.raises(NotAccepted, match=r"predicts held-out regions of stops (no better|worse)") as refused:
        calibrate(perfect, basis="b-spline:4")
    held = refused.value.found.cross_validation
    assert held.other_rms_um < held.rms_um
    file = written(perfect, tmp_path / "data.csv")
    (tmp_path / "cal.json").write_text("an older file")
    results = ("--json", "out.json", "--report", "out.html")
    done = command("fit", file, "-m", "cframe", "--basis", "b-spline:4", "-o", "cal.json", *results)
    assert done.status == 2
    page = (tmp_path / "out.html").read_text()
    assert re.search(r'class="verdict refusal">NOT WRITTEN: ', page)
    assert 'class="calibration gap"' in page  # there is none
    said = json.loads((tmp_path / "out.json").read_text())
    assert not said["accepted"]
    assert said["held_out"]["none_rms_um"] == pytest.approx(held.other_rms_um)
    assert said["held_out"]["new_rms_um"] == pytest.approx(held.rms_um)
    assert done.out.decode().startswith("NOT WRITTEN: ")
    assert (tmp_path / "cal.json").read_text() == "an older file"


def test_before_and_after_have_the_same_keys(command, tmp_path):
    file = written(data()[1], tmp_path / "data.csv")
    done = command("fit", file, "-m", "cframe", "--basis", "b-spline:4", "-o", "cal.json", "--json", "-")
    said = json.loads(done.out)
    assert said["before"].keys() == said["after"].keys() - {"p_value"}
    assert said["accepted"]
    assert said["reason"] == ""
    assert said["after"]["heldout_rms_um"] < said["before"]["heldout_rms_um"]


@pytest.mark.statistical
def test_a_confirmed_calibration_is_uncertain_by_what_no_cause_explains():
    """Beside an error that swings with Y and time its values stay, but it no longer predicts to its own uncertainty."""
    model, first = data(n=200)
    present = calibrate(first, basis="b-spline:4").model
    swing = Unnamed("Z", ("Y", "time"), ((0.0, 500.0), (0.0, 15.0 * 80)), ((1, 2), (1, 3)), (60.0, 60.0))
    moved = msgspec.structs.replace(model, effects=(*model.effects, swing))
    plain, beside = (diagnose(data(seed=5, model=each, n=80)[1], present) for each in (model, moved))
    assert plain.confirmed
    assert not [cause for cause in beside.causes if cause.where == "machine"]
    assert any("time" in each.term.variables for each in beside.unexplained)
    assert np.trace(beside.model.covariance) > np.trace(plain.model.covariance)


@pytest.mark.statistical
def test_a_calibration_of_another_machine_is_replaced_by_one_that_predicts_better():
    _, first = data(n=150)
    present = calibrate(first, basis="b-spline:4").model
    loose = msgspec.structs.replace(present, covariance=(100.0 * np.array(present.covariance)).tolist())
    other = truth(MACHINE, np.random.default_rng(7), 20.0)
    changed = diagnose(data(seed=6, model=other)[1], loose)
    assert changed.accepted
    assert not changed.confirmed
    assert changed.held_out.with_all < changed.held_out.nothing
    assert changed.model.id != loose.id


def test_instrument_effects_are_no_merit_of_the_machine_model():
    """A station that was knocked: the nominal machine is compared with the same shift fitted."""
    _, perfect = data(model=no_errors(MACHINE))
    late = perfect.state.time > 900.0
    knocked = replace(perfect, observed=perfect.observed + late[:, None] * np.array([0.05, 0.0, 0.0]))
    shift = StationShift(station="s1", since_s=900.0)
    found = fit(knocked, msgspec.structs.replace(no_errors(MACHINE), effects=(shift,)))
    assert found.chi2_reduced == pytest.approx(1.0, abs=0.2)
    assert np.sqrt(np.mean(nominal_residuals(found) ** 2)) == pytest.approx(found.rms_um * 1e-3, rel=0.02)
