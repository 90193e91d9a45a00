"""The exam of short measurements (benchmarks/short_measurements_exam.py): its questions, and how answers are judged."""

import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks"))

import short_measurements_exam as exam


def test_each_design_is_asked_with_each_effect_once():
    asked = [(design, effect) for _, design, effect, _ in exam.questions(3)]
    assert sorted(asked) == sorted((design, effect) for design in exam.DESIGNS for effect in exam.KINDS)
    assert {effect for _, effect in asked[:14]} == set(exam.KINDS)


@pytest.mark.parametrize("name", exam.MACHINES)
def test_points_are_those_of_exact_transforms(name):
    machine, rng = exam.MACHINES[name], np.random.default_rng(0)
    q, errors, arm = (
        machine.positions(rng.uniform(size=(4, 3))),
        rng.normal(0, 2e-5, (4, 3, 6)),
        rng.normal(size=(4, 3)),
    )
    for i, found in enumerate(machine.points(q, errors, arm)):
        whole = np.eye(4)
        for axis, carries in machine.chain:
            k = exam.AXES.index(axis)
            error, step = np.eye(4), np.eye(4)
            error[:3, :3], error[:3, 3] = Rotation.from_rotvec(errors[i, k, 3:]).as_matrix(), errors[i, k, :3]
            step[k, 3] = q[i, k]
            whole = whole @ (step @ error if carries == "tool" else error @ step)
        assert found == pytest.approx((whole @ np.append(arm[i], 1.0))[:3], abs=1e-9)


def test_directions_of_unseen_states_are_measured_ones():
    case = exam.Case("gantry", "layers", "none", 21)
    moved = np.argmax(case.rows.q[:, 2] != case.rows.q[0, 2])
    assert moved == 35
    assert np.mean(case.unseen().approach[:, 2] > 0) == pytest.approx(np.mean(case.rows.approach[35:, 2] > 0), abs=0.1)


def test_causes_count_by_kind_and_axis():
    case = exam.Case("cframe", "sparse", "backlash", 5)
    own, other = exam.AXES[case.axis], exam.AXES[case.axis - 1]
    named = {"kind": "backlash", "axis": own, "verdict": "strong"}
    tied = {"kind": "settling", "axis": own, "verdict": "tied", "alternatives": [{"kind": "backlash", "axis": own}]}
    false = {"kind": "backlash", "axis": other, "verdict": "weak"}
    assert exam.judged(case, [named, false], None)["verdict"] == "named"
    assert exam.judged(case, [named, false], None)["false"] == [f"backlash {other} weak"]
    assert exam.judged(case, [tied], None) == {"verdict": "tied", "false": [], "variables": None}
    assert exam.judged(case, [], {"variables": ["X"]})["verdict"] == "unexplained"
    assert exam.judged(case, [], None)["verdict"] == "missed"


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
    assert exam.summary(records) == ["2", "0", "0", "2", "0", "0", "1", "1", "90.0 %"]
    assert len(list(exam.table(records))) == 4
