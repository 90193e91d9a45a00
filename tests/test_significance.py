"""What of the predicted improvement stands above the uncertainty of the calibration."""

import json

import msgspec
import numpy as np
import pytest
from support.programs import load

from kinematics.effects import LocationError
from kinematics.error_model.model import no_errors, write_model
from kinematics.state import State
from postproc.compensation.significance import Significance, uncertainties_um

PROGRAM = "G21 G17 G90\nG0 X100 Y100 Z100\nG1 X200 F500\nG1 Y300\nM30\n"


def shifted(u_x, u_y=0.0):
    effects = (LocationError("X", "X", 10.0, u=(u_x,)), LocationError("Y", "Y", 1.0, u=(u_y,)))
    return msgspec.structs.replace(no_errors(load("gantry")), effects=effects)


def test_gains_above_two_uncertainties_count():
    found = Significance()
    found.add(np.array([10.0, 3.0]), np.array([0.0, 0.0]), np.array([4.9, 1.6]))
    assert found.share == pytest.approx(10.0 / 13.0)
    found.add(np.array([1.0]), np.array([2.0]), np.array([0.1]))  # what got worse is no improvement
    assert found.share == pytest.approx(10.0 / 12.0)


def test_without_uncertainty_or_gain_there_is_no_share():
    found = Significance()
    assert found.share is None
    found.add(np.array([5.0]), np.array([0.0]), np.array([0.0]))
    assert found.share is None


def test_the_uncertainty_that_counts_is_the_one_along_the_deviation():
    machine = load("gantry")
    state, tool = State(np.array([[100.0, 200.0, 300.0]])), np.zeros((1, 3))
    whole, along = uncertainties_um(machine, shifted(3.0, 4.0), state, tool)
    unit = np.array([10.0, 1.0]) / np.hypot(10.0, 1.0)
    assert whole == pytest.approx([5.0])
    assert along == pytest.approx([np.hypot(3.0 * unit[0], 4.0 * unit[1])])
    nothing = msgspec.structs.replace(shifted(3.0), effects=(LocationError("X", "X", 0.0, u=(3.0,)),))
    assert uncertainties_um(machine, nothing, state, tool)[1] == pytest.approx([3.0])


@pytest.mark.parametrize(("u", "share"), [(1.0, 1.0), (30.0, 0.0), (0.0, None)])
def test_the_summary_says_it(command, tmp_path, u, share):
    (tmp_path / "in.nc").write_text(PROGRAM)
    write_model(shifted(u), tmp_path / "cal.json")
    options = ("--datum", "G54=true", "--accept", "insignificant") if share == 0.0 else ("--datum", "G54=true")
    done = command("in.nc", "-m", "gantry", "-c", "cal.json", "-o", "out.nc", "--json", "-", "--set-up-zero", *options)
    assert done.status == 0, done.err
    assert json.loads(done.out)["predicted_error_um"]["significant_share_of_improvement"] == share
    assert (f"{100 * share:.0f} %" in done.err) if share is not None else ("significant" not in done.err)
