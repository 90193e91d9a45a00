"""Foreign formats: what they mean is what comes out; what is not certain is refused."""

import math
import re
import textwrap
import time
from pathlib import Path

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.file_examples import CMM, ETALON, MAP, RTL, WIDE

import machines
from calibration.instruments import Interferometer, LaserTracker, Part
from calibration.measurement.readers import FORMATS, read_any
from calibration.measurement.readers.delimited import map_names, read_map
from kinematics.effects import ErrorMotion, LocationError
from kinematics.error_model.model import no_errors, read_model
from kinematics.state import State
from kinematics.user_error import UserError
from postproc.control_data.formats import FORMATS as OF_CONTROLS

GANTRY, DMU50 = machines.load("gantry"), machines.load("dmu50")
LASER = {"u_um": "0.3", "u_um_per_m": "0.5", "target.r": "0 0 -60"}


@pytest.fixture
def write(tmp_path, monkeypatch):
    """Writes a file into a folder of the test's own."""
    monkeypatch.chdir(tmp_path)

    def write_text(text: str | bytes, name: str = "data.txt") -> Path:
        Path(name).write_bytes(text if isinstance(text, bytes) else text.encode())
        return Path(name)

    return write_text


# ---- Renishaw


@pytest.mark.parametrize(
    "change", [lambda t: t, lambda t: t.replace("\n", "\r\n"), lambda t: t.replace("mill", "铣床")]
)
def test_renishaw(write, change):
    m = read_any(write(change(RTL).encode("gbk"), "x.rtl"), GANTRY, header=LASER)
    assert m.instrument == Interferometer(0.3, 0.5)
    assert m.axis.tolist() == ["X"] * 24
    assert m.run.tolist() == ["1"] * 12 + ["2"] * 12
    assert m.state.approach[:, 0].tolist() == ([1.0] * 6 + [-1.0] * 6) * 2
    assert m.state.positions[:, 0].tolist() == [*range(0, 600, 100), *range(500, -100, -100)] * 2
    expected = [run + target / 10 for run in (1, 2, 3, 4) for target in (range(1, 7) if run % 2 else range(6, 0, -1))]
    np.testing.assert_allclose(m.observed[:, 0], np.array(expected) * 1e-3)
    assert m.notes[0] == "read as a linear measurement of X: targets in mm, deviations in um, measured minus target"
    assert m.where(0) == "x.rtl:23"
    assert m.tool[0].tolist() == [0, 0, -60]


def test_renishaw_one_direction_filled_with_zeros(write):
    text = re.sub(r"^ ([24])   (\d)      .*$", r" \1   \2      0", RTL, flags=re.M).replace("Flags: 0 0", "Flags: 0 1")
    m = read_any(write(text), GANTRY, header=LASER)
    assert m.run.tolist() == ["1"] * 6 + ["2"] * 6
    assert (m.state.approach[:, 0] == 1).all()
    assert "run 2 is left out: all its deviations are 0, as of a run that was not measured" in m.notes


def test_renishaw_axis_that_falls(write):
    """Targets listed downwards: the first run goes backward."""
    text = RTL.replace("0.000  100.000  200.000  300.000  400.000", "500 400 300 200 100").replace(" 500.000\n", " 0\n")
    m = read_any(write(text), GANTRY, header=LASER)
    assert m.state.approach[:, 0].tolist() == ([-1.0] * 6 + [1.0] * 6) * 2
    assert m.run.tolist() == ["1"] * 12 + ["2"] * 12


