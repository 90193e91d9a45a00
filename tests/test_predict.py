"""Predictions of a calibration against the kinematics done once more, point by point; the two commands at a shell."""

import csv
import dataclasses
import datetime
import html
import json
import math
import re
from pathlib import Path
from typing import NamedTuple

import msgspec
import numpy as np
import pytest
from support.file_examples import LASER
from support.pages import text_of
from support.programs import random_model

import machines
from calibration.fit.prediction import predictions, read_points, relative
from kinematics.basis import BSpline, Legendre
from kinematics.deviation import exact_deviation
from kinematics.effects import Backlash, DriftWithSensor, ErrorMotion, LocationError, RangeOffset, ThermalDrift
from kinematics.error_model.model import ErrorModel, read_model, write_model
from kinematics.error_model.provenance import Provenance, reference
from kinematics.machine import Machine
from kinematics.state import State
from kinematics.transforms import ROWS_OF_BLOCK
from kinematics.user_error import UserError
from rendering.si import si

GANTRY, DMU50 = machines.load("gantry"), machines.load("dmu50")


def model_of(machine: Machine, *effects, covariance=None) -> ErrorModel:
    made = Provenance("test", datetime.datetime(2020, 1, 1, tzinfo=datetime.UTC))
    return ErrorModel(machine=reference(machine), provenance=made, effects=effects, covariance=covariance)


class Result(NamedTuple):
    status: int
    out: str
    err: str


@pytest.fixture
def ncomp(command):
    """The command line, in a folder of its own; what it prints is text."""

    def run(*arguments: object) -> Result:
        done = command(*arguments)
        return Result(done.status, done.out.decode(), done.err)

    return run


def rows_of(text: str) -> list[dict[str, str]]:
    return list(csv.DictReader(line for line in text.splitlines() if not line.startswith("#")))


# ---- what is predicted

STRETCH = ErrorMotion(component="X", axis="X", basis=BSpline((0.0, 5000.0), 1), parameters=(0.0, 500.0), u=(0.0, 5.0))
YAW = ErrorMotion(component="C", axis="X", basis=BSpline((0.0, 5000.0), 1), parameters=(0.0, 100.0), u=(0.0, 2.0))
PLAY = Backlash(axis="Y", width=20.0, u=(1.0,))
GROWTH = ThermalDrift(component="Z", rate=-6.0, amplitudes=(), time_constants_s=(), u=(0.5,))


def test_by_hand(ncomp):
    """A stretched, yawing X, backlash in Y, and a spindle that grows, added up with a pencil."""
    write_model(model_of(GANTRY, STRETCH, YAW, PLAY, GROWTH), Path("cal.json"))
    Path("points.csv").write_text(
        "# machine: gantry\n# target.t1: 0 100 -50\n# a remark\nstation,X,Y,Z,time_s,dir_Y\n"
        "a,2500.0,100,0,0,1\nb,5000,100.00,0,3600,-1\n"
    )
    assert (
        ncomp("predict", "points.csv", "-m", "gantry", "-c", "cal.json", "-o", "out.csv", "--json", "out.json").status
        == 0
    )
    text = Path("out.csv").read_text()
    assert text.splitlines()[:3] == ["# machine: gantry", "# target.t1: 0 100 -50", "# a remark"]
    assert text.splitlines()[3].startswith("# predicted_with: calibration ")
    one, other = rows_of(text)
    assert ",".join(one) == "station,X,Y,Z,time_s,dir_Y,dx_um,dy_um,dz_um,u_dx_um,u_dy_um,u_dz_um"
    assert (one["station"], one["X"], other["Y"]) == ("a", "2500.0", "100.00")
    # the carriage turns by 50 urad about itself, so the arm (0, Y + 100, -50) swings the target by -50 x 0.2 um in x
    assert float(one["dx_um"]) == pytest.approx(250 - 50e-6 * 200e3, abs=1e-3)
    assert float(one["dy_um"]) == pytest.approx(-10.0, abs=1e-3)
    assert float(one["dz_um"]) == 0.0
    assert float(one["u_dx_um"]) == pytest.approx(math.hypot(2.5, 1e-6 * 200e3), abs=1e-4)
    assert float(one["u_dy_um"]) == pytest.approx(0.5)
    assert float(other["dx_um"]) == pytest.approx(500 - 100e-6 * 200e3, abs=2e-3)
    assert float(other["dy_um"]) == pytest.approx(10.0, abs=2e-3)
    assert float(other["dz_um"]) == pytest.approx(-6.0)
    assert float(other["u_dz_um"]) == pytest.approx(0.5)
    data = json.loads(Path("out.json").read_text())
    assert data["points"] == 2
    assert data["deviation_um"]["max"] == pytest.approx(math.sqrt(480**2 + 10**2 + 6**2), abs=0.01)
    assert data["dx_um"]["rms"] == pytest.approx(math.sqrt((240**2 + 480**2) / 2), abs=0.01)
    assert data["significant_share"] == 1.0


