"""Plans for ranges alone: stations, targets and positions together, and the plan as an input of the next steps."""

import json
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest

from calibration.optimal.set_ups import SetUps, best_set_ups
from kinematics.state import State

MACHINE = """\
name = "centre"
chain = "w b X Y Z t"
[axes.X]
travel = [0, 1500]
[axes.Y]
travel = [0, 1000]
[axes.Z]
travel = [0, 800]
"""
TARGETS = ("--target", "t1=80,0,-100", "--target", "t2=-60,70,-150", "--target", "t3=-60,-70,-250")
PLAN = ("plan", "optimised", "--machine", "centre.toml", "--instrument", "ranging", *TARGETS)
QUICK = (*PLAN, "--candidates", "100")
THREE = ("-360,500,-60", "760,-370,700", "760,1370,700")


@pytest.fixture
def planned(command):
    """The plan of three given places, 45 ranges, with its results and its program."""
    Path("centre.toml").write_text(MACHINE)
    places = [word for place in THREE for word in (f"--tracker={place}",)]
    done = command(
        *QUICK, "--points", 45, "--stations", 3, *places, "-o", "plan.csv", "--nc", "plan.nc", "--json", "plan.json"
    )
    assert done.status == 0, done.err
    return done


def rows_of(path: str) -> tuple[list[str], list[list[str]]]:
    """Names of the columns, and the cells of the rows."""
    lines = [line for line in Path(path).read_text().splitlines() if not line.startswith("#")]
    return lines[0].split(","), [line.split(",") for line in lines[1:]]


@pytest.mark.usefixtures("planned")
def test_the_plan_has_its_stations_and_the_program_stops_at_each():
    text = Path("plan.csv").read_text()
    assert [line for line in text.splitlines() if line.startswith("# station.")] == [
        "# station.s1: -360.0 500.0 -60.0", "# station.s2: 760.0 -370.0 700.0", "# station.s3: 760.0 1370.0 700.0"
    ]  # fmt: skip
    names, rows = rows_of("plan.csv")
    station = [row[names.index("station")] for row in rows]
    assert len(rows) == 45
    assert station == sorted(station)
    assert min(station.count(name) for name in ("s1", "s2", "s3")) >= 10
    found = json.loads(Path("plan.json").read_text())
    assert found["instrument"] == "ranging"
    assert found["stations"]["s2"] == [760.0, -370.0, 700.0]
    assert found["not_visible"] == []
    program = Path("plan.nc").read_text()
    assert program.count("AND THE PATH TO THE FIRST POSITION IS CLEAR") == 3
    assert "GO ON WHEN STATION S2 AND TARGET" in program
    assert program.count("\nM0") == len([line for line in program.splitlines() if "GO ON WHEN STATION" in line])


@pytest.mark.usefixtures("planned")
def test_simulate_and_fit_read_the_plan(command):
    done = command(
        "simulate", "--machine", "centre.toml", "--strategy", "plan.csv", "--errors", "none",
        "--effect", "location:component=C,axis=Y,value=30", "-o", "ranges.csv",
    )  # fmt: skip
    assert done.status == 0, done.err
    assert "45 observations by ranging" in done.err
    assert "# station.s1: -360.0 500.0 -60.0" in Path("ranges.csv").read_text()
    # the plan with the column of the ranges is a measurement file as well
    head = [line for line in Path("plan.csv").read_text().splitlines() if line.startswith("#")]
    names, rows = rows_of("plan.csv")
    others, read = rows_of("ranges.csv")
    lines = [",".join([*row, own[others.index("range_mm")]]) for row, own in zip(rows, read, strict=True)]
    Path("own.csv").write_text("\n".join([*head, ",".join([*names, "range_mm"]), *lines]) + "\n")
    for file in ("ranges.csv", "own.csv"):
        done = command("fit", file, "--machine", "centre.toml", "--basis", "legendre:1", "-o", "c.json", "--json", "-")
        assert done.status == 0, done.err
        (square,) = [each for each in json.loads(Path("c.json").read_text())["effects"] if each.get("value")][:1]
        assert square["value"] == pytest.approx(30.0, abs=4.0 * square["u"][0])
        assert "unknown, and ignored" not in done.err


@pytest.mark.usefixtures("planned")
def test_real_places_replace_the_planned_ones_one_by_one(command):
    simulate = ("simulate", "--machine", "centre.toml", "--strategy", "plan.csv", "-o", "ranges.csv")
    real = ("-330,510,-50", "750,-400,690", "770,1390,720")
    done = command(*simulate, *(f"--tracker={place}" for place in real))
    assert done.status == 0, done.err
    assert "# station.s3: 770.0 1390.0 720.0" in Path("ranges.csv").read_text()
    Path("ranges.csv").unlink()
    done = command(*simulate, f"--tracker={real[0]}")
    assert done.status == 2
    assert "the plan has the stations s1, s2, s3, but 1 positions of the instrument" in done.err
    assert not Path("ranges.csv").exists()


@pytest.mark.usefixtures("planned")
def test_a_station_without_its_position_is_refused(command):
    plan = Path("plan.csv")
    plan.write_text(plan.read_text().replace("# station.s2: 760.0 -370.0 700.0\n", ""))
    done = command("simulate", "--machine", "centre.toml", "--strategy", "plan.csv", "-o", "ranges.csv")
    assert done.status == 2
    assert "'s2' is not in the header: state its position (# station.s2: x y z)" in done.err


