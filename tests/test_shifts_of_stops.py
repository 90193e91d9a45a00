"""Shifts of stops that depend on positions and time, and look like an axis that does not repeat."""

from dataclasses import replace

import numpy as np
import pytest
from shop_floor.question import ask
from support.tiers import EXAM, STATISTICAL, quick

import machines
from calibration.diagnosis.diagnose import diagnose
from calibration.measurement.file import read_measurement

UM = 1e-3


def diagnosed(question, folder):
    path = folder / "data.csv"
    path.write_text(question.sheet(), encoding="utf-8")
    return diagnose(read_measurement(path, machines.load(question.run.machine.name)))


@pytest.mark.parametrize("machine", [pytest.param("gantry", marks=STATISTICAL), pytest.param("cframe", marks=EXAM)])
def test_an_error_that_swings_is_no_non_repeatability(machine, tmp_path):
    found = diagnosed(ask("random3", "swing", machine, 0, 7), tmp_path)
    assert not found.not_repeating
    assert not found.causes
    assert "time" in {variable for each in found.unexplained for variable in each.variables}


@pytest.mark.parametrize("seed", quick(range(1, 8), [], [1]))
def test_an_axis_that_does_not_repeat_depends_on_nothing(seed, tmp_path):
    plain = ask("random3", "none", "cframe", 0, seed)
    stops = np.random.default_rng(seed).normal(size=(len(plain.run), 3))[plain.run.stop] * [0.0, 12.0, 0.0] * UM
    found = diagnosed(replace(plain, stops=stops), tmp_path)
    assert found.not_repeating == {"Y": pytest.approx(12.0, rel=0.3)}
    assert not found.causes
    assert not found.unexplained
