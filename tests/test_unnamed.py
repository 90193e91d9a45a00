"""What no cause explains, added to a calibration without a name: only where it predicts."""

import pytest
from support.command import refusal
from virtual_machine import draws

import machines
from calibration.diagnosis.diagnose import diagnose
from calibration.measurement.file import read_measurement


def read(text, name, folder):
    (folder / "data.csv").write_text(text, encoding="utf-8")
    return read_measurement(folder / "data.csv", machines.load(name))


def test_what_to_do_with_what_is_left_is_one_of_two(tmp_path):
    (tmp_path / "data.csv").write_text("", encoding="utf-8")
    words = ["diagnose", str(tmp_path / "data.csv"), "-m", "cframe", "-o", str(tmp_path / "n.json")]
    assert "--unexplained drop: expected report or add" in refusal(*words, "--unexplained", "drop")
    assert not (tmp_path / "n.json").exists()


@pytest.mark.statistical
def test_where_nothing_is_left_nothing_is_added(tmp_path):
    measurement = read(draws.nothing(1).sheet(), "cframe", tmp_path)
    told, found = diagnose(measurement), diagnose(measurement, add_unexplained=True)
    assert not found.added
    assert found.model.effects == told.model.effects
    assert found.model.covariance == told.model.covariance
