"""A tracker's uncertainties from its tests by ASME B89.4.19, drawn from points that a tracker would read."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from support.command import succeed

from calibration.instruments import LaserTracker
from calibration.measurement.tracker_tests import PARAMETERS, fit_tests, read_tests
from calibration.reports.tracker import tracker_report
from calibration.study.cases import read_cases
from calibration.study.definition import study_of
from kinematics.transforms import Array
from kinematics.user_error import UserError

TRUE = LaserTracker(0.4, 0.3, 6.0, 2.5)
BAR = 2300.0


def readings(points: Array, rng: np.random.Generator) -> Array:
    root = np.linalg.cholesky(TRUE.covariance(points))
    return np.asarray(points + (root @ rng.standard_normal((len(points), 3, 1)))[:, :, 0])


def length(first: Array, second: Array, rng: np.random.Generator) -> float:
    a, b = readings(np.stack([first, second]), rng)
    return float(np.linalg.norm(b - a) - np.linalg.norm(second - first)) * 1e3


def drawn(rng: np.random.Generator, repeats: int) -> str:
    """Tests of a virtual tracker, from its readings."""
    rows = ["test,range_mm,range_2_mm,length_mm,error_um"]
    x, y = np.eye(3)[:2]
    for _ in range(repeats):
        for far in (4000.0, 10000.0, 20000.0, 35000.0):
            rows.append(f"ranging,2000,{far},,{length(2000.0 * x, far * x, rng)}")
        for away in (1500.0, 3000.0, 6000.0, 12000.0, 20000.0):
            rows.append(f"length,{away},,{BAR},{length(away * x - BAR / 2 * y, away * x + BAR / 2 * y, rng)}")
        for away in (1500.0, 6000.0, 15000.0):
            front, back = readings(np.tile(away * x, (2, 1)), rng)
            rows.append(f"two-face,{away},,,{np.linalg.norm((front - back)[1:]) * 1e3}")
    return "\n".join(rows) + "\n"


def written(folder: Path, text: str) -> Path:
    path = folder / "b89.csv"
    path.write_text(text)
    return path


def test_the_parameters_are_found_within_their_uncertainty(tmp_path: Path) -> None:
    true = np.array([getattr(TRUE, name) for name in PARAMETERS])
    away = []
    for seed in range(12):
        found = fit_tests(read_tests(written(tmp_path, drawn(np.random.default_rng(seed), 20))))
        away.append((found.parameters - true) / found.u)
        assert not any(found.doubtful(kind) for kind in ("ranging", "length", "two-face"))
    assert np.all(np.sqrt(np.mean(np.square(away), axis=0)) < 1.7)
    assert np.sqrt(np.mean(np.square(away))) > 0.5


def test_stated_values_of_a_data_sheet(tmp_path: Path) -> None:
    rows = ["# coverage: 2", "test,range_mm,range_2_mm,length_mm,stated_um"]
    for far in (5.0, 10.0, 30.0):
        rows.append(f"ranging,1000,{far * 1e3},,{2 * np.hypot(0.4 + 0.3, 0.4 + 0.3 * far)}")
    for away in (2.0, 5.0, 12.0):
        rows.append(f"two-face,{away * 1e3},,,{2 * 2 * (6.0 + 2.5 * away)}")
    found = fit_tests(read_tests(written(tmp_path, "\n".join(rows) + "\n")))
    np.testing.assert_allclose(found.parameters, [0.4, 0.3, 6.0, 2.5], rtol=1e-2)


def test_the_command_and_the_study_take_the_tests(tmp_path: Path) -> None:
    data = written(tmp_path, drawn(np.random.default_rng(1), 20))
    out = tmp_path / "tracker.toml"
    succeed("tracker", data, "-o", out, "--json", tmp_path / "t.json")
    parameters = json.loads((tmp_path / "t.json").read_text())["parameters"]
    assert f"u_angle_um = {parameters['u_angle_um']:.4g}  # u = " in out.read_text()
    case = {"name": "a", "strategy": "random", "points": 20, "tracker": [-1500.0, 1500.0, 300.0]}
    study = study_of(
        {
            "machine": "gantry",
            "instrument": {"tests": "b89.csv"},
            "case": [case],
            "draws": 2,
            "fit": {"basis": "legendre:2"},
        },
        "study",
    )
    (read,) = read_cases(study, tmp_path)
    assert isinstance(read.instrument, LaserTracker)
    assert read.instrument.u_angle_um == pytest.approx(parameters["u_angle_um"])
    study = study_of(
        {"machine": "gantry", "instrument": {"tests": "b89.csv", "u_range_um": 1.0}, "case": [case]}, "study"
    )
    with pytest.raises(UserError, match="without u_range_um"):
        read_cases(study, tmp_path)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (
            "test,range_mm,range_2_mm,error_um\nranging,1000,2000,1\nranging,1000,3000,1\nranging,1000,4000,1\n",
            "the angles: three or more",
        ),
        ("test,range_mm,error_um\ntwo-face,1000,1\ntwo-face,2000,1\ntwo-face,3000,1\n", "the range: three or more"),
        ("test,range_mm,error_um\nroll,1000,1\n", "'roll' is none of ranging, length, two-face"),
        ("test,range_mm,range_2_mm,error_um\nranging,1000,,1\n", "column range_2_mm: empty"),
        ("test,range_mm,length_mm,error_um\nlength,1000,-3,1\n", "'-3' is no number above 0"),
        ("test,range_mm,stated_um\ntwo-face,1000,1\n", "'# coverage: 2'"),
        ("test,range_mm\ntwo-face,1000\n", "one column, error_um (measured) or stated_um"),
        ("test,range_mm,error_um\ntwo-face,-5,1\n", "a range must be above 0"),
    ],
)
def test_tests_that_can_not_be_used(tmp_path: Path, text: str, words: str) -> None:
    with pytest.raises(UserError) as fault:
        fit_tests(read_tests(written(tmp_path, text)))
    assert words in str(fault.value)


def test_a_systematic_error_is_said(tmp_path: Path) -> None:
    lines = drawn(np.random.default_rng(1), 20).splitlines()
    spoiled = [
        line if not line.startswith("length") else f"{line.rpartition(',')[0]},{300 + i % 7}"
        for i, line in enumerate(lines)
    ]
    found = fit_tests(read_tests(written(tmp_path, "\n".join(spoiled) + "\n")))
    assert found.doubtful("length") or found.doubtful("two-face")
    kinds = [kind for kind in ("ranging", "length", "two-face") if found.doubtful(kind)]
    verdict = tracker_report(found, "b89.csv").verdict
    assert f"The {' and '.join(kinds)} tests scatter more than they explain" in verdict
    assert f"{found.parameters[0]:.2f} um + {found.parameters[1]:.2f} um/m along the beam" in verdict
