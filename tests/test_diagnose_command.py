"""`ncomp diagnose` as a user calls it: contract 4.3 to the letter, what cannot be used, what is odd but can."""

import io
import json
import math
import random
import re
from pathlib import Path

import msgspec
import numpy as np
import pytest
from support.pages import figures
from support.tiers import quick
from support.virtual_measurements import THREE, measured, positions

import machines
from calibration.measurement.written_file import write_measurement
from kinematics.basis import Polynomial
from kinematics.effects import Backlash, ErrorMotion
from kinematics.error_model.model import encode_model, no_errors

CFRAME = machines.load("cframe")
FIGURES = {"rms_um", "max_um", "chi2_reduced", "heldout_rms_um"}
OUTPUTS = {"-o": "new.json", "--json": "out.json", "--report": "page.html"}
WITHOUT_PAGE = {"-o": "new.json", "--json": "out.json"}


class Sheet:
    """A measurement file in lines, to be spoilt."""

    def __init__(self, text: str) -> None:
        lines = text.splitlines()
        self.head = [line for line in lines if line.startswith("#")]
        self.names, *self.rows = (line.split(",") for line in lines if not line.startswith("#"))

    def column(self, name, change):
        """The sheet with the numbers of a column changed."""
        at = self.names.index(name)
        for number, row in enumerate(self.rows):
            row[at] = f"{change(number, float(row[at])):.6f}"
        return self

    def with_column(self, name, value):
        self.names.append(name)
        for number, row in enumerate(self.rows):
            row.append(str(value(number)))
        return self

    def without(self, name):
        at = self.names.index(name)
        for row in (self.names, *self.rows):
            del row[at]
        return self

    def header(self, key, value):
        self.head = [f"# {key}: {value}" if line.startswith(f"# {key}:") else line for line in self.head]
        return self

    def write(self, path):
        rows = [",".join(row) for row in (self.names, *self.rows)]
        path.write_text("\n".join([*self.head, *rows]) + "\n", encoding="utf-8")
        return path


@pytest.fixture(scope="module")
def text():
    """A tracker's view of a machine with backlash of X, positions seen again on the way back."""
    rng = np.random.default_rng(5)
    there = positions(CFRAME, 40, rng, edges=14)
    model = msgspec.structs.replace(no_errors(CFRAME), effects=(Backlash("X", 30.0),))
    file = io.BytesIO()
    write_measurement(measured(CFRAME, np.concatenate([there, there[::-1]]), THREE, model, rng), file)
    return file.getvalue().decode()


@pytest.fixture
def sheet(text):
    return Sheet(text)


@pytest.fixture
def diagnosed(command, tmp_path):
    """Runs the command on a sheet; how it ended, what it said as JSON, and the new calibration."""

    def run(sheet, *options, machine="cframe", outputs=OUTPUTS):
        data = sheet.write(tmp_path / "data.csv")
        named = [part for option, name in outputs.items() for part in (option, name)]
        done = command("diagnose", data, "-m", machine, *named, *options)
        assert "Traceback" not in done.err
        made = [name for name in OUTPUTS.values() if Path(name).exists()]
        refused = b"NOT WRITTEN" in done.out
        written = [name for name in outputs.values() if not done.status or (refused and name != "new.json")]
        assert made == written, done.err
        if done.status:
            return done, json.loads(Path("out.json").read_text()) if refused else None, None
        # a number that is none is no JSON
        return done, *(
            json.loads(Path(name).read_text(), parse_constant=pytest.fail) for name in ("out.json", "new.json")
        )

    return run


def kinds(said):
    return [(effect["kind"], effect["axis"]) for effect in said["effects"]]


