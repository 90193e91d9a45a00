"""Zeros of the runs of an interferometer: printed, and said where they spread by more than noise."""

import json

import numpy as np
import pytest

import machines
from calibration.fit.calibrate import calibrate
from calibration.fit.set_up.run_zeros import run_zeros, zero_findings
from calibration.instruments import Interferometer
from calibration.measurement.measurement import with_moves
from calibration.reports.fit import fit_json, fit_report
from calibration.simulation.simulate import observe
from kinematics.error_model.model import no_errors
from kinematics.state import State

CFRAME = machines.load("cframe")


def runs(zeros_um, *, one_way=False):
    """Runs along X of an axis without error; the zero of each as given, noise 0.5 um."""
    there = np.linspace(0.0, 500.0, 11)
    x = np.tile(there if one_way else np.concatenate([there, there[::-1]]), len(zeros_um))
    each = len(x) // len(zeros_um)
    q = np.zeros((len(x), len(CFRAME.axes)))
    q[:, CFRAME.index("X")] = x
    run = np.repeat([f"r{i}" for i in range(len(zeros_um))], each)
    state = with_moves(State(q, target=np.full(len(x), "1")), np.ones_like(q) if one_way else None)
    rng = np.random.default_rng(1)
    data = observe(CFRAME, no_errors(CFRAME), state, Interferometer(0.5), rng, axis=np.full(len(x), "X"), run=run)
    data.observed[:, 0] += 1e-3 * np.repeat(zeros_um, each)
    return data


def test_zeros_of_noise_are_printed_and_cause_no_finding():
    found = calibrate(runs([0.0] * 5), force=True, basis="legendre:2")
    zeros = run_zeros(found.fit)
    assert [zero.run for zero in zeros] == [f"X r{i}" for i in range(5)]
    assert not list(zero_findings(zeros))
    written = fit_json(found, None)["zeros"]
    json.dumps(written)
    assert {"run", "zero_um", "u_um"} == set(written[0])
    assert "Zeros of the runs" in [section.title for section in fit_report(found, None, "ncomp fit").sections]


def test_zeros_that_drift_are_said_with_their_range():
    found = calibrate(runs([0.0, 2.0, 4.0, 6.0]), force=True, basis="legendre:2")
    (finding,) = [each for each in found.findings if each.check == "zeros"]
    assert "the zeros of the 4 runs of X spread from" in finding.message
    zeros = np.array([zero.value for zero in run_zeros(found.fit)])
    assert zeros - zeros[0] == pytest.approx([0.0, 2.0, 4.0, 6.0], abs=0.7)
    assert "backlash" not in finding.message


def test_runs_of_one_direction_hide_the_backlash_in_their_zeros():
    found = calibrate(runs([0.0, 5.0, 0.0, 5.0], one_way=True), force=True, basis="legendre:2")
    (finding,) = [each for each in found.findings if each.check == "zeros"]
    assert "its zero also holds the backlash" in finding.message