ASCENDING = re.sub(r"^ ([24])   (\d) ", lambda f: f" {f[1]}   {7 - int(f[2])} ", RTL, flags=re.M)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (RTL.replace("Axis:X", "Axis:"), "Axis: '' is no axis of machine gantry (w b X Y Z t); state axis"),
        (RTL.replace("Axis:X", "Axis:X-Achse"), "Axis: 'X-Achse' is no axis"),
        (RTL.replace("count: 6", "count: 7"), "Target-count: 7, but 6 targets are listed"),
        (RTL.replace("Target-count: 6\n", ""), "Target-count: missing"),
        (RTL.replace("1   2      1.2", "1   9      1.2"), "x.rtl:24: target 9 is none of 6"),
        (RTL.replace("1   2      1.2", "1   2      1,2"), "x.rtl:24: '1,2' is no number"),
        (RTL.replace("1   2      1.2", "1   2"), "x.rtl:24: '1 2' is not 'run target deviation'"),
        (RTL.replace("1   2      1.2", "1   4      1.2"), "run 1 passes its targets neither forward nor backward"),
        (RTL.split("DEVIATIONS")[0] + "EOF::\n", "no readings below 'Run Target Data:'"),
        (ASCENDING, "Flags: 0 0 2 0 means both directions, but all runs list their targets in the same order"),
        (RTL.replace("ISO", "Angular"), "axis X, 'Angular LASER': .rtl is read only of linear measurements"),
    ],
)  # fmt: skip
def test_renishaw_refused(write, text, words):
    with pytest.raises(UserError) as fault:
        read_any(write(text, "x.rtl"), GANTRY, header=LASER)
    assert words in str(fault.value)


def test_renishaw_needs_what_it_does_not_say(write):
    with pytest.raises(UserError, match=r"uncertainty .* of the interferometer is missing: state u_um"):
        read_any(write(RTL), GANTRY)
    with pytest.raises(UserError, match=r"axis C, .* read only of linear measurements"):
        read_any(write(RTL), DMU50, header={**LASER, "axis": "C"})
    assert read_any(write(RTL), GANTRY, header={**LASER, "axis": "Y"}).axis[0] == "Y"


# ---- tables of ISO 230-2


@pytest.mark.parametrize(
    "text",
    [
        WIDE,
        WIDE.replace(",", ".").replace(";", ","),
        WIDE.replace(";", "\t"),
        WIDE.replace("1 up", "1+").replace("2 up", "forward 2").replace("1 down", "run 1 -").replace("2 down", "↓ 2"),
        WIDE.replace("um\n# u_", "mm\n# u_").replace("0,5;-2,25;0,4;-2", "0,0005;-0,00225;0,0004;-0,002").replace(
            "100;1;;1,5;-1,5", "100;0,001;;0,0015;-0,0015"
        ),
    ],
)  # fmt: skip
def test_wide_table(write, text):
    m = read_any(write(text), GANTRY)
    assert m.instrument == Interferometer(0.3)
    assert m.run.tolist() == ["1", "1", "1", "2", "2", "2", "2"]
    assert m.state.approach[:, 0].tolist() == [1, 1, -1, 1, 1, -1, -1]
    assert m.state.positions[:, 0].tolist() == [0, 100, 0, 0, 100, 100, 0]
    np.testing.assert_allclose(m.observed[:, 0] * 1e3, [0.5, 1, -2.25, 0.4, 1.5, -1.5, -2], rtol=1e-12)
    assert m.lines.tolist() == [6, 7, 6, 6, 7, 7, 6]


def test_wide_table_of_a_rotary_axis(write):
    text = WIDE.replace("axis: X", "axis: C").replace("unit: um", "unit: arcsec").replace("target_mm", "target_deg")
    m = read_any(write(text), DMU50)
    np.testing.assert_allclose(m.observed[:2, 0], np.radians(np.array([0.5, 1]) / 3600))
    np.testing.assert_allclose(m.state.positions[1, 0], math.radians(100))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("# unit: um\n", ""), "state the unit of the deviations (# unit: um | mm | inch)"),
        (("unit: um", "unit: urad"), "unit 'urad' is none of um, mm, inch"),
        (("# axis: X\n", ""), "state the axis (# axis: X | Y | Z), got ''"),
        (("target_mm", "target_deg"), "w.txt:5: target_deg is not for X, a linear axis"),
        (("0,4;", "x;"), "w.txt:6 column 2 up: 'x' is no number"),
        (("\n0;", "\n;"), "w.txt:6 column target_mm: empty"),
        (("1,5;-1,5", "1,5"), "w.txt:7: 4 cells, but 5 columns have names"),
        (("# u_um: 0.3\n", ""), "state u_um above zero"),
    ],
)
def test_wide_table_refused(write, change, words):
    assert change[0] in WIDE
    with pytest.raises(UserError) as fault:
        read_any(write(WIDE.replace(*change), "w.txt"), GANTRY)
    assert words in str(fault.value)


