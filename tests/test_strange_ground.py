"""Machines and designs that ncomp's planning does not make: calibrations by `fit` help, with honest uncertainties."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
from support.command import succeed
from support.tiers import quick
from virtual_machine import strange

from kinematics.transforms import Array
from kinematics.user_error import UserError

CLAIMED_TOO_MUCH = 2.0
"""Remaining error in standard uncertainties, RMS over the measured volume."""


def length(vectors: Array) -> float:
    return float(np.sqrt(np.mean(np.sum(vectors**2, axis=1))))


def predictions(file: Path) -> tuple[Array, Array]:
    """Deviations and their standard uncertainties `(n, 3)`, um."""
    rows = list(csv.DictReader(line for line in file.read_text().splitlines() if not line.startswith("#")))
    found, u = (np.array([[float(row[f"{name}{c}_um"]) for c in "xyz"] for row in rows]) for name in ("d", "u_d"))
    return found, u


def examined(
    folder: Path, kind: str, seed: int, rotary: int, fitted: tuple[str, ...] = ("fit", "--no-hold-out")
) -> tuple[float, float, float]:
    """Volumetric error before and after, best aligned, and its uncertainty as claimed, um RMS, where it was measured."""
    rng = np.random.default_rng(seed)
    toml = strange.machine_file(rng, rotary)
    design = strange.design_of(kind, toml, rng)
    truth = strange.truth_of(design, rng)
    (folder / "strange.toml").write_text(toml)
    (folder / "data.csv").write_text(strange.sheet(design, strange.readings(design, truth, rng)))
    machine, calibration = ("--machine", str(folder / "strange.toml")), str(folder / "cal.json")
    succeed(*fitted, str(folder / "data.csv"), *machine, "-o", calibration)
    positions = strange.scattered(design.chain, rng, design.ranges, 200)
    (folder / "points.csv").write_text(strange.points_file(design, positions))
    predicted = folder / "predicted.csv"
    succeed("predict", str(folder / "points.csv"), *machine, "--calibration", calibration, "-o", str(predicted))
    found, u = predictions(predicted)
    points, true = strange.deviations(design, truth, positions, strange.TARGETS["t1"])
    before, after = strange.left_over(points, true * 1e3), strange.left_over(points, true * 1e3 - found)
    return length(before), length(after), length(u)


POOR = [(kind, seed) for seed in (3, 6) for kind in ("one-at-a-time", "bed", "table-only")]


def check(before: float, after: float, u: float, share: float) -> None:
    assert after < share * before
    assert after < CLAIMED_TOO_MUCH * u


def test_inches_on_a_strange_three_axis_chain(tmp_path: Path) -> None:
    check(*examined(tmp_path, "inches", 2, rotary=0), share=0.2)


def test_one_line_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="lie on one line"):
        examined(tmp_path, "line", 1, rotary=1)


def test_targets_on_the_bed_alone_show_nothing_and_are_refused(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="do not show the machine's errors"):
        examined(tmp_path, "bed-only", 1, rotary=1)


def test_few_positions_are_refused_with_what_is_needed(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="too few for"):
        examined(tmp_path, "few", 3, rotary=1)


MANY = [(kind, seed) for seed in (1, 4, 5) for kind in ("whole-turn", "part-of-turn", "inches", "within")]


@pytest.mark.parametrize(("kind", "seed"), quick(MANY, [], MANY[:4]))
def test_many_positions_on_strange_machines(tmp_path: Path, kind: str, seed: int) -> None:
    check(*examined(tmp_path, kind, seed, rotary=2), share=0.2)


SCATTERED = [(basis, seed) for seed in (1, 3) for basis in ("polynomial", "table")]


@pytest.mark.statistical
def test_three_points_on_a_table_with_long_arms_make_nothing_worse(tmp_path: Path) -> None:
    """Angles from targets 100 mm apart act at arms of 2.5 m; curves must not swing between the positions."""
    check(*examined(tmp_path, "three-points", 4, rotary=2, fitted=("three-points",)), share=1.0)


@pytest.mark.parametrize(("basis", "seed"), quick(SCATTERED, [], [SCATTERED[0], SCATTERED[3]]))
def test_three_points_scatter_as_they_claim(tmp_path: Path, seed: int, basis: str) -> None:
    """Predictions from eight measurements of one machine, each with other noise."""
    rng = np.random.default_rng(seed)
    toml = strange.machine_file(rng, rotary=0)
    design = strange.design_of("three-points", toml, rng)
    truth = strange.truth_of(design, rng)
    (tmp_path / "strange.toml").write_text(toml)
    machine = ("--machine", str(tmp_path / "strange.toml"))
    (tmp_path / "points.csv").write_text(
        strange.points_file(design, strange.scattered(design.chain, rng, design.ranges, 100))
    )
    found, u = [], []
    for _ in range(8):
        (tmp_path / "data.csv").write_text(strange.sheet(design, strange.readings(design, truth, rng)))
        calibration = str(tmp_path / "cal.json")
        succeed("three-points", str(tmp_path / "data.csv"), *machine, "--basis", basis, "-o", calibration)
        predicted = tmp_path / "predicted.csv"
        succeed(
            "predict", str(tmp_path / "points.csv"), *machine, "--calibration", calibration, "-o", str(predicted)
        )  # fmt: skip
        deviation, own = predictions(predicted)
        found.append(deviation)
        u.append(own)
    scatter = np.concatenate(np.array(found) - np.mean(found, axis=0)) * np.sqrt(8 / 7)
    assert 0.7 < length(scatter) / length(np.concatenate(u)) < 1.3


@pytest.mark.parametrize(("kind", "seed"), quick(POOR, [], POOR[:3]))
def test_poor_designs_claim_little_and_make_nothing_worse(tmp_path: Path, kind: str, seed: int) -> None:
    check(*examined(tmp_path, kind, seed, rotary=1), share=1.0)
