"""A machine that drifts between parts, followed by touches of spheres, from the command line."""

from __future__ import annotations

import datetime
import json
import re
import threading
import time
from collections.abc import Callable, Iterable, Sequence
from itertools import cycle
from pathlib import Path

import msgspec
import pytest
from support.command import refusal, succeed

import ncomp
from kinematics.user_error import UserError

HEAD = "# machine: dmu50\n# instrument: touch-probe\n# u_um: 0.5\n# probe: 0 0 -150\n"
SPHERES = {"s1": (100.0, 20.0, 60.0), "left": (-200.0, 20.0, 60.0), "right": (200.0, 20.0, 60.0)}
SCATTER = 0.0, 0.3, -0.2, 0.1, -0.3, 0.2, -0.1
"""um, in each direction; what a probe repeats to."""
OUTPUT = ("--machine", "dmu50", "--calibration", "none", "-o", "now.json", "--json", "drift.json")
PROGRAM = "G21 G90 G54\nT1 M6\nG43 H1\nG0 X0 Y0 Z50\nG1 X60 F500\nM30\n"
Row = tuple[object, str, Sequence[float]]


@pytest.fixture(autouse=True)
def _folder(command: Callable[..., object]) -> None:
    """Every test is in a folder of its own."""


def log(
    rows: Iterable[Row],
    time: str = "time_s",
    temperature: Sequence[float] = (),
    extra: str = "",
    scatter: Sequence[float] = SCATTER,
) -> Path:
    """A log; each row has its time, its sphere, and the shift of the position where the tip was found, um."""
    found, used, off = [], [], cycle(scatter)
    for k, (moment, sphere, shift) in enumerate(rows):
        x, y, z = ((p + 1e-3 * (s + next(off))) for p, s in zip(SPHERES[sphere], shift, strict=True))
        warm = [f"{temperature[k]:.2f}"] if len(temperature) else []
        found.append(",".join([str(moment), f"{x:.5f}", f"{y:.5f}", f"{z + 150.0:.5f}", "0", "0", sphere, *warm]))
        used.append(sphere)
    spheres = [f"# sphere.{name}: {' '.join(map(str, SPHERES[name]))}" for name in dict.fromkeys(used)]
    names = f"{time},X,Y,Z,B,C,sphere" + ",temp_bed" * bool(len(temperature))
    path = Path("touches.csv")
    path.write_text(HEAD + extra + "\n".join([*spheres, names, *found]) + "\n")
    return path


def constant(shift: Sequence[float], count: int = 12) -> list[Row]:
    """Readings every 20 minutes of a machine that comes to a shift within two hours, and stays there."""
    shares = [0.0, 0.3, 0.55, 0.75, 0.87, 0.94, 0.98, *[1.0] * (count - 7)]
    return [(1200.0 * k, "s1", [share * each for each in shift]) for k, share in enumerate(shares)]


def drift() -> dict:
    """The results."""
    return json.loads(Path("drift.json").read_text())


def effects() -> list[dict]:
    """The effects of the calibration that was written."""
    return json.loads(Path("now.json").read_text())["effects"]


def test_a_zero_that_has_moved_is_found_and_the_next_program_goes_where_the_part_is():
    # the tip meets the sphere at X 10 um lower: for the same command it goes 10 um too far
    shown = succeed("drift", log(constant((-10.0, 0.0, 4.0))), *OUTPUT).shown
    assert "The machine has drifted by X +" in shown
    values = {each["name"]: each for each in drift()["parameters"]}
    assert values["E_X0X, zero of X"]["value"] == pytest.approx(10.0, abs=0.8)
    assert values["E_Z0Z, zero of Z"]["value"] == pytest.approx(-4.0, abs=0.8)
    assert 0.3 < values["E_X0X, zero of X"]["U"] < 1.6  # by the last reading alone: u 0.5 and its scatter
    x, _, z = (each["value"] for each in effects())
    Path("part.nc").write_text(PROGRAM)
    set_up = "--work-offset", "G54=-30,-20,150", "--tool-length", "T1=80", "--machine", "dmu50"
    # the work offset was touched off before: it does not contain the drift, and all moves go back by it
    succeed("part.nc", "--calibration", "now.json", *set_up, "-o", "part_c.nc", "--json", "part.json")
    words = dict(re.findall(r"([XZ])(\d\S*)", Path("part_c.nc").read_text()))
    assert float(words["X"]) == pytest.approx(60.0 - 1e-3 * x, abs=6e-4)
    assert float(words["Z"]) == pytest.approx(50.0 - 1e-3 * z, abs=6e-4)
    errors = json.loads(Path("part.json").read_text())["predicted_error_um"]["anywhere"]
    assert errors["before"] == pytest.approx((x**2 + z**2) ** 0.5, abs=0.2)
    assert errors["after"] < 1.0


