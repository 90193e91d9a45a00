"""Observations as a sum of Gaussian terms: the algebra against dense matrices, and what simulated data contain."""

from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest
from scipy import linalg
from support.ballbar_cases import circles_of
from support.diagnosis_cases import CFRAME, data_with, with_stops
from support.tiers import quick

import ncomp
from calibration.evaluation.volumetric import aligned, deviation_on
from calibration.fit.calibrate import calibrate
from calibration.fit.written.calibrated import calibrated
from calibration.gaussian_terms.gains import log_gains
from calibration.gaussian_terms.noise import Noise
from calibration.gaussian_terms.observations import Observations
from calibration.gaussian_terms.structure import Data, Structure
from calibration.gaussian_terms.term import Term
from calibration.measurement.measurement import Measurement
from kinematics.basis import Legendre
from kinematics.effects import COMPONENTS, Backlash, ErrorMotion
from kinematics.error_model.model import no_errors
from kinematics.error_transform import error_transform_with_tool
from kinematics.state import State
from machines import path_of


def structure_of(measurement: Measurement) -> Structure:
    return Structure.first(Data.of(Observations.of(measurement)))


def with_backlash(structure: Structure, size: float = 1.0) -> Structure:
    effect = Backlash(axis="X", width=0.0)
    columns = structure.data.observations.columns([effect]) * effect.typical
    term = Term("backlash X", "backlash", "backlash X", lambda: columns, columns.shape[2], (effect,))
    return Structure(structure.data, structure.noise, structure.band_sizes, (term,), (size,))


def dense_log_density(structure: Structure) -> float:
    """Log density, by one covariance matrix of all rows, of the part of the observations that no registration moves."""
    observations, factor = structure.data.observations, structure.noise.factor
    n, d = observations.residual.shape
    covariance = np.zeros((n * d, n * d))
    for row, own in enumerate(observations.specified):
        covariance[row * d : (row + 1) * d, row * d : (row + 1) * d] = factor * own
    for stops in structure.data.stops:
        for axis, size in structure.noise.repeats.items():
            for rows, arm in zip(stops.rows, stops.arms[axis], strict=True):
                index = (rows[:, None] * d + np.arange(d)).ravel()
                covariance[np.ix_(index, index)] += size**2 * np.outer(arm, arm)
    columns = [structure.data.geometry.columns, *(term.columns for term in structure.terms)]
    design = np.concatenate(columns, axis=2).reshape(n * d, -1) * structure.sizes
    covariance += design @ design.T
    free = linalg.null_space(observations.registration.reshape(n * d, -1).T)
    residual, covariance = free.T @ observations.residual.ravel(), free.T @ covariance @ free
    return float(-0.5 * (residual @ np.linalg.solve(covariance, residual) + np.linalg.slogdet(covariance)[1]))


@pytest.mark.parametrize(("factor", "repeats"), [(1.0, {}), (2.5, {}), (1.0, {"X": 6.0, "Z": 2.0}), (0.5, {"Y": 10.0})])
def test_the_evidence_is_the_density_of_the_observations(factor, repeats):
    """Differences of the evidence between sizes, noises and terms are those of dense covariance matrices."""
    start = structure_of(with_stops(1, {0: 0.01}))
    nothing = np.zeros(len(start.data.observations), bool)
    one = Structure(start.data, Noise(factor, repeats, nothing), start.band_sizes * 0.3)
    for other in (with_backlash(one), with_backlash(one, 3.0), start):
        expected = dense_log_density(other) - dense_log_density(one)
        assert other.log_evidence - one.log_evidence == pytest.approx(expected, rel=1e-5, abs=1e-3)


def test_a_gain_is_the_rise_of_the_evidence():
    one = structure_of(data_with(Backlash("X", 8.0), n=40))
    columns = with_backlash(one).terms[0].columns
    white = one.whitener.columns(columns)
    through = one.through(white).T
    block = white.T @ white - through @ one.posterior.covariance @ through.T / one.noise.factor
    along = white.T @ one.equations.residual - through @ one.posterior.mean
    for size in (0.1, 1.0, 10.0):
        rise = with_backlash(one, size).log_evidence - one.log_evidence
        gain = log_gains(block[None], along[None], np.array([size]), one.noise.factor)[0]
        assert gain == pytest.approx(rise, rel=1e-6, abs=1e-6)


