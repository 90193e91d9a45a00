"""From continuous runs to corrected programs, tables and back: `ncomp continuous --write-calibration`."""

import json
from pathlib import Path

import numpy as np
import pytest

import machines
from kinematics.basis import Polynomial
from kinematics.deviation import exact_deviation
from kinematics.effects import Backlash, Cyclic, ErrorMotion, LocationError
from kinematics.error_model.model import ErrorModel, read_model, write_model
from kinematics.error_model.provenance import Provenance, reference
from kinematics.state import State

CFRAME = machines.load("cframe")
MADE = Provenance("test", "2026-01-01T00:00:00Z")
ERRORS = (
    "--effect", "cyclic:component=X,axis=X,period=12,sine=[1.5],cosine=[0]", "--effect", "backlash:axis=X,width=9",
    "--effect", 'error-motion:component=X,axis=X,basis={"kind":"polynomial","interval":[0,600],"degree":3},'
    "parameters=[0,40,-90,35],u=[0,0,0,0]",
)  # fmt: skip
SIMULATE = (
    "simulate-continuous",
    "--axis",
    "X",
    "--start-mm",
    0,
    "--end-mm",
    450,
    "--errors",
    "none",
    "--both",
    "--feed",
    1000,
)
SET_UP = ("--work-offset", "G54=20,225,100", "--tool-length", "T1=100")
PART = "G21 G90 G17 G54\nT1 M6\nG0 X10. Y0. Z30.\n" + "".join(
    f"G1 X{x}. Y{y}. F500\n" for x, y in ((57, 20), (401, 0), (123, -50), (188, 90), (40, 3), (333, 0), (211, 5))
)


def made(command, machine="cframe", *errors, targets=("--spacing", 25, "--runs", 2, "--u-um", 0.2)):
    """Runs, targets and truth of a virtual machine."""
    names = ("-o", "run.csv", "--quasistatic", "targets.csv", "--truth", "truth.json")
    options = ("--machine", machine, *errors, *targets, *names, "--seed", 4)
    once(options, names[1::2], lambda: command(*SIMULATE, *options))


def calibrated(command, machine, *options):
    """The calibration that the files make."""
    to = ("-o", "table.csv", "--machine", machine, "--write-calibration", "cal.json", *options)
    data = tuple(Path(name).read_bytes() for name in ("run.csv", "targets.csv"))
    return once((data, *to), ("cal.json",), lambda: command("continuous", "run.csv", "targets.csv", *to))


MADE_ONCE = {}
"""How commands ended and what they wrote, by their inputs."""


def once(inputs, outputs, run):
    """The end of a successful command, whose outputs are written again where it has run before."""
    if inputs not in MADE_ONCE:
        done = run()
        assert done.status == 0, done.err
        MADE_ONCE[inputs] = done, {name: Path(name).read_bytes() for name in outputs}
    done, files = MADE_ONCE[inputs]
    for name, content in files.items():
        Path(name).write_bytes(content)
    return done


def along(model, machine, x, way, *, z=0.0, tool=(0.0, 0.0, 0.0)):
    """Deviations `(n, 3)`, um, with X at positions approached from one direction and Z at z."""
    q = np.zeros((len(x), len(machine.axes)))
    q[:, machine.index("X")], q[:, machine.index("Z")] = x, z
    approach = np.zeros(q.shape)
    approach[:, machine.index("X")] = way
    return exact_deviation(machine, q, model.errors(machine, State(q, approach=approach)), tool).position * 1e3


def left(command, calibration):
    """RMS of the tool point at block ends by the truth, um, before and after correction by a calibration."""
    Path("part.nc").write_text(PART)
    corrected = command("part.nc", "--machine", "cframe", "-c", calibration, *SET_UP, "-o", "out.nc")
    assert corrected.status == 0, corrected.err
    against = ("--machine", "cframe", "-c", calibration, "--align", "truth.json", *SET_UP, "--json", "-")
    shown = command("verify", "part.nc", "out.nc", *against)
    assert shown.status == 0, shown.err
    ends = json.loads(shown.out)["block_ends_um"]
    return ends["before"]["rms"], ends["after"]["rms"]


def test_from_the_log_to_the_corrected_program(command):
    made(command, "cframe", *ERRORS)
    assert "E_XX, backlash X" in calibrated(command, "cframe").err
    before, after = left(command, "cal.json")
    assert before > 6.0
    assert after < 0.3


@pytest.mark.statistical
def test_from_the_log_to_tables_and_back(command):
    made(command, "cframe", *ERRORS)
    calibrated(command, "cframe")
    tables = command("export", "--machine", "cframe", "-c", "cal.json", "--format", "linuxcnc", "-o", "tables")
    assert tables.status == 0, tables.err
    read = command("import", "tables", "--machine", "cframe", "--format", "linuxcnc", "-o", "back.json")
    assert read.status == 0, read.err
    before, after = left(command, "back.json")
    assert before > 6.0
    assert after < 0.3