def test_an_axis_grows_with_its_sensor_and_not_with_time():
    # 12 um/m/K: at X -200 and +200 the tip goes 2.4 um/K too far out; the bed warms up, and cools down
    warm = [*range(11), *range(9, -1, -1), *range(11)]
    rows = [
        (1200.0 * k + 60.0 * i, name, (-12.0 * SPHERES[name][0] * 1e-3 * kelvin, 0.0, 0.0))
        for k, kelvin in enumerate(warm) for i, name in enumerate(("left", "right"))
    ]  # fmt: skip
    temperatures = [20.0 + kelvin for kelvin in warm for _ in range(2)]
    path = log(rows, temperature=temperatures)
    succeed("drift", path, *OUTPUT)
    (sensor,) = drift()["sensors"]
    assert sensor["parameter"] == "scale of X"
    assert sensor["sensor"] == "bed"
    assert sensor["per_K"] == pytest.approx(12.0, abs=0.2)
    assert abs(sensor["per_K"] - 12.0) < sensor["U_per_K"]
    # five hours later, 4 K cooler than the last reading: the temperatures carry the prediction
    succeed("drift", path, *OUTPUT, "--at", rows[-1][0] + 5 * 3600, "--temperature", "bed=26")
    scale = next(each for each in drift()["parameters"] if each["name"] == "scale of X")
    assert scale["value"] == pytest.approx(12.0 * 6.0, abs=scale["U"])
    assert scale["U"] < 8.0


def test_an_uncertainty_grows_with_age_and_a_stale_log_changes_nothing():
    wander = [0.0, 3.0, -1.0, 4.0, 2.0, 6.0, 3.0, 8.0, 5.0, 9.0]
    path = log((3600.0 * k, "s1", (0.0, shift, 0.0)) for k, shift in enumerate(wander))
    succeed("drift", path, *OUTPUT)
    now = drift()
    succeed("drift", path, *OUTPUT, "--at", 9 * 3600 + 4 * 3600)
    later = drift()
    assert later["age_s"] == 4 * 3600
    assert later["U_um"] > 1.5 * now["U_um"]
    Path("now.json").unlink()
    message = refusal("drift", path, *OUTPUT, "--at", 13 * 3600, "--tolerance-um", "1")
    assert "4.0 h after the last plausible reading" in message
    assert "touch the sphere again" in message
    assert not Path("now.json").exists()
    # a day later the drift may have any sign: the calibration stays as it is
    shown = succeed("drift", path, *OUTPUT, "--at", 9 * 3600 + 86400 * 20).shown
    assert "nothing is corrected" in " ".join(shown.split())
    assert effects() == []


def test_a_drift_below_its_uncertainty_is_not_corrected():
    shown = succeed("drift", log(constant((0.0, 0.0, 0.0))), *OUTPUT).shown
    assert "nothing is corrected" in " ".join(shown.split())
    assert effects() == []
    assert drift()["corrected"] is False


def test_one_implausible_reading_changes_nothing_and_is_named():
    rows = constant((-10.0, 0.0, 0.0))
    succeed("drift", log(rows), *OUTPUT)
    before = drift()["places"][0]["drift_um"]
    path = log([*rows, (14400.0, "s1", (-10.0, 90.0, 0.0))])
    shown = succeed("drift", path, *OUTPUT).shown
    line = len(path.read_text().splitlines())
    assert f"line {line} is implausible" in " ".join(shown.split())
    assert drift()["places"][0]["drift_um"] == pytest.approx(before, abs=0.5)
    assert [each["line"] for each in drift()["implausible"]] == [line]


