"""LinuxCNC's simulator as a machine with location errors: measured, fitted, its parameters set, measured again."""

import json
import re

import numpy as np
import pytest
from clients.linuxcnc_sim import Config
from support.linuxcnc_trunnion import (
    ANGLES,
    PROBE,
    SHIFT_OF_C,
    SHIFT_OF_TILT,
    SPHERES,
    machine_file,
    positions,
    real,
    unseen,
)
from support.programs import model_of

import machines
from kinematics.basis import Harmonics
from kinematics.effects import ErrorMotion, LocationError
from kinematics.forward import tool_point
from postproc.control_data.formats import formats_of
from postproc.control_data.parameters.export_parameters import export_parameters
from postproc.control_data.parameters.parameter_format import ParameterFormat

FORMATS = formats_of(ParameterFormat)

pytestmark = pytest.mark.statistical


def test_measured_fitted_set_and_measured_again(linuxcnc_sim, command, tmp_path):
    """The positions at which the real machine's tip is in the spheres; then tool point errors at other poses."""
    places = [(centre, angle) for centre in SPHERES.values() for angle in ANGLES]
    joints = positions(linuxcnc_sim, "A", real("A"), places)
    found = joints[:, :3] + np.random.default_rng(3).normal(0.0, 0.001, (len(joints), 3))
    names = np.repeat(list(SPHERES), len(ANGLES))
    rows = [
        ",".join(f"{value:.6f}" for value in (*xyz, *turns)) + f",{name}"
        for xyz, turns, name in zip(found.tolist(), joints[:, 3:].tolist(), names, strict=True)
    ]
    head = ["# machine: mill", "# instrument: touch-probe", "# u_um: 1.0", f"# probe: 0 0 {-PROBE}"]
    head += [f"# sphere.{name}: {x} {y} {z}" for name, (x, y, z) in SPHERES.items()]
    (tmp_path / "data.csv").write_text("\n".join([*head, "X,Y,Z,A,C,sphere", *rows, ""]))
    (tmp_path / "mill.toml").write_text(machine_file("A"))
    assert command("fit", "data.csv", "--machine", "mill.toml", "-o", "cal.json").status == 0
    done = command("export", "-m", "mill.toml", "-c", "cal.json", "--format", "linuxcnc-kinematics", "-o", "out",
                   "--tool-mm", PROBE, "--json", "out.json")  # fmt: skip
    assert done.status == 0, done.err

    lines = {name: (tmp_path / "out" / f"{name}.hal").read_text().splitlines()[1:]
             for name in ("kinematics_before", "kinematics")}  # fmt: skip
    others = unseen(12)
    right = positions(linuxcnc_sim, "A", real("A"), others)
    before, after = (
        np.linalg.norm((positions(linuxcnc_sim, "A", lines[name], others) - right)[:, :3], axis=1) * 1e3
        for name in ("kinematics_before", "kinematics")
    )
    assert np.sqrt(np.mean(before**2)) > 40.0
    assert np.sqrt(np.mean(after**2)) < 2.0
    assert after.max() < 0.1 * before.max()
    told = json.loads((tmp_path / "out.json").read_text())
    true = {"C along X": 42.0, "C along Y": -31.0, "A along Y": -4.0, "A along Z": -36.0}
    assert {row["line"] for row in told["lines"]} == set(true)
    assert all(abs(row["change"] - true[row["line"]]) < 2 * row["u"] for row in told["lines"])


def test_parameters_of_a_table_with_b(linuxcnc_sim):
    """Known location errors: LinuxCNC with the exported lines goes where the real machine is right."""
    machine = machines.parse(machine_file("B"), "mill")
    of_b, of_c = (1e3 * SHIFT_OF_TILT).tolist(), (1e3 * SHIFT_OF_C).tolist()
    errors = [
        LocationError("X", "B", -of_b[0]),
        LocationError("Z", "B", -of_b[2]),
        LocationError("X", "C", of_b[0] - of_c[0]),
        LocationError("Y", "C", -of_c[1]),
    ]
    form = FORMATS["linuxcnc-kinematics"]
    found = export_parameters(machine, model_of(machine, *errors), form, form.settings(), "correction", (0, 0, -PROBE))
    lines = found.files["kinematics.hal"].splitlines()[1:]
    others = unseen(8)
    right, sent = (positions(linuxcnc_sim, "B", each, others) for each in (real("B"), lines))
    assert np.abs(sent - right).max() < 2e-5