# ---- coordinate measuring machines


def test_cmm(write):
    m = read_any(
        write(CMM.replace("\n", "\r\n")),
        GANTRY,
        header={"u_um": "2.3", "part_offset": "2500 1500 10", "target.t": "0 0 -5"},
    )
    assert m.instrument == Part(2.3, 0.0, 2)
    assert m.observed.tolist() == [[-73.126, 121.717], [231.288, 204.188]]
    np.testing.assert_allclose(m.state.positions, [[2426.86, 1621.705, 15], [2731.279, 1704.187, 15]])
    assert m.lines.tolist() == [5, 6]
    assert m.notes[0] == "lengths are read as mm: the file names no unit"
    three = (
        CMM.replace("Nom D   Round", "Meas Z Nom Z").replace("2.167   0.007", "1.1 1").replace("2.167   0.018", "1.2 1")
    )
    m = read_any(write(three), GANTRY, header={"u_um": "2.3"})
    assert (m.instrument.components, m.observed[:, 2].tolist()) == (3, [1.1, 1.2])


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (CMM.replace("0.014 ", "0.024 "), "c.txt:5: Err X is 0.024, Meas - Nom is 0.014"),
        (CMM.replace("2.174   2.167   0.007", "2.174   2.167"), "c.txt:5: 8 numbers, but 9 columns have names"),
        (CMM.replace("231.279", "231,279"), "c.txt:6 column nom x: '231,279' is no number"),
        ("\n".join(CMM.splitlines()[:4]), "no observations"),
    ],
)
def test_cmm_refused(write, text, words):
    with pytest.raises(UserError) as fault:
        read_any(write(text, "c.txt"), GANTRY, header={"u_um": "2.3"})
    assert words in str(fault.value)


@pytest.fixture
def plates():
    """Folder of the plug plates of the Sloan survey."""
    folder = Path(__file__).parents[2] / "shared" / "data" / "plug_plates"
    if not folder.is_dir():
        pytest.skip("the measured plug plates (../shared/data/plug_plates) are not beside this repository")
    return folder


@pytest.mark.parametrize(("name", "holes"), [("D1396A1", 637), ("D1597A_2003", 650), ("D8131_1", 82)])
def test_plug_plates(plates, name, holes):
    header = {"u_um": "2.3", "part_offset": "2500 1500 100"}
    m = read_any(plates / name, GANTRY, header=header)
    assert len(m) == holes
    rows = [line.split() for line in (plates / name).read_text().splitlines() if re.match(r"\s*-?\d+\.\d+\s", line)]
    errors = np.array([[float(row[4]), float(row[5])] for row in rows])
    np.testing.assert_allclose(m.observed - (m.state.positions[:, :2] - [2500, 1500]), errors, atol=1.1e-3)
    with pytest.raises(UserError, match="state u_um"):
        read_any(plates / name, GANTRY)


# ---- tracker exports

PLAN = "point,X,Y,Z,target\np1,0,0,1500,t1\np2,1000,0,1500,t1\np3,2000,0,1500,t1\n"
TARGET = {"target.t1": "0 0 -120"}