def test_readings_that_contradict_all_earlier_ones_are_refused():
    rows = constant((-10.0, 0.0, 0.0))
    path = log([*rows, (14400.0, "s1", (-10.0, 90.0, 0.0)), (15600.0, "s1", (-10.0, 90.0, 0.0))])
    message = refusal("drift", path, *OUTPUT)
    assert f"touches.csv:{len(path.read_text().splitlines()) - 1}" in message
    assert "knocked" in message
    assert not Path("now.json").exists()
    succeed("drift", path, *OUTPUT, "--accept-jumps")
    assert drift()["places"][0]["drift_um"][1] == pytest.approx(-90.0, abs=1.0)


@pytest.mark.parametrize("knock", [0.0, 20.0, 100.0])
def test_a_knock_is_not_hidden_by_the_walk_that_stands_for_a_sensor(knock: float):
    # the bed brings the tip 1.7 um/K to +Z; a walk that is large enough for the knock would explain that as well
    warm = [0.0, 4.5, 6.8, 8.2, 8.9, 9.4, 6.7, 3.2, 1.9, 6.0, 8.1, 9.1]
    rows = [(2400.0 * k, "s1", (0.0, 0.0, 1.7 * kelvin + knock * (k >= 5))) for k, kelvin in enumerate(warm)]
    path = log(rows, temperature=[20.4 + kelvin for kelvin in warm])
    if knock:
        message = refusal("drift", path, *OUTPUT)
        assert f"touches.csv:{len(path.read_text().splitlines()) - 6}:" in message
        assert "knocked" in message
    else:
        succeed("drift", path, *OUTPUT)
        assert [each["sensor"] for each in drift()["sensors"]] == ["bed"]


def test_a_knock_that_a_walk_explains_as_well_is_asked_for():
    # by itself the tip wanders by 3 um from one touch to the next, so that a step of 20 um may be a knock or a walk
    warm = [0.0, 4.5, 6.8, 8.2, 8.9, 9.4, 6.7, 3.2, 1.9, 6.0, 8.1, 9.1]
    wander = [0.0, 3.0, -1.0, 2.0, 5.0, 3.0, 6.0, 4.0, 1.0, 3.0, 0.0, 2.0]
    shifts = [1.7 * kelvin + off + 20.0 * (k >= 5) for k, (kelvin, off) in enumerate(zip(warm, wander, strict=True))]
    rows = [(2400.0 * k, "s1", (0.0, 0.0, shift)) for k, shift in enumerate(shifts)]
    path = log(rows, temperature=[20.4 + kelvin for kelvin in warm])
    message = refusal("drift", path, *OUTPUT)
    assert f"touches.csv:{len(path.read_text().splitlines()) - 6}:" in message
    assert "do not show whether" in message
    succeed("drift", path, *OUTPUT, "--accept-jumps")
    assert drift()["places"][0]["drift_um"][2] == pytest.approx(-shifts[-1], abs=3.0)


def test_a_new_run_keeps_what_was_learned_and_begins_a_new_reference():
    # the bed brings the tip 3 um/K forward in Y; after half of the readings the sphere is clamped again, 0.3 mm off
    warm = [*range(9), *range(7, -1, -1)] * 2
    rows = [(1200.0 * k, "s1", (300.0 * (k > 16), -3.0 * kelvin, 0.0)) for k, kelvin in enumerate(warm)]
    path = log(rows, temperature=[20.0 + kelvin for kelvin in warm])
    assert "knocked" in refusal("drift", path, *OUTPUT)
    lines = path.read_text().splitlines()
    first = next(k for k, line in enumerate(lines) if line.startswith("time_s"))
    runs = [f"{line},{1 + (k > 16)}" for k, line in enumerate(lines[first + 1 :])]
    path.write_text("\n".join([*lines[:first], lines[first] + ",run", *runs]) + "\n")
    succeed("drift", path, *OUTPUT, "--temperature", "bed=25", "--at", rows[-1][0] + 600)
    assert drift()["places"][0]["drift_um"][:2] == pytest.approx([0.0, 3.0 * (5.0 - warm[17])], abs=0.7)
    assert "last run" in refusal("drift", path, *OUTPUT, "--since", 1200)


def test_a_drift_counts_from_the_time_at_which_the_work_offset_was_touched_off():
    rows = [(1200.0 * k, "s1", (-1.0 * k, 0.0, 0.0)) for k in range(12)]
    succeed("drift", log(rows), *OUTPUT, "--since", 6 * 1200)
    assert drift()["places"][0]["drift_um"][0] == pytest.approx(5.0, abs=0.6)


