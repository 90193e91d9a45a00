"""What residuals depend on, and what `ncomp fit` is told to fit besides."""

import io
import json
from dataclasses import replace

import msgspec
import numpy as np
import pytest
from support.virtual_measurements import THREE, measured, pose_of, positions, truth

import machines
from calibration.fit.fit import fit
from calibration.fit.residual_tests import dependences
from calibration.measurement.written_file import write_measurement
from kinematics.effects import Backlash, ThermalDrift

MACHINE = machines.load("cframe")


def spoilt(*effects, seed=0, n=300):
    """A measurement of a machine that has these effects besides smooth error motions; and its truth without them."""
    rng = np.random.default_rng(seed)
    base = truth(MACHINE, rng, 10.0)
    whole = msgspec.structs.replace(base, effects=(*base.effects, *effects))
    clean = measured(MACHINE, positions(MACHINE, n, rng), THREE, base, rng)
    exact = [
        clean.instrument.expected(clean, pose_of(["s1"]), model.observation(MACHINE, clean.state))
        for model in (base, whole)
    ]
    observed = clean.observed + exact[1] - exact[0]
    return replace(clean, observed=observed, state=replace(clean.state, observed=observed)), base


def zeroed(model):
    return msgspec.structs.replace(
        model, effects=tuple(e.with_parameters([0.0] * len(e.parameters), e.u) for e in model.effects)
    )


def test_nothing_is_suspected_of_clean_data():
    measurement, base = spoilt()
    assert dependences(fit(measurement, zeroed(base))) == []


@pytest.mark.parametrize(
    ("effect", "variable"),
    [
        (Backlash("X", 40.0), "the direction of X"),
        (Backlash("Z", 40.0), "the direction of Z"),
        (ThermalDrift(component="Z", rate=-40.0), "time"),
    ],
)
def test_a_missing_effect_is_suspected_first(effect, variable):
    measurement, base = spoilt(effect)
    found = dependences(fit(measurement, zeroed(base)))
    assert found[0].variable == variable
    assert effect.kind in found[0].hint


def test_the_command_names_it_and_fits_it(command, tmp_path):
    measurement, _ = spoilt(Backlash("X", 40.0), n=150)
    file = io.BytesIO()
    write_measurement(measurement, file)
    (tmp_path / "data.csv").write_bytes(file.getvalue())
    given = ("fit", "data.csv", "-m", "cframe", "--basis", "b-spline:6", "--no-hold-out", "--json", "-")
    without = json.loads(command(*given, "-o", "a.json").out)
    assert without["depends_on"][0]["what"] == "the direction of X"
    done = command(*given, "--effect", "backlash:axis=X,width=0", "-o", "b.json", "--report", "b.html")
    report = json.loads(done.out)
    assert report["depends_on"] == []
    (found,) = report["effects"]
    assert found["name"] == "backlash X"
    assert found["parameters"]["width_um"] == pytest.approx(40.0, abs=4 * found["u"]["width_um"])
    assert "backlash X" in done.err
    assert "backlash X" in (tmp_path / "b.html").read_text()


@pytest.mark.parametrize("option", ["-o", "--json", "--report"])
def test_an_output_does_not_replace_the_data(command, tmp_path, option):
    measurement, _ = spoilt()
    file = io.BytesIO()
    write_measurement(measurement, file)
    (tmp_path / "data.csv").write_bytes(file.getvalue())
    outputs = {"-o": "cal.json"} | {option: "./data.csv"}
    done = command("fit", "data.csv", "-m", "cframe", *(part for pair in outputs.items() for part in pair))
    assert done.status == 2
    assert "overwritten" in done.err
    assert (tmp_path / "data.csv").read_bytes() == file.getvalue()


def test_outputs_are_looked_at_before_the_work(command, tmp_path):
    (tmp_path / "data.csv").write_text("nothing that could be read")
    done = command("fit", "data.csv", "-m", "cframe", "-o", "missing/cal.json")
    assert done.status == 2
    assert "cannot write missing/cal.json" in done.err
