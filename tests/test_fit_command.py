"""`ncomp fit` as a user calls it: on virtual trackers, on real plates, on what it cannot use."""

import io
import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.pages import figures
from support.tiers import quick
from support.virtual_measurements import THREE, measured, positions, truth

import machines
from calibration.measurement.written_file import write_measurement
from kinematics.error_model.model import read_model

MACHINE = machines.load("cframe")


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    """A virtual measurement with one outlier, as a file, and its truth."""
    rng = np.random.default_rng(0)
    model = truth(MACHINE, rng, 20.0)
    measurement = measured(MACHINE, positions(MACHINE, 240, rng, edges=100), THREE, model, rng)
    observed = measurement.observed.copy()
    observed[7, 1] += 0.4
    path = tmp_path_factory.mktemp("fit") / "data.csv"
    file = io.BytesIO()
    write_measurement(replace(measurement, observed=observed), file)
    path.write_bytes(file.getvalue())
    return path


def test_a_calibration_and_its_report(command, data, tmp_path):
    done = command("fit", data, "--machine", "cframe", "--basis", "auto", "-o", tmp_path / "cal.json", "--json", "-")
    assert done.status == 0, done.err
    report = json.loads(done.out)
    assert report["after"]["rms_um"] < 0.7 * report["before"]["rms_um"]
    assert report["after"]["chi2_reduced"] == pytest.approx(1.0, abs=0.15)
    assert report["after"]["heldout_rms_um"] > report["after"]["rms_um"]
    assert (report["n_observations"], report["n_parameters"]) == (239 * 3, report["n_parameters"])
    assert report["rank_registered"] == report["rank"] - 6
    assert report["outliers"] == [f"{data}:{_line_of_row(data, 7)}"]
    assert set(report["locations"]) == {"E_C0Y", "E_B0Z", "E_A0Z"}
    model = read_model(tmp_path / "cal.json", MACHINE)
    assert model.id == report["calibration"]
    assert model.covariance is not None
    assert model.provenance.inputs.keys() == {str(data)}


def test_the_calibration_corrects_a_program(command, data, tmp_path):
    calibration = tmp_path / "cal.json"
    assert command("fit", data, "-m", "cframe", "--basis", "b-spline:4", "-o", calibration, "--no-hold-out").status == 0
    program = tmp_path / "part.nc"
    program.write_text("G21 G90 G17\nG0 X100 Y100 Z200\nG1 X300 Y250 Z150 F500\nM30\n")
    done = command(
        program,
        "--machine",
        "cframe",
        "--calibration",
        calibration,
        "--set-up-zero",
        "-o",
        tmp_path / "out.nc",
        "--json",
        "-",
    )
    assert done.status == 0, done.err
    error = json.loads(done.out)["predicted_error_um"]
    assert error["after"]["max"] < 0.1 < error["before"]["max"]


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--basis", "spline"], "none of b-spline:N"),
        (["--basis", "auto:wavelet"], "none of b-spline:N"),
        (["--basis", "X=b-spline:5"], "has no entry for Y, Z"),
        (["--basis", "X=b-spline:5,Y=legendre:3,Z=cubic:3,C=cubic:4"], "C does not move"),
        (["--noise", "white"], "sheet or estimate"),
        (["--header", "u_um"], "expected KEY=VALUE"),
        (["--machine", "gantry"], "gantry"),
    ],
)
def test_what_can_t_be_used_is_refused_without_output(command, data, tmp_path, options, said):
    machine = [] if "--machine" in options else ["--machine", "cframe"]
    done = command("fit", data, *machine, *options, "-o", tmp_path / "cal.json", "--json", tmp_path / "fit.json")
    assert done.status == 2
    assert said in done.err
    assert "Traceback" not in done.err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("plate", "rows"), quick([("D1396A1", 637), ("D1597A_2003", 650), ("D8131_1", 82)], [("D8131_1", 82)])
)
def test_real_plates(command, plates, plate, rows, tmp_path):
    done = command(
        "fit", plates / plate, "-m", "gantry", "--header", "u_um=2.3", "-o", tmp_path / "cal.json", "--json", "-"
    )
    assert done.status == 0, done.err
    report = json.loads(done.out)
    assert report["n_observations"] <= 2 * rows
    assert report["after"]["rms_um"] < report["after"]["heldout_rms_um"] < report["before"]["rms_um"]
    assert {"E_ZX", "E_AX", "E_BX", "E_ZY", "E_AY", "E_BY"} <= set(report["not_visible"])
    assert report["after"]["chi2_reduced"] > 2.0  # the drill scatters more than the measuring machine