def test_a_ring_shows_two_directions_and_the_third_stays_unknown():
    rows = constant((-10.0, 5.0, 300.0))
    succeed("drift", log(rows, extra="# shows.s1: X Y\n"), *OUTPUT)
    names = [each["name"] for each in drift()["parameters"]]
    assert names == ["E_X0X, zero of X", "E_Y0Y, zero of Y"]
    assert drift()["places"][0]["U_um"][2] is None
    assert "is no sphere" in refusal("fit", "touches.csv", "--machine", "dmu50", "-o", "cal.json")
    message = refusal("drift", log(rows, extra="# shows.s1: X K\n"), *OUTPUT)
    assert "directions of the workpiece frame" in message


def test_rotary_positions_show_the_shift_of_a_line():
    # a shift of the line of C is one of X while the table lies flat; once it swivels, the two differ
    from kinematics.effects import LocationJump
    from machines import load

    places = [(0, 0), (0, 180), (90, 0), (90, 180)] * 8
    rows = [f"{600.0 * k:.0f},{b},{c},{min(max(k - 4, 0) / 16, 1.0)}" for k, (b, c) in enumerate(places)]
    Path("touches.csv").write_text(of_line(load("dmu50"), LocationJump("X", "C", 8.0), rows))
    succeed("drift", "touches.csv", *OUTPUT)
    values = {each["name"]: each for each in drift()["parameters"]}
    line = values.pop("E_X0C, line of C")
    assert line["value"] == pytest.approx(8.0, abs=1.0)
    assert all(abs(each["value"]) < each["U"] for each in values.values())


@pytest.mark.parametrize(
    ("kind", "field", "size"), [("ToolShift", "Z", -16.0), ("ToolShift", "X", 16.0), ("Scale", "X", 48.0)]
)
def test_a_sphere_at_two_positions_of_a_head_shows_the_tool_and_what_grows(kind: str, field: str, size: float):
    # B0 and B90 have other positions of X and Z too: zeros and growth of both axes explain the places as well
    import numpy as np

    import kinematics.effects
    from kinematics.deviation import exact_deviation
    from kinematics.error_model.model import read_model
    from kinematics.state import State
    from machines import load

    machine, effect = load("head_table"), getattr(kinematics.effects, kind)(field, size)
    rows = [f"{3600.0 * k + 600.0 * i:.0f},{b},0,{k / 11}" for k in range(12) for i, b in enumerate((0, 90))]
    Path("touches.csv").write_text(of_line(machine, effect, rows))
    succeed("drift", "touches.csv", "--machine", "head_table", *OUTPUT[2:])
    model = read_model(Path("now.json"), machine)
    # a longer spindle, 16 um: X400 Z300 at B45 is off by 16/sqrt(2) um in X and in Z, at B90 by 16 um in X
    for b in (0.0, 45.0, 90.0):
        q = np.array([[{"X": 400.0, "Z": 300.0, "B": np.radians(b)}.get(axis, 0.0) for axis in machine.names]])
        tool = np.array([[0.0, 0.0, -100.0]])

        def error(*effects, at=q, tip=tool):
            own = msgspec.structs.replace(model, effects=effects, covariance=None)
            return 1e3 * exact_deviation(machine, at, own.errors(machine, State(at)), tip).position[0]

        design = np.column_stack([error(each.with_parameters([1.0])) for each in model.effects])
        u = np.sqrt(np.einsum("ip,pq,iq->i", design, np.array(model.covariance), design))
        off = error(*model.effects) - error(effect)
        assert np.all(np.abs(off) < 2.0 * u)
        assert np.all(2.0 * u < 6.0)
        if kind == "ToolShift" and field == "Z":
            own = 16.0 * np.sin(np.radians(b)), 16.0 * np.cos(np.radians(b))
            assert error(effect)[[0, 2]] == pytest.approx(np.negative(own), abs=0.01)


