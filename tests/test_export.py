"""`ncomp export` and `ncomp import`."""

import json

import numpy as np
import pytest
from support.programs import load, model_of
from support.table_cases import PLAY, POSITIONING, SQUARENESS, STRAIGHTNESS, motions
from support.tiers import quick

from kinematics.basis import Harmonics
from kinematics.effects import Backlash, ErrorMotion, GrowthWithSensor, LocationError, Scale
from kinematics.error_model.model import read_model, write_model
from kinematics.state import State

pytestmark = pytest.mark.usefixtures("few_positions")

NC = "G21 G90 G0 X10 Y10 Z400\nG1 X500 Y300 F800\nG2 X400 Y200 I-100 J0\nG1 Z100\nX20\nX30\nX25\nM2\n"


@pytest.fixture
def calibration(tmp_path):
    machine = load("cframe")
    path = tmp_path / "cal.json"
    further = [*SQUARENESS, *PLAY, GrowthWithSensor(axis="Z", sensor="spindle", coefficient=9.0)]
    write_model(model_of(machine, *motions(machine, f"{POSITIONING} {STRAIGHTNESS} AX"), *further), path)
    return path


def test_export_writes_tables_sheet_rest_and_json(command, calibration, tmp_path):
    (tmp_path / "part.nc").write_text(NC)
    done = command(
        "export", "--machine", "cframe", "-c", calibration, "--format", "linuxcnc", "-o", "out", "--tool-mm", 80,
        "--rest", "rest.json", "--program", "part.nc", "--json", "out.json",
    )  # fmt: skip
    assert done.status == 0, done.err
    told = json.loads((tmp_path / "out.json").read_text())
    assert told["files"] == ["comp_x.txt", "comp_y.txt", "comp_z.txt", "linuxcnc.ini", "sheet.md"]
    assert sorted(told["files"]) == sorted(path.name for path in (tmp_path / "out").iterdir())
    assert (told["values_are"], told["sign_confirmed"], told["tool_mm"]) == ("correction", True, 80)
    names = {item["error"] for item in told["not_carried"]}
    assert {"E_YX", "E_AX", "thermal-scale-sensor Z spindle"} <= names
    assert "E_XX" not in names
    for where in ("volume", "program"):
        point = told["errors"][where]["tool_point_um"]
        order = [point[stage]["rms"] for stage in ("before", "after_tables", "after_nc_correction")]
        assert order[0] > order[1] > order[2]
        assert order[2] < 1e-3
        assert point["after_tables_and_nc_correction_of_the_rest"]["max"] < 0.02
    sheet = (tmp_path / "out" / "sheet.md").read_text()
    assert "9.0000 um/m/K of sensor spindle" in sheet
    assert "backlash of X | 15.000 um" in sheet
    assert [
        line.endswith("| yes: do not enter it as well |") for line in sheet.splitlines() if "| backlash of" in line
    ] == [True, True]
    assert [table["name"] for table in told["tables"]][:2] == ["X(X) forward", "X(X) backward"]
    assert f"| with these tables | {told['errors']['volume']['tool_point_um']['after_tables']['rms']:.2f} |" in sheet


def test_a_program_corrected_with_the_rest_does_what_is_left(command, calibration, tmp_path):
    """Nothing twice: the two corrections, one after the other, move as much as the program corrected alone."""
    (tmp_path / "part.nc").write_text(NC)
    options = ("--machine", "cframe", "--temperature", "spindle=20", "--set-up-zero")
    made = command("export", "--machine", "cframe", "-c", calibration, "--format", "linuxcnc", "-o", "t", "--rest", "rest.json")  # fmt: skip
    assert made.status == 0, made.err
    done = command("part.nc", *options, "-c", "rest.json", "-o", "rest.nc", "--json", "report.json")
    assert done.status == 0, done.err
    report = json.loads((tmp_path / "report.json").read_text())
    before = report["predicted_error_um"]["before"]["rms"]
    assert "TAKE-UP" not in (tmp_path / "rest.nc").read_text()  # the backlash is in the tables
    done = command("part.nc", *options, "-c", calibration, "-o", "all.nc", "--json", "report.json")
    assert done.status == 0, done.err
    report = json.loads((tmp_path / "report.json").read_text())
    whole = report["predicted_error_um"]["before"]["rms"]
    assert "TAKE-UP" in (tmp_path / "all.nc").read_text()
    assert 0 < before < 0.9 * whole