HEAD = (
    'name = "head"\nchain = "w b X Y Z C B t"\naxes.X = { travel = [-500, 500] }\naxes.Y = { travel = [-400, 400] }'
    "\naxes.Z = { travel = [-300, 300] }\naxes.C = { travel = [-200, 200], point = [0, 0, 250] }\n"
    "axes.B = { travel = [-100, 100], point = [0, 0, 250], direction = [0, -1, 0] }\n"
)


def test_the_pivot_length_of_a_head(linuxcnc_sim):
    """A pivot 40 um longer than in the machine file."""
    machine = machines.parse(HEAD, "head")
    waves = {"X": (40.0, 0.0), "Z": (0.0, -40.0)}
    errors = [LocationError("Z", "B", 40.0)]
    errors += [ErrorMotion(c, "B", Harmonics((-100, 100), 1), (0.0, *v), u=(0.0,) * 3) for c, v in waves.items()]
    form = FORMATS["linuxcnc-kinematics"]
    found = export_parameters(machine, model_of(machine, *errors), form, form.settings(), "correction", (0, 0, 0))
    (value,) = re.findall(r"^setp 5axiskins.pivot-length (\S+)$", found.files["kinematics.hal"], re.M)
    assert float(value) == pytest.approx(250.04, abs=1e-5)
    blocks = [f"G53 G0 X{10 * k} Y{5 * k} Z{k} B{13 * k - 30} C{31 * k - 90}" for k in range(6)]
    right, sent = (
        linuxcnc_sim.at_rest(Config("XYZBCW", "5axiskins", [f"setp 5axiskins.pivot-length {length}"]), blocks).joint
        for length in ("250.04", value)
    )
    assert np.abs(sent - right).max() < 2e-5


@pytest.mark.parametrize(("unit", "summed"), [("mm", True), ("inch", True), ("mm", False)])
def test_the_tool_comes_by_the_sum_with_the_pivot(linuxcnc_sim, unit, summed):
    """As sheet.md describes it: with a pin that holds the exported number alone, the tip of a tool goes astray."""
    machine = machines.parse(f'{HEAD}\n[control]\nunit = "{unit}"\n', "head")
    form, length = FORMATS["linuxcnc-kinematics"], {"mm": 1.0, "inch": 25.4}[unit]
    small = model_of(machine, LocationError("Z", "B", 0.1))
    exported = export_parameters(machine, small, form, form.settings(), "correction", (0, 0, -100))
    (pin, value) = re.findall(r"^setp (\S+) (\S+)$", exported.files["kinematics_before.hal"], re.M)[0]
    hal = [
        "loadrt sum2 names=pivotsum", "addf pivotsum servo-thread", f"setp pivotsum.in0 {value}",
        "net tool-length motion.tooloffset.z => pivotsum.in1", f"net pivot pivotsum.out => {pin}",
    ]  # fmt: skip
    tools = {1: 100.0 / length}
    config = Config("XYZBCW", "5axiskins", hal if summed else [f"setp {pin} {value}"], tools=tools, unit=unit)
    blocks = ["T1 M6", "G43", "G21 G90 G0 X0 Y0 Z0 B90", "G0 X30 Y-20 Z10 B40 C70"]
    joints = linuxcnc_sim.at_rest(config, blocks).joint[2:] * np.array([length] * 3 + [1.0, 1.0, length])
    q = joints[:, ["XYZBCW".index(axis) for axis in machine.names]] * machine.scale
    tips = tool_point(machine, q, np.tile([0.0, 0.0, -100.0], (2, 1)))
    missed = np.linalg.norm(tips - [[0.0, 0.0, 0.0], [30.0, -20.0, 10.0]], axis=1)
    assert missed == pytest.approx([0.0, 0.0], abs=1e-4) if summed else missed[0] == pytest.approx(141.42, abs=0.01)
