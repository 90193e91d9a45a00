"""Small slips at the command line, each with an answer that helps."""

import datetime
import os
import subprocess
import sys
from pathlib import Path

import pytest
from support.programs import load

from calibration.simulation.effect_text import read_effects
from kinematics.error_model.model import ErrorModel
from kinematics.error_model.needed_conditions import needed_conditions
from kinematics.error_model.provenance import Provenance, reference
from postproc.commands.controls.export import FORMAT_LIST, format_names

GANTRY = ("--machine", "gantry", "-c", "cal.json", "--set-up-zero")


@pytest.mark.parametrize("word", ["export", "import"])
def test_the_help_lists_all_formats(ncomp, word):
    listed = " ".join(ncomp(word, "--help").out.decode().split())
    assert [name for name in format_names() if name not in listed] == []
    assert [name for name in format_names() if name not in FORMAT_LIST] == []


def test_quiet_has_a_short_name(ncomp):
    short, long = (ncomp("in.nc", *GANTRY, "-o", "out.nc", word) for word in ("-q", "--quiet"))
    assert (short.status, short.err) == (0, long.err)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("predict", "in.nc", "--machine", "gantry", "-c", "cal.json", "-o", "p.csv"), "in.nc: this is an NC program"),
        (("compare", "cal.json", "./cal.json"), "are one file: name the calibrations"),
        (("fit", "data.csv", "-m", "gantry", "-o", "c.json", "--pass-through", "G234"), "--pass-through is for data"),
        (("fit", "data.csv", "-m", "gantry", "-o", "c.json", "--corner-mm", "9"), "--corner-mm is for data"),
        (("fit", "data.csv", "-m", "gantry", "-o", "c.json", "--dialect", "iso"), "--dialect is for data"),
    ],
)
def test_refusals(ncomp, words, said):
    Path("data.csv").write_text("# machine: gantry\n# instrument: laser-tracker\n")
    done = ncomp(*words)
    assert done.status == 2
    assert said in done.err


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--spacing", "100"), "--spacing has no effect on --strategy random: give --points"),
        (("--planes-at", "0.5"), "--planes-at is an option of --strategy planes"),
        (("--rotary-points", "5"), "--rotary-points is an option of --rotary swept"),
        (("--rotary", "swept"), "--rotary has no effect: machine gantry has no rotary axis"),
        (("--overrun", "3"), "--overrun has no effect without --approach"),
        (("--target-order", "alternating"), "--target-order has no effect on one target"),
        (("--tool-length", "T1=5"), "--tool-length is an option of ncomp plan path"),
    ],
)
def test_options_that_a_strategy_does_not_use(ncomp, options, said):
    done = ncomp("plan", "--machine", "gantry", "--strategy", "random", "-o", "plan.csv", *options)
    assert done.status == 2
    assert said in done.err


def test_a_hook_makes_its_folder(ncomp):
    assert ncomp("hook", "nx", "-o", "new/folder").status == 0
    assert Path("new/folder/ncomp_nx.tcl").is_file()


def test_conditions_without_effect_are_said(ncomp):
    Path("log.csv").write_text("time_s,temp_air\n0,20\n10,21\n")
    timed = ncomp("in.nc", *GANTRY, "-o", "out.nc", "--elapsed", "3600")
    assert "--elapsed 3600 was given, and no effect of the calibration depends on time" in timed.err
    logged = ncomp("in.nc", *GANTRY, "-o", "out.nc", "--log", "log.csv")
    assert "log log.csv was given, and no effect of the calibration depends on time" in " ".join(logged.err.split())


def test_the_conditions_that_a_calibration_needs():
    gantry = load("gantry")
    backlash, growth = read_effects(
        ["backlash:axis=X,width=3", "thermal-scale-sensor:axis=Y,sensor=air,coefficient=11"], gantry
    )
    assert needed_conditions(model(gantry, backlash, growth)) == ["--temperature air=degC"]
    assert needed_conditions(model(gantry, backlash)) == []


def model(machine, *effects):
    made = Provenance("test", datetime.datetime.now(datetime.UTC))
    return ErrorModel(machine=reference(machine), provenance=made, effects=effects)


@pytest.mark.parametrize(
    ("block", "said"),
    [
        ("G1 X10 Y=AC(R1) F500", "Y=AC(R1): R1 is not set by the program"),
        ("DEF REAL LEVEL[3]={0.5,1.5,2.5}", "'{0.5,1.5,2.5}' is not understood: correct the block"),
        ("G1 X1,5 F500", "',5 F500' is not understood: write the decimal point as '.'"),
    ],
)
def test_a_block_is_quoted_whole_and_its_cure_is_one(ncomp, block, said):
    Path("part.mpf").write_text(f"G71 G90 G54\nG0 X0 Y0 Z0\n{block}\nM30\n")
    assert said in " ".join(ncomp("part.mpf", *GANTRY, "-o", "out.mpf").err.split())


@pytest.mark.skipif(os.name == "nt", reason="signals of POSIX")
def test_ctrl_c_is_answered(tmp_path):
    (tmp_path / "in").mkdir()
    code = (
        "import os, signal, time\nfrom postproc import cli, command_line\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "command_line.command_line = lambda: (os.kill(os.getpid(), signal.SIGINT), time.sleep(50))\ncli.run()"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False, cwd=tmp_path, timeout=60
    )
    assert (done.returncode, done.stderr) == (130, "ncomp: interrupted\n")