def test_import_subtracts_and_adds(command, calibration, tmp_path):
    machine = load("cframe")
    assert command("export", "--machine", "cframe", "-c", calibration, "--format", "csv", "-o", "t").status == 0
    for option, out in (("", "is.json"), ("--less-tables-from", "less.json"), ("--with-tables-to", "with.json")):
        more = (option, calibration) if option else ()
        done = command("import", "t", "--machine", "cframe", "--format", "csv", "-o", out, *more)
        assert done.status == 0, done.err
    rng = np.random.default_rng(3)
    q = rng.uniform(0, 450, (200, 3))
    state = State(q, rng.choice([-1.0, 1.0], q.shape), temperatures={"spindle": np.zeros(200)})
    whole, tables, less, both = (
        read_model(tmp_path / name, machine).errors(machine, state)
        for name in ("cal.json", "is.json", "less.json", "with.json")
    )
    assert less == pytest.approx(whole - tables, abs=1e-12)
    assert both == pytest.approx(whole + tables, abs=1e-12)
    assert np.abs(less).max() < 1e-4 < np.abs(tables).max()


def test_export_of_the_calibration_with_tables_active_is_of_the_whole_machine(command, tmp_path):
    """Measured with old tables active, new tables hold old and new."""
    machine = load("cframe")
    old, left = (model_of(machine, *motions(machine, names, size=10.0)) for names in ("XX", "YY"))
    write_model(old, tmp_path / "old.json")
    write_model(left, tmp_path / "measured.json")
    run = ("--machine", "cframe", "--format", "linuxcnc")
    assert command("export", *run, "-c", "old.json", "-o", "old").status == 0
    assert command("import", "old", *run, "-o", "raw.json", "--with-tables-to", "measured.json").status == 0
    assert command("export", *run, "-c", "raw.json", "-o", "new").status == 0
    rows = [np.loadtxt(tmp_path / where / "comp_x.txt") for where in ("old", "new")]
    at = np.linspace(0, 600, 50)
    for column in (1, 2):
        values = [np.interp(at, row[:, 0], row[:, column]) for row in rows]
        assert values[0] == pytest.approx(values[1], abs=2e-6)
    assert (tmp_path / "new" / "comp_y.txt").exists()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--format", "heidenhein"), "--format heidenhein: expected one of linuxcnc"),
        (("--format", "linuxcnc", "--set", "points=1"), "--set: Expected `int` >= 2"),
        (("--format", "linuxcnc", "--sign", "error"), "known to mean the correction"),
        (("--format", "linuxcnc", "--sign", "up"), "--sign up: expected error or correction"),
        (("--format", "linuxcnc", "--probe", "X", "--sign", "correction"), "--probe excludes --sign"),
        (("--format", "linuxcnc", "--probe", "Q"), "has no axis Q"),
        (("--format", "linuxcnc", "--rest", "cal.json"), "is an input and would be overwritten"),
        (("--format", "linuxcnc", "--rest", "no/rest.json"), "No such file or directory"),
        (("--format", "linuxcnc", "--program", "empty.nc"), "cannot be evaluated"),
        (("--format", "linuxcnc", "--set", "joints=XY"), "Z has a table; expected its letter among the joints"),
    ],
)
def test_what_cant_be_done_is_refused_and_leaves_nothing(command, calibration, tmp_path, arguments, said):
    (tmp_path / "empty.nc").write_text("G21\nM2\n")
    before = sorted(tmp_path.iterdir())
    done = command("export", "--machine", "cframe", "-c", calibration, "-o", "out", *arguments)
    assert (done.status, done.out) == (2, b"")
    assert said in done.err
    assert sorted(tmp_path.iterdir()) == before


def test_a_folder_that_is_not_empty_is_refused(command, calibration, tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "comp_a.txt").write_text("0 0 0\n")
    done = command("export", "--machine", "cframe", "-c", calibration, "--format", "linuxcnc", "-o", "out")
    assert done.status == 2
    assert "expected a new or empty folder" in done.err
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["comp_a.txt"]