def test_against_kinematics_of_each_point(tmp_path):
    """The shipped five-axis calibration with covariances: exact deviations, and u from differences of parameters."""
    rng = np.random.default_rng(2)
    shipped = read_model(machines.default_calibration(DMU50), DMU50)
    few = tuple(effect for effect in shipped.effects if isinstance(effect, LocationError))[:4]
    motion = ErrorMotion(
        component="A", axis="Z", basis=Legendre((0.0, 400.0), 2), parameters=(3.0, -4.0, 5.0), u=(1.0, 1.0, 1.0)
    )
    size = sum(len(effect.parameters) for effect in (*few, motion))
    root = rng.normal(size=(size, size))
    covariance = tuple(tuple(row) for row in (root @ root.T).tolist())
    model = model_of(DMU50, *few, motion, covariance=covariance)
    path = tmp_path / "p.csv"
    q = np.stack([rng.uniform(*axis.travel, 30) for axis in DMU50.axes], axis=1)
    lines = [",".join([*(repr(v) for v in row), "t1" if i % 2 else "t2"]) for i, row in enumerate(q.tolist())]
    path.write_text(
        "# machine: dmu50\n# target.t2: 30 0 -90\n# target.t1: 0 0 -120\nC,B,X,Y,Z,target\n" + "\n".join(lines)
    )
    points = read_points(path, DMU50)
    (block,) = predictions(model, DMU50, points.states.state, points.states.tool)
    tool = np.array([(0, 0, -120) if i % 2 else (30, 0, -90) for i in range(30)], float)
    positions = q * DMU50.scale

    def exact(parameters):
        effects, left = [], list(parameters)
        for effect in model.effects:
            n = len(effect.parameters)
            effects.append(effect.with_parameters(left[:n]))
            left = left[n:]
        state = dataclasses.replace(points.states.state)
        return exact_deviation(DMU50, positions, model_of(DMU50, *effects).errors(DMU50, state), tool).position * 1e3

    np.testing.assert_allclose(block.deviation, exact(model.parameters), atol=1e-9)
    steps = np.eye(size) * 1e-2
    slopes = np.stack([(exact(step) - exact(-step)) / 2e-2 for step in steps], axis=2)  # at no errors
    u = np.sqrt(np.einsum("nip,pq,niq->ni", slopes, np.array(covariance), slopes))
    np.testing.assert_allclose(block.u, u, rtol=1e-5, atol=1e-6)


