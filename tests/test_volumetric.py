"""Volumetric error: what rigid alignment takes, and the published machine."""

import numpy as np
import pytest

import machines
from calibration.evaluation.volumetric import aligned, deviation_on, volumetric_error_um
from calibration.planning.strategies import evaluation_grid
from calibration.simulation.true_model import random_true_model
from kinematics.forward import tool_point
from kinematics.state import State
from kinematics.transforms import rotation_vector_matrix, turn

GANTRY = machines.load("gantry")


def points_and_deviation(n=200, seed=1):
    rng = np.random.default_rng(seed)
    return rng.uniform(-1000.0, 4000.0, (n, 3)), rng.normal(0.0, 0.02, (n, 3))


def test_a_rigid_motion_is_taken_off():
    points, deviation = points_and_deviation()
    shift, turns = np.array([1.0, -2.0, 0.5]), np.array([2e-5, -1e-5, 3e-5])
    rigid = shift + np.cross(turns, points)
    assert np.abs(aligned(rigid, points)).max() < 1e-12
    assert aligned(deviation + rigid, points) == pytest.approx(aligned(deviation, points), abs=1e-12)


def test_small_turns_are_those_of_rotations():
    points, _ = points_and_deviation()
    turns = np.array([2e-5, -1e-5, 3e-5])
    exact = turn(rotation_vector_matrix(turns), points) - points
    assert np.abs(aligned(exact, points)).max() < 4000 * 5e-5**2


def test_nothing_rigid_is_left_and_nothing_else_taken():
    points, deviation = points_and_deviation()
    left = aligned(deviation, points)
    assert np.abs(left.mean(axis=0)).max() < 1e-15
    assert np.abs(np.cross(points, left).mean(axis=0)).max() < 1e-11
    assert aligned(left, points) == pytest.approx(left, abs=1e-15)
    columns = np.concatenate(
        [np.tile(np.eye(3), (len(points), 1, 1)), np.cross(np.eye(3), points[:, None]).swapaxes(1, 2)], axis=2
    )
    normal = np.linalg.pinv(columns.reshape(-1, 6))
    expected = deviation - (columns.reshape(-1, 6) @ (normal @ deviation.reshape(-1))).reshape(-1, 3)
    assert left == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("points", [np.zeros((1, 3)), np.outer(np.arange(5.0), [1, 2, 3]), np.ones((4, 3))])
def test_points_that_fix_no_turn(points):
    deviation = np.random.default_rng(3).normal(size=points.shape)
    left = aligned(deviation, points)
    assert np.all(np.isfinite(left))
    assert np.abs(left.mean(axis=0)).max() < 1e-12


def test_statistics():
    deviation = np.zeros((100, 3))
    deviation[:, 0] = np.arange(100) * 1e-3
    error = volumetric_error_um(deviation)
    assert error.rms == pytest.approx(np.sqrt(np.mean(np.arange(100.0) ** 2)))
    assert error.p95 == pytest.approx(94.05)
    assert error.largest == pytest.approx(99.0)
    assert volumetric_error_um(deviation, np.random.default_rng(0).normal(size=(100, 3))).rms < error.rms


def test_deviations_are_those_of_the_matrix_product():
    rng, machine = np.random.default_rng(5), machines.load("dmu50")
    grid = evaluation_grid(machine, 3)
    model = random_true_model(machine, rng)
    deviation, points = deviation_on(machine, model, grid, (10.0, 0.0, -100.0))
    actual = tool_point(machine, grid, (10.0, 0.0, -100.0), model.errors(machine, State(grid)))
    assert deviation == pytest.approx(actual - points, abs=1e-12)


def test_the_gantry_of_the_virtual_calibration_paper():
    """VE0 of Table 1 on a 9 x 9 x 9 grid: 52 um raw, 27.5 um aligned, means over 150 to 200 draws."""
    rng, grid = np.random.default_rng(0), evaluation_grid(GANTRY)
    assert len(grid) == 729
    raw, fitted = [], []
    for _ in range(150):
        deviation, points = deviation_on(GANTRY, random_true_model(GANTRY, rng), grid)
        raw.append(volumetric_error_um(deviation).rms)
        fitted.append(volumetric_error_um(deviation, points).rms)
    assert np.mean(raw) == pytest.approx(52.0, abs=3 * np.std(raw) / 150**0.5)
    assert np.mean(fitted) == pytest.approx(27.5, abs=3 * np.std(fitted) / 150**0.5)
