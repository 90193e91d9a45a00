"""Shifts of stops that depend on positions and time, and look like an axis that does not repeat."""

from dataclasses import replace

import numpy as np
import pytest
from calibration.diagnosis.preparation import prepared
from calibration.diagnosis.residual.unexplained import in_lengths, unexplained
from shop_floor.question import ask
from support.tiers import EXAM, STATISTICAL, quick

import machines
from calibration.measurement.file import read_measurement
from kinematics.running.progress import silent

UM = 1e-3


def dependence_of(question, folder):
    """The bare fit of the data of a question, and the dependence of its residuals."""
    path = folder / "data.csv"
    path.write_text(question.sheet(), encoding="utf-8")
    measurement = read_measurement(path, machines.load(question.run.machine.name))
    linearised = prepared(measurement, None, "sheet", silent, silent).selector.bare.linearised
    assert linearised.measurement.noise.non_repeatability
    return linearised, unexplained(linearised)


@pytest.mark.parametrize("machine", [pytest.param("gantry", marks=STATISTICAL), pytest.param("cframe", marks=EXAM)])
def test_an_error_that_swings_is_no_non_repeatability(machine, tmp_path):
    question = ask("random3", "swing", machine, 0, 7)
    linearised, found = dependence_of(question, tmp_path)
    assert set(found.variables) == {"X", "Z", "time"}
    (swing,) = question.hidden
    true = question.poses["s1"].seen(swing.tool(question.run)) - question.poses["s1"].seen(np.zeros((1, 3)))
    true = (true - true.mean(axis=0))[linearised.rows]
    shape = in_lengths(linearised, found)
    assert np.sum(shape * true) > 0.5 * np.sum(true**2)


@pytest.mark.parametrize("seed", quick(range(1, 8), [], [1]))
def test_an_axis_that_does_not_repeat_depends_on_nothing(seed, tmp_path):
    plain = ask("random3", "none", "cframe", 0, seed)
    stops = np.random.default_rng(seed).normal(size=(len(plain.run), 3))[plain.run.stop] * [0.0, 12.0, 0.0] * UM
    assert dependence_of(replace(plain, stops=stops), tmp_path)[1] is None
