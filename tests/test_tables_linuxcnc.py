"""LinuxCNC's simulator loads exported tables, and its joints move as the error model says."""

import re
from pathlib import Path

import numpy as np
import pytest
from clients.linuxcnc_sim import Config, Table
from support.programs import load, model_of

import machines
from kinematics.basis import BSpline
from kinematics.effects import Backlash, ErrorMotion
from kinematics.effects.base import COMPONENTS, own_component
from kinematics.error_model.model import write_model
from kinematics.state import State
from postproc.control_data.format import parse_settings
from postproc.control_data.formats import FORMATS
from postproc.control_data.tables.export_tables import export

pytestmark = pytest.mark.statistical

CLOSE = 1e-6  # mm and degrees
TRAVEL = {"cframe": {"X": (0, 600), "Y": (0, 450), "Z": (0, 500)}, "head_table": {"C": (0, 360), "X": (-500, 500)}}


def measured(machine, axis, seed):
    """A positioning error as it is measured: values every 25 mm or 15 degrees, rounded to 0.1 um or urad."""
    low, high = TRAVEL[machine.name][axis]
    nodes = np.linspace(low, high, 25)
    rng = np.random.default_rng(seed)
    values = np.cumsum(rng.normal(0.0, 4.0, len(nodes))).round(1)
    if machine.axes[machine.index(axis)].rotary:
        values[-1] = values[0]
    return ErrorMotion(
        own_component(axis), axis, BSpline(tuple(nodes.tolist()), 1), tuple(values.tolist()), u=(0.0,) * 25
    )


def model(name):
    machine = load(name)
    errors = [measured(machine, axis, seed) for seed, axis in enumerate(TRAVEL[name])]
    plays = [Backlash(axis, 12.0 + 5 * k) for k, axis in enumerate(TRAVEL[name])]
    return machine, model_of(machine, *errors, *plays)


def stands(machine, errors, motors, ways):
    """Where the axes with errors, mm or degrees, stand when their motors stand there; ends hold outside."""
    found = np.empty_like(motors)
    q = np.zeros((len(motors), len(machine.axes)))
    q[:, [machine.index(axis) for axis in TRAVEL[machine.name]]] = motors
    approach = np.zeros_like(q)
    approach[:, [machine.index(axis) for axis in TRAVEL[machine.name]]] = ways
    e = errors.errors(machine, State(q * machine.scale, approach))
    for k, axis in enumerate(TRAVEL[machine.name]):
        i = machine.index(axis)
        found[:, k] = motors[:, k] + e[:, i, COMPONENTS.index(own_component(axis))] / machine.scale[i]
    return found


@pytest.mark.parametrize(("name", "kind"), [("cframe", 1), ("cframe", 0), ("head_table", 1)])
def test_joints_move_as_the_error_model_says(linuxcnc_sim, name, kind):
    """At rest, from both sides, in the travel, at its ends and outside: the motor is where the axis is right."""
    machine, errors = model(name)
    form = FORMATS["linuxcnc"]
    exported = export(machine, errors, form, parse_settings(form.settings, [f"type={kind}"]), "correction", (0, 0, -80))
    letters = "XYZC" if name == "head_table" else "XYZ"
    files = {axis: exported.files[f"comp_{axis.lower()}.txt"] for axis in TRAVEL[name]}
    config = Config(
        letters, tables={axis: Table(text, kind) for axis, text in files.items()}, velocity=500.0, acceleration=3000.0
    )
    columns = [letters.index(axis) for axis in TRAVEL[name]]
    ends = np.array(list(TRAVEL[name].values()), float)
    shares = np.append(np.linspace(-0.08, 1.08, 30).round(2), [0.263, 0.777])
    shares.sort()
    up = ends[:, 0] + shares[:, None] * (ends[:, 1] - ends[:, 0])
    asked = np.concatenate([up[:1] - 5.0, up, up[-1:] + 5.0, up[::-1]])
    ways = np.sign(np.diff(asked, axis=0, prepend=np.zeros_like(asked[:1])))
    blocks = [
        "G53 G0 " + " ".join(f"{axis}{v:.9f}" for axis, v in zip(TRAVEL[name], row, strict=True)) for row in asked
    ]
    samples = linuxcnc_sim.at_rest(config, blocks)
    joints, motors = samples.joint[:, columns], samples.motor[:, columns]
    assert joints == pytest.approx(asked, abs=1e-9)

    inside = (asked >= ends[:, 0]) & (asked <= ends[:, 1])
    reached = stands(machine, errors, motors, ways)
    assert np.abs((reached - asked)[inside]).max() <= CLOSE, "inside, at the ends too"
    assert np.abs((motors - joints)[inside]).max() > 0.005
    endless = np.array([np.isinf(machine.axes[machine.index(axis)].travel[1]) for axis in TRAVEL[name]])
    held = np.where(endless, asked % 360.0, np.clip(asked, *ends.T))
    outside = stands(machine, errors, held + motors - joints, ways) - held
    assert np.abs(outside[~inside]).max() <= CLOSE, "outside, the value at the end holds, or a turn begins again"