def check_contract(said):
    """Design contract 4.3, the stable part: keys and types."""
    for when in ("before", "after"):
        assert set(said[when]) == FIGURES
        for key, value in said[when].items():
            assert isinstance(value, float) or (
                value is None and key == "heldout_rms_um" and said["n_observations"] < 40
            )
    assert isinstance(said["noise_um"], float)
    assert said["accepted"] == (said["reason"] == "")
    for key in ("n_observations", "n_parameters", "rank"):
        assert isinstance(said[key], int)
    assert all(isinstance(name, str) for name in said["not_visible"])
    for effect in said["effects"]:
        assert isinstance(effect["kind"], str)
        assert effect["where"] in ("machine", "instrument")
        assert effect["axis"] is None or isinstance(effect["axis"], str)
        assert set(effect["parameters"]) == set(effect["u"])
        for size in (*effect["parameters"].values(), *effect["u"].values()):
            assert all(isinstance(value, float) and math.isfinite(value) for value in np.atleast_1d(size).tolist())
        for key in ("log10_odds" if "log10_odds" in effect else "delta_bic", "heldout_gain_um", "share"):
            assert isinstance(effect[key], float)
        assert 0.0 <= effect["share"] <= 1.0
        assert effect["verdict"] in ("strong", "tied", "weak")
        for other in effect["alternatives"]:
            assert isinstance(other["kind"], str)
            assert 0.0 <= other["cosine"] <= 1.0
            assert other["odds"] >= 0.0
    left = said["unexplained"]
    if left is not None:
        assert set(left) == {"variables", "p_value", "rms_um"}
        assert all(isinstance(name, str) for name in left["variables"])
        assert 0.0 <= left["p_value"] <= 1.0
    assert isinstance(said["next_measurement"], str)


@pytest.mark.statistical
def test_a_diagnosis_its_calibration_and_what_it_is_good_for(diagnosed, sheet, command, tmp_path):
    done, said, new = diagnosed(sheet)
    assert done.status == 0, done.err
    check_contract(said)
    (effect,) = said["effects"]
    assert (effect["kind"], effect["axis"], effect["where"]) == ("backlash", "X", "machine")
    assert abs(effect["parameters"]["width_um"] - 30.0) < 3 * effect["u"]["width_um"]
    assert said["after"]["heldout_rms_um"] < said["before"]["heldout_rms_um"]
    assert said["n_observations"] == 240
    (written,) = [each for each in new["effects"] if each["kind"] == "backlash"]
    assert written["width"] == pytest.approx(effect["parameters"]["width_um"])
    assert new["ncomp_calibration"] == 1
    assert "backlash X" in done.out.decode()
    assert figures(tmp_path / "page.html")
    (tmp_path / "part.nc").write_text("G21 G90 G94 G54 G17\nT1 M6\nG43 H1\nG0 X10 Y10 Z50\nG1 X90 F500\nX20\nM30\n")
    setup = ("-m", "cframe", "-c", "new.json", "--work-offset", "G54=100,100,200", "--tool-length", "T1=100")
    done = command("part.nc", *setup, "-o", "part_c.nc", "--no-travel-check")
    assert done.status == 0, done.err
    done = command("verify", "part.nc", "part_c.nc", *setup)
    assert done.status == 0, done.err
    done = command("predict", "data.csv", "-m", "cframe", "-c", "new.json", "-o", "predicted.csv")
    assert done.status == 0, done.err


def test_json_on_standard_output_is_json_alone_and_several_files_are_one(command, tmp_path):
    sheet = readings(0.3, points=20)
    half = len(sheet.rows) // 2
    later = sheet.rows[half:]
    sheet.rows = sheet.rows[:half]
    first = sheet.write(tmp_path / "first.csv")
    sheet.rows = later
    second = sheet.write(tmp_path / "second.csv")
    done = command("diagnose", first, second, "-m", "cframe", "-o", "new.json", "--json", "-")
    assert done.status == 0, done.err
    said = json.loads(done.out)
    check_contract(said)
    assert kinds(said) == [("backlash", "X")]
    assert "backlash X" in done.err


def _swapped(sheet):
    for row in sheet.rows:
        row[1], row[2] = row[2], row[1]
    return sheet


def _in_metres(sheet):
    for name in "xyz":
        sheet.column(name, lambda _, value: value / 1000.0)
    return sheet


def _first(count):
    def change(sheet):
        sheet.rows = sheet.rows[:count]
        return sheet

    return change


def _in_one_place(sheet):
    columns = [sheet.names.index(name) for name in (*"XYZxyz", "target")]
    for row in sheet.rows:
        for at in columns:
            row[at] = sheet.rows[0][at]
    return sheet