def test_spatialanalyzer(write):
    text = "// exported\ncol,S1,p2,1.5,2,3\ncol,S1,p1,0.5,2,3\ncol,S2,p2,1.25,2,3\n"
    m = read_any(write(text), GANTRY, columns="spatialanalyzer", plan=write(PLAN, "plan.csv"), header=TARGET)
    assert m.instrument == LaserTracker(0.5, 0.25, 5.0, 2.5)
    assert m.observed.tolist() == [[1.5, 2, 3], [0.5, 2, 3], [1.25, 2, 3]]
    assert m.state.positions[:, 0].tolist() == [1000, 0, 1000]
    assert m.state.station.tolist() == ["S1", "S1", "S2"]
    assert m.lines.tolist() == [2, 3, 4]
    assert m.notes == (
        "points of the plan that were not measured, 1: p3",
        "the file names no machine: it is read as data of gantry",
    )


def test_polyworks(write):
    text = "Name;Type;X;Y;Z\np2;point;1,5;2;-3,25\np1;point;0,5;2;3\n"
    m = read_any(
        write(text), GANTRY, columns="polyworks", plan=write(PLAN.replace("point", "Name"), "plan.csv"), header=TARGET
    )
    assert m.observed.tolist() == [[1.5, 2, -3.25], [0.5, 2, 3]]
    assert m.lines.tolist() == [2, 3]


def test_leica(write):
    text = "# nr X Y Z t x y z\n1 10 20 30 0.5   1.0001 -2 3\n2\t11 20 30 1.5   1.001 -2 3\n"
    m = read_any(write(text), GANTRY, columns="leica", header=TARGET)
    np.testing.assert_allclose(m.observed, [[1000.1, -2000, 3000], [1001, -2000, 3000]])
    assert m.state.positions.tolist() == [[10, 20, 30], [11, 20, 30]]
    assert m.state.time.tolist() == [0.5, 1.5]


def test_units_of_a_map(write):
    header = {"target.t1": "1 2 3"}
    m = read_any(
        write("2,0.5,294.65,1500,0.25,1000,2000,3000,-1\n"), DMU50, columns=str(write(MAP, "m.toml")), header=header
    )
    np.testing.assert_allclose(m.state.positions[0], [0.5, 0, 50.8, 0, 400])
    np.testing.assert_allclose(m.observed[0], [1, 2, 3])
    np.testing.assert_allclose(m.state.temperatures["air"], [1.5])
    assert m.state.time.tolist() == [1.5]
    np.testing.assert_allclose(m.actual[0, 0], 0.25)
    assert m.state.approach[0, 2] == -1
    assert m.stands_on == "bed"
    assert m.targets["t1"].position == (1, 2, 3)  # what is given along overrules the map


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (('xyz = "um"\n', ""), "column map does not state the unit of x: add [units] xyz = mm|m|inch|um"),
        (('linear = "inch"\n', ""), "does not state the unit of X"),
        (('xyz = "um"', 'xyz = "cm"'), "units.xyz: unit 'cm' is none of mm, m, inch, um"),
        (('decimal = "."', 'decimal = ","'), "a comma cannot be both the separator of cells and the decimal sign"),
        (('delimiter = ","\n', ""), "column map m.toml: delimiter is missing: write delimiter ="),
        (
            ('delimiter = ","', 'delimiter = "|"'),
            "column map m.toml:1: delimiter: expected ',', ';', 'tab' or 'blank', not '|'",
        ),
        (
            ("x = 6", 'x = "PosX"'),
            "column 'PosX' is missing or occurs twice; the columns are 2, 0.5, 294.65",
        ),
        (("x = 6", "x = 60"), "data.txt:1: column 60 is missing: the line has 9 columns"),
        (("x = 6", "x = 0"), "data.txt:1: column 0 is missing"),
        (("[columns]", 'join = "point"\n[columns]'), "join 'point' is not one of its columns"),
        (("[columns]", "colour = 1\n[columns]"), "column map m.toml:3: colour is not known"),
        (("x = 6", "x = 6\nspeed = 3"), "data.txt column speed: not known"),
        (("z = 8\n", ""), "data.txt laser-tracker: column z missing"),
        (("u_angle_um = 5\n", ""), "state u_angle_um or u_angle_um_per_m above zero"),
        (("[columns]", "[columns"), "column map m.toml:3: '[columns': column 9"),
    ],
)
def test_maps_refused(write, change, words):
    assert change[0] in MAP
    with pytest.raises(UserError) as fault:
        read_any(
            write("2,0.5,294.65,1500,0.25,1000,2000,3000,-1\n"),
            DMU50,
            columns=str(write(MAP.replace(*change), "m.toml")),
        )
    assert words in str(fault.value)


