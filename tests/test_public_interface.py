"""The public interface: its examples, its names, and its results beside those of the commands."""

from __future__ import annotations

import doctest
import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np

import ncomp
from calibration.instruments import LaserTracker
from calibration.simulation.measure_plan import VirtualInstrument
from calibration.simulation.true_model import random_true_model
from kinematics.error_model.model import write_model

EXAMPLES = Path(__file__).parents[1] / "examples"
OFFSET, LENGTH = "G54=-30,-20,150", "T1=80"
HEAVY = ("scipy.optimize", "sympy", "plotly", "lark", "rich")


def test_every_public_function_has_a_docstring_and_the_examples_run():
    functions = [getattr(ncomp, name) for name in ncomp.__all__]
    assert all(function.__doc__ for function in functions)
    names = {name: getattr(ncomp, name) for name in ncomp.__all__}
    modules = {module for function in functions if (module := sys.modules.get(function.__module__))}
    results = [doctest.testmod(module, extraglobs=names) for module in (ncomp, *modules)]
    assert sum(result.attempted for result in results) > 20
    assert sum(result.failed for result in results) == 0


def test_the_import_is_light():
    code = f"import ncomp, sys; print([name for name in {HEAVY} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=EXAMPLES.parent)
    assert done.stdout.strip() == "[]"


def test_the_command_and_the_function_write_the_same_bytes(command, tmp_path):
    program = EXAMPLES / "box.nc"
    options = ("--work-offset", OFFSET, "--tool-length", LENGTH)
    assert command(program, "-m", "dmu50", *options, "-o", "out.nc", "--json", "out.json").status == 0
    done = ncomp.correct(program, "dmu50", setup=ncomp.set_up("dmu50", work_offset=[OFFSET], tool_length=[LENGTH]))
    assert done.text.encode("latin-1") == (tmp_path / "out.nc").read_bytes()
    written = json.loads((tmp_path / "out.json").read_text())
    assert written.pop("provenance")["machine"] == "dmu50"
    assert json.dumps(done.report.json()) == json.dumps(written)
    assert len(done.moves) == done.report.moves + sum(done.moves.added)


def test_a_measurement_is_planned_simulated_fitted_and_predicted(tmp_path):
    plan = ncomp.plan("gantry", "random", 60)
    tracker = VirtualInstrument(LaserTracker(u_range_um=0.5, u_angle_um=1.0))
    made = ncomp.simulate(plan, random_true_model(plan.machine, np.random.default_rng(3)), tracker, seed=3)
    found = ncomp.fit(made.measurement, basis="legendre:2", hold_out=False)
    assert found.fit.rms_um < found.before_rms_um
    write_model(found.model, tmp_path / "cal.json")
    prediction = ncomp.predict(plan.positions / plan.machine.scale, "gantry", tmp_path / "cal.json")
    assert prediction.deviation_um.shape == prediction.u_um.shape == (60, 3)


def test_the_page_of_functions_has_those_that_are_defined_elsewhere():
    """MkDocs shows a function of another package only if it has read that package before."""
    functions = [getattr(ncomp, name) for name in ncomp.__all__ if name != "UserError"]
    packages = {function.__module__.partition(".")[0] for function in functions} - {"ncomp"}
    read = re.search(r"preload_modules: \[(.*)\]", (EXAMPLES.parent / "mkdocs.yml").read_text())
    assert read is not None
    assert packages == set(read[1].split(", "))