def _line_of_row(path: Path, row: int) -> int:
    lines = path.read_text().splitlines()
    return sum(line.startswith("#") for line in lines) + 2 + row


def test_the_report_is_one_page_with_its_figures(command, data, tmp_path):
    done = command(
        "fit", data, "-m", "cframe", "--basis", "b-spline:4", "-o", "cal.json", "--no-hold-out", "--report", "fit.html"
    )
    assert done.status == 0, done.err
    page = (tmp_path / "fit.html").read_text()
    assert len(figures(page)) == 5
    assert "src=" not in page.replace("xlink:href", "")  # nothing is loaded from elsewhere
    for part in (
        "Location errors",
        "E_C0Y",
        "Error motions",
        "U (k=2)",
        "Unexplained residual",
        "Rows that disagree, or repeat",
        "χ²/dof",
    ):
        assert part in page


def test_runs_of_an_interferometer_that_others_do_not_predict(command, tmp_path):
    """A run with its own positions is held out completely: its zero is then not known, and it is not counted."""
    head = "# machine: dmu50\n# instrument: interferometer\n# u_um: 0.3\n# target.r: 0 0 -50\n"
    rows = "".join(f"X,1,+,{x},{0.01 * x}\nX,1,-,{x},{0.01 * x}\n" for x in range(-100, 101, 20))
    (tmp_path / "data.csv").write_text(f"{head}axis,run,direction,target_mm,deviation_um\n{rows}X,2,-,-100,1\n")
    done = command("fit", "data.csv", "--machine", "dmu50", "--basis", "legendre:1", "-o", "cal.json")
    assert done.status == 0, done.err


@pytest.mark.parametrize("u_um", quick(["0.0001", "0.001", "0.3"], ["0.0001"]))
@pytest.mark.parametrize("machine", quick(["cframe", "dmu50"], ["dmu50"]))
def test_a_calibration_by_an_instrument_that_is_nearly_exact_is_read_again(command, machine, u_um):
    """Priors of some tens of um beside readings of 0.1 nm: the datum leaves differences of large terms."""
    simulated = command(
        *("simulate", "-m", machine, "--strategy", "axes", "--points", 45, "--instrument", "interferometer"),
        *("-o", "a.csv"),
    )
    assert simulated.status == 0, simulated.err
    stated = re.sub(r"(?m)^# u_um: .*$", f"# u_um: {u_um}", Path("a.csv").read_text())
    Path("data.csv").write_text(re.sub(r"(?m)^# u_um_per_m: .*$", "# u_um_per_m: 0", stated))
    done = command("fit", "data.csv", "-m", machine, "-o", "cal.json", "--no-hold-out")
    assert done.status == 0, done.err
    model = read_model(Path("cal.json"), machines.load(machine))
    covariance = np.array(model.covariance)
    assert (covariance == covariance.T).all()
    u = np.array([value for effect in model.effects for value in effect.uncertainties])
    assert u == pytest.approx(np.sqrt(np.diag(covariance)), rel=1e-12)
    done = command("export", "-m", machine, "-c", "cal.json", "--format", "csv", "-o", "tables")
    assert done.status == 0, done.err


def test_a_calibration_from_simulated_data_is_announced_when_a_program_is_corrected(command, tmp_path):
    (tmp_path / "a.nc").write_text("G21 G90\nG0 X100. Y100. Z100.\n")
    measuring = ("--strategy", "random", "--points", "30", "--target", "t1=0,0,-120", "--target", "t2=90,40,-180")
    for data, real in (("virtual.csv", False), ("real.csv", True)):
        assert command("simulate", "-m", "cframe", *measuring, "-o", data).status == 0
        if real:
            text = (tmp_path / data).read_text()
            (tmp_path / data).write_text(text.replace(", simulated\n", "\n"))
        assert command("fit", data, "-m", "cframe", "--basis", "legendre:1", "-o", "cal.json").status == 0
        set_up = ("--set-up-zero", "--accept", "insignificant,worse")
        done = command("a.nc", "-m", "cframe", "-c", "cal.json", *set_up, "-o", "out.nc")
        assert done.status == 0, done.err
        assert ("it describes no real machine" in done.err) is not real