@pytest.mark.parametrize(
    ("export", "plan", "words"),
    [
        ("c,S,p9,1,2,3\n", PLAN, "data.txt:1 column point: 'p9' is not in the plan plan.csv"),
        ("c,S,p1,1,2,3\n", PLAN + "p1,0,0,0,t1\n", "plan.csv:5 column point: 'p1' occurs twice"),
        ("c,S,p1,1,2,3\n", PLAN.replace("target", "x"), "plan.csv:1 column x occurs in the export too"),
        ("c,S,p1,1,2,3\n", PLAN.replace("point", "name"), "plan.csv:1 a plan: column point missing"),
        ("c,S,p1,1,2,3\n", PLAN.replace("p1,0,", "p1,left,"), "data.txt:1 column X: 'left' is no number"),
        ("c,S,p1,1,2,3\nc,S,p1,1,2\n", PLAN, "data.txt:2: column 6 is missing: the line has 5 columns"),
        ("c,S,p1,1,2,3mm\n", PLAN, "data.txt:1 column 6: '3mm' is no number"),
        ("// nothing\n\n", PLAN, "data.txt contains no data"),
    ],
)
def test_exports_refused(write, export, plan, words):
    with pytest.raises(UserError) as fault:
        read_any(write(export), GANTRY, columns="spatialanalyzer", plan=write(plan, "plan.csv"), header=TARGET)
    assert words in str(fault.value)


def test_shipped_maps():
    assert map_names() == ["leica", "polyworks", "spatialanalyzer"]
    for name in map_names():
        assert read_map(name).keys["instrument"] == "laser-tracker"


def test_a_map_with_names_takes_them_from_the_first_line(tmp_path):
    (tmp_path / "map.toml").write_text('delimiter = ";"\ndecimal = ","\n[columns]\nx = "Gemessen X"\ny = 2\n')
    assert read_map(str(tmp_path / "map.toml")).named
    (tmp_path / "map.toml").write_text('delimiter = ";"\ndecimal = ","\n[columns]\nx = 1\ny = 2\n')
    assert not read_map(str(tmp_path / "map.toml")).named


def test_map_and_plan_where_they_have_no_use(write):
    with pytest.raises(UserError, match="a column map is for delimited exports, not for format cmm"):
        read_any(write(CMM), GANTRY, "cmm", columns="leica")
    with pytest.raises(UserError, match="a column map with 'join'"):
        read_any(write("1 2 3 4 5 6 7 8\n"), GANTRY, columns="leica", plan=write(PLAN, "plan.csv"))
    with pytest.raises(UserError, match="looks up 'point' in a plan: give --plan"):
        read_any(write("c,S,p1,1,2,3\n"), GANTRY, columns="spatialanalyzer")
    with pytest.raises(UserError, match=r"needs a column map: leica, polyworks, spatialanalyzer, or a \.toml file"):
        read_any(write("1 2"), GANTRY, "delimited")


# ---- whichever it is


def test_formats_are_recognised(write):
    own = "# instrument: laser-tracker\n# u_range_um: 1\n# u_angle_um: 1\nX,x,y,z\n0,1,2,3\n"
    for text, header in ((own, {}), (RTL, LASER), (WIDE, {}), (CMM, {"u_um": "2.3"})):
        auto = read_any(write(text), GANTRY, header=header)
        assert len(auto) > 0
        with pytest.raises(UserError):
            read_any(write(text[: len(text) // 9]), GANTRY, header=header)
    foreign = ("rtl", "iso230-table", "ecmc-report", "cmm", "epics", "twincat-scope", "ballbar-angles")
    assert ("auto", "ncomp", *foreign, "target-readings", "robot", "delimited") == FORMATS


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "1 2 3\n4 5 6\n",
            r"the format of the file is unknown: give a column map .*; known formats are ncomp \(measurement file.*delimited",
        ),
        (
            "a,b\n1,2\n",
            r"the format of the file is unknown: give a column map .*; known formats are ncomp \(measurement file.*delimited",
        ),
        (b"\x89PNG\r\n\x1a\n\0\0", "this is a picture, no measurement: give the data of an instrument"),
        ("G0 X1\n", "this is an NC program, no measurement: give the data of an instrument"),
    ],
)
def test_other_files(write, text, message):
    with pytest.raises(UserError, match=message):
        read_any(write(text), GANTRY)