def of_line(machine, effect, rows: Sequence[str]) -> str:
    """A log of one sphere on the table; rows: time, B, C, and the share of the effect."""
    import numpy as np

    from kinematics.deviation import exact_deviation
    from kinematics.error_model.model import no_errors
    from kinematics.inverse import linear_positions
    from kinematics.state import State

    off = cycle(SCATTER)
    tip, centre, lines = np.array([[0.0, 0.0, -150.0]]), np.array([SPHERES["s1"]]), []
    for row in rows:
        time, b, c, size = row.split(",")
        q = np.zeros((1, 5))
        q[0, [machine.index("B"), machine.index("C")]] = np.radians([float(b), float(c)])
        q = linear_positions(machine, q, centre, tip)
        model = msgspec.structs.replace(
            no_errors(machine), effects=(effect.with_parameters([effect.parameters[0] * float(size)]),)
        )
        error = exact_deviation(machine, q, model.errors(machine, State(q)), tip).position
        q = linear_positions(machine, q, centre - error, tip)
        place = dict(zip(machine.names, q[0].tolist(), strict=True))
        cells = [f"{place[axis] + 1e-3 * next(off):.5f}" for axis in "XYZ"]
        lines.append(",".join([time, *cells, b, c, "s1"]))
    head = HEAD.replace("dmu50", machine.name)
    return head + "\n".join(["# sphere.s1: 100 20 60", "time_s,X,Y,Z,B,C,sphere", *lines]) + "\n"


OFFSETS = {
    "linuxcnc": "G10 L2 P2 X{x:.4f} Y",
    "fanuc": "G10 L2 P2 X{x:.4f} Y",
    "siemens": "$P_UIFR[2,X,TR]={x:.4f}",
    "heidenhain": "CYCL DEF 7.1 X{shift:+.4f}",
}


@pytest.mark.parametrize("dialect", OFFSETS)
def test_a_work_offset_moves_by_minus_the_drift(dialect: str):
    given = "--offsets", "zero.nc", "--dialect", dialect, "--work-offset", "G55=-30,-20,150"
    succeed("drift", log(constant((-10.0, 0.0, 4.0))), *OUTPUT, *given)
    program, shift = Path("zero.nc").read_text(), -1e-3 * drift()["places"][0]["drift_um"][0]
    assert shift == pytest.approx(-0.010, abs=0.0008)
    assert OFFSETS[dialect].format(x=-30.0 + shift, shift=shift) in program
    assert ("NOT TRIED ON A CONTROL" in program) == (dialect != "linuxcnc")
    if dialect in ("fanuc", "siemens"):  # their readers of tables of offsets share no code with it
        Path("part.nc").write_text(PROGRAM.replace("G54", "G55"))
        part = "part.nc", "--machine", "dmu50", "--calibration", "now.json", "--tool-length", "T1=80"
        succeed(*part, "--tool-table", "zero.nc", "-o", "part_c.nc", "--json", "part.json")
        (datum,) = json.loads(Path("part.json").read_text())["datum"]
        assert datum["position"]["X"] == pytest.approx(-30.0 + shift, abs=1e-4)
    assert ("IT LEAVES G21 G90 IN FORCE" in program) == ("G21 G90\n" in program) == (dialect in ("linuxcnc", "fanuc"))


def test_linuxcnc_itself_moves_the_zero_by_minus_the_drift(linuxcnc):
    given = "--offsets", "zero.ngc", "--work-offset", "G55=-30,-20,150"
    succeed("drift", log(constant((-10.0, 0.0, 4.0))), *OUTPUT, *given)
    shift = [-1e-3 * each for each in drift()["places"][0]["drift_um"]]
    program = Path("zero.ngc").read_text().replace("M30", "G55\nG0 X0 Y0 Z0\nM30")
    (move,) = linuxcnc.run(program).moves
    assert move.machine[:3] == pytest.approx(
        [o + s for o, s in zip((-30.0, -20.0, 150.0), shift, strict=True)], abs=1e-4
    )


def test_offsets_need_the_offset_as_it_was_touched_off():
    path = log(constant((-10.0, 0.0, 0.0)))
    assert "--work-offset" in refusal("drift", path, *OUTPUT, "--offsets", "zero.nc")
    assert not Path("now.json").exists()


