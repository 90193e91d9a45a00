"""`ncomp square`: squareness from the lengths of a rectangle, its calibration, and lengths that are none."""

import json
from pathlib import Path

import numpy as np
import pytest

import ncomp
from benchmarks import lengths as benchmark
from kinematics.deviation import exact_deviation
from kinematics.error_model.model import read_model
from kinematics.state import State


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "router.toml").write_text(benchmark.MACHINE)
    return tmp_path


def squared(command, *words) -> tuple[dict, str]:
    """The results, and what is printed."""
    done = command("square", *words, "--json", "-")
    assert done.status == 0, done.err
    return json.loads(done.out), " ".join(done.err.split())


@pytest.mark.parametrize(
    ("lengths", "tangent"),
    [((319, 318, 199), 0.003218), ((141.22, 141.15, 100), 0.000496), ((318, 319, 199), -0.003218)],
)
def test_the_reference_results_of_printers(command, lengths, tangent):
    ac, bd, ad = lengths
    found, printed = squared(command, "--ac", ac, "--bd", bd, "--ad", ad)
    assert found["tangent"] == pytest.approx(tangent, abs=5e-7)
    assert found["squareness_urad"] == pytest.approx(-1e6 * tangent, abs=0.5)
    assert found["lean_mm_per_300_mm"] == pytest.approx(300 * tangent, abs=2e-4)
    side = np.sqrt((ac**2 + bd**2) / 2 - ad**2)
    assert found["u_urad"] == pytest.approx(1e6 * 0.5 * np.hypot(ac, bd) / (2 * ad * side), rel=0.01)
    assert f"Y leans towards {'+' if tangent > 0 else '-'}X" in printed
    assert f"corners at {'A and C' if tangent > 0 else 'B and D'} are smaller than 90 degrees" in printed


def test_a_larger_uncertainty_than_the_result_is_said(command):
    words = "less than its uncertainty: the axes may be square"
    assert words in squared(command, "--ac", 319, "--bd", 318, "--ad", 199)[1]
    assert words not in squared(command, "--ac", 319, "--bd", 318, "--ad", 199, "--u", 0.1)[1]


@pytest.mark.parametrize("plane", ["XY", "XZ", "YZ"])
def test_the_calibration_puts_the_corners_where_they_were_measured(command, folder, plane):
    """The machine with the errors of the calibration marks a rectangle with these diagonals."""
    given = "--ac", 851, "--bd", 846.5, "--ad", 600, "--ab", 600.5, "--plane", plane
    done = command("square", *given, "-m", folder / "router.toml", "-o", folder / "cal.json")
    assert done.status == 0, done.err
    machine = ncomp.load_machine(folder / "router.toml")
    model = read_model(folder / "cal.json", machine)
    corners = {"A": (0.0, 0.0), "B": (0.0, 600.5), "C": (600.0, 600.5), "D": (600.0, 0.0)}
    q = np.zeros((4, 3))
    q[:, ["XYZ".index(axis) for axis in plane]] = list(corners.values())
    marks = q + exact_deviation(machine, q, model.errors(machine, State(q)), np.zeros((4, 3))).position
    a, b, c, d = marks
    assert np.linalg.norm(c - a) - np.linalg.norm(d - b) == pytest.approx(4.5, abs=0.03)
    assert model.effects[0].u[0] == pytest.approx(1e6 * 0.5 * np.hypot(851, 846.5) / (2 * 600 * 600.5), rel=0.01)


def test_a_program_is_corrected_by_it(command, folder):
    """Y leans towards +X by 3.218 mm per metre: the program is given less X at high Y."""
    machine = "-m", folder / "router.toml"
    given = "--ac", 319, "--bd", 318, "--ad", 199, "--u", 0.05
    assert command("square", *given, *machine, "-o", folder / "cal.json").status == 0
    program, output = folder / "part.nc", folder / "out.nc"
    program.write_text("G21 G90 G54 G17\nG0 X0 Y0 Z0\nG1 X100 Y0 F500\nG1 X100 Y100\nM30\n")
    options = "-c", folder / "cal.json", "--work-offset", "G54=100,100,-50", "-o", output, "--accept", "insignificant"
    done = command(program, *machine, *options)
    assert done.status == 0, done.err
    xs = [word for line in output.read_text().splitlines() for word in line.split() if word.startswith("X")]
    assert float(xs[-1][1:]) == pytest.approx(100.0 - 0.3218, abs=0.002)


def test_the_measurement_file_is_fitted(command, folder):
    machine = "-m", folder / "router.toml"
    given = "--ac", 851, "--bd", 846.5, "--ad", 600, "--ab", 600.5, "--size", "601,600"
    assert command("square", *given, *machine, "-o", folder / "lengths.csv").status == 0
    done = command("fit", folder / "lengths.csv", *machine, "-o", folder / "cal.json")
    assert done.status == 0, done.err
    (square,) = (
        e for e in read_model(folder / "cal.json", ncomp.load_machine(machine[1])).effects if e.kind == "location"
    )
    assert square.value == pytest.approx(-5300.0, abs=30.0)


BAD = {
    "exchanged": (("--ac", 199, "--bd", 318, "--ad", 319), "--ad 319: a side is shorter than both diagonals, --ac 199 and --bd 318: are two letters exchanged?"),
    "zero": (("--ac", 319, "--bd", 0, "--ad", 199), "--bd 0: a length is above 0"),
    "negative": (("--ac", 319, "--bd", 318, "--ad", -199), "--ad -199: a length is above 0"),
    "far off": (("--ac", 319, "--bd", 250, "--ad", 199), "the corner would be more than 2.9 degrees off 90"),
    "contradiction": (("--ac", 319, "--bd", 318, "--ad", 199, "--ab", 260), "--ab 260 contradicts the other lengths, which say 248.68 mm"),
    "no u": (("--ac", 319, "--bd", 318, "--ad", 199, "--u", 0), "--u 0: expected the standard uncertainty of a length"),
    "no machine": (("--ac", 319, "--bd", 318, "--ad", 199, "-o", "cal.json"), "-o cal.json: it belongs to a machine"),
    "no size": (("--ac", 319, "--bd", 318, "--ad", 199, "-m", "cframe", "-o", "x.csv"), "give --size MM,MM"),
    "size for nothing": (("--ac", 319, "--bd", 318, "--ad", 199, "--size", "2,3"), "--size 2,3: is for a measurement file"),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD)
def test_what_is_no_rectangle_is_refused(command, name, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    words, reason = BAD[name]
    done = command("square", *words)
    assert done.status == 2
    assert reason in " ".join(done.err.split())
    assert not list(tmp_path.iterdir())


def test_equal_diagonals_are_square(command):
    found, printed = squared(command, "--ac", 300, "--bd", 300, "--ad", 200)
    assert found["squareness_urad"] == 0.0
    assert "Y is square to X, to 1.42 mm in 300 mm" in printed


def test_inches_are_asked_about(command):
    _, printed = squared(command, "--ac", 12.559, "--bd", 12.52, "--ad", 7.835, "--u", 0.02)
    assert "lengths are in mm, not in inches" in printed