def test_a_calibration_without_standing_errors_is_refused(command, tmp_path):
    machine = load("cframe")
    write_model(model_of(machine, GrowthWithSensor(axis="Z", sensor="s", coefficient=9.0)), tmp_path / "c.json")
    for calibration in ("c.json", "none"):
        done = command("export", "--machine", "cframe", "-c", calibration, "--format", "csv", "-o", "out")
        assert done.status == 2
        assert "no errors that a table can hold" in done.err


def test_rotary_centres_are_in_the_sheet(command, tmp_path):
    machine = load("head_table")
    model = model_of(machine, LocationError("X", "C", 30.0), LocationError("A", "B", -12.0), *motions(machine, "XX"))
    write_model(model, tmp_path / "c.json")
    done = command("export", "--machine", "head_table", "-c", "c.json", "--format", "csv", "-o", "out")
    assert done.status == 0, done.err
    sheet = (tmp_path / "out" / "sheet.md").read_text()
    assert "| E_X0C | 30.000 um: the line lies at X -0.030000 Y 0.000000 Z 0.000000 mm instead of" in sheet
    assert "| E_A0B | -12.000 urad: the line is tilted by -12.000 urad about A |" in sheet


BAD_TABLES = {
    "a comment": ("0 0 0\n# x\n10 0.01 0.01\n", "comp_x.txt:2: '# x': expected three numbers"),
    "a blank line": ("0 0 0\n\n10 0.01 0.01\n", "comp_x.txt:2: '': expected three numbers"),
    "two columns": ("0 0\n", "comp_x.txt:1"),
    "not a number": ("0 0 nan\n", "not finite"),
    "a word": ("0 0 x\n", "could not convert"),
    "not increasing": ("0 0 0\n0 1 1\n", "positions must increase"),
    "too many": ("".join(f"{k} 0 0\n" for k in range(257)), "reads at most 256 rows"),
    "nothing": ("", "comp_x.txt: the file has no rows"),
}


@pytest.mark.parametrize(("text", "said"), BAD_TABLES.values(), ids=BAD_TABLES)
def test_tables_that_linuxcnc_would_cut_off_are_refused(command, tmp_path, text, said):
    (tmp_path / "my.ini").write_text("[EMC]\nMACHINE = x\n[JOINT_0]\nCOMP_FILE = comp_x.txt\nCOMP_FILE_TYPE = 1\n")
    (tmp_path / "comp_x.txt").write_text(text)
    files = ("my.ini", "comp_x.txt")
    done = command("import", *files, "--machine", "cframe", "--format", "linuxcnc", "-o", "out.json")
    assert done.status == 2
    assert said in done.err
    assert not (tmp_path / "out.json").exists()


def test_the_sample_that_linuxcnc_ships(command, tmp_path):
    """configs/sim/screwcompX.dat of LinuxCNC 5c41560: its first row; a missing COMP_FILE_TYPE is 0."""
    (tmp_path / "my.ini").write_text("[JOINT_0]\nCOMP_FILE = screwcompX.dat\n[HAL]\nHALFILE = a.hal\nHALFILE = b.hal\n")
    (tmp_path / "screwcompX.dat").write_text("-10 -10.001  -9.999\n10 10.001 10.002\n")
    files = ("my.ini", "screwcompX.dat")
    done = command("import", *files, "--machine", "cframe", "--format", "linuxcnc", "-o", "out.json")
    assert done.status == 0, done.err
    machine = load("cframe")
    state = State(np.array([[-10.0, 0, 0], [-10.0, 0, 0]]), np.array([[1.0, 0, 0], [-1.0, 0, 0]]))
    errors = read_model(tmp_path / "out.json", machine).errors(machine, state)[:, 0, 0]
    assert errors == pytest.approx([-0.001, 0.001], abs=1e-12)


def test_where_the_rest_cannot_be_written_nothing_is(command, calibration, tmp_path):
    done = command(
        "export", "--machine", "cframe", "-c", calibration, "--format", "csv", "-o", "out", "--json", "out.json",
        "--rest", "/proc/rest.json",
    )  # fmt: skip
    assert (done.status, done.err.count("\n")) == (2, 1), done.err
    assert not (tmp_path / "out").exists()
    assert not (tmp_path / "out.json").exists()