def test_lagged_sensor_over_long_tables(tmp_path):
    """An effect that remembers earlier rows: the same as from all rows at once, values and uncertainties."""
    n = 2 * ROWS_OF_BLOCK + 100
    rng = np.random.default_rng(3)
    warm = np.cumsum(rng.normal(0, 0.1, n)) + 22.0
    rows = "\n".join(f"{i % 5000},0,0,{5.0 * i},{warm[i]:.6f}" for i in range(n))
    path = tmp_path / "p.csv"
    path.write_text("# machine: gantry\nX,Y,Z,time_s,temp_spindle\n" + rows)
    lag = DriftWithSensor(component="Z", sensor="spindle", coefficient=-3.0, lag_s=20_000.0, u=(0.2, 500.0))
    size = len(STRETCH.parameters) + 2
    root = rng.normal(size=(size, size))
    for covariance in (None, tuple(tuple(row) for row in (root @ root.T).tolist())):
        model = model_of(GANTRY, STRETCH, lag, covariance=covariance)
        state = read_points(path, GANTRY).states.state
        tool = np.zeros((n, 3))
        blocks = list(predictions(model, GANTRY, state, tool))
        assert len(blocks) == 3
        whole = exact_deviation(GANTRY, state.positions, model.errors(GANTRY, state)).position * 1e3
        np.testing.assert_allclose(np.concatenate([block.deviation for block in blocks]), whole, atol=1e-9)
        transform = np.zeros((n, 3, 24))
        transform[:, :, 18:21] = np.eye(3)
        transform[:, 0, 0] = 1.0
        u = model.standard_uncertainty(GANTRY, state, transform) * 1e3
        np.testing.assert_allclose(np.concatenate([block.u for block in blocks]), u, rtol=1e-9, atol=1e-12)


def test_effects_of_the_instrument_have_no_part(tmp_path):
    path = tmp_path / "p.csv"
    path.write_text("# machine: gantry\nX,Y,Z\n1000,2,3\n")
    points = read_points(path, GANTRY)
    tracker = RangeOffset(offset_um=40.0, u=(1.0,))
    (block,) = predictions(model_of(GANTRY, tracker, STRETCH), GANTRY, points.states.state, points.states.tool)
    np.testing.assert_allclose(block.deviation, [[100.0, 0, 0]], atol=1e-9)
    np.testing.assert_allclose(block.u, [[1.0, 0, 0]], atol=1e-9)


KINDS = {
    "tracker": "# machine: gantry\n# instrument: laser-tracker\n# u_range_um: 1\nX,Y,Z,x,y,z\n2500,0,0,,no number,7\n",
    "interferometer": "# machine: gantry\naxis,run,direction,target_mm,deviation_um\nX,1,+,2500,3.5\n",
    "part": "# machine: gantry\n# part_offset: 2000 0 0\nnominal_x,nominal_y,x,y\n500,0,501,0\n",
}


@pytest.mark.parametrize("text", KINDS.values(), ids=KINDS)
def test_points_of_any_instrument(ncomp, text):
    """What was observed is not looked at."""
    write_model(model_of(GANTRY, STRETCH), Path("cal.json"))
    Path("p.csv").write_text(text)
    done = ncomp("predict", "p.csv", "-m", "gantry", "-c", "cal.json")
    assert (done.status, float(rows_of(done.out)[0]["dx_um"])) == (0, 250.0)


# ---- the command


def test_notes_and_summary(ncomp):
    write_model(model_of(GANTRY, without_u(STRETCH)), Path("cal.json"))
    Path("p.csv").write_text("X,Y\r\n5100,1\r\n1,1\r\n")
    done = ncomp("predict", "p.csv", "-m", "gantry", "-c", "cal.json", "--json", "-", "-o", "out.csv")
    data = json.loads(done.out)
    assert done.status == 0
    assert data["notes"] == [
        "the file names no machine: it is read as data of gantry",
        "the header gives no target: it is assumed in the tool reference point (spindle nose)",
        "no column of Z: the home position is used (Z 1500 mm)",
        "X leaves its travel 0..5000 mm by 100 mm: are these machine coordinates?",
        "E_XX is used up to 100 mm beyond its calibrated range; its end value is held there",
        "the calibration has no uncertainties: every deviation counts as significant",
    ]
    for note in data["notes"]:
        assert f"note: {note}" in done.err
    assert (
        "2 points: deviation of the tool point 353.55 um RMS, at most 500.00 um; at 2 of them it is significant"
        in done.err
    )
    assert Path("out.csv").read_bytes().count(b"\r") == 0