def test_format_that_is_none(write):
    with pytest.raises(UserError, match="format 'xls' is none of auto, ncomp"):
        read_any(write(""), GANTRY, "xls")


def test_header_overrules_the_file(write):
    own = "# instrument: laser-tracker\n# u_range_um: 1\n# u_angle_um: 1\nX,x,y,z\n0,1,2,3\n"
    assert read_any(write(own), GANTRY, header={"u_range_um": "7"}).instrument == LaserTracker(7.0, 0.0, 1.0)
    with pytest.raises(UserError, match=r"^data.txt u_range_um: expected a number, got 'x'"):
        read_any(write(own), GANTRY, header={"u_range_um": "x"})


# ---- Etalon


def read_etalon(text, value_is="error", **settings):
    return (
        OF_CONTROLS["etalon"]
        .read_files(DMU50, {"t.txt": text}, value_is, [f"{k}={v}" for k, v in settings.items()])
        .effects
    )


def test_etalon():
    square, shift, motion, turn = effects = read_etalon(ETALON)
    assert isinstance(square, LocationError)
    assert (square.name, square.value) == ("E_C0Y", pytest.approx(22.0))
    assert (shift.name, shift.value) == ("E_X0C", pytest.approx(-10.0))
    assert isinstance(motion, ErrorMotion)
    assert (motion.name, motion.basis.nodes, motion.basis.degree) == ("E_XX", (-250.0, 0.0, 250.0), 1)
    assert motion.parameters == pytest.approx((-1.0, 0.5, 2.0))
    assert (turn.name, turn.parameters) == ("E_CC", pytest.approx((10.0, 20.0)))
    model = msgspec.structs.replace(no_errors(DMU50), effects=tuple(effects))
    errors = model.errors(DMU50, State(np.array([[0, 0, 125.0, 0, 0]])))
    assert errors[0, 2, 0] == pytest.approx(0.00125)
    opposite = read_etalon(ETALON, "correction", length="um", angle="deg", rotary="rad")
    assert opposite[2].parameters == pytest.approx((0.001, -0.0005, -0.002))
    assert opposite[0].value == pytest.approx(-math.radians(0.000022) * 1e6)
    assert opposite[3].basis.nodes[1] == pytest.approx(math.degrees(360))


