"""Plans and the exports that are joined with them: unique names, one count, one time, arms of rotary axes only."""

import csv
import re
from pathlib import Path

import numpy as np
import pytest
from support import robot

MAP = 'delimiter = ";"\ndecimal = "."\nnames = true\njoin = "point"\n[units]\nxyz = "mm"\n[columns]\npoint = "Point Name"\nx = "X"\ny = "Y"\nz = "Z"\n'
UNCERTAIN = ("--header", "instrument=laser-tracker", "--header", "u_range_um=5", "--header", "u_angle_um=5")


def rows_of(path):
    return list(csv.DictReader(line for line in Path(path).read_text().splitlines() if not line.startswith("#")))


def exported(plan, data, names=None):
    """The points of a virtual measurement of a plan, as an export with the names of the plan."""
    points = rows_of(data)
    names = [row["point"] for row in rows_of(plan)] if names is None else names
    lines = [f"{name};{p['x']};{p['y']};{p['z']}" for name, p in zip(names, points, strict=True)]
    Path("export.txt").write_text("\n".join(["Point Name;X;Y;Z", *lines]) + "\n")
    Path("map.toml").write_text(MAP)


@pytest.mark.parametrize("options", [("--order", "retraced"), ("--runs", "2"), ("--references", "10")])
def test_a_plan_can_be_joined_by_its_names(command, options):
    plan = ("plan", "--machine", "cframe", "--strategy", "random", "--points", "30", *options, "-o", "plan.csv")
    assert command(*plan).status == 0
    names = [row["point"] for row in rows_of("plan.csv")]
    assert len(set(names)) == len(names)
    assert command("simulate", "--machine", "cframe", "--strategy", "plan.csv", "-o", "data.csv").status == 0
    exported("plan.csv", "data.csv")
    fit = ("fit", "export.txt", "--machine", "cframe", "--plan", "plan.csv", "--columns", "map.toml", *UNCERTAIN)
    done = command(*fit, "--basis", "legendre:1", "-o", "cal.json", "--force")
    assert done.status == 0, done.err


def test_a_point_is_named_once_for_each_target(command):
    targets = ("--target", "t1=0,0,-100", "--target", "t2=50,0,-120", "--target-order", "alternating")
    command(
        "plan", "--machine", "cframe", "--strategy", "random", "--points", "4", *targets, "--runs", "2", "-o", "p.csv"
    )
    found = [(row["point"], row["target"]) for row in rows_of("p.csv")]
    assert found[:3] == [("R1", "t1"), ("R1", "t2"), ("R2", "t1")]
    assert found[8:10] == [("R1b", "t1"), ("R1b", "t2")]


def test_a_name_in_other_letters_is_asked_about(command):
    command("plan", "--machine", "cframe", "--strategy", "random", "--points", "30", "-o", "plan.csv")
    command("simulate", "--machine", "cframe", "--strategy", "plan.csv", "-o", "data.csv")
    exported("plan.csv", "data.csv", [row["point"].lower() for row in rows_of("plan.csv")])
    done = command(
        "fit",
        "export.txt",
        "--machine",
        "cframe",
        "--plan",
        "plan.csv",
        "--columns",
        "map.toml",
        *UNCERTAIN,
        "-o",
        "c.json",
    )
    assert done.status == 2
    assert re.search(r"export.txt:2 .*'r1' is not in the plan plan.csv \(did you mean 'R1'\?\)", done.err)


def test_plan_and_simulation_count_alike(command):
    options = ("--strategy", "random", "--points", "20", "--order", "retraced", "--runs", "2")
    planned = command("plan", "--machine", "cframe", *options, "-o", "plan.csv")
    simulated = command("simulate", "--machine", "cframe", "--strategy", "plan.csv", "-o", "data.csv")
    counts = [
        re.search(r"(\d+) positions, (\d+) observations, (\d+) min", (each.out.decode() + each.err))
        for each in (planned, simulated)
    ]
    assert counts[0] is not None
    assert counts[1] is not None
    assert counts[0].groups() == counts[1].groups()
    assert counts[0].groups()[:2] == ("20", "78")


@pytest.mark.parametrize("strategy", ["random", "space-filling"])
def test_an_arm_of_rotary_axes_only_is_measured_at_random_joints(command, strategy):
    Path("robot.toml").write_text(robot.toml())
    options = ("--machine", "robot.toml", "--strategy", strategy, "--points", "40")
    done = command("plan", *options, "-o", "plan.csv")
    assert done.status == 0, done.err
    assert "rotary axes do not move" not in done.err + done.out.decode()
    joints = np.array([[float(row[f"A{i}"]) for i in range(1, 7)] for row in rows_of("plan.csv")])
    low, high = np.array(robot.LIMITS, float).T
    assert (joints >= low).all()
    assert (joints <= high).all()
    assert (np.ptp(joints, axis=0) > 0.7 * (high - low)).all()
    done = command("simulate", *options, "--target", "t=60,40,150", "-o", "data.csv")
    assert done.status == 0, done.err
    refused = command("plan", "--machine", "robot.toml", "--strategy", "planes", "-o", "p.csv")
    assert refused.status == 2
    assert "random, space-filling and axes" in refused.err


RTL = """HEADER::
File type: RTL
TARGET DATA::
Filetype: Linear
Target-count: 11
Targets :
0 40 80 120 160 200
240 280 320 360 400
Flags: 1 0 0
USER-TEXT::
Axis: x
RUNS::
Run-count: 6
DEVIATIONS::
Run Target Data:
"""


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_an_axis_in_small_letters_and_a_negative_backlash(command, sign):
    rng, lines = np.random.default_rng(2), []
    for run in range(1, 7):
        order = range(1, 12) if run % 2 else range(11, 0, -1)
        for k in order:
            error = 4.0 * np.sin(k / 2.0) - sign * 4.5 * (1 if run % 2 else -1) + rng.normal(0.0, 0.2)
            lines.append(f"{run} {k} {error:.3f}")
    Path("x.rtl").write_text(RTL + "\n".join(lines) + "\nEOF::\n")
    done = command("fit", "x.rtl", "--machine", "cframe", "--header", "u_um=0.3", "-o", "cal.json")
    assert done.status == 0, done.err
    text = re.sub(r"\s+", " ", done.out.decode() + done.err)
    assert ("the backlash of X is negative" in text) == (sign < 0.0)
    assert ("directions of the runs are exchanged" in text) == (sign < 0.0)