def test_values_and_uncertainties_are_those_of_the_truth(command):
    made(command, "cframe", *ERRORS)
    calibrated(command, "cframe")
    found, truth = (read_model(Path(name), CFRAME) for name in ("cal.json", "truth.json"))
    x = np.linspace(3.0, 447.0, 301)
    ways = [along(found, CFRAME, x, way)[:, 0] - along(truth, CFRAME, x, way)[:, 0] for way in (1, -1)]
    off = np.concatenate(ways)
    assert np.std(off) < 0.15
    assert abs(np.mean(ways[0] - ways[1])) < 0.2
    motion, backlash = found.effects[:2]
    assert backlash.width == pytest.approx(9.0, abs=4 * backlash.u[0])
    assert 0.0 < backlash.u[0] < 0.3
    # the mean over the axis is no error: its zero is the laser's
    assert abs(np.mean(np.interp(x, motion.basis.nodes, motion.parameters))) < 0.3
    u = np.interp(x, motion.basis.nodes, motion.u)
    centred = ways[0] + ways[1] - np.mean(ways[0] + ways[1])
    assert np.mean(np.abs(centred / 2.0) < 2.0 * u) > 0.8


AGAINST = """
name = "against"
chain = "w b Y X Z t"
[axes.X]
travel = [0, 600]
direction = [-1, 0, 0]
[axes.Y]
travel = [0, 400]
[axes.Z]
travel = [0, 400]
"""


def test_an_axis_that_runs_against_its_letter(command):
    Path("against.toml").write_text(AGAINST)
    made(command, "against.toml", *ERRORS)
    calibrated(command, "against.toml")
    machine = machines.load("against.toml")
    found, truth = (read_model(Path(name), machine) for name in ("cal.json", "truth.json"))
    x = np.linspace(5.0, 445.0, 200)
    for way in (1, -1):
        off = along(found, machine, x, way)[:, 0] - along(truth, machine, x, way)[:, 0]
        assert np.std(off) < 0.2
    assert found.effects[1].width == pytest.approx(9.0, abs=0.5)


def test_a_jump_keeps_its_place(command):
    made(command, "cframe", "--effect", "quantised-compensation:axis=X,step=13,pitch=150,offset=61")
    calibrated(command, "cframe")
    found, truth = (read_model(Path(name), CFRAME) for name in ("cal.json", "truth.json"))
    beside = np.array([60.7, 61.3, 210.7, 211.3])
    step = [np.diff(along(model, CFRAME, beside, 1)[:, 0])[[0, 2]] for model in (found, truth)]
    np.testing.assert_allclose(step[0], step[1], atol=0.4)


def test_between_the_segment_and_the_end_nothing_is_claimed(command):
    """At 5000 mm/min ramps take 30 mm, of which only the target at the end is known: less than a wave of 40 mm."""
    wave = ("--effect", "cyclic:component=X,axis=X,period=40,sine=[1.8],cosine=[0]")
    made(command, "cframe", *wave, "--feed", 5000, "--rate", 1000)
    calibrated(command, "cframe")
    found, truth = (read_model(Path(name), CFRAME) for name in ("cal.json", "truth.json"))
    nodes, u = np.array(found.effects[0].basis.nodes), np.array(found.effects[0].u)
    x = np.linspace(nodes[0], nodes[-1], 400)
    off = np.abs(along(found, CFRAME, x, 1)[:, 0] - along(truth, CFRAME, x, 1)[:, 0])
    assert off.max() > 0.5
    assert np.all(off < 4.0 * np.interp(x, nodes, u) + 0.4)
    assert np.median(u) < 0.15


def test_targets_on_a_jump_do_not_count_as_scatter(command):
    made(command, "cframe", "--effect", "quantised-compensation:axis=X,step=13,pitch=100,offset=25")
    done = command("continuous", "run.csv", "targets.csv", "-o", "table.csv", "--json", "-")
    assert json.loads(done.out)["quasi_static"]["u_um"] < 0.25


def base_of(machine, *effects):
    return ErrorModel(machine=reference(machine), provenance=MADE, effects=effects)