def faulty(fault: str) -> tuple[Path, Sequence[str]]:
    """A log with a mistake, and words of its refusal."""
    rows = constant((-10.0, 0.0, 0.0))
    path = log(rows)
    text = path.read_text()
    last = text.splitlines()[-1]
    cells = last.split(",")
    changed, words = {
        "time goes back": (text.replace(last, ",".join(["5", *cells[1:]])), ("time is before",)),
        "no number": (text.replace(last, ",".join([cells[0], "nan", *cells[2:]])), ("column X",)),
        "machine": (text.replace("# machine: dmu50", "# machine: gantry"), ("'gantry'",)),
        "sphere": (text.replace(last, last.replace("s1", "s9")), ("'s9'", "header")),
        "inch": (
            text.replace(last, ",".join([cells[0], *(f"{float(c) / 25.4:.5f}" for c in cells[1:4]), *cells[4:]])),
            ("unit", "mm from the other readings"),
        ),
        "all in inch": (
            re.sub(
                r"(?m)^([\d.]+),(\S+?),(\S+?),(\S+?),",
                lambda row: ",".join([row[1], *(f"{float(each) / 25.4:.6f}" for each in row.groups()[1:]), ""]),
                text,
            ),
            ("inch and mm mixed up", "s1"),
        ),
        "unit": (text.replace("# u_um", "# unit: inch\n# u_um"), ("unit", "mm and degrees")),
        "few": ("\n".join(text.splitlines()[:-10]) + "\n", ("touch the sphere again",)),
        "no times": (text.replace("time_s,", "run,"), ("needs times",)),
    }[fault]
    path.write_text(changed)
    return path, words


FAULTS = "time goes back", "no number", "machine", "sphere", "inch", "all in inch", "unit", "few", "no times"


@pytest.mark.parametrize("fault", FAULTS)
def test_a_log_with_a_mistake_is_refused_in_words(fault: str):
    path, words = faulty(fault)
    message = refusal("drift", path, *OUTPUT)
    assert all(word in message for word in words), message
    assert not Path("now.json").exists()


def test_an_hour_of_summer_time_is_refused_until_the_zone_is_stated():
    stamps = [
        f"2026-10-25 {h:02d}:{m:02d}:00" for h, m in [(1, 20), (1, 40), (2, 0), (2, 20), (2, 40), (2, 0), (2, 20)]
    ]
    rows = [(stamp, "s1", (0.0 if k < 2 else -10.0, 0.0, 0.0)) for k, stamp in enumerate(stamps)]
    assert "zone" in refusal("drift", log(rows, "time"), *OUTPUT)
    path = log(rows, "time", extra="# zone: Europe/Berlin\n")
    succeed("drift", path, *OUTPUT, "--at", "2026-10-25 03:20:00")
    assert drift()["age_s"] == 3600.0
    assert "twice" in refusal("drift", path, *OUTPUT, "--at", "2026-10-25 02:30:00")


def dated(rows: Sequence[Row], last: datetime.datetime) -> None:
    """Write a log whose last reading is of this time."""
    stamps = [last + datetime.timedelta(seconds=float(row[0]) - float(rows[-1][0])) for row in rows]
    log(
        [(f"{stamp:%Y-%m-%d %H:%M:%S}", *row[1:]) for stamp, row in zip(stamps, rows, strict=True)],
        "time",
        extra="# zone: UTC\n",
    )


def watched(
    last: datetime.datetime,
    rows: Sequence[Row],
    calibration: str = "none",
    idle: float = 0.5,
    more: Sequence[str] = (),
    run_from: int | None = None,
) -> str:
    """What the terminal shows where a folder is watched with a log whose last reading is of this time."""
    dated(rows, last)
    if run_from is not None:
        lines = Path("touches.csv").read_text().splitlines()
        first = next(k for k, line in enumerate(lines) if line.startswith("time"))
        runs = [f"{line},{'ab'[k >= run_from]}" for k, line in enumerate(lines[first + 1 :])]
        Path("touches.csv").write_text("\n".join([*lines[:first], f"{lines[first]},run", *runs]) + "\n")
    Path("in").mkdir(exist_ok=True)
    Path("in/part.nc").write_text(PROGRAM)
    options = (
        "--machine",
        "dmu50",
        "--calibration",
        calibration,
        "--work-offset",
        "G54=-30,-20,150",
        "--tool-length",
        "T1=80",
    )
    ends = "--settle", "0.1", "--idle", idle
    return succeed("watch", "in", "out", *options, "--drift", "touches.csv", *more, *ends).shown