@pytest.mark.usefixtures("planned")
def test_a_study_measures_the_plan(command):
    case = 'name = "{0}"\nstrategy = "{1}"\n'
    Path("study.toml").write_text(
        'machine = "centre.toml"\ndraws = 2\ncheck_draws = 0\n[fit]\nbasis = "legendre:3"\n'
        '[instrument]\nkind = "ranging"\nu_range_um = 0.2\nu_range_um_per_m = 0.3\n[[case]]\n'
        + case.format("plan", "plan.csv")
    )
    done = command("study", "study.toml", "-o", "results.csv")
    assert done.status == 0, done.err
    names, (row,) = rows_of("results.csv")
    assert row[names.index("points")] == "45"
    minutes = json.loads(Path("plan.json").read_text())["minutes"]
    assert float(row[names.index("minutes")]) == pytest.approx(minutes, abs=0.1)


def test_two_stations_are_planned_and_what_stays_hidden_is_named(command):
    Path("centre.toml").write_text(MACHINE)
    done = command(
        *QUICK,
        "--points",
        40,
        "--stations",
        2,
        *(f"--tracker={p}" for p in THREE[:2]),
        "-o",
        "plan.csv",
        "--json",
        "plan.json",
    )
    assert done.status == 0, done.err
    hidden = json.loads(Path("plan.json").read_text())["not_visible"]
    assert hidden
    assert all("one more station" in each["remedy"] for each in hidden)
    assert "NOT VISIBLE" in done.err
    assert hidden[0]["effects"][0] in done.err


@pytest.mark.statistical
def test_planned_stations_leave_less_than_those_at_the_corners(command):
    Path("centre.toml").write_text(MACHINE)
    corners = [f"--tracker={x},{y},-60" for x in (-360, 1880) for y in (-370, 1370)]
    expected = []
    for places in ([], corners):
        done = command(*PLAN, "--candidates", 400, "--points", 200, *places, "-o", "plan.csv", "--json", "plan.json")
        assert done.status == 0, done.err
        found = json.loads(Path("plan.json").read_text())
        assert len(found["stations"]) == 4
        expected.append(found["expected_um"])
    assert expected[0] < 0.95 * expected[1]


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--stations", 3, *(f"--tracker={p}" for p in THREE[:2])], "3 stations are wanted, but only 2 places are given"),
        (["--stations", 1, "--tracker=700,500,300"], "--tracker 700,500,300 is inside the volume of the targets"),
        (["--stations", 2, "--obstacle", "x=-9e9:9e9"], "leave 0 of 48 places with a line of sight, and 2 are needed"),
        (["--beam-mm", "1:200"], "leave 0 of 48 places with a line of sight, and 4 are needed"),
        (["--beam-mm", "500:200"], "--beam-mm 500:200: it must go from a shorter to a longer distance"),
        (["--targets", 4], "4 targets are wanted, but only 3 are given"),
        ([*(f"--tracker={p}" for p in THREE), "--stations", 3, "--points", 29], "at least 30, 10 for each station"),
    ],
)  # fmt: skip
def test_what_cannot_be_planned_is_refused(command, options, said):
    Path("centre.toml").write_text(MACHINE)
    points = [] if "--points" in options else ["--points", 60]
    done = command(*QUICK, *points, *options, "-o", "plan.csv")
    assert done.status == 2
    assert said in " ".join(done.err.split())
    assert not Path("plan.csv").exists()


def test_set_ups_are_those_of_all_combinations_with_the_registrations_eliminated():
    """Two rows a set-up; the registration of a station is one column, eliminated in the whole normal equations."""
    rng = np.random.default_rng(4)
    stations, targets, p = ("a", "b", "c", "d"), ("u", "v", "w"), 4
    names = [(s, t) for s in stations for t in targets for _ in range(2)]
    rows = np.zeros((len(names), 1, len(stations) + p))
    for row, (station, _) in zip(rows, names, strict=True):
        row[0, stations.index(station)] = rng.normal()
        row[0, len(stations) :] = rng.normal(size=p)
    prior = np.diag([1e-12] * len(stations) + [1.0] * p)
    evaluated = np.zeros_like(prior)
    evaluated[4:, 4:] = np.diag([1.0, 2.0, 3.0, 4.0])
    station, target = (np.array(each) for each in zip(*names, strict=True))
    state = State(np.zeros((len(names), 1)), station=station, target=target)
    set_ups = SetUps(state, rows, slice(4, None), prior, evaluated)

    def variance(some: tuple[str, ...], used: tuple[str, ...]) -> float:
        mine = rows[np.isin(station, some) & np.isin(target, used), 0]
        information = prior + mine.T @ mine * (24 / (len(some) * len(used)) / 2)
        return float(np.trace(evaluated @ np.linalg.inv(information)))

    found = best_set_ups(set_ups, stations, targets, (2, 2), 24)
    least = min((variance(s, t), s, t) for s in combinations(stations, 2) for t in combinations(targets, 2))
    assert set_ups.variance(*found, 24) == pytest.approx(variance(*found), rel=1e-5)
    assert variance(*found) <= least[0] * 1.1
