"""Ranges alone: files, stations and dead lengths without a guess, air, fits by the command, and what stays hidden."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.command import refusal, succeed
from support.tiers import quick

import ncomp
from benchmarks import ranging as benchmark
from calibration.instruments.ranging.air import refractive_index
from calibration.instruments.ranging.multilateration import located
from kinematics.error_model.model import read_model

MACHINE = 'name = "centre"\nchain = "w b X Y Z t"\n' + "".join(
    f"[axes.{axis}]\ntravel = [0, {travel}]\n" for axis, travel in (("X", 1500), ("Y", 1000), ("Z", 800))
)
STATIONS = ("-400,-300,100", "1900,-300,200", "750,1400,150", "700,500,-250")
TARGETS = ("t1=80,0,-100", "t2=-60,70,-150", "t3=-60,-70,-250")
SQUARE = "location:component=C,axis=Y,value=30"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "centre.toml").write_text(MACHINE)
    return tmp_path


def simulated(command, folder: Path, *options: str, stations: int = 4, targets: int = 3, points: int = 30) -> Path:
    """Ranges to random positions, in shuffled order."""
    own = [f"--tracker={text}" for text in STATIONS[:stations]] + [f"--target={text}" for text in TARGETS[:targets]]
    done = command(
        "simulate", "-m", folder / "centre.toml", "--instrument", "ranging", "--strategy", "random", "--points", points,
        "--order", "shuffled", "--errors", "none", "-o", folder / "ranges.csv", *own, *options,
    )  # fmt: skip
    assert done.status == 0, done.err
    return folder / "ranges.csv"


def fitted(command, folder: Path, *options: str) -> tuple[dict, dict, str]:
    """The effects of the calibration by name, the results, and what was printed."""
    done = command(
        "fit", folder / "ranges.csv", "-m", folder / "centre.toml", "-o", folder / "cal.json", "--json",
        folder / "fit.json", "--basis", "legendre:2", *options,
    )  # fmt: skip
    assert done.status == 0, done.err
    model = read_model(folder / "cal.json", ncomp.load_machine(folder / "centre.toml"))
    results = json.loads((folder / "fit.json").read_text())
    return {effect.name: effect for effect in model.effects}, results, " ".join((done.out.decode() + done.err).split())


def refused(command, folder: Path, text: str) -> str:
    """The refusal of a file, which leaves no calibration."""
    (folder / "ranges.csv").write_text(text)
    done = command("fit", folder / "ranges.csv", "-m", folder / "centre.toml", "-o", folder / "cal.json")
    assert done.status == 2
    assert not (folder / "cal.json").exists()
    return " ".join(done.err.split())


def squareness(results: dict) -> tuple[float, float]:
    """Squareness of Y to X, urad, and its expanded uncertainty."""
    own = results["locations"]["E_C0Y"]
    return own["value_urad"], 2.0 * own["u"]


def test_stations_without_a_guess_and_with_unknown_dead_lengths_give_a_squareness(command, folder):
    data = simulated(command, folder, "--effect", SQUARE)
    assert "station." not in data.read_text()
    _, results, printed = fitted(command, folder)
    value, expanded = squareness(results)
    assert value == pytest.approx(30.0, abs=expanded)
    assert expanded < 1.0
    assert results["rank_registered"] + results["by_convention"] == results["n_parameters"]
    assert "NOT VISIBLE" not in printed


def test_a_file_is_written_as_it_was_read(command, folder):
    data = simulated(command, folder, stations=2, points=10)
    text = data.read_text()
    head = "# station.s1: -390.0 -310.0 90.0\n# dead_mm.s2: 5.0\n# dead_u_um: 3.0\n"
    data.write_text(text.replace("# stands_on: workpiece\n", "# stands_on: workpiece\n" + head))
    measurement = ncomp.read_measurement(data, folder / "centre.toml")
    assert measurement.instrument.dead_mm == (("s2", 5.0),)
    assert dict(measurement.spheres) == {"s1": (-390.0, -310.0, 90.0)}


def test_a_break_of_the_beam_begins_a_new_dead_length(command, folder):
    data = simulated(command, folder, "--effect", SQUARE)
    head, _, body = data.read_text().partition("time_s")
    rows = ("time_s" + body).splitlines()
    later = [row.split(",") for row in rows[150:]]
    run, reading = (rows[0].split(",").index(name) for name in ("run", "range_mm"))
    for cells in later:  # the counter was set to zero elsewhere
        cells[run], cells[reading] = "2", repr(float(cells[reading]) + 321.5)
    data.write_text("\n".join([head + rows[0], *rows[1:150], *map(",".join, later)]) + "\n")
    value, expanded = squareness(fitted(command, folder)[1])
    assert value == pytest.approx(30.0, abs=expanded)


def test_a_known_dead_length_shows_more_than_an_unknown_one(command, folder):
    data = simulated(command, folder, "--effect", SQUARE, "--noise-scale", "1", stations=1)
    unknown = squareness(fitted(command, folder)[1])[1]
    lines, zeros = data.read_text().splitlines(), {}
    first = next(i for i, line in enumerate(lines) if line.startswith("time_s"))
    names = lines[first].split(",")
    for i, line in enumerate(lines[first + 1 :], start=first + 1):
        cells = dict(zip(names, line.split(","), strict=True))
        target = np.array([float(cell) for cell in TARGETS[int(cells["target"][1]) - 1][3:].split(",")])
        point = np.array([float(cells[axis]) for axis in "XYZ"]) + target
        away = float(np.linalg.norm(point - [-400.0, -300.0, 100.0]))
        zero = zeros.setdefault(cells["target"], round(float(cells["range_mm"]) - away, 1))
        cells["range_mm"] = repr(float(cells["range_mm"]) - zero)
        lines[i] = ",".join(cells[name] for name in names)
    data.write_text("\n".join(["# dead_u_um: 100", *lines, ""]))
    known = squareness(fitted(command, folder)[1])[1]
    assert known < unknown


def test_one_station_names_what_it_does_not_show(command, folder):
    simulated(command, folder, "--effect", SQUARE, stations=1)
    printed = fitted(command, folder)[2]
    assert "NOT VISIBLE" in printed
    assert "ranges from 2 more stations" in printed


def test_one_target_hides_angles_and_says_so(command, folder):
    simulated(command, folder, "--effect", SQUARE, targets=1)
    printed = fitted(command, folder)[2]
    assert "NOT VISIBLE" in printed
    assert "three targets on the tool, not in one line, would show it" in printed


@pytest.mark.parametrize("index", [1.0, 1.00027])
def test_air_that_warms_is_taken_out(command, folder, index):
    """Ranges that refer to one index; the air warms by 6 K, which is 6 um in each metre, and its dead path with it."""
    data = simulated(command, folder, "--effect", SQUARE, "--temperature", "air=18:24")
    lines = data.read_text().splitlines()
    first = next(i for i, line in enumerate(lines) if line.startswith("time_s"))
    names = lines[first].split(",")
    for i, line in enumerate(lines[first + 1 :], start=first + 1):
        cells = dict(zip(names, line.split(","), strict=True))
        target = np.array([float(cell) for cell in TARGETS[int(cells["target"][1]) - 1][3:].split(",")])
        station = np.array([float(cell) for cell in STATIONS[int(cells["station"][1]) - 1].split(",")])
        away = float(np.linalg.norm(np.array([float(cells[axis]) for axis in "XYZ"]) + target - station))
        n = refractive_index(np.array(float(cells["temp_air"])), np.array(1013.25), np.array(50.0), 632.991)
        cells["range_mm"] = repr(float(cells["range_mm"]) + away * (float(n) / index - 1.0))
        lines[i] = ",".join([*(cells[name] for name in names), "1013.25", "50"])
    lines[first] += ",pressure_hPa,humidity_percent"
    data.write_text("\n".join([f"# assumed_index: {index}", *lines, ""]))
    results = fitted(command, folder)[1]
    value, expanded = squareness(results)
    assert value == pytest.approx(30.0, abs=expanded)
    assert results["after"]["chi2_reduced"] < 1.3


def test_the_refractive_index_is_that_of_ciddor():
    """By Ciddor 1996, from the package ref-index 1.0."""
    air = np.array([[20.0, 1013.25, 50.0], [25.0, 950.0, 70.0], [10.0, 1050.0, 30.0]])
    expected = [1.0002713728590, 1.0002497481854, 1.0002915014828]
    assert refractive_index(*air.T, 632.991) == pytest.approx(expected, abs=5e-9)


def test_a_station_is_where_hand_worked_ranges_say():
    """Seven corners of a cube about (100, 0, 0); distances from (100, 0, 500) by Pythagoras, 7 mm of dead length."""
    points = np.array([[x, y, z] for x in (0.0, 200.0) for y in (-100.0, 100.0) for z in (-100.0, 100.0)])
    ranges = np.where(points[:, 2] < 0.0, 380000.0, 180000.0) ** 0.5 + 7.0
    (found,) = located(points[:7], ranges[:7], np.zeros(7, int))
    assert found.position == pytest.approx([100.0, 0.0, 500.0], abs=1e-6)
    assert found.dead == pytest.approx([7.0], abs=1e-6)


def test_points_in_one_plane_leave_two_places_and_the_guess_decides():
    points = np.array([[x, y, 0.0] for x in (0.0, 300.0, 500.0) for y in (0.0, 200.0, 450.0)])
    ranges = np.linalg.norm(points - [100.0, 150.0, 400.0], axis=1) - 50.0
    assert len(located(points, ranges, np.zeros(9, int))) == 2
    below = located(points, ranges, np.zeros(9, int), np.array([100.0, 100.0, -300.0]))
    assert below[0].position == pytest.approx([100.0, 150.0, -400.0], abs=1e-3)


def cells_of(data: Path) -> tuple[list[str], list[str], list[list[str]]]:
    """Header lines, names of columns, and cells of a file."""
    lines = data.read_text().splitlines()
    first = next(i for i, line in enumerate(lines) if line.startswith("time_s"))
    return lines[:first], lines[first].split(","), [line.split(",") for line in lines[first + 1 :]]


def with_readings(data: Path, change, *head: str) -> str:
    """The file with `change(row, range)` in place of its ranges, and further header lines."""
    header, names, rows = cells_of(data)
    column = names.index("range_mm")
    for i, cells in enumerate(rows):
        cells[column] = repr(change(i, float(cells[column])))
    return "\n".join([*head, *header, ",".join(names), *map(",".join, rows), ""])


SMALL = {"stations": 2, "targets": 2, "points": 24}


def test_a_station_in_another_frame_is_refused(command, folder):
    """Stated from the middle of the table instead of its corner, with the place that the ranges show."""
    data = simulated(command, folder, **SMALL)
    message = refused(command, folder, with_readings(data, lambda _, mm: mm, "# station.s1: -1150 -800 100"))
    assert "station s1 is stated at (-1150, -800, 100) mm, but its ranges put it at (-400, -300, 100) mm" in message
    assert "901.4 mm away" in message
    assert "delete it, because the ranges show the place" in message


def test_a_break_of_the_beam_without_a_new_run_is_refused_with_its_row(command, folder):
    data = simulated(command, folder, **SMALL)
    first = len(data.read_text().splitlines()) - 4 * 24
    message = refused(command, folder, with_readings(data, lambda i, mm: mm + 7.25 * (34 <= i < 48)))
    assert f"station s1, target t2, run 1 from {folder / 'ranges.csv'}:{first + 1 + 34} on" in message
    assert "its ranges jump by +7.25" in message
    assert "give its rows another name in the column run" in message


def test_a_dead_length_that_was_forgotten_in_one_run_is_refused_with_its_row(command, folder):
    """An absolute distance meter whose dead length of 150 mm was entered for the first target alone."""
    data = simulated(command, folder, **(SMALL | {"stations": 1}))
    _, names, rows = cells_of(data)
    away = [
        np.linalg.norm(np.array([float(cells[names.index(axis)]) for axis in "XYZ"]) + target - [-400.0, -300.0, 100.0])
        for cells in rows
        for target in [[80.0, 0.0, -100.0] if cells[names.index("target")] == "t1" else [-60.0, 70.0, -150.0]]
    ]
    text = with_readings(data, lambda i, _: float(away[i]) + 150.0 * (i < 24), "# dead_mm.s1: 150", "# dead_u_um: 20")
    line = len(text.splitlines()) - 24 + 1
    message = refused(command, folder, text)
    assert (
        f"ranges.csv:{line}: from this row on the ranges of station s1, target t2, run 1 are 150 mm shorter" in message
    )
    assert "it was forgotten in these ranges" in message


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda _, mm: mm / 25.4, "inch and mm mixed up"),
        (lambda _, mm: mm * 1e3, "m, mm or um mixed up"),
    ],
)
def test_ranges_in_another_unit_are_refused(command, folder, change, words):
    data = simulated(command, folder, **SMALL)
    assert words in refused(command, folder, with_readings(data, change))


def test_columns_that_are_exchanged_are_refused(command, folder):
    data = simulated(command, folder, **SMALL)
    text = data.read_text().replace("time_s,X,Y,", "time_s,Y,X,").replace("dir_X,dir_Y", "dir_Y,dir_X")
    assert "with columns X and Y exchanged" in refused(command, folder, text)


def test_targets_in_one_plane_need_a_guess(command, folder):
    """Z stands still: the ranges do not show whether a station is above or below the targets."""
    data = simulated(command, folder, "--range", "Z=400", **(SMALL | {"targets": 1}))
    message = refused(command, folder, data.read_text())
    assert "two places explain the ranges of station s1 equally well" in message
    assert "State about where it stands: # station.s1: x y z" in message
    data.write_text("# station.s1: -400 -300 0\n# station.s2: 1900 -300 0\n" + data.read_text())
    fitted(command, folder, "--force")


def test_too_few_ranges_of_a_station_are_refused(command, folder):
    data = simulated(command, folder, **SMALL)
    header, names, rows = cells_of(data)
    text = "\n".join([*header, ",".join(names), *map(",".join, rows[:48] + rows[-4:]), ""])
    assert "station s2 has 4 ranges with 1 dead lengths, and needs 5 to be located" in refused(command, folder, text)


CAUSES = {
    "range-jump s2": ("range-jump:station=s2,offset_um=6,since_s=2700", "offset_um", 6.0),
    "tracker-range-drift": ("tracker-range-drift:rate_um_per_h=12", "rate_um_per_h", 12.0),
    "backlash X": ("backlash:axis=X,width=8", "width_um", 8.0),
}


@pytest.mark.parametrize("name", quick(CAUSES, ["range-jump s2"]))
def test_a_hidden_cause_is_named_with_its_size(command, folder, name):
    effect, parameter, size = CAUSES[name]
    data = simulated(command, folder, "--effect", effect, "--effect", SQUARE, stations=3, points=40, targets=2)
    done = command("diagnose", data, "-m", folder / "centre.toml", "-o", folder / "d.json", "--json", folder / "j.json")
    assert done.status == 0, done.err
    results = json.loads((folder / "j.json").read_text())
    (found,) = results["effects"]
    assert found["kind"] == name.split()[0]
    assert found["parameters"][parameter] == pytest.approx(size, abs=3.0 * found["u"][parameter])
    assert "air-scale" in results["not_visible"]


STUDY = """machine = "centre.toml"
draws = 4
[instrument]
kind = "ranging"
u_range_um = 0.2
u_range_um_per_m = 0.3
[errors]
model = "none"
location = 30
[fit]
basis = "legendre:2"
[common]
strategy = "random"
points = 20
tools = [[80, 0, -100], [-60, 70, -150], [-60, -70, -250]]
[[case]]
name = "four"
tracker = [[-400, -300, 100], [1900, -300, 200], [750, 1400, 150], [700, 500, -450]]
[[case]]
name = "two"
tracker = [[-400, -300, 100], [1900, -300, 200]]
"""


def test_a_study_compares_places_of_stations(command, folder, monkeypatch):
    monkeypatch.chdir(folder)
    (folder / "study.toml").write_text(STUDY)
    done = command("study", "study.toml", "-o", "results.csv")
    assert done.status == 0, done.err
    _, *rows = (folder / "results.csv").read_text().splitlines()
    left = {row.split(",")[0]: float(row.split(",")[5]) for row in rows}
    assert left["four"] < 1.0
    assert left["four"] < left["two"]


@pytest.mark.statistical
def test_the_uncertainties_of_four_stations_cover_the_true_errors():
    """By the benchmark with 40 draws: 95 % within 1.96 u; the draws spread by about 1 %."""
    judged = [benchmark.one("four stations", draw)[0] for draw in range(40)]
    inside = np.mean([np.abs(each.error) < 1.96 * each.u for each in judged])
    assert 0.92 < inside < 0.98


HEAD = "# machine: centre\n# instrument: ranging\n# u_range_um: 0.2\n# target.t1: 0 0 -100\n"
COLUMNS = "time_s,X,Y,Z,target,station,range_mm\n"
ROWS = "".join(f"{i},{37 * i % 1500},{53 * i % 1000},{29 * i % 800},t1,s1,{500 + i}\n" for i in range(40))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (HEAD.replace("# u_range_um: 0.2\n", "") + COLUMNS + ROWS, "state u_range_um or u_range_um_per_m above zero"),
        (HEAD + COLUMNS.replace("range_mm", "feed") + ROWS, "ranging: column range_mm missing"),
        (HEAD + "# station.s9: 1 2 3\n" + COLUMNS + ROWS, "ranges.csv:5 station.s9: no row has the station 's9'"),
        (HEAD + "# dead_u_um: 0\n" + COLUMNS + ROWS, "ranges.csv:5 dead_u_um: 0 is not above 0"),
        (HEAD + "# assumed_index: 1.27\n" + COLUMNS + ROWS, "1.27 is no refractive index of air"),
        (HEAD + "# assumed_index: 1\n" + COLUMNS + ROWS, "columns temp_air, pressure_hPa, humidity_percent missing"),
        (
            HEAD + "# assumed_index: 1\n" + COLUMNS.replace("station", "temp_air,pressure_hPa,humidity_percent")
            + ROWS.replace("s1", "20,101325,50"),
            "ranges.csv:7 column pressure_hPa: 101325 is not within 600 to 1200",
        ),
    ],
)  # fmt: skip
def test_a_file_that_is_not_understood_is_refused(command, folder, text, message):
    assert message in refused(command, folder, text)


def test_a_refusal_of_too_few_ranges_says_how_many_are_enough(tmp_path, command):  # noqa: ARG001
    """18 error motions of 7 parameters, whose constants are zero by convention, and 4 of the station: 112 / 0.8."""
    data = tmp_path / "few.csv"
    ranges = ("--strategy", "random", "--points", "60", "--machine", "cframe", "--instrument", "ranging")
    succeed("simulate", *ranges, "-o", data)
    message = refusal("fit", data, "--machine", "cframe", "--basis", "legendre:6", "-o", tmp_path / "cal.json")
    assert "too few for 126 parameters of the machine and 4 of the registration" in message
    assert "(140 rows are enough for these), or fit a smaller basis" in message


def test_a_stated_dead_length_counts_by_its_uncertainty(command, folder):
    """A dead length 4 um from its stated one with u = 2 um is off by two; its derivative is the one of the design."""
    data = simulated(command, folder, stations=2, points=10)
    head = "# dead_mm.s2: 5.0\n# dead_u_um: 2.0\n"
    data.write_text(data.read_text().replace("# stands_on: workpiece\n", f"# stands_on: workpiece\n{head}"))
    measured = ncomp.read_measurement(data, folder / "centre.toml")
    first = measured.instrument.first_registration(measured, np.ones(len(measured), bool))
    stated = measured.instrument.stated_dead(measured)
    near = replace(first, zeros={name: stated.get(name, 0.0) - 0.004 for name in first.zeros})
    assert measured.instrument.stated_residuals(measured, near) == pytest.approx([2.0] * len(first.zeros))
    design = measured.instrument.stated_design(measured, near)
    assert design[:, -len(first.zeros) :] == pytest.approx(np.eye(len(first.zeros)) / 0.002)