def test_the_units_of_etalon_are_for_import(command):
    Path("t.etalon").write_text(ETALON)
    words = ("-m", "dmu50", "--format", "etalon", "--sign", "error", "--set", "length=um")
    assert command("import", "t.etalon", *words, "-o", "out.json").status == 0
    (motion,) = (each for each in read_model(Path("out.json"), DMU50).effects if each.name == "E_XX")
    assert motion.parameters == pytest.approx((-0.001, 0.0005, 0.002))
    refused = command("export", *words, "-c", "out.json", "-o", "tables")
    assert refused.status == 2
    assert "are for import" in refused.err


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("EXX", "EXA"), "t.txt:6: '[EXA]': the machine dmu50 has no such axis"),
        (("EXX", "FOO"), "t.txt:6: '[FOO]': expected [EXX], [C0Y], VALUE = or Gridpoints = {"),
        (("EXX", "X0B"), "t.txt:6: '[X0B]': expected one VALUE for a location error"),
        (("C0Y", "ECY"), "t.txt:2: '[ECY]': expected at least two grid points for an error motion"),
        (("0.0  0.0005", "0.0"), "t.txt:9: '0.0   // in the middle': expected a grid point: position and value"),
        (("0.0  0.0005", "0.0  abc"), "t.txt:9: '0.0  abc   // in the middle': could not convert"),
        (("250.0  0.002", "-50.0  0.002"), "t.txt:10: '-50': positions must increase"),
        (("[ECC]", "[EXX]"), "t.txt:12: '[EXX]': E_XX is given twice"),
        (("}  // end of EXX\n", ""), "t.txt:11: '[ECC]': could not convert"),
        (("360 0.00002\n}", "360 0.00002"), "the '}' after the last grid points is missing"),
        (("// made up", "VALUE = 1"), "t.txt:1: 'VALUE = 1': expected [EXX]"),
        (("VALUE = 0.000022", "WERT = 3"), "t.txt:3: 'WERT = 3': expected [EXX]"),
    ],
)
def test_etalon_refused(change, words):
    assert change[0] in ETALON
    with pytest.raises(UserError) as fault:
        read_etalon(ETALON.replace(*change, 1))
    assert words in str(fault.value)


def test_etalon_elsewhere(write):
    with pytest.raises(UserError, match="contains errors of the machine, not measurements of it; ncomp import"):
        read_any(write(ETALON), DMU50)
    with pytest.raises(UserError, match=r"inch.*length"):
        read_etalon(ETALON, length="inch")
    with pytest.raises(UserError, match="no table of format etalon"):
        read_etalon("// empty\n")


# ---- any numbers

value = st.decimals(-999, 999, places=3, allow_nan=False).map(float)