def _shuffled(sheet):
    random.Random(1).shuffle(sheet.rows)
    return sheet


def _put(row, name, value):
    def change(sheet):
        sheet.rows[row][sheet.names.index(name)] = value
        return sheet

    return change


REFUSED = {
    "no rows": (_first(0), "no rows"),
    "one row": (_first(1), "no axis moves"),
    "one place": (_in_one_place, "no axis moves"),
    "axes swapped": (_swapped, "columns X and Y exchanged"),
    "metres": (_in_metres, "mixed up"),
    "mirrored": (lambda s: s.column("x", lambda _, v: -v), "mirrored"),
    "time is no number": (_put(5, "time_s", "nan"), "column time_s: 'nan' is no number"),
    "no time in a row": (_put(5, "time_s", ""), "column time_s: empty"),
    "infinite": (_put(5, "x", "inf"), "'inf' is no number"),
    "rows in no order": (_shuffled, "not in the order of acquisition"),
    "time counts down": (lambda s: s.column("time_s", lambda _, v: -v), "not in the order of acquisition"),
    "kelvin": (lambda s: s.with_column("temp_spindle", lambda i: 294.0 + 0.01 * i), "degC"),
    "unknown target": (_put(3, "target", "t9"), "'t9' is not in the header"),
    "other machine": (lambda s: s.header("machine", "gantry"), "the file is of 'gantry', not of cframe"),
    "no uncertainty": (
        lambda s: s.header("u_range_um", 0).header("u_range_um_per_m", 0).header("u_angle_um", 0),
        "standard uncertainty",
    ),
    "negative": (lambda s: s.header("u_angle_um", -3), "negative"),
    "a station a row": (
        lambda s: _first(30)(s.without("station").with_column("station", lambda i: f"s{i}")),
        "from each of the 30 set-ups",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_data_that_can_t_be_used_are_refused_in_one_line(diagnosed, sheet, case):
    spoil, said = REFUSED[case]
    done, *_ = diagnosed(spoil(sheet))
    assert done.status == 2
    faults = [line for line in done.err.splitlines() if line.startswith("ncomp: ")]
    assert len(faults) == 1
    assert said in faults[0]
    assert "data.csv" in faults[0]


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["-m", "nosuch"], "nosuch"),
        (["-m", "gantry"], "not of gantry"),
        (["-o", "data.csv"], "is an input and would be overwritten"),
        (["-o", "nowhere/new.json"], "nowhere"),
        (["--json", "new.json"], "both name"),
        (["--report", "data.csv"], "is an input and would be overwritten"),
        (["--calibration", "nosuch.json"], "nosuch.json"),
        (["--calibration", "data.csv"], "data.csv"),
        (["--header", "u_um"], "KEY=VALUE"),
    ],
)
def test_mistakes_at_the_command_line_are_refused_without_output(command, sheet, tmp_path, options, said):
    sheet.write(tmp_path / "data.csv")
    before = (tmp_path / "data.csv").read_bytes()
    machine = [] if "-m" in options else ["-m", "cframe"]
    output = [] if "-o" in options else ["-o", "new.json"]
    done = command("diagnose", "data.csv", *machine, *output, *options)
    assert done.status == 2
    assert said in done.err
    assert "Traceback" not in done.err
    assert [path.name for path in tmp_path.iterdir()] == ["data.csv"]
    assert (tmp_path / "data.csv").read_bytes() == before


def test_a_missing_file_is_refused(command, tmp_path):
    done = command("diagnose", "nosuch.csv", "-m", "cframe", "-o", "new.json")
    assert done.status == 2
    assert "nosuch.csv" in done.err
    assert not list(tmp_path.iterdir())


def of_x_alone(name, tmp_path):
    """A file with a calibration of a machine that has error motions of X alone."""
    motion = ErrorMotion("X", "X", Polynomial((0.0, 500.0), 0), (5.0,), u=(1.0,))
    model = msgspec.structs.replace(no_errors(machines.load(name)), effects=(motion,))
    (tmp_path / "cal.json").write_bytes(encode_model(model))
    return "cal.json"