def test_the_page_has_the_notes_of_the_terminal(ncomp):
    Path("p.csv").write_text("X,Y,Z,B,C\n0,0,100,190,0\n50,20,120,60,90\n")
    done = ncomp("predict", "p.csv", "-m", "dmu50", "-o", "out.csv", "--report", "page.html")
    notes = [line.removeprefix("note: ") for line in done.err.splitlines() if line.startswith("note: ")]
    assert "E_XB, E_YB, E_ZB, E_AB, E_BB, E_CB: each is used up to 10 deg beyond its calibrated range" in done.err
    page = html.unescape(text_of(Path("page.html")))
    assert len(notes) == 4
    for note in notes:
        assert si(note) in page
    assert page.index("DEMONSTRATION CALIBRATION") < page.index("Deviations in the workpiece frame")
    rows = re.findall(r"<td[^>]*>(-?[\d.]+ ± [\d.]+)</td>", page)
    assert len(rows) == 6


def without_u(effect: ErrorMotion) -> ErrorMotion:
    """The effect without uncertainties."""
    return effect.with_parameters(effect.parameters)


def test_without_errors(ncomp):
    Path("p.csv").write_text("# machine: gantry\nX,Y,Z\n1,2,3\n")
    done = ncomp("predict", "p.csv", "-m", "gantry", "-c", "none")
    assert rows_of(done.out)[0]["dx_um"] in ("0.0000", "-0.0000")
    assert "calibration none" in done.out


@pytest.mark.parametrize(
    ("text", "arguments", "words"),
    [
        ("X,Y\n1\n", (), "p.csv:2: 1 cells, but 2 columns have names"),
        ("X,Yy\n1,2\n", (), "p.csv:1 column Yy: not known"),
        ("x,y,z\n1,2,3\n", (), "p.csv:1: no column has commanded positions of an axis (X, Y, Z)"),
        ("X,dx_um\n1,2\n", (), "p.csv:1 column dx_um: these points already have a prediction"),
        ("# machine: dmu50\nX\n1\n", (), "p.csv:1 machine: the file is of 'dmu50', not of gantry"),
        ("# table.r: 1 2 3\nX\n1\n", (), "p.csv: target r is on the table: only a target on the tool can be predicted"),
        ("X\n1\n", ("--json", "-"), "--output and --json cannot both go to standard output"),
        ("X\n1\n", ("--json", "o", "-o", "o"), "--output and --json both name o"),
        ("X\n1\n", ("-c", "drift.json"), "needs time, which these data do not give"),
        ("X\n1\n", ("-c", "none.json"), "none.json: No such file"),
    ],
)
def test_refused(ncomp, text, arguments, words):
    write_model(model_of(GANTRY, STRETCH), Path("cal.json"))
    write_model(model_of(GANTRY, GROWTH), Path("drift.json"))
    Path("p.csv").write_text(text)
    before = sorted(Path().iterdir())
    calibration = () if "-c" in arguments else ("-c", "cal.json")
    done = ncomp("predict", "p.csv", "-m", "gantry", *calibration, *arguments)
    assert (done.status, done.out) == (2, "")
    assert words in done.err
    assert done.err.startswith("ncomp: ")
    assert done.err.count("\n") == 1
    assert sorted(Path().iterdir()) == before


def test_missing_points(tmp_path):
    with pytest.raises(UserError, match=r"file of points .*none\.csv: No such file"):
        read_points(tmp_path / "none.csv", GANTRY)


# ---- ISO 230-2 at a shell