def test_watched_programs_are_corrected_for_the_drift():
    shown = watched(minutes_ago(2), constant((-10.0, 0.0, 0.0)))
    assert "The machine has drifted by X +" in shown
    effect = json.loads(Path("touches.drift.json").read_text())["effects"][0]
    assert shift_of("out/part.nc") == pytest.approx(-effect["value"], abs=0.6)


def test_programs_that_python_watches_are_corrected_for_the_drift_as_well():
    dated(constant((-10.0, 0.0, 0.0)), minutes_ago(2))
    Path("in").mkdir()
    Path("in/part.nc").write_text(PROGRAM)
    set_up = {"work_offset": ["G54=-30,-20,150"], "tool_length": ["T1=80"]}
    options = {"set_up": set_up, "settle": 0.1, "idle": 0.5, "drift": "touches.csv"}
    said: list[str] = []
    assert ncomp.watch("in", "out", "dmu50", "none", say=said.append, **options) == {"corrected": 1}
    effect = json.loads(Path("touches.drift.json").read_text())["effects"][0]
    assert shift_of("out/part.nc") == pytest.approx(-effect["value"], abs=0.6)
    assert any("The machine has drifted by X +" in line for line in said)
    with pytest.raises(UserError, match=r"known to 0\.001 um: touch the sphere again"):
        ncomp.watch("in", "new", "dmu50", "none", drift_tolerance_um=0.001, **options)
    del options["drift"]
    with pytest.raises(UserError, match=r'drift_since= is of the log of touches: give drift="LOG\.csv" too'):
        ncomp.watch("in", "new", "dmu50", "none", drift_since="2026-01-01", **options)


def test_the_drift_of_watched_programs_counts_from_the_touch_off():
    since = ("--drift-since", f"{minutes_ago(2 + 20 * 6):%Y-%m-%d %H:%M:%S}")
    watched(minutes_ago(2), WALK, more=since)
    assert shift_of("out/part.nc") == pytest.approx(-12.0, abs=1.5)
    watched(minutes_ago(2), WALK, more=since, run_from=11)  # of a new run its own first reading
    assert shift_of("out/part.nc") == pytest.approx(-6.0, abs=1.5)
    with pytest.raises(UserError, match="lies in the future: correct it, or the clock"):
        watched(minutes_ago(2), WALK, more=("--drift-since", "2099-01-01 10:00:00"))


def test_no_program_is_corrected_where_the_drift_is_not_known_well_enough():
    with pytest.raises(UserError, match="it has to be known to 5 um: touch the sphere again"):
        watched(minutes_ago(600), WALK, more=("--drift-tolerance-um", "5"))
    assert not Path("out/part.nc").exists()
    watched(minutes_ago(2), WALK, more=("--drift-tolerance-um", "5"))
    assert shift_of("out/part.nc") == pytest.approx(-28.0, abs=1.5)


@pytest.mark.parametrize("words", [("--drift-since", "2026-01-01 10:00:00"), ("--drift-tolerance-um", "3")])
def test_options_of_the_log_need_it(words):
    Path("in").mkdir()
    message = refusal("watch", "in", "out", "--machine", "dmu50", "--calibration", "none", *words)
    assert "give --drift LOG.csv too" in message
    Path("job.toml").write_text('machine = "dmu50"\ncalibration = "none"\n[programs]\n"in/a.nc" = "out/a.nc"\n')
    assert "nor --drift" in refusal("watch", "job.toml", *words)


def minutes_ago(minutes: float) -> datetime.datetime:
    """A time before now."""
    return datetime.datetime.now(datetime.UTC) - datetime.timedelta(minutes=minutes)


def shift_of(program: str) -> float:
    """The correction of X in a corrected program, um."""
    (x,) = re.findall(r"G1 X(\S+)", Path(program).read_text())
    return 1e3 * (float(x) - 60.0)


WALK = [(1200.0 * k, "s1", (-2.0 * k, 0.0, 0.0)) for k in range(15)]
"""The tip goes 2 um too far in 20 minutes."""


def beside(act: Callable[[], None]) -> threading.Thread:
    """Act once the first program is corrected."""

    def wait_and_act() -> None:
        end = time.monotonic() + 30.0
        while not Path("out/part.nc").exists() and time.monotonic() < end:
            time.sleep(0.02)
        act()

    thread = threading.Thread(target=wait_and_act)
    thread.start()
    return thread