def test_a_calibration_of_another_machine_is_refused(command, sheet, tmp_path):
    sheet.write(tmp_path / "data.csv")
    done = command("diagnose", "data.csv", "-m", "cframe", "-c", of_x_alone("gantry", tmp_path), "-o", "new.json")
    assert done.status == 2
    assert "gantry" in done.err
    assert not (tmp_path / "new.json").exists()


def test_a_calibration_of_fewer_axes_gets_the_others_from_the_data(diagnosed, sheet, tmp_path):
    done, said, new = diagnosed(sheet, "--calibration", of_x_alone("cframe", tmp_path), outputs=WITHOUT_PAGE)
    assert done.status == 0, done.err
    assert kinds(said) == [("backlash", "X")]
    assert {effect["axis"] for effect in new["effects"] if effect["kind"] == "error-motion"} == {"X", "Y", "Z"}


@pytest.mark.parametrize("count", [3, 6])
def test_few_rows_are_refused_with_what_is_needed(diagnosed, sheet, count):
    done, _, _ = diagnosed(_first(count)(sheet))
    assert done.status == 2
    assert re.search(r"too few for \d+ parameters .* measure about \d+ positions or more", done.err)


ODD = {
    "an outlier of 1 km": _put(30, "x", "1000000.0"),
    "a clock of another epoch": lambda s: s.column("time_s", lambda _, v: v + 1.7e9),
    "the time of day": lambda s: s.column("time_s", lambda _, v: v + 34000.0),
    "no time": lambda s: s.without("time_s"),
    "each row twice": lambda s: setattr(s, "rows", [*s.rows, *s.rows]) or s,
    "5 % outliers": lambda s: s.column("y", lambda i, v: v + (i % 20 == 7) * (-1) ** i * (0.5 + 0.03 * i)),
    "one constant temperature": lambda s: s.with_column("temp_hall", lambda _: 20.5),
}


@pytest.mark.statistical
def test_rows_that_are_wrong_have_a_number_and_no_uncertainty(diagnosed, sheet):
    done, said, _ = diagnosed(_put(30, "x", "1000.0")(sheet))
    assert "outliers" in {kind for kind, _ in kinds(said)}
    rows = [line for line in done.out.decode().splitlines() if re.match(r" \d+ +outliers ", line)]
    assert "  1 row  " in rows[0]
    assert not any("±" in row for row in rows)
    cells = re.findall(r"<td[^>]*>outliers \(instrument\)</td>(.*?)</tr>", Path("page.html").read_text(), re.DOTALL)
    texts = [re.sub("<[^>]+>", "|", row) for row in cells]
    assert any("|1 row|" in text for text in texts)
    assert not any("±" in text for text in texts)


@pytest.mark.parametrize("case", quick(ODD, [], ["an outlier of 1 km", "no time"]))
def test_odd_data_show_the_same_cause(diagnosed, sheet, case):
    done, said, _ = diagnosed(ODD[case](sheet))
    assert done.status == 0, done.err
    check_contract(said)
    found = kinds(said)
    assert ("backlash", "X") in found
    assert {kind for kind, _ in found} <= {"backlash", "outliers"}
    width = next(effect for effect in said["effects"] if effect["kind"] == "backlash")
    assert abs(width["parameters"]["width_um"] - 30.0) < 4 * width["u"]["width_um"]


@pytest.mark.parametrize("factor", quick([1e-3, 50.0], [], [50.0]))
def test_a_sheet_that_is_far_off_is_told(diagnosed, sheet, factor):
    for line in [line for line in sheet.head if line.startswith("# u_")]:
        key, value = line[2:].split(": ")
        sheet.header(key, float(value) * factor)
    done, said, _ = diagnosed(sheet)
    assert "contradict" in done.out.decode() + done.err
    assert kinds(said) == [("backlash", "X")]


