"""Programs of the tool point as positions of the axes, and back, against LinuxCNC's own kinematics in its simulator.

LinuxCNC carries out the program of the tool point with its component xyzac-trt-kins, xyzbc-trt-kins or 5axiskins, and
tells the positions of its joints; its interpreter reads the converted program, whose coordinates are those positions.
"""

import re
from pathlib import Path

import numpy as np
import pytest
from clients.linuxcnc_sim import Config
from clients.rs274 import Tool
from support import linuxcnc_trunnion as trunnion

CONTROL = '\n[control]\nfamily = "linuxcnc"\ntcp_at_start = true\n'
LENGTH, PIVOT = 80.0, 250.0
SET_UP = (
    *("--machine", "mill.toml", "--calibration", "none", "--work-offset", "G54=0,0,0", "--tool-length", f"T1={LENGTH}"),
)
HEAD = (
    'name = "head"\nchain = "w b X Y Z C B t"\naxes.X = { travel = [-500, 500] }\naxes.Y = { travel = [-500, 500] }'
    f"\naxes.Z = {{ travel = [-400, 400] }}\naxes.C = {{ travel = [-200, 200], point = [0, 0, {PIVOT}] }}\n"
    f"axes.B = {{ travel = [-100, 100], point = [0, 0, {PIVOT}], direction = [0, -1, 0] }}\n"
)


def of_trunnion(tilt):
    """Machine file and configuration of a trunnion table."""
    lines = trunnion.pins(tilt, trunnion.POINT, trunnion.TILT[tilt])
    connect = f"net tool-length motion.tooloffset.z => xyz{tilt.lower()}c-trt-kins.tool-offset"
    module = f"xyz{tilt.lower()}c-trt-kins"
    return trunnion.machine_file(tilt), Config(f"XYZ{tilt}C", module, [*lines, connect], tools={1: LENGTH}), f"{tilt}C"


def of_head():
    """Machine file and configuration of a head whose pivot pin takes the sum of pivot and tool."""
    hal = [
        "loadrt sum2 names=pivotsum", "addf pivotsum servo-thread", f"setp pivotsum.in0 {PIVOT}",
        "net tool-length motion.tooloffset.z => pivotsum.in1", "net pivot pivotsum.out => 5axiskins.pivot-length",
    ]  # fmt: skip
    return HEAD, Config("XYZBCW", "5axiskins", hal, tools={1: LENGTH}), "BC"


MACHINES = {"xyzac-trt": lambda: of_trunnion("A"), "xyzbc-trt": lambda: of_trunnion("B"), "5axiskins": of_head}


def poses(axes, count):
    """Blocks of random poses of the tool point."""
    rng, (tilting, turning) = np.random.default_rng(11), axes
    for _ in range(count):
        x, y, z = rng.uniform((-80, -80, 0), (80, 80, 90))
        tilt, turn = rng.uniform(-70, 50), rng.uniform(-180, 180)
        yield f"X{x:.4f} Y{y:.4f} Z{z:.4f} {tilting}{tilt:.4f} {turning}{turn:.4f}"


def program(axes, count):
    first, *others = poses(axes, count)
    lines = ["G21 G17 G90 G94 G54", "T1 M6", f"G0 {axes[0]}0. {axes[1]}0.", "G43 H1", f"G0 {first}"]
    return "\n".join([*lines, *(f"G1 {block} F5000." for block in others), "M30", ""])


def converted(ncomp, text, machine):
    """The converted program of a machine file."""
    as_written = machine.replace("axes.C = { ", 'axes.C = { rollover = "as-written", ')
    Path("mill.toml").write_text(as_written + CONTROL)
    Path("tip.ngc").write_text(text)
    done = ncomp("tip.ngc", *SET_UP, "--tcp", "to-axes", "--tolerance-um", "1e7", "-o", "axes.ngc")
    assert done.status == 0, done.err
    return Path("axes.ngc").read_text()


@pytest.mark.parametrize(("kinematics", "count"), [
    ("xyzac-trt", 20),
    *(pytest.param(name, 200, marks=pytest.mark.statistical) for name in MACHINES),
])  # fmt: skip
def test_positions_of_the_axes_are_those_of_linuxcnc_s_joints(ncomp, linuxcnc, linuxcnc_sim, kinematics, count):
    machine, config, axes = MACHINES[kinematics]()
    text = program(axes, count)
    blocks = [f"G0 {block}" for block in poses(axes, count)]
    head = ["T1 M6", "G43", "G21 G90"]
    joints = linuxcnc_sim.at_rest(config, [*head, *blocks], timeout=120.0).joint[len(head) :]
    joints = joints[:, [config.axes.index(letter) for letter in "XYZ" + axes]]

    result = converted(ncomp, text, machine)
    ran = linuxcnc.run(result, tools={1: Tool(length=LENGTH)})
    assert (ran.exit_status, ran.message) == (0, "")
    lines = result.splitlines()
    moves = [i for i, line in enumerate(lines) if re.match(r"(G93 )?G[01] X", line)]
    last = [i for i in moves if i + 1 not in moves or "NCOMP FROM" not in lines[i + 1]]
    at = {move.line: move.machine for move in ran.moves}
    found = np.array([at[i + 1] for i in last])[:, ["XYZABC".index(letter) for letter in "XYZ" + axes]]
    assert found.shape == joints.shape
    assert np.abs(found - joints).max() < 1e-4
    Path("axes.ngc").write_text(result)
    back = ncomp("axes.ngc", *SET_UP, "--tcp", "to-tcp", "--tolerance-um", "1e7", "--force", "-o", "back.ngc")
    assert back.status == 0, back.err
    again = linuxcnc.run(Path("back.ngc").read_text(), tools={1: Tool(length=LENGTH)})
    tips = {move.line: move.end for move in again.moves}
    lines = Path("back.ngc").read_text().splitlines()
    moves = [i for i, line in enumerate(lines) if re.match(r"(G93 )?G[01] X", line)]
    ends = [i for i in moves if i + 1 not in moves or "NCOMP FROM" not in lines[i + 1]]
    programmed = [[float(number) for number in re.findall(r"[XYZABC]([-\d.]+)", block)] for block in poses(axes, count)]
    returned = np.array([tips[i + 1] for i in ends])[:, ["XYZABC".index(letter) for letter in "XYZ" + axes]]
    assert np.abs(returned[-count:] - programmed).max() < 2e-4  # rounded there and back
