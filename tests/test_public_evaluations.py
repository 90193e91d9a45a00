"""The functions that evaluate one kind of measurement: their results are those of the commands."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from support.docs_files import CIRCLES, RUNS
from support.programs import load, shifted

import ncomp

EXAMPLES = Path(__file__).parents[1] / "examples"


def results(command, *arguments):
    """The results of a command as JSON, without their origin."""
    done = command(*arguments, "--json", "-")
    assert done.status == 0, done.shown
    found = json.loads(done.out)
    found.pop("provenance", None)
    return found


def shows_itself(*found):
    """Whether results are short lines, and have tables for a notebook."""
    return all(len(repr(each)) < 200 and "<table>" in each._repr_html_() for each in found)


def test_circles_of_a_ballbar(command):
    made = f"simulate --machine cframe {CIRCLES} --errors none --effect backlash:axis=X,width=8 -o circles.csv"
    assert command(*made.split()).status == 0
    found = ncomp.ballbar(ncomp.read_measurement("circles.csv", "cframe"))
    assert json.loads(json.dumps(found.json())) == results(command, "ballbar", "circles.csv", "-m", "cframe")
    assert found.shares.causes[0].kind == "backlash"
    assert shows_itself(found)


def test_interferometer_runs(command):
    made = "simulate --machine gantry --strategy axes --spacing 400 --runs 3 --instrument interferometer -o laser.csv"
    assert command(*made.split()).status == 0
    found = ncomp.iso230(ncomp.read_measurement("laser.csv", "gantry"))
    assert shows_itself(*found)
    assert {"axes": [json.loads(json.dumps(test.json())) for test in found]} == results(
        command, "iso230", "laser.csv", "-m", "gantry"
    )


def test_laser_runs_in_motion(command):
    made = f"simulate-continuous --machine cframe {RUNS} -o run.csv --quasistatic targets.csv --truth truth.json"
    assert command(*made.split()).status == 0
    found = ncomp.continuous(["run.csv", "targets.csv"], "cframe", header={}, spacing_mm=5.0)
    assert found.calibration is not None
    assert found.calibration.model.effects
    assert shows_itself(found)
    assert found.columns.keys() == {"position_mm", "error_um", "u_um"}
    assert command("continuous", "run.csv", "targets.csv", "-o", "table.csv", "--spacing-mm", "5").status == 0
    written = np.genfromtxt("table.csv", delimiter=",", names=True)
    np.testing.assert_allclose(written["error_um"], found.table.error, atol=1e-4)
    measured = ncomp.simulate_continuous(
        "cframe", "truth.json", "X", 0, 450, feed=5000, rate=1000, spacing=45, both=True
    )
    again = ncomp.continuous(["run.csv", "targets.csv"]).data
    np.testing.assert_allclose(measured.records[0].displacement, again.records[0].displacement, atol=1e-6)


def test_a_virtual_machine_is_that_of_the_command(command):
    made = "simulate --machine gantry --strategy random --points 20 --location 5 --seed 4 -o data.csv --truth t.json"
    assert command(*made.split()).status == 0
    true = ncomp.virtual_machine("gantry", location_um=5.0, seed=4)
    assert true == ncomp.load_calibration("gantry", "t.json")


def test_calibrations_are_compared(command):
    ncomp.save(shifted(load("gantry"), X=-10.0), "a.json")
    ncomp.save(shifted(load("gantry"), X=4.0), "b.json")
    written = results(command, "compare", "a.json", "b.json", "--reference", "X=100")
    found = ncomp.compare("a.json", "b.json", reference={"X": 100})
    assert json.loads(json.dumps(found.json())).items() <= written.items()
    models = [ncomp.load_calibration("gantry", name) for name in ("a.json", "b.json")]
    assert ncomp.compare(*models, reference="X=100").json() == found.json()
    with pytest.raises(ncomp.UserError, match="only calibrations of one machine"):
        ncomp.compare(models[0], ncomp.load_calibration("dmu50"))


def test_touches_of_spheres(command):
    folder = EXAMPLES / "spheres"
    log, plan = folder / "ncomp40661.txt", folder / "spheres.csv"
    found = ncomp.touches(log, "dmu50", plan)
    written = results(command, "touches", log, "-m", "dmu50", "--plan", plan, "-o", "data.csv")
    assert shows_itself(found)
    assert (len(found.measurement), found.scatter_um) == (written["centres"], written["scatter_um"])


def test_tests_of_a_tracker(command, tmp_path):
    rows = [f"ranging,1000,{far * 1e3},,{1.0 + far / 10}" for far in (5.0, 10.0, 30.0)]
    rows += [f"two-face,{away * 1e3},,,{20.0 + away}" for away in (2.0, 5.0, 12.0)]
    (tmp_path / "b89.csv").write_text(
        "# coverage: 2\n" + "\n".join(["test,range_mm,range_2_mm,length_mm,stated_um", *rows]) + "\n"
    )
    found = ncomp.tracker("b89.csv")
    assert shows_itself(found)
    assert list(results(command, "tracker", "b89.csv")["parameters"].values()) == pytest.approx(found.parameters)


def test_tables_of_a_control_are_imported(command):
    ncomp.save(shifted(load("gantry"), X=-10.0), "cal.json")
    made = "export -m gantry -c cal.json --format linuxcnc -o tables"
    assert command(*made.split()).status == 0
    options = ("-m", "gantry", "--format", "linuxcnc", "--less-tables-from", "cal.json", "-o", "rest.json")
    assert command("import", "tables", *options).status == 0
    found = ncomp.import_tables("tables", "gantry", "linuxcnc", less_tables_from="cal.json").model
    assert found.effects == ncomp.load_calibration("gantry", "rest.json").effects


@pytest.mark.statistical
def test_readings_on_the_fly(command):
    corners = "X600 F2500\nY450\nZ300\nX0\nY0\nZ0\nX600 Y450 Z300\n"
    Path("path.nc").write_text(f"G21 G90\nG0 X0 Y0 Z0\nG1 {corners}M30\n")
    made = "simulate --machine cframe --path path.nc --target t=0,0,-120 --feed 2500 --seed 2 -o moving.csv"
    assert command(*made.split()).status == 0
    written = results(
        command,
        *[
            "fit",
            "moving.csv",
            "-m",
            "cframe",
            "--path",
            "path.nc",
            "--basis",
            "legendre:1",
            "--force",
            "-o",
            "cal.json",
        ],
    )
    path = ncomp.read_path("path.nc", "cframe")
    taken = ncomp.read_on_the_fly("moving.csv", path)
    found = ncomp.fit(taken, basis="legendre:1", force=True)
    assert found.model.effects == ncomp.load_calibration("cframe", "cal.json").effects
    assert found.fit.rms_um == pytest.approx(written["after"]["rms_um"])


def test_measurements_plans_and_calibrations_are_saved(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    plan = ncomp.plan("gantry", "random", 20)
    true = ncomp.virtual_machine("gantry")
    measured = ncomp.simulate(plan, true).measurement
    ncomp.save(measured, "data.csv")
    again = ncomp.read_measurement("data.csv", "gantry")
    np.testing.assert_allclose(again.observed, measured.observed, atol=1e-5)
    ncomp.save(plan, "plan.csv")
    assert "# strategy: random" in Path("plan.csv").read_text()
    ncomp.save(true, "true.json")
    assert ncomp.load_calibration("gantry", "true.json").effects == true.effects