@given(
    st.dictionaries(st.integers(0, 4000), st.lists(st.one_of(st.none(), value), min_size=4, max_size=4), min_size=1),
    st.booleans(),
)
def test_any_wide_table(tmp_path_factory, cells, comma):
    """Every reading that is there comes out once, in the run, direction and target of its cell."""
    rows = [";".join([str(p), *("" if v is None else str(v) for v in row)]) for p, row in cells.items()]
    text = "# axis: X\n# unit: um\n# u_um: 1\ntarget_mm;1 up;1 down;2 up;2 down\n" + "\n".join(rows)
    path = tmp_path_factory.mktemp("w") / "w.txt"
    path.write_text(text.replace(".", ",") if comma else text)
    there = {
        (p, str(k // 2 + 1), 1 - 2 * (k % 2)): v for p, row in cells.items() for k, v in enumerate(row) if v is not None
    }
    if not there:
        with pytest.raises(UserError, match="no observations"):
            read_any(path, GANTRY)
        return
    m = read_any(path, GANTRY)
    keys = zip(m.state.positions[:, 0].tolist(), m.run.tolist(), m.state.approach[:, 0].tolist(), strict=True)
    found = dict(zip(keys, (m.observed[:, 0] * 1e3).tolist(), strict=True))
    assert len(m) == len(there)
    assert found == pytest.approx(there)


# ---- the documentation

PAGES = sorted((Path(__file__).parents[1] / "docs" / "measurements").glob("*.md"))
EXAMPLES = [
    textwrap.dedent(block) for page in PAGES for block in re.findall(r"(?:^    .*\n)+", page.read_text(), re.MULTILINE)
]


@pytest.mark.parametrize("text", [text for text in EXAMPLES if text.startswith("#") and "time;temp" not in text])
def test_examples_of_the_documentation(write, text):
    named = re.search(r"machine: (\w+)", text)
    name = named[1] if named else "gantry"
    own = next((machines.parse(block, name) for block in EXAMPLES if block.startswith(f'name = "{name}"')), None)
    measurement = read_any(write(text), machines.load(name) if own is None else own)
    rows = text.count("\n") - text.count("#") - 1
    # a cell of the level is empty, and a length has two ends
    readings = {"EXX_um": 6 * rows, "pitch_urad": 2 * rows - 1, "length_mm\n": 2 * rows}
    expected = next((number for column, number in readings.items() if column in text), rows)
    assert len(measurement) == expected or "1 up" in text


def test_column_map_of_the_documentation(write):
    (text,) = (text for text in EXAMPLES if text.startswith("delimiter") and "join" in text)
    plan = write("point,X,Y,Z\np1,1,2,3\n", "plan.csv")
    m = read_any(write("c,S,p1,1,2,3\n"), GANTRY, columns=str(write(text, "m.toml")), plan=plan)
    assert m.state.positions.tolist() == [[1, 2, 3]]


def test_given_header_keys_and_empty_files(write):
    text = (
        "# machine: gantry\n# instrument: laser-tracker\n# u_range_um: 1\n# u_angle_um: 5\nX,Y,Z,x,y,z\n1,2,3,4,5,6\n"
    )
    assert "--header foo is unknown, and ignored" in read_any(write(text), GANTRY, header={"foo": "1"}).notes
    for nothing in ("", " \n\n"):
        with pytest.raises(UserError, match="is empty"):
            read_any(write(nothing), GANTRY)


SEVERAL = (
    'delimiter = ";"\ndecimal = ","\nnames = true\njoin = "point"\n[columns]\npoint = "Name"\ntarget = "Refl"\nx = "X"\n'
    'y = "Y"\nz = "Z"\n[units]\nxyz = "mm"\n[header]\ninstrument = "laser-tracker"\nu_range_um = 1\nu_angle_um = 2\n'
)


def test_a_plan_with_several_targets_at_each_point_is_joined_by_both(tmp_path):
    plan = tmp_path / "plan.csv"
    rows = [(f"P{i}", t, 100.0 * i, 50.0 * i, 10.0 * i) for i in range(1, 5) for t in ("t1", "t2")]
    head = "# target.t1: 0 0 -60\n# target.t2: 60 40 -90\npoint,target,X,Y,Z\n"
    plan.write_text(head + "".join(f"{p},{t},{x},{y},{z}\n" for p, t, x, y, z in rows))
    text = "Name;Refl;X;Y;Z\n"
    text += "".join(f"{p};{t};{x + 0.5};{y};{z}\n".replace(".", ",") for p, t, x, y, z in reversed(rows))
    export, columns = tmp_path / "export.txt", tmp_path / "map.toml"
    export.write_text(text)
    columns.write_text(SEVERAL)
    found = read_any(export, machines.load("gantry"), columns=str(columns), plan=plan)
    assert found.targets["t2"].position == (60.0, 40.0, -90.0)  # by the header of the plan
    assert found.state.target.tolist() == [t for _, t, *_ in reversed(rows)]
    np.testing.assert_allclose(found.state.positions[:, 0], [x for _, _, x, *_ in reversed(rows)])
    np.testing.assert_allclose(found.observed[:, 0], [x + 0.5 for _, _, x, *_ in reversed(rows)])
    columns.write_text(SEVERAL.replace('target = "Refl"\n', ""))
    with pytest.raises(UserError, match=r"'P1' occurs twice: .*, or map a column target too"):
        read_any(export, machines.load("gantry"), columns=str(columns), plan=plan)
    columns.write_text(SEVERAL.replace('delimiter = ";"', 'delimiter = "tab"').replace("names = true", "names = false")
                       .replace('"Name"', "1").replace('"Refl"', "2"))  # fmt: skip
    with pytest.raises(UserError, match=r"the line has 1 columns, and contains ';': check delimiter"):
        read_any(export, machines.load("gantry"), columns=str(columns), plan=plan)


@pytest.mark.parametrize("empty", ["\t", " , ", " ; "])
def test_many_empty_cells_take_no_time(write, empty):
    """18 of them took half a minute, and each more three times as long."""
    path = write(f"1.5{empty * 18}x\n2.5{empty * 18}x\n")
    start = time.process_time()
    with pytest.raises(UserError, match=r"data\.txt: the format of the file is unknown"):
        read_any(path, GANTRY)
    assert time.process_time() - start < 2.0