@pytest.mark.parametrize("unit", ["mm", "inch"])
def test_a_gantry_in_the_unit_of_its_control(linuxcnc_sim, command, tmp_path, unit):
    """The INI lines and tables of the command: both joints of Y are where the axis is right, in mm and in inches."""
    machine, errors = model("cframe")
    write_model(errors, tmp_path / "cal.json")
    text = (Path(machines.__file__).parent / "cframe.toml").read_text()
    (tmp_path / "mill.toml").write_text(f'{text}\n[control]\nfamily = "linuxcnc"\nunit = "{unit}"\n')
    done = command(
        "export", "--machine", "mill.toml", "-c", "cal.json", "--format", "linuxcnc", "--set", "joints=XYYZ",
        "--tool-mm", "80", "-o", "tables",
    )  # fmt: skip
    assert done.status == 0, done.err
    ini = (tmp_path / "tables" / "linuxcnc.ini").read_text()
    lines = {int(joint): own for joint, own in re.findall(r"\[JOINT_(\d)\]\n([^\[]*)", ini)}
    comps = {path.name: path.read_text() for path in (tmp_path / "tables").glob("comp_*.txt")}
    config = Config("XYZ", gantry="XYYZ", unit=unit, of_joints=lines, files=comps, velocity=500.0, acceleration=3000.0)
    length = {"mm": 1.0, "inch": 25.4}[unit]
    ends = np.array(list(TRAVEL["cframe"].values()), float)
    shares = np.array([0.02, 0.263, 0.5, 0.777, 0.98])
    up = ends[:, 0] + shares[:, None] * (ends[:, 1] - ends[:, 0])
    asked = np.concatenate([up, up[-2::-1]])
    ways = np.sign(np.diff(asked, axis=0, prepend=np.zeros_like(asked[:1])))
    blocks = ["G21 G53 G0 " + " ".join(f"{axis}{v:.9f}" for axis, v in zip("XYZ", row, strict=True)) for row in asked]
    samples = linuxcnc_sim.at_rest(config, blocks)
    assert samples.joint[:, [0, 1, 3]] * length == pytest.approx(asked, abs=1e-9)
    assert (samples.motor[:, 1] == samples.motor[:, 2]).all(), "the bridge stays square"
    motors = samples.motor[:, [0, 1, 3]] * length
    assert np.abs(motors - asked).max() > 0.005
    assert np.abs(stands(machine, errors, motors, ways) - asked).max() <= CLOSE + 1e-7 * length


def test_a_joint_without_a_table_does_not_move(linuxcnc_sim):
    machine = load("cframe")
    form = FORMATS["linuxcnc"]
    errors = model_of(machine, measured(machine, "X", 1))
    exported = export(machine, errors, form, parse_settings(form.settings, []), "correction", (0, 0, 0))
    assert set(exported.files) == {"comp_x.txt", "linuxcnc.ini"}
    assert exported.files["linuxcnc.ini"].splitlines()[1:] == [
        "[JOINT_0]", "COMP_FILE = comp_x.txt", "COMP_FILE_TYPE = 1"
    ]  # fmt: skip
    config = Config("XYZ", tables={"X": Table(exported.files["comp_x.txt"])}, velocity=500.0, acceleration=3000.0)
    samples = linuxcnc_sim.at_rest(config, ["G53 G0 X200 Y200 Z100", "G53 G0 X40 Y100 Z300"])
    assert (samples.motor == samples.joint)[:, 1:].all()
    assert (samples.motor != samples.joint)[:, 0].all()
