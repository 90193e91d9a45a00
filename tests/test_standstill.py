"""Standstills in a tracker's stream: every position of the plan that was measured is found, and no other."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.command import refusal, succeed
from support.three_points_cases import SERIES, TARGETS, locations, model, random_effects, rows, station
from support.tiers import quick
from support.tracker_logs import Log, Stop, header, log_of, write

import machines
from calibration.measurement.file import read_measurement
from calibration.measurement.measurement import Measurement
from calibration.measurement.plan import Plan
from calibration.measurement.plan_file import read_plan
from calibration.measurement.readers import read_any
from calibration.measurement.written_file import write_measurement
from calibration.simulation.simulate import tracker_pose
from calibration.simulation.true_model import random_true_model
from kinematics.machine import Machine
from kinematics.transforms import Array
from kinematics.user_error import UserError

BZT = machines.load("bzt_pfu")
DMU50 = machines.load("dmu50")


def planned(folder: Path, machine: Machine, *options: str) -> Plan:
    """A plan as the command writes it, read again."""
    path = folder / "plan.csv"
    succeed("plan", "--machine", machine.name, *options, "-o", path)
    return read_plan(path, machine)


def stops_of(plan: Plan, rng: np.random.Generator, shortest: float = 0.4, longest: float = 1.6) -> list[Stop]:
    assert plan.state.target is not None
    positions = plan.positions / plan.machine.scale
    return [
        Stop(position, str(target), float(rng.uniform(shortest, longest)))
        for position, target in zip(positions, plan.state.target, strict=True)
    ]


def recorded(plan: Plan, stops: list[Stop], seed: int = 5, **options: object) -> Log:
    rng = np.random.default_rng(seed)
    truth, pose = random_true_model(plan.machine, rng), tracker_pose((-900.0, 700.0, 200.0), rng)
    return log_of(plan.machine, truth, stops, plan.targets, pose, rng, speed=800.0, **options)  # type: ignore[arg-type]


def read(folder: Path, plan: Plan, log: Log, **columns: object) -> Measurement:
    path = write(folder / "log.csv", log.text(header(plan.machine), **columns))  # type: ignore[arg-type]
    return read_any(path, plan.machine, plan=folder / "plan.csv")


def found_rows(measurement: Measurement, positions: Array) -> list[int]:
    """Row of the plan of each row of the measurement, by its positions and in order."""
    found, start = [], 0
    for own in measurement.state.positions:
        start = next(i for i in range(start, len(positions)) if np.allclose(positions[i], own, atol=1e-9)) + 1
        found.append(start - 1)
    return found


def listed(measurement: Measurement, what: str) -> list[str]:
    return [note for note in measurement.notes if note.startswith(what)]


@pytest.mark.parametrize("seed", quick(range(6), [0], [1, 2]))
def test_all_positions_are_found_and_none_is_false(tmp_path: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    strategies = ("random", "hexahedron", "grid", "space-diagonals", "random", "planes")
    target = ("--target", "t1=0,0,-60", "--target", "t2=30,20,-90")
    plan = planned(tmp_path, BZT, "--strategy", strategies[seed], "--points", "24", "--seed", str(seed), *target)
    stops, expected, foreign = [], [], 0
    whole = stops_of(plan, rng)
    kinds = rng.choice(["", "skipped", "foreign", "broken", "settles"], len(whole), p=[0.5, 0.1, 0.1, 0.2, 0.1])
    kinds[[0, -1]] = ""
    changes = {"settles": {"dwell": 1.2, "settle": 0.1}, "broken": {"dwell": 1.0, "broken": (0.4, 0.6)}}
    for i, (own, kind) in enumerate(zip(whole, kinds.tolist(), strict=True)):
        if kind == "skipped":
            continue
        expected.append(i)
        stop = replace(own, broken_before=i > 0 and own.target != whole[i - 1].target)
        if kind == "foreign":
            foreign += 1
            stops.append(replace(stop, position=np.array(stop.position) + 7.3, dwell=1.0))
        stops.append(replace(stop, **changes.get(kind, {})))  # type: ignore[arg-type]
    measurement = read(tmp_path, plan, recorded(plan, stops, rate=1000.0))
    assert found_rows(measurement, plan.positions) == expected
    assert len(listed(measurement, "position without a standstill")) == len(whole) - len(expected)
    assert len(listed(measurement, "standstill that is not in the plan")) == foreign
    assert not listed(measurement, "not certain")


def test_means_are_those_of_the_stands_and_their_scatter_covers_them(tmp_path: Path) -> None:
    plan = planned(tmp_path, BZT, "--strategy", "random", "--points", "24", "--target", "t1=0,0,-60")
    stops = stops_of(plan, np.random.default_rng(1))
    measurement = read(tmp_path, plan, recorded(plan, stops, rate=1000.0, reading_um=8.0, vibration_um=0.0))
    true = read(tmp_path, plan, recorded(plan, stops, rate=1000.0, reading_um=1e-9, vibration_um=0.0))
    assert measurement.scatter is not None
    away = (measurement.observed - true.observed) / measurement.scatter[:, None]
    assert 0.75 < np.sqrt(np.mean(away**2)) < 1.35
    assert np.median(measurement.scatter) * 1e3 < 8.0 / np.sqrt(150.0)


def test_a_position_visited_twice_that_the_plan_has_once_is_listed_and_left_out(tmp_path: Path) -> None:
    plan = planned(tmp_path, BZT, "--strategy", "random", "--points", "12", "--target", "t1=0,0,-60")
    stops = stops_of(plan, np.random.default_rng(1))
    there = replace(stops[4], position=np.array(stops[4].position) + 20.0, dwell=0.0)
    measurement = read(tmp_path, plan, recorded(plan, [*stops[:5], there, *stops[4:]]))
    assert found_rows(measurement, plan.positions) == [0, 1, 2, 3, 5, 6, 7, 8, 9, 10, 11]
    assert "position R5 " in listed(measurement, "not certain")[0]


def test_a_position_that_the_plan_has_twice_is_found_twice(tmp_path: Path) -> None:
    plan = planned(
        tmp_path, BZT, "--strategy", "random", "--points", "12", "--references", "3", "--target", "t1=0,0,-60"
    )
    measurement = read(tmp_path, plan, recorded(plan, stops_of(plan, np.random.default_rng(1))))
    assert found_rows(measurement, plan.positions) == list(range(len(plan)))


def test_creeping_is_no_stand(tmp_path: Path) -> None:
    plan = planned(tmp_path, BZT, "--strategy", "random", "--points", "12", "--target", "t1=0,0,-60")
    stops = stops_of(plan, np.random.default_rng(1))
    stops[3], stops[7] = (replace(stops[i], dwell=2.0, creep=speed) for i, speed in ((3, 0.04), (7, 0.012)))
    measurement = read(tmp_path, plan, recorded(plan, stops))
    assert found_rows(measurement, plan.positions) == [0, 1, 2, 4, 5, 6, 8, 9, 10, 11]
    assert listed(measurement, "slow motion")
    assert len(listed(measurement, "position without a standstill")) == 2


def test_rows_after_a_missing_position_do_not_claim_a_side_of_approach(tmp_path: Path) -> None:
    options = ("--strategy", "grid", "--points", "18", "--target", "t1=0,0,-60")
    plan = planned(tmp_path, BZT, *options, "--approach", "positive")
    stops = stops_of(plan, np.random.default_rng(1))
    moved = np.flatnonzero(plan.positions[5] != plan.positions[4])
    measurement = read(tmp_path, plan, recorded(plan, stops))
    assert measurement.state.approach is not None
    assert np.array_equal(measurement.state.approach, plan.state.approach)
    away = replace(stops[5], position=np.array(stops[5].position) + 11.0)
    measurement = read(tmp_path, plan, recorded(plan, [*stops[:5], away, *stops[5:]]))
    assert measurement.state.approach is not None
    assert np.all(measurement.state.approach[5][moved] == 0.0)


def test_a_line_that_may_begin_at_another_position_is_refused_with_both_names(tmp_path: Path) -> None:
    plan = planned(tmp_path, BZT, "--strategy", "axes", "--spacing", "50", "--range", "Y=0", "--range", "Z=0")
    rows_of_x = [i for i, name in enumerate(plan.names.tolist()) if name.startswith("X")]
    lines = (tmp_path / "plan.csv").read_text().splitlines()
    top = next(i for i, line in enumerate(lines) if not line.startswith("#"))
    forward = rows_of_x[: len(rows_of_x) // 2]
    write(tmp_path / "plan.csv", "\n".join([*lines[: top + 1], *(lines[top + 1 + i] for i in forward)]) + "\n")
    plan = read_plan(tmp_path / "plan.csv", BZT)
    stops = stops_of(plan, np.random.default_rng(1))
    assert len(read(tmp_path, plan, recorded(plan, stops))) == len(stops)
    with pytest.raises(
        UserError, match=r"several possible assignments to the plan: .* may be position X\.\d+ .* or position X"
    ):
        read(tmp_path, plan, recorded(plan, stops[1:]))


def test_readings_without_a_beam_are_left_out(tmp_path: Path) -> None:
    plan = planned(tmp_path, BZT, "--strategy", "random", "--points", "12", "--target", "t1=0,0,-60")
    log = recorded(plan, stops_of(plan, np.random.default_rng(1)), rate=1000.0)
    points = log.points.copy()
    points[4000:4400] = 0.0
    points[9000:9300] = points[8999]
    measurement = read(tmp_path, plan, replace(log, points=points))
    assert any("700 readings without a beam" in note or "699 readings" in note for note in measurement.notes)
    whole = read(tmp_path, plan, log)
    both = set(found_rows(measurement, plan.positions))
    assert len(both) >= len(plan) - 2
    kept = [i for i, row in enumerate(found_rows(whole, plan.positions)) if row in both]
    np.testing.assert_allclose(measurement.observed, whole.observed[kept], atol=2e-3)


def test_fit_takes_a_log_and_its_plan(tmp_path: Path) -> None:
    options = ("--strategy", "random", "--points", "24", "--target", "t1=0,0,-60", "--target", "t2=40,30,-90")
    plan = planned(tmp_path, BZT, *options)
    log = write(tmp_path / "log.csv", recorded(plan, stops_of(plan, np.random.default_rng(1), 0.4, 0.8)).text(
        header(BZT)
    ))  # fmt: skip
    command = ["fit", str(log), "--machine", "bzt_pfu", "--plan", str(tmp_path / "plan.csv"), "--basis", "legendre:2"]
    command += ["-o", str(tmp_path / "cal.json"), "--json", str(tmp_path / "fit.json"), "--no-hold-out"]
    done = succeed(*command)
    assert "48 of 48 positions of the plan found" in " ".join(done.shown.split())
    found = json.loads((tmp_path / "fit.json").read_text())
    assert found["after"]["rms_um"] < 0.5 * found["before"]["rms_um"]


def test_three_points_takes_a_log_and_its_plan(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    for axis in "XC":
        monkeypatch.setitem(SERIES, axis, SERIES[axis][::2])
    truth = model(DMU50, random_effects(3, axes="XC") + locations({"C0Y": 12.0}))
    positions, names, runs = rows(DMU50, "XC", ["1"], TARGETS)
    positions = np.round(positions, 4)
    rng = np.random.default_rng(3)
    lines = ["# machine: dmu50"]
    for name, target in TARGETS.items():
        on_tool = target.carrier == "tool"
        guess = np.array(target.position) + (0.0 if on_tool else np.round(rng.uniform(-8, 8, 3)))
        lines.append(f"# {'target' if on_tool else 'table'}.{name}: {' '.join(map(str, guess))}")
    lines += [",".join([*DMU50.names, "target", "run"])]
    for place, name, run in zip(positions, names, runs, strict=True):
        lines.append(",".join([*(f"{v:.4f}" for v in place), name, run]))
    write(tmp_path / "plan.csv", "\n".join(lines) + "\n")
    stops = [
        Stop(p, str(n), float(rng.uniform(0.4, 0.9)), broken_before=i > 0 and n != names[i - 1])
        for i, (p, n) in enumerate(zip(positions, names, strict=True))
    ]
    pose = station((800.0, -850.0, -650.0), 0.4)
    taken = log_of(DMU50, truth, stops, TARGETS, pose, rng, speed=400.0, stands_on="bed", reading_um=1.0)
    log = write(tmp_path / "log.csv", taken.text(header(DMU50, "bed")))
    command = ["three-points", str(log), "--machine", "dmu50", "--plan", str(tmp_path / "plan.csv")]
    done = succeed(*command, "-o", tmp_path / "cal.json", "--json", tmp_path / "r.json")
    assert f"{len(stops)} of {len(stops)} positions of the plan found" in " ".join(done.shown.split())


def test_scatter_counts_as_far_as_it_exceeds_the_sheet(tmp_path: Path) -> None:
    head = "\n".join(f"# {key}: {value}" for key, value in header(BZT).items())
    body = "X,Y,Z,x,y,z,scatter_um\n0,0,0,1000,0,0,0.1\n10,0,0,1010,0,0,50\n20,0,0,1020,0,0,0\n"
    measurement = read_measurement(write(tmp_path / "data.csv", f"{head}\n{body}"), BZT)
    sheet = replace(measurement, scatter=None).covariances
    own = measurement.covariances
    np.testing.assert_array_equal(own[[0, 2]], sheet[[0, 2]])
    assert np.trace(own[1]) / 3.0 == pytest.approx(0.05**2)
    with (tmp_path / "again.csv").open("wb") as file:
        write_measurement(measurement, file)
    again = read_measurement(tmp_path / "again.csv", BZT)
    assert again.scatter is not None
    np.testing.assert_array_equal(again.scatter, measurement.scatter)


def test_a_log_that_is_not_of_the_plan_is_refused(tmp_path: Path) -> None:
    plan = planned(tmp_path, BZT, "--strategy", "random", "--points", "12", "--target", "t1=0,0,-60")
    rng = np.random.default_rng(1)
    stops = stops_of(plan, rng)
    log = recorded(plan, stops)
    with pytest.raises(UserError, match="if the log were in inch: mm are expected"):
        read(tmp_path, plan, replace(log, points=log.points / 25.4))
    elsewhere = [replace(stop, position=np.array(stop.position) + rng.uniform(-60, 60, 3)) for stop in stops]
    with pytest.raises(UserError, match="check that log, plan and machine belong together"):
        read(tmp_path, plan, recorded(plan, elsewhere))
    with pytest.raises(UserError, match="10 or more readings per second"):
        read(tmp_path, plan, log.kept(np.arange(len(log.time)) % 200 == 0))
    with pytest.raises(UserError, match="the time decreases after"):
        read(tmp_path, plan, replace(log, time=np.where(log.time > 5.0, log.time - 1.0, log.time)))
    with pytest.raises(UserError, match="no standstill of the target"):
        read(tmp_path, plan, recorded(plan, [replace(stop, dwell=0.05) for stop in stops]))


def test_a_plan_goes_with_a_log_and_not_with_a_path_or_positions(tmp_path: Path) -> None:
    plan = planned(tmp_path, BZT, "--strategy", "random", "--points", "12", "--target", "t1=0,0,-60")
    log = write(tmp_path / "log.csv", recorded(plan, stops_of(plan, np.random.default_rng(1))).text(header(BZT)))
    given = ["--machine", "bzt_pfu", "--plan", str(tmp_path / "plan.csv"), "-o", str(tmp_path / "cal.json")]
    path = write(tmp_path / "path.nc", "G53 G1 X0 Y0 Z0 F1000\nG53 G1 X100\nM2\n")
    assert "--plan is for measurements at standstill" in refusal("fit", log, *given, "--path", path)
    head = "\n".join(f"# {key}: {value}" for key, value in header(BZT).items())
    data = write(tmp_path / "data.csv", f"{head}\nX,Y,Z,x,y,z\n0,0,0,1000,0,0\n")
    assert "a tracker's log with the columns" in refusal("fit", data, *given)
    assert "--plan PLAN.csv" in refusal("fit", log, *given[:2], *given[4:])
