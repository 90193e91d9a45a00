"""Commands that ncomp prints run as they are printed, in the folder in which it was called."""

import re
import shlex
from pathlib import Path

import numpy as np
import pytest
from support.command import run_command
from support.file_examples import PROGRAM
from support.programs import load, shifted

import machines
import ncomp
from calibration.diagnosis.diagnose import diagnose
from calibration.instruments import LaserTracker
from calibration.reports.diagnosis.commands import Files
from calibration.reports.diagnosis.page import diagnosis_report
from calibration.simulation.measure_plan import VirtualInstrument
from calibration.simulation.true_model import random_true_model
from kinematics.error_model.model import write_model

MILL = (machines.FOLDER / "gantry.toml").read_text().replace('"gantry"', '"mill"')


def printed(report, part):
    """The commands in the report, for the program `part`."""
    (section,) = [each for each in report.sections if each.title == "Use of the new calibration"]
    lines = [line for _, text in section.table.rows for line in text.splitlines()]
    return [line.replace("PART", part) for line in lines]


@pytest.mark.statistical
@pytest.mark.parametrize("present", [None, "old cal.json"])
def test_the_commands_of_a_diagnosis_run_as_printed(tmp_path, monkeypatch, present):
    monkeypatch.chdir(tmp_path)
    Path("my mill.toml").write_text(MILL)
    Path("part.nc").write_text(PROGRAM)
    mill = ncomp.load_machine("my mill.toml")
    tracker = VirtualInstrument(LaserTracker(u_range_um=0.5, u_angle_um=1.0))
    plan = ncomp.plan(mill, "grid", 64)
    made = ncomp.simulate(plan, random_true_model(mill, np.random.default_rng(3)), tracker, seed=3)
    found = diagnose(made.measurement, None)
    write_model(found.model, Path("new cal.json"))
    write_model(shifted(mill, X=-10.0), Path("old cal.json"))
    report = diagnosis_report(found, "ncomp diagnose", Files("my mill.toml", "new cal.json", present))
    commands = printed(report, "part")
    assert len(commands) == (2 if present is None else 4)
    for line in commands:
        done = run_command(
            *shlex.split(line)[1:], *(["--accept", "worse,insignificant"] if "verify" not in line else [])
        )
        assert done.status == 0, f"{line}\n{done.err}"


def test_the_folder_that_is_given_as_a_program_is_a_batch(command):
    Path("posted").mkdir()
    Path("posted/a.nc").write_text(PROGRAM)
    write_model(shifted(load("gantry"), X=-10.0), Path("cal.json"))
    Path("b.nc").write_text(PROGRAM)
    options = ("--machine", "gantry", "-c", "cal.json", "--set-up-zero")
    refused = command("posted", "b.nc", *options, "-o", "out")
    assert refused.status == 2
    hint = refused.err.split("'")[1]
    assert command(*shlex.split(hint)[1:], "--set-up-zero", "-c", "cal.json").status == 0
    assert Path("out/a.nc").is_file()


@pytest.mark.parametrize("format", ["heidenhain", "siemens-cec", "heidenhain-kinematics"])
def test_the_probe_of_a_format_without_a_known_sign_runs_as_printed(command, format):
    refused = command("export", "--machine", "dmu50", "--format", format, "-o", "tables")
    assert refused.status == 2
    (line,) = re.findall(r"'ncomp (export [^']*)'", refused.err)
    assert command(*shlex.split(line)).status == 0
    assert Path("probe/probe.md").exists()
