"""Straightness, angles and six-degree data along one axis' line: signs, registration, files, fit."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from support.command import succeed

import machines
from calibration.measurement.file import read_measurement
from calibration.measurement.readers import read_any
from calibration.measurement.written_file import write_measurement
from calibration.single_axis.iso230 import evaluate
from kinematics.error_model.model import Observation, read_model
from kinematics.state import State
from kinematics.transforms import Array
from kinematics.user_error import UserError

CFRAME = machines.load("cframe")
HEAD = "# machine: cframe\n# instrument: interferometer\n# u_um: 0.3\n# u_straightness_um: 0.5\n# u_angle_urad: 1\n"
WIDE = "run,direction,X,EXX_um,EYX_um,EZX_um,EAX_urad,EBX_urad,ECX_urad\n"


def written(folder: Path, text: str) -> Path:
    path = folder / "data.csv"
    path.write_text(text)
    return path


@pytest.mark.parametrize("name", ["cframe", "gantry", "bzt_pfu", "dmu50", "head_head"])
def test_every_error_motion_is_read_with_its_own_sign(tmp_path: Path, name: str) -> None:
    """Tool relative to workpiece, whichever of the two the axis carries: E_YX of 5 um is read as 5 um in y."""
    machine = machines.load(name)
    for axis in [axis for axis in machine.axes if not axis.rotary]:
        columns = [f"E{c}{axis.name}_{'um' if c in 'XYZ' else 'urad'}" for c in "XYZABC"]
        homes = [f"{each.home}" for each in machine.axes]
        head = HEAD.replace("cframe", name) + ",".join(["run", "direction", *machine.names, *columns])
        text = f"{head}\n{','.join(['1', '+', *homes])},1,2,3,4,5,6\n"
        measurement = read_measurement(written(tmp_path, text), machine)
        errors = np.zeros((6, len(machine.axes) + 1, 6))
        six = np.arange(1, 7) * np.array([1e-3] * 3 + [1e-6] * 3)
        errors[:, machine.index(axis.name)] = six * np.array([1, 1, 1, 0, 0, 0])
        registration = measurement.instrument.first_registration(measurement, np.ones(6, bool))
        registration = type(registration)(zeros=dict.fromkeys(registration.zeros, 0.0), slopes=registration.slopes)
        seen = measurement.instrument.expected(measurement, registration, Observation(errors, np.zeros((6, 3))))
        np.testing.assert_allclose(seen[:3], measurement.observed[:3], atol=1e-9)
        errors[:, machine.index(axis.name)] = six * np.array([0, 0, 0, 1, 1, 1])
        seen = measurement.instrument.expected(measurement, registration, Observation(errors, np.zeros((6, 3))))
        np.testing.assert_allclose(seen[3:], measurement.observed[3:], atol=1e-9)


def simulated(folder: Path, *options: str) -> Path:
    data = folder / "data.csv"
    succeed(
        "simulate", "--machine", "cframe", "--strategy", "axes", "--spacing", "30", "--runs", "2", "--target", "t=0,0,-90",
        "--instrument", "interferometer", "--error-motions", "all", *options, "-o", str(data),
        "--truth", str(folder / "truth.json"),
    )  # fmt: skip
    return data


def test_lines_of_straightness_slope_to_both_sides(tmp_path: Path) -> None:
    """They lie off their axes by up to 0.5 mm/m: of a machine without errors that is all that is read."""
    options = ("--errors", "none", "--noise-scale", "0", "--runs", "4")
    measurement = read_measurement(simulated(tmp_path, *options), CFRAME)
    slopes = [
        np.polyfit(measurement.axis_position[rows], measurement.observed[rows, 0], 1)[0]
        for rows in (measurement.groups == group for group in np.unique(measurement.groups[measurement.straightness]))
    ]
    assert max(map(abs, slopes)) <= 5.0e-4
    assert min(max(slopes), -min(slopes)) > 3e-4


def curves(path: Path, x: Array) -> dict[str, Array]:
    """Error motions of X by component, um and urad, at positions `(n,)`."""
    q = np.tile([axis.home for axis in CFRAME.axes], (len(x), 1)).astype(float)
    q[:, CFRAME.index("X")] = x
    errors = read_model(path, CFRAME).errors(CFRAME, State(q * CFRAME.scale, approach=np.zeros_like(q)))[
        :, CFRAME.index("X")
    ]
    return {c: errors[:, k] * (1e3 if k < 3 else 1e6) for k, c in enumerate("XYZABC")}


def without_line(values: Array, x: Array, degree: int) -> Array:
    return np.asarray(values - np.polynomial.Polynomial.fit(x, values, degree)(x))


def test_fit_finds_all_six_error_motions_of_an_axis(tmp_path: Path) -> None:
    options = ("--machine", "cframe", "--basis", "cubic:9", "--no-hold-out", "-o", str(tmp_path / "cal.json"))
    succeed("fit", str(simulated(tmp_path)), *options)
    x = np.linspace(*CFRAME.axes[CFRAME.index("X")].travel, 50)
    true, found = curves(tmp_path / "truth.json", x), curves(tmp_path / "cal.json", x)
    for component in "XYZABC":
        degree = 1 if component in "YZ" else 0
        left = without_line(found[component] - true[component], x, degree)
        assert np.sqrt(np.mean(left**2)) < 0.15 * np.sqrt(np.mean(without_line(true[component], x, degree) ** 2)) + 0.3


@pytest.mark.statistical
def test_slope_and_offset_of_a_straightness_are_the_lasers_not_the_machines(tmp_path: Path) -> None:
    data = simulated(tmp_path)
    succeed("fit", str(data), "--machine", "cframe", "--basis", "cubic:6", "-o", str(tmp_path / "one.json"))
    lines = data.read_text().splitlines()
    top = next(i for i, line in enumerate(lines) if not line.startswith("#"))
    names = lines[top].split(",")
    axis, component, target, reading, urad = (
        names.index(n) for n in ("axis", "component", "target_mm", "deviation_um", "deviation_urad")
    )
    for i in range(top + 1, len(lines)):
        cells = lines[i].split(",")
        if cells[component] in "ABC":
            cells[urad] = f"{float(cells[urad]) + 40.0:.4f}"
        elif cells[component] != cells[axis]:
            cells[reading] = f"{float(cells[reading]) + 25.0 + 0.3 * float(cells[target]):.4f}"
        lines[i] = ",".join(cells)
    written(tmp_path, "\n".join(lines) + "\n")
    succeed("fit", str(data), "--machine", "cframe", "--basis", "cubic:6", "-o", str(tmp_path / "two.json"))
    x = np.linspace(*CFRAME.axes[CFRAME.index("X")].travel, 30)
    one, two = curves(tmp_path / "one.json", x), curves(tmp_path / "two.json", x)
    for letter in "XYZABC":
        np.testing.assert_allclose(two[letter], one[letter], atol=0.05)


def test_a_file_of_columns_is_that_of_rows_and_is_written_back(tmp_path: Path) -> None:
    text = f"{HEAD}{WIDE}1,+,0,0,0,0,0,0,0\n1,+,100,1,2,,4,5,6\n1,-,100,1.5,2,3,,,\n"
    measurement = read_measurement(written(tmp_path, text), CFRAME)
    assert len(measurement) == 14
    assert measurement.component is not None
    assert "".join(measurement.component) == "XYZABC" + "XYABC" + "XYZ"
    assert measurement.where(7) == f"{tmp_path / 'data.csv'}:8"
    assert measurement.state.approach is not None
    assert measurement.state.approach[-1, CFRAME.index("X")] == -1.0
    with (tmp_path / "again.csv").open("wb") as file:
        write_measurement(measurement, file)
    again = read_measurement(tmp_path / "again.csv", CFRAME)
    np.testing.assert_array_equal(again.observed, measurement.observed)
    np.testing.assert_array_equal(again.component, measurement.component)
    assert [test.axis for test in evaluate(measurement)] == ["X"]


def test_an_export_takes_units_and_signs_from_its_map(tmp_path: Path) -> None:
    (tmp_path / "map.toml").write_text(
        'delimiter = ";"\ndecimal = ","\nnames = true\nreversed = ["EBX_urad"]\n'
        '[columns]\nX = "Pos"\nrun = "Run"\ndirection = "Dir"\nEYX_um = "Hor"\nEBX_urad = "Pitch"\n'
        '[units]\nlinear = "mm"\nerrors = "mm"\nangles = "arcsec"\n'
        '[header]\ninstrument = "interferometer"\nu_straightness_um = 0.5\nu_angle_urad = 1\n'
    )
    data = written(tmp_path, "Pos;Run;Dir;Hor;Pitch\n0;1;+;0;0\n100,5;1;+;0,002;1,5\n")
    measurement = read_any(data, CFRAME, columns=str(tmp_path / "map.toml"))
    assert measurement.observed[2, 0] == pytest.approx(2e-3)
    assert measurement.observed[3, 0] == pytest.approx(-1.5 * np.pi / 180 / 3600)


@pytest.mark.parametrize(
    ("head", "row", "words"),
    [
        ("run,direction,X,EYX_urad", "1,+,0,1", "E_YX is in um"),
        ("run,direction,X,EYQ_um", "1,+,0,1", "no axis 'Q'"),
        ("run,direction,EYX_um", "1,+,1", "position of X is missing: column target_mm or X"),
        ("run,direction,axis,X,EYX_um", "1,+,Y,0,1", "Y, but the row has an error motion of X"),
        ("run,direction,X,EYX_um", "1,+,0,", "no row has an error motion"),
        ("run,direction,X,EYX_um", "1,+,0,a", "'a' is no number"),
        ("run,direction,X,EYX_um,deviation_um", "1,+,0,1,1", "is not allowed together with columns of error motions"),
        ("axis,run,direction,component,target_mm,deviation_um", "X,1,+,Q,0,1", "'Q' is none of X, Y, Z, A, B, C"),
        ("axis,run,direction,component,target_mm,deviation_um", "X,1,+,B,0,1", "needs the column deviation_urad"),
    ],
)
def test_files_that_can_not_be_used(tmp_path: Path, head: str, row: str, words: str) -> None:
    with pytest.raises(UserError) as fault:
        read_measurement(written(tmp_path, f"{HEAD}{head}\n{row}\n"), CFRAME)
    assert words in str(fault.value)


def test_each_kind_needs_its_uncertainty(tmp_path: Path) -> None:
    text = f"# machine: cframe\n# instrument: interferometer\n# u_um: 0.3\n{WIDE}1,+,0,0,0,0,0,0,0\n"
    with pytest.raises(UserError, match="of angles is missing: state u_angle_urad"):
        read_measurement(written(tmp_path, text), CFRAME)
    only = (
        "# machine: cframe\n# instrument: interferometer\n# u_straightness_um: 0.3\nrun,direction,X,EYX_um\n1,+,0,0\n"
    )
    assert len(read_measurement(written(tmp_path, only), CFRAME)) == 1


def test_a_rotary_axis_has_no_such_columns(tmp_path: Path) -> None:
    text = HEAD.replace("cframe", "dmu50") + "run,direction,C,ECC_urad\n1,+,0,1\n"
    with pytest.raises(UserError, match="belong to linear axes"):
        read_measurement(written(tmp_path, text), machines.load("dmu50"))


@pytest.mark.statistical
def test_diagnose_finds_backlash_in_six_degree_data(tmp_path: Path) -> None:
    data = simulated(tmp_path, "--effect", "backlash:axis=Y,width=9")
    found = tmp_path / "found.json"
    succeed("diagnose", str(data), "--machine", "cframe", "-o", str(tmp_path / "new.json"), "--json", str(found))
    effects = json.loads(found.read_text())["effects"]
    assert [(e["kind"], e["axis"]) for e in effects if e["verdict"] == "strong"] == [("backlash", "Y")]