def test_joined_to_angles_that_are_known_the_arm_is_taken_off(command):
    """The line lies at Z 500: the contribution of E_BX there is not E_XX."""
    line = Polynomial((0.0, 600.0), 1)
    tilt = ErrorMotion(component="B", axis="X", basis=line, parameters=(0.0, 40.0), u=(0.0, 1.0))
    old = ErrorMotion(component="X", axis="X", basis=line, parameters=(0.0, 99.0), u=(0.0, 1.0))
    square = LocationError(component="C", axis="Y", value=30.0, u=(2.0,))
    wave = Cyclic(component="X", axis="X", period=7.0, sine=(3.0,), cosine=(0.0,))
    play = Backlash(axis="Y", width=5.0, u=(0.5,))
    write_model(base_of(CFRAME, old, tilt, wave, square, play), Path("old.json"))
    write_model(base_of(CFRAME, tilt, square, play), Path("real.json"))
    made(command, "cframe", "--calibration", "real.json", *ERRORS)
    done = calibrated(command, "cframe", "--add-to", "old.json")
    assert "E_XX, cyclic E_XX of" in done.err
    found, truth = (read_model(Path(name), CFRAME) for name in ("cal.json", "truth.json"))
    assert [effect.name for effect in found.effects] == ["E_BX", "E_C0Y", "backlash Y", "E_XX", "backlash X"]
    x = np.linspace(3.0, 447.0, 100)
    for z in (0.0, 250.0, 500.0):
        off = along(found, CFRAME, x, 1, z=z) - along(truth, CFRAME, x, 1, z=z)
        assert np.std(off[:, 0]) < 0.2, z
        assert np.abs(off[:, 2]).max() < 1e-3
    # the arm's uncertainty is in E_XX, and tied to that of E_BX: 500 mm x 1 urad over the axis
    covariance = np.array(found.covariance)
    assert np.sqrt(covariance[-2, -2]) > 0.1
    assert abs(covariance[1, -2]) > 0.05


@pytest.mark.statistical
def test_reversal_that_changes_along_the_axis(command):
    made(command, "cframe", "--effect", "backlash:axis=X,width=9,windup=20", *ERRORS[:2])
    assert "reversal E_XX" in calibrated(command, "cframe").err
    found, truth = (read_model(Path(name), CFRAME) for name in ("cal.json", "truth.json"))
    x = np.linspace(10.0, 440.0, 50)
    play = [along(model, CFRAME, x, 1)[:, 0] - along(model, CFRAME, x, -1)[:, 0] for model in (found, truth)]
    np.testing.assert_allclose(play[0], play[1], atol=0.5)


def test_one_direction_knows_no_reversal(command):
    made(command, "cframe", *ERRORS)
    text = Path("targets.csv").read_text().splitlines()
    head = next(i for i, line in enumerate(text) if line.startswith(("time_s", "axis", "X,"))) + 1
    columns = text[head - 1].split(",")
    kept = [line for line in text[head:] if line.split(",")[columns.index("direction")] in ("1", "+", "forward")]
    Path("targets.csv").write_text("\n".join([*text[:head], *kept, ""]))
    done = calibrated(command, "cframe")
    assert "forward only" in done.err
    assert [effect.name for effect in read_model(Path("cal.json"), CFRAME).effects] == ["E_XX"]


def test_what_can_not_be_a_calibration(command):
    made(command, "cframe", *ERRORS)
    write_model(base_of(machines.load("gantry")), Path("gantry.json"))
    Path("short.toml").write_text('name = "cframe"\nchain = "w b Y Z t"\naxes.Y.travel=[0,9]\naxes.Z.travel=[0,9]\n')
    targets = Path("targets.csv").read_text()
    write = ("--write-calibration", "cal.json")
    for options, says in (
        (write, "give the machine of the calibration with --machine"),
        (("--machine", "cframe"), "is an option of --write-calibration"),
        (("--add-to", "gantry.json"), "is an option of --write-calibration"),
        ((*write, "--machine", "gantry"), "of machine cframe, and --machine is gantry: give the machine of the data"),
        ((*write, "--machine", "short.toml"), "has no axis X"),
        ((*write, "--machine", "cframe", "--add-to", "gantry.json"), "is of machine gantry"),
        ((*write, "--machine", "cframe", "--report", "cal.json"), "both name"),
        (("--write-calibration", "run.csv", "--machine", "cframe"), "is an input and would be overwritten"),
    ):
        refused = command("continuous", "run.csv", "targets.csv", "-o", "table.csv", *options)
        assert refused.status == 2, options
        assert says in refused.err
        assert "Traceback" not in refused.err
        assert not Path("cal.json").exists()
        assert not Path("table.csv").exists()
    lines = targets.splitlines()
    row = lines[-1].split(",")
    head = next(line for line in lines if not line.startswith("#")).split(",")
    row[head.index("Z")] = "400"
    Path("targets.csv").write_text("\n".join([*lines[:-1], ",".join(row), ""]))
    refused = command("continuous", "run.csv", "targets.csv", "-o", "t.csv", *write, "--machine", "cframe")
    assert refused.status == 2
    assert "more than one line" in refused.err