def test_sizes_are_likeliest():
    """A fitted size that is changed by a fifth is less likely."""
    found = structure_of(data_with(Backlash("X", 20.0), n=80)).fitted()
    found = with_backlash(found).fitted()
    for factor in (0.8, 1.25):
        other = found.resized(np.append(found.band_sizes * factor, found.term_sizes))
        assert other.total < found.total


def test_noise_and_non_repeatability_are_found():
    quiet, shifted = structure_of(with_stops(1, {})).fitted(), structure_of(with_stops(1, {0: 0.025})).fitted()
    assert quiet.noise.factor**0.5 == pytest.approx(1.0, abs=0.2)
    assert max(quiet.noise.repeats.values(), default=0.0) < 2.0
    assert shifted.noise.repeats["X"] == pytest.approx(25.0, rel=0.25)
    assert shifted.noise.factor**0.5 == pytest.approx(1.0, abs=0.2)


def test_noise_and_non_repeatability_that_look_alike_are_one_noise():
    """On a full circle, the length of a ballbar does not tell the noise of X and of Y from that of the bar."""
    found = structure_of(circles_of(step=5.0, noise=3.0)[0]).fitted()
    variance = 0.3**2 * found.noise.factor + found.noise.repeats.get("X", 0.0) ** 2
    assert variance**0.5 == pytest.approx(0.9, rel=0.25)


def test_what_the_machine_file_expects_decides_where_the_data_do_not(tmp_path):
    """Errors that the data hardly show are as large as the machine file says."""
    text = Path(path_of("cframe")).read_text()
    spread = []
    for size in (3.0, 300.0):
        (tmp_path / "mill.toml").write_text(f"{text}\n[priors]\nerror_motion_um = {size}\n")
        data = replace(data_with(n=20), machine=ncomp.load_machine(str(tmp_path / "mill.toml")))
        spread.append(np.trace(np.array(calibrated(structure_of(data).fitted()).covariance)))
    assert spread[1] > 100.0 * spread[0]


def test_outliers_are_left_out_and_come_back():
    data = data_with(n=80)
    start = structure_of(data)
    observed = start.data.observations.residual.copy()
    observed[[7, 40]] += [[0.3, -0.2, 0.1], [0.0, 0.0, 0.15]]
    observations = replace(start.data.observations, residual=observed)
    found = Structure.first(replace(start.data, observations=observations)).fitted()
    assert np.flatnonzero(found.noise.left_out).tolist() == [7, 40]
    again = Structure(start.data, found.noise, found.band_sizes).fitted()
    assert not again.noise.left_out.any()


def error_motions(seed: int) -> list[ErrorMotion]:
    """Error motions of third degree of each axis of the C-frame, about 10 um and urad in each coefficient."""
    rng = np.random.default_rng(seed)
    travels = {axis.name: axis.travel for axis in CFRAME.axes}
    return [
        ErrorMotion(component, axis, Legendre(travel, 3), tuple(10.0 * rng.standard_normal(4)))
        for axis, travel in travels.items()
        for component in COMPONENTS
    ]


@pytest.mark.parametrize("seed", quick([1, 2], [1]))
def test_the_calibration_predicts_the_errors_within_its_uncertainty(seed):
    """At positions between the measured ones; the same errors as `ncomp fit` leaves, or smaller ones."""
    motions = error_motions(seed)
    data = data_with(*motions, n=120, seed=seed)
    truth = msgspec.structs.replace(no_errors(CFRAME), effects=tuple(motions))
    own, other = calibrated(structure_of(data).fitted()), calibrate(data, hold_out=False, force=True).model
    positions = data.state.positions[:60]
    positions = (positions + positions[::-1]) / 2.0
    true, ours, theirs = (aligned(*deviation_on(CFRAME, model, positions)) for model in (truth, own, other))
    left, before = np.sqrt(np.mean((ours - true) ** 2)), np.sqrt(np.mean(true**2))
    assert left < max(0.15 * before, 1.2 * np.sqrt(np.mean((theirs - true) ** 2)))
    transform = error_transform_with_tool(CFRAME, positions, np.zeros((60, 3)))[:, :3]
    design = own.design(CFRAME, State(positions), transform).reshape(60, 3, -1)
    u = np.sqrt(np.einsum("nkp,pq,nkq->nk", design, np.array(own.covariance), design))
    assert np.mean(np.abs(ours - true) <= 2.0 * u) > 0.9