def touch_again() -> None:
    """Three more touches, and the next program."""
    dated(WALK, minutes_ago(2))
    Path("in/next.nc").write_text(PROGRAM)


def test_the_next_program_is_corrected_for_the_touches_since_the_last_one():
    thread = beside(touch_again)
    watched(minutes_ago(62), WALK[:12], idle=2.0)
    thread.join()
    assert shift_of("out/part.nc") == pytest.approx(-22.0, abs=1.5)
    assert shift_of("out/next.nc") == pytest.approx(-28.0, abs=1.5)


def test_a_drift_that_cannot_be_written_corrects_no_program_until_it_can():
    away = Path("away")

    def lose_the_drive() -> None:
        Path("drive").rename(away)
        touch_again()
        time.sleep(0.6)
        assert not Path("out/next.nc").exists()
        away.rename("drive")

    Path("drive").mkdir()
    Path("touches.drift.json").symlink_to("drive/now.json")
    thread = beside(lose_the_drive)
    shown = watched(minutes_ago(62), WALK[:12], idle=2.0)
    thread.join()
    assert "cannot write touches.drift.json" in shown
    assert shift_of("out/next.nc") == pytest.approx(-28.0, abs=1.5)


def test_watching_begins_again_beside_the_drift_of_before():
    watched(minutes_ago(62), WALK[:12])
    watched(minutes_ago(2), WALK)
    assert shift_of("out/part.nc") == pytest.approx(-28.0, abs=1.5)


def test_another_file_of_the_name_of_the_drift_stays():
    Path("touches.drift.json").write_text("{}")
    with pytest.raises(UserError, match="rename the file that is there"):
        watched(minutes_ago(2), WALK)
    assert Path("touches.drift.json").read_text() == "{}"


def test_a_drift_is_not_added_to_a_calibration_that_has_it():
    succeed("drift", log(WALK), *OUTPUT)
    again = "--machine", "dmu50", "--calibration", "now.json", "-o", "twice.json"
    message = refusal("drift", "touches.csv", *again)
    assert "calibration now.json has a drift already (drift by touches.csv)" in message
    assert "give the calibration without the drift" in message
    assert not Path("twice.json").exists()
    with pytest.raises(UserError, match="give the calibration without the drift"):
        watched(minutes_ago(2), WALK, "now.json")
    assert not Path("out").exists() or not list(Path("out").iterdir())


def test_a_drift_is_no_lasting_error_of_the_machine():
    from support.history_cases import calibration, entries

    calibration(Path("cal.json"), machine="dmu50")
    succeed("drift", log(WALK), "--machine", "dmu50", "--calibration", "cal.json", "-o", "now.json")
    found = json.loads(succeed("compare", "cal.json", "now.json", "--json", "-").out)
    assert found["volume"]["difference_um"]["rms"] == 0.0
    assert any("E_X0X of B: has come since the touch-off" in each for each in found["not_compared"])
    figures = []
    for name in ("cal.json", "now.json"):
        succeed("history", "add", "dmu50", name, "--db", f"{name}.db")
        (entry,) = entries(f"{name}.db", "dmu50")
        figures.append(entry["figures"])
    assert figures[0]
    assert figures[0] == figures[1]
    succeed("drift", "touches.csv", "--machine", "dmu50", "--calibration", "none", "-o", "alone.json")
    succeed("history", "add", "dmu50", "alone.json", "--db", "alone.db")
    (entry,) = entries("alone.db", "dmu50")
    assert entry["figures"] == []


def test_a_stale_log_leaves_watched_programs_as_they_are():
    shown = watched(minutes_ago(60 * 24 * 60), constant((-10.0, 0.0, 0.0)))
    assert "nothing is corrected" in shown
    assert not Path("touches.drift.json").exists()
    assert "X60 F500" in Path("out/part.nc").read_text()


def test_the_zone_of_a_watched_log_has_to_be_stated():
    Path("in").mkdir()
    path = log(constant((-10.0, 0.0, 0.0)))
    message = refusal("watch", "in", "out", "--machine", "dmu50", "--calibration", "none", "--drift", path)
    assert "# zone: Europe/Berlin" in message
