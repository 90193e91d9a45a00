"""The exam of short measurements (benchmarks/short_measurements_exam.py): its questions, and how answers are judged."""

import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks"))

import short_measurements_exam as exam
from short_measurements.answers import judged
from short_measurements.case import KINDS, Case
from short_measurements.designs import DESIGNS
from short_measurements.machines import AXES, MACHINES
from short_measurements.tables import summary, table
from short_measurements.visibility import information, power


def test_each_design_is_asked_with_each_effect_once():
    asked = [(design, effect) for _, design, effect, _ in exam.questions(3)]
    assert sorted(asked) == sorted((design, effect) for design in DESIGNS for effect in KINDS)
    assert {effect for _, effect in asked[:14]} == set(KINDS)


@pytest.mark.parametrize("name", MACHINES)
def test_points_are_those_of_exact_transforms(name):
    machine, rng = MACHINES[name], np.random.default_rng(0)
    q, errors, arm = (
        machine.positions(rng.uniform(size=(4, 3))),
        rng.normal(0, 2e-5, (4, 3, 6)),
        rng.normal(size=(4, 3)),
    )
    for i, found in enumerate(machine.points(q, errors, arm)):
        whole = np.eye(4)
        for axis, carries in machine.chain:
            k = AXES.index(axis)
            error, step = np.eye(4), np.eye(4)
            error[:3, :3], error[:3, 3] = Rotation.from_rotvec(errors[i, k, 3:]).as_matrix(), errors[i, k, :3]
            step[k, 3] = q[i, k]
            whole = whole @ (step @ error if carries == "tool" else error @ step)
        assert found == pytest.approx((whole @ np.append(arm[i], 1.0))[:3], abs=1e-9)


def test_directions_of_unseen_states_are_measured_ones():
    case = Case("gantry", "layers", "none", 21)
    moved = np.argmax(case.rows.q[:, 2] != case.rows.q[0, 2])
    assert moved == 35
    assert np.mean(case.unseen().approach[:, 2] > 0) == pytest.approx(np.mean(case.rows.approach[35:, 2] > 0), abs=0.1)


def test_causes_count_by_kind_and_axis():
    case = Case("cframe", "sparse", "backlash", 5)
    own, other = AXES[case.axis], AXES[case.axis - 1]
    named = {"kind": "backlash", "axis": own, "verdict": "strong", "log10_odds": 3.0}
    tied = {**named, "kind": "settling", "verdict": "tied", "alternatives": [{"kind": "backlash", "axis": own}]}
    false = {"kind": "backlash", "axis": other, "verdict": "weak", "log10_odds": 3.0}
    assert judged(case, [named, false], None)["verdict"] == "named"
    assert judged(case, [named, false], None)["false"] == [f"backlash {other} weak"]
    assert judged(case, [tied], None) == {"verdict": "tied", "false": [], "odds": [[3.0, True]], "variables": None}
    assert judged(case, [], {"variables": ["X"]})["verdict"] == "unexplained"
    assert judged(case, [], None)["verdict"] == "missed"
    slip = Case("cframe", "sparse", "stick-slip", 5)
    noise = {"non_repeatability": {AXES[slip.axis]: 30.0}}
    assert judged(slip, [], None, noise)["verdict"] == "unexplained"
    assert judged(case, [], None, noise)["verdict"] == "missed"


def test_the_table_counts_calibrations_that_are_worse_or_refused():
    record = {
        "design": "layers",
        "effect": "pitch",
        "verdict": "unexplained",
        "false": [],
        "none_um": 60.0,
        "covered": 0.9,
    }
    records = [{**record, "accepted": True, "after_um": 70.0}, {**record, "accepted": False, "after_um": 50.0}]
    assert summary(records) == ["2", "0", "0", "2", "0", "0", "0", "1", "1", "90.0 %"]
    assert len(list(table(records))) == 4


def test_an_effect_that_the_data_cannot_show_is_invisible_and_no_other():
    missed = {"design": "layers", "effect": "pitch", "verdict": "missed", "false": [], "accepted": True}
    records = [{**missed, "power": 0.2}, {**missed, "power": 0.9}, missed, {**missed, "power": 0.2, "verdict": "named"}]
    assert summary(records)[:6] == ["4", "1", "0", "0", "2", "1"]


@pytest.mark.statistical
def test_the_power_is_that_of_the_effect_beside_everything_unknown():
    case = Case("gantry", "pairs", "backlash", 5)
    whole = information(case)
    assert power(case) == pytest.approx(1.0)
    case.size /= 2.0
    assert information(case) == pytest.approx(whole / 4.0, rel=1e-3)
    case.size *= (12.0 / (whole / 4.0)) ** 0.5
    assert 0.0 < power(case) < 0.5
    assert power(Case("gantry", "pairs", "none", 5)) == 0.0
    # any error along an axis that depends on its position alone is an error motion
    assert information(Case("gantry", "sorted", "worn spot", 5)) < 1e-2