def test_iso230(ncomp):
    Path("laser.csv").write_text(LASER)
    done = ncomp("iso230", "laser.csv", "-m", "gantry", "--header", "u_um=0.3", "-o", "x.csv", "--json", "x.json")
    assert done.status == 0
    for words in (
        "reversal value",
        "Axis X: deviations in um\nDeviations are measured minus target.",
        "2.00",
        "U (k=2, instrument), um",
    ):
        assert words in done.out
    assert "note: X: 5 targets, 2 readings each: ISO 230-2 requires" in done.err
    rows = rows_of(Path("x.csv").read_text())
    assert list(rows[0]) == ["axis", "direction", "position_mm", "error_um", "u_um", "n"]
    assert [(row["direction"], float(row["position_mm"]), float(row["error_um"])) for row in rows] == [
        *(("forward", 100.0 * i, i + 0.25) for i in range(5)),
        *(("backward", 100.0 * i, i - 1.75) for i in range(5)),
    ]
    u = math.hypot(math.sqrt(0.125), 0.3) / math.sqrt(2)
    assert [float(row["u_um"]) for row in rows] == pytest.approx([u] * 10, abs=1e-4)
    values = json.loads(Path("x.json").read_text())["axes"][0]["values"]
    assert values["B"] == pytest.approx({"value_um": 2.0, "U_um": 2 * 0.3})
    assert values["M"]["value_um"] == pytest.approx(4.0)


def test_iso230_of_linear_and_rotary_axes(ncomp):
    Path("l.csv").write_text(
        "# instrument: interferometer\n# u_um: 0.3\naxis,run,direction,target_mm,target_deg,deviation_um,deviation_urad\n"
        "X,1,+,0,,1,\nX,1,+,100,,2,\nB,1,+,,0,,10\nB,1,+,,90,,30\n"
    )
    done = ncomp("iso230", "l.csv", "-m", "dmu50", "-o", "-")
    rows = rows_of(done.out)
    assert list(rows[0]) == [
        "axis",
        "direction",
        "position_deg",
        "error_urad",
        "u_urad",
        "position_mm",
        "error_um",
        "u_um",
        "n",
    ]
    assert (rows[1]["error_urad"], rows[1]["error_um"], rows[3]["error_um"]) == ("30.0000", "", "2.0000")
    assert "target, deg" in done.err


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((), "state u_um above zero"),
        (("--header", "u_um"), "--header u_um: expected KEY=VALUE, as in u_um=0.3"),
        (("--header", "u_um=1", "--header", "u_um=2"), "--header u_um=2: u_um is given twice"),
        (("--header", "u_um=1", "--format", "rtl"), "Target-count: missing"),
        (("--header", "u_um=1", "--json", "-", "-o", "-"), "cannot both go to standard output"),
    ],
)
def test_iso230_refused(ncomp, arguments, words):
    Path("laser.csv").write_text(LASER)
    done = ncomp("iso230", "laser.csv", "-m", "gantry", *arguments)
    assert (done.status, done.out) == (2, "")
    assert words in done.err


def test_help(ncomp):
    for command, example in (("predict", "ncomp predict points.csv"), ("iso230", "ncomp iso230 laser.csv")):
        shown = ncomp(command, "--help")
        assert shown.status == 0
        assert example in shown.out


def test_directions_without_errors_of_the_model_are_unknown():
    """Their uncertainty is not zero."""
    along = ErrorMotion("X", "X", Legendre((0.0, 400.0), 1), (0.0, 9.0), u=(1.0, 2.0))
    state, tool = State(np.linspace((0.0, 0.0, 0.0), (400.0, 10.0, 10.0), 5)), np.zeros((5, 3))
    text = str(relative(model_of(GANTRY, along), GANTRY, state, tool))
    assert re.search(r" of \d\.\d\d um in x\. .* has \d\.\d\d um; .* Deviations in y, z are unknown", text)
    assert " um in x, y, z. " in str(relative(random_model(GANTRY, 1), GANTRY, state, tool))
    without = model_of(GANTRY, msgspec.structs.replace(along, u=()))
    assert " of 0.00, 0.00, 0.00 um in x, y, z. " in str(relative(without, GANTRY, state, tool))