def test_a_file_that_is_no_text_is_refused(command, tmp_path):
    (tmp_path / "t.ini").write_bytes(bytes(range(256)))
    done = command("import", "t.ini", "--machine", "cframe", "--format", "siemens-eec", "-o", "in.json")
    assert (done.status, "expected a text file" in done.err) == (2, True), done.err


def test_tables_are_not_corrected_by_a_class(command, calibration, tmp_path):
    """A table holds errors of several classes: the rest of a calibration is corrected as a whole."""
    (tmp_path / "part.nc").write_text(NC)
    made = command(
        "export", "--machine", "cframe", "-c", calibration, "--format", "siemens-cec", "--sign", "error", "-o", "t",
        "--rest", "rest.json",
    )  # fmt: skip
    assert made.status == 0, made.err
    options = ("--machine", "cframe", "-c", "rest.json", "--temperature", "spindle=20", "--set-up-zero")
    refused = command("correct", "part.nc", *options, "--classes", "L-POS", "-o", "part_c.nc")
    assert (refused.status, "L-ANG, L-SQU, L-STR as well" in refused.err) == (2, True), refused.err
    assert not (tmp_path / "part_c.nc").exists()
    for name, classes in (("all.nc", ()), ("chosen.nc", ("--classes", "L-VOL"))):
        done = command("correct", "part.nc", *options, *classes, "-o", name)
        assert done.status == 0, done.err
    moves = [
        [row for row in (tmp_path / name).read_text().splitlines() if row[:1] == "G"]
        for name in ("all.nc", "chosen.nc")
    ]
    assert moves[0] == moves[1]


def test_a_table_of_a_rotary_axis_is_read_and_written(command, tmp_path):
    """As a calibration file, which holds numbers of plain Python."""
    table = "kopf.log_achs_name C\nkw.ssfk.unit 1\nkw.ssfk.kw_nr_max 2\n" + "".join(
        f"kw.ssfk.table[{k}].setpoint {k * 900000}\nkw.ssfk.table[{k}].pos {k}\n" for k in range(2)
    )
    (tmp_path / "c.lis").write_text(table)
    done = command("import", "c.lis", "--machine", "head_table", "--format", "isg", "-o", "made.json")
    assert done.status == 0, done.err
    (effect,) = read_model(tmp_path / "made.json", load("head_table")).effects
    assert effect.axis == "C"


@pytest.mark.parametrize(
    ("form", "name"), quick([("siemens-eec", "interval"), ("heidenhain", "distance")], [("siemens-eec", "interval")])
)
def test_an_interval_that_does_not_divide_the_turn_is_refused(command, tmp_path, form, name):
    machine = load("dmu50")
    positioning = ErrorMotion("C", "C", Harmonics((0.0, 360.0), 1), (0.0, 20.0, 10.0))
    write_model(model_of(machine, positioning), tmp_path / "c.json")
    run = ("export", "--machine", "dmu50", "-c", "c.json", "--format", form, "--sign", "error", "-o", "out")
    layout = ("--set", "layout=old") if form == "heidenhain" else ()
    done = command(*run, *layout, "--set", f"{name}=7")
    assert done.status == 2
    assert "an interval of 7 does not divide the 360 degrees" in done.err
    assert "give 6 or 7.2" in done.err
    assert not (tmp_path / "out").exists()
    assert command(*run, *layout, "--set", f"{name}=7.2").status == 0


def test_a_reversal_that_a_table_cannot_hold_is_stated_with_one_half(command, tmp_path):
    """Backlash of X 8 um and of C 50 urad, in a table that is the same in both directions."""
    machine = load("dmu50")
    effects = (Backlash("C", 50.0), Backlash("X", 8.0), Scale("X", 30.0))
    write_model(model_of(machine, *effects), tmp_path / "cal.json")
    options = ("--machine", "dmu50", "-c", "cal.json", "--format", "siemens-eec", "--sign", "error", "-o", "out")
    done = command("export", *options, "--json", "-")
    left = {each["error"]: each["rms_um"] for each in json.loads(done.out)["not_carried"]}
    assert left == {"reversal of C": pytest.approx(25.0, abs=1e-3), "reversal of X": pytest.approx(4.0, abs=1e-3)}