def readings(noise, seed=2, points=40, backlash=10.0, wave=0.0):
    """An interferometer's sheet of X of the C-frame: two runs there and back."""
    rng = np.random.default_rng(seed)
    where = np.sort(rng.uniform(20.0, 480.0, points))
    rows = []
    for run in (1, 2):
        for direction, ladder in ((1, where), (-1, where[::-1])):
            for x in ladder.tolist():
                deviation = 0.02 * x - direction * backlash / 2 + wave * math.sin(2 * math.pi * x / 10.0)
                rows.append(f"X,{run},{direction},{x:.4f},{deviation + noise * rng.normal():.4f}")
    head = ["# machine: cframe", "# instrument: interferometer", f"# u_um: {max(noise, 0.1)}"]
    return Sheet("\n".join([*head, "axis,run,direction,target_mm,deviation_um", *rows]) + "\n")


def test_an_interferometer_shows_backlash_and_a_wave(diagnosed):
    done, said, _ = diagnosed(readings(0.3, wave=4.0))
    assert done.status == 0, done.err
    check_contract(said)
    assert sorted(kinds(said)) == [("backlash", "X"), ("cyclic", "X")]
    sizes = {effect["kind"]: effect["parameters"] for effect in said["effects"]}
    assert sizes["backlash"]["width_um"] == pytest.approx(10.0, abs=0.2)
    assert sizes["cyclic"]["period_mm"] == pytest.approx(10.0, abs=0.02)


def test_data_without_noise(diagnosed):
    done, said, _ = diagnosed(readings(0.0), outputs=WITHOUT_PAGE)
    assert done.status == 0, done.err
    check_contract(said)
    assert kinds(said) == [("backlash", "X")]


@pytest.mark.parametrize("shear", quick([0.0, 3e-5], [3e-5]))
def test_a_machined_part(diagnosed, shear):
    """Data of a machine that is out of square, and of one whose errors are hidden by noise: the latter is not written."""
    rng = np.random.default_rng(4)
    nominal = rng.uniform(50.0, 350.0, (60, 2))
    made = nominal + 2e-3 * rng.normal(size=nominal.shape) + shear * nominal[:, ::-1] * (1.0, 0.0)
    rows = [",".join(f"{value:.5f}" for value in (*a, *b)) for a, b in zip(nominal, made, strict=True)]
    head = ["# machine: cframe", "# instrument: part", "# u_um: 2", "# part_offset: 50 50 100"]
    outputs = WITHOUT_PAGE if shear else OUTPUTS
    done, said, _ = diagnosed(Sheet("\n".join([*head, "nominal_x,nominal_y,x,y", *rows]) + "\n"), outputs=outputs)
    check_contract(said)
    if not shear:
        assert done.status == 2
        assert "worse" in done.err
        assert said["reason"] in done.err
        assert not said["accepted"]
        return
    assert done.status == 0, done.err
    assert said["accepted"]
    assert said["effects"] == []


@pytest.mark.parametrize(("half_waves", "worse"), [(0, False), (1, True)])
def test_a_calibration_that_is_worse_than_none_is_called_so(command, half_waves, worse):
    """An encoder that was referenced anew half a wave away: the curve of the calibration is off along the axis."""
    rng, x = np.random.default_rng(4), np.linspace(0.0, 600.0, 25)
    for name, phase in (("then", 0.0), ("now", np.pi * half_waves)):
        rows = [
            f"X,{run},{'+' if run % 2 else '-'},{target:g},{15.0 * np.sin(target / 40.0 + phase) + rng.normal(0.0, 0.5):.3f}"
            for run in range(1, 5)
            for target in (x if run % 2 else x[::-1])
        ]
        head = (
            "# machine: cframe\n# instrument: interferometer\n# u_um: 0.5\naxis,run,direction,target_mm,deviation_um\n"
        )
        Path(f"{name}.csv").write_text(head + "\n".join(rows) + "\n")
    done = command("fit", "then.csv", "--machine", "cframe", "-o", "then.json")
    assert done.status == 0, done.err
    done = command(
        "diagnose", "now.csv", "--machine", "cframe", "-c", "then.json", "-o", "new.json", "--json", "d.json"
    )
    first = next(line for line in done.out.decode().splitlines() if line.strip())
    found = json.loads(Path("d.json").read_text())
    assert found["worse_than_none"] == worse
    assert ("WORSE THAN NONE" in first) == worse
    if worse:
        assert "without --calibration" in first
