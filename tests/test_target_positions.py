"""Positions of targets on the tool: unknown ones are fitted, and wrong ones are said and do not enter the errors."""

from dataclasses import replace

import numpy as np
import pytest
from support.virtual_measurements import ONE, THREE, measured, positions, truth, written

import machines
from calibration.diagnosis.diagnose import diagnose
from calibration.fit.calibrate import calibrate
from calibration.fit.set_up.target_positions import at_positions, findings, target_positions
from calibration.measurement.file import read_measurement
from calibration.measurement.joining import joined
from calibration.measurement.measurement import Target
from calibration.single_axis.three_points import identify
from kinematics.user_error import UserError

CFRAME = machines.load("cframe")
TWO = {name: THREE[name] for name in "12"}


def data(targets=THREE, n=150, seed=4, stated=None):
    """What a tracker sees of a C-frame with random errors; the file states other positions for some targets."""
    rng = np.random.default_rng(seed)
    found = measured(CFRAME, positions(CFRAME, n, rng), targets, truth(CFRAME, rng), rng)
    return replace(found, targets={**targets, **(stated or {})})


def moved(name, *offset):
    """The target of that name, stated at another position."""
    x, y, z = np.array(THREE[name].position) + offset
    return {name: Target((float(x), float(y), float(z)))}


@pytest.mark.parametrize("seed", range(4))
def test_right_positions_stay_as_they_are(seed):
    assert target_positions(data(seed=seed)) == []


@pytest.mark.parametrize("offset", [(-1.0, 0.02, 0.0), (0.0, 0.0, 0.3), (0.02, -0.02, 0.03)])
def test_a_wrong_position_is_found_by_name_and_size(offset):
    (found,) = target_positions(data(stated=moved("2", *offset)))
    assert found.name == "2"
    assert not found.others
    assert found.offset == pytest.approx(-np.array(offset), abs=0.012)
    assert np.all(np.abs(found.offset + offset) < 4.0 * found.u)
    assert "target 2: its position on the tool differs by (" in found.text


def test_two_wrong_positions_of_three_are_found():
    found = target_positions(data(stated={**moved("2", 0.5, 0.0, 0.0), **moved("3", 0.0, -0.4, 0.2)}))
    assert {each.name for each in found} == {"2", "3"}


def test_with_two_targets_the_data_do_not_show_which_is_wrong():
    (found,) = target_positions(data(TWO, stated=moved("1", 0.5, 0.0, 0.0)))
    assert {found.name, *found.others} == {"1", "2"}
    assert "these data do not show which" in found.text
    assert np.linalg.norm(found.offset) == pytest.approx(0.5, abs=0.02)


def test_a_target_measured_in_one_go_may_be_a_moved_instrument():
    whole = data(TWO, stated=moved("2", 0.2, 0.0, 0.0))
    order = np.argsort(whole.target_number, kind="stable")
    (found,) = target_positions(whole.rows(order))
    assert "or the instrument moved" in found.text


def test_the_fit_uses_the_positions_of_the_data():
    """A position that is 0.3 mm off does not enter the errors of the machine."""
    right, wrong = (
        calibrate(data(stated=stated), basis="legendre:4", hold_out=False)
        for stated in ({}, moved("3", 0.3, -0.2, 0.1))
    )
    assert wrong.fit.chi2_reduced == pytest.approx(right.fit.chi2_reduced, rel=0.05)
    difference = np.subtract(wrong.model.parameters, right.model.parameters)
    assert np.all(np.abs(difference) < 4.0 * np.sqrt(np.diag(wrong.model.covariance)) + 1e-9)
    assert [finding.check for finding in wrong.findings] == ["targets"]
    assert wrong.targets[0].json()["offset_um"] == pytest.approx([-300.0, 200.0, -100.0], abs=12.0)


def test_an_unknown_position_is_fitted():
    unknown = data(stated={"3": Target((0.0, 0.0, 0.0), free=True)})
    (found,) = target_positions(unknown)
    assert not found.stated
    assert found.offset == pytest.approx(THREE["3"].position, abs=0.02)
    assert at_positions(unknown, [found]).targets["3"].position == pytest.approx(THREE["3"].position, abs=0.02)
    fitted = calibrate(unknown, basis="legendre:4", hold_out=False)
    assert 0.8 < fitted.fit.chi2_reduced < 1.2
    assert fitted.fit.registration.targets["3"] == pytest.approx(THREE["3"].position, abs=0.02)


def test_a_file_may_lack_the_position_of_a_target(tmp_path):
    path = written(data(), tmp_path / "m.csv")
    lines = path.read_text().splitlines(keepends=True)
    path.write_text("".join(line for line in lines if not line.startswith("# target.3")))
    found = read_measurement(path, CFRAME)
    assert found.targets["3"].free
    assert any("target 3" in note for note in found.notes)
    again = read_measurement(written(found, tmp_path / "again.csv"), CFRAME)
    assert again.targets == found.targets


def test_of_several_files_one_may_state_the_position():
    stated, unknown = data(seed=1), data(seed=2, stated={"3": Target((0.0, 0.0, 0.0), free=True)})
    for pair in ((stated, unknown), (unknown, stated)):
        each = [replace(one, source=f"{i}.csv", fingerprint=str(i)) for i, one in enumerate(pair)]
        assert joined(each).targets == THREE


def test_three_points_need_stated_targets():
    unknown = data(stated={"3": Target((0.0, 0.0, 0.0), free=True)})
    with pytest.raises(UserError, match="does not give the position of target 3"):
        identify(replace(unknown, stands_on="bed"))


def test_no_prediction_for_a_target_without_position(tmp_path):
    from calibration.fit.prediction import read_points

    path = written(data(), tmp_path / "m.csv")
    lines = path.read_text().splitlines(keepends=True)
    path.write_text("".join(line for line in lines if not line.startswith("# target.3")))
    with pytest.raises(UserError, match="does not give the position of target 3"):
        read_points(path, CFRAME)


def test_one_target_shows_nothing_of_its_position():
    one = data(ONE, stated={"1": Target((1.0, 0.0, -120.0))})
    assert target_positions(one) == []
    (said,) = findings(one, [])
    assert "a second target would show it" in said.message


@pytest.mark.statistical
def test_a_diagnosis_names_the_position_that_is_wrong():
    (cause,) = diagnose(data(stated=moved("3", 0.0, -0.2, 0.0))).causes
    assert (cause.kind, cause.where, cause.axis) == ("target-offset", "instrument", "3")
    assert cause.effect.parameters == pytest.approx([0.0, 200.0, 0.0], abs=15.0)


def test_of_two_targets_either_may_be_at_the_wrong_position():
    (cause,) = diagnose(data(TWO, stated=moved("2", 0.5, 0.0, 0.0))).causes
    assert (cause.kind, cause.verdict) == ("target-offset", "tied")
    assert {cause.axis, *(each.axis for each in cause.alternatives)} >= {"1", "2"}
