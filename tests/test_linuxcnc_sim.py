"""Kinematics against LinuxCNC's own, and what its simulator makes of compensation tables and backlash."""

import numpy as np
import pytest
from clients.linuxcnc_sim import Config, OwnFault, SimulatorError, Table

import machines
from kinematics.forward import forward, tool_point
from kinematics.inverse import inverse, linear_positions

pytestmark = pytest.mark.statistical

TOLERANCE = 1e-9  # mm and rad
EXACT = 1e-12
SINGLE = 1e-8  # LinuxCNC keeps corrections of hundredths in single precision
RETRACT = 50.0  # mm
PAIRS = 24  # of poses
TOOLS = {1: 12.5, 2: 163.25}  # lengths in mm
POINT = np.array([3.0, -7.0, 11.0])  # on the C axis of a table
TILT = {"A": np.array([0.0, -20.0, -15.0]), "B": np.array([-20.0, 0.0, -15.0])}  # from there to the tilting axis
PIVOT = 250.0  # mm from the tool point of a head, with W at 0, to its swivels


def machine_file(name, chain, **lines):
    """A machine file; `lines` are direction and point of the axes that do not follow their letter from the origin."""
    text = [f'name = "{name}"', f'chain = "{chain}"']
    for axis in (link for link in chain.split() if link not in "wbt"):
        text += [f"[axes.{axis}]", "travel = [-inf, inf]"]
        if axis in lines:
            direction, point = lines[axis]
            text += [f"direction = {list(direction)}", f"point = {list(map(float, point))}"]
    return "\n".join(text)


def table_table(tilt):
    """C on a trunnion A or B. A positive angle turns the table right-handed: the tool left-handed, against ISO 841."""
    module = f"xyz{tilt.lower()}c-trt-kins"
    pins = {f"{axis}-rot-point": value for axis, value in zip("xyz", POINT, strict=True)}
    pins |= {f"{axis}-offset": value for axis, value in zip("xyz", TILT[tilt], strict=True)}
    hal = [f"setp {module}.{pin} {value}" for pin, value in pins.items()]
    hal.append(f"net tool-length motion.tooloffset.z => {module}.tool-offset")
    against = {"A": (-1, 0, 0), "B": (0, -1, 0), "C": (0, 0, -1)}
    lines = {"C": (against["C"], POINT), tilt: (against[tilt], POINT + TILT[tilt])}
    return Config(f"XYZ{tilt}C", module, hal, tools=TOOLS), machine_file(module, f"w C {tilt} b X Y Z t", **lines)


def head_head(chain):
    """C and B in the head, and the quill W: an axis of the chain, or the length of the tool.

    C turns right-handed, B left-handed, against ISO 841; a positive W moves the tool away from the spindle.
    """
    lines = {"C": ((0, 0, 1), (0, 0, PIVOT)), "B": ((0, -1, 0), (0, 0, PIVOT)), "W": ((0, 0, -1), (0, 0, 0))}
    config = Config("XYZBCW", "5axiskins", [f"setp 5axiskins.pivot-length {PIVOT}"])
    return config, machine_file("5axiskins", chain, **lines)


KINEMATICS = {
    "xyzbc-trt-kins": table_table("B"),
    "xyzac-trt-kins": table_table("A"),
    "5axiskins": head_head("w b X Y Z C B t"),
    "5axiskins with a quill": head_head("w b X Y Z C B W t"),
}


def random_positions(axes, rng):
    """Axis positions `(PAIRS, axes)`, mm and degrees."""
    reach = {"X": 200, "Y": 200, "Z": 200, "A": 110, "B": 110, "C": 360, "W": 150}
    return np.array([reach[axis] for axis in axes]) * rng.uniform(-1, 1, (PAIRS, len(axes)))


def moves(axes, positions, tools):
    """Blocks that go to machine coordinates, with a tool change where the tool is another one."""
    blocks = []
    for row, tool, before in zip(positions, tools, [0, *tools], strict=False):
        words = " ".join(f"{axis}{value:.12f}" for axis, value in zip(axes, row, strict=True))
        blocks.append((f"T{tool} M6 G43 " if tool != before else "") + "G53 G0 " + words)
    return blocks


@pytest.mark.parametrize("name", KINEMATICS)
def test_kinematics(linuxcnc_sim, name):
    """Each second pose is RETRACT away from the one before, along the tool axis as ncomp has it."""
    config, text = KINEMATICS[name]
    machine = machines.parse(text, name)
    axes = config.axes
    chain = [axes.index(axis) for axis in machine.names]

    first = random_positions(axes, np.random.default_rng(841))
    second = first.copy()
    tool_axis = forward(machine, first[:, chain] * machine.scale).rotation[:, :, 2]
    if "W" in axes:
        second[:, axes.index("W")] += RETRACT
        lift = RETRACT * tool_axis
    else:
        second[:, :3] += RETRACT * tool_axis
        lift = np.array([0.0, 0.0, RETRACT])
    asked = np.stack([first, second], axis=1).reshape(-1, len(axes))
    tool_axes = np.repeat(tool_axis, 2, axis=0)
    tools = np.repeat(np.arange(PAIRS) * (1 + len(config.tools)) // PAIRS, 2)

    stood = linuxcnc_sim.at_rest(config, moves(axes, asked, tools))
    assert np.abs(stood.axis - asked).max() <= TOLERANCE, "LinuxCNC went somewhere else"

    # LinuxCNC counts the tool length of G43 along Z of the workpiece, whatever way the tool points.
    length = np.array([config.tools.get(tool, 0.0) for tool in tools])
    tip = stood.axis[:, :3] - np.outer(length, [0, 0, 1])
    if "W" in axes and "W" not in machine.names:
        length = length + stood.axis[:, axes.index("W")]
    tool = np.outer(length, [0, 0, -1])
    q = stood.joint[:, chain] * machine.scale
    near = q + np.where(machine.rotary, 0.05, 0.0)
    found = [inverse(machine, *row[:3], start=row[3]).q[0] for row in zip(tip, tool_axes, tool, near, strict=True)]
    differences = {
        "joints by linear_positions": linear_positions(machine, q, tip, tool) - q,
        "joints by inverse": np.array(found) - q,
        "tool point by forward": tool_point(machine, q, tool) - tip,
        "joints along the tool axis": stood.joint[1::2, :3] - stood.joint[::2, :3] - lift,
    }
    largest = {what: float(np.abs(difference).max()) for what, difference in differences.items()}
    told = ", ".join(f"{what} {value:.1e}" for what, value in largest.items())
    assert max(largest.values()) <= TOLERANCE, f"{name}, {len(asked)} poses, largest differences in mm and rad: {told}"


# Position, correction to add on the way up, and on the way down: mm or degrees.
TABLE_ROWS = np.array([(-100, 0.012, -0.004), (-20, -0.03, 0.01), (50, 0.02, 0.033), (120.5, 0.007, 0.007)])


def travelled(joint):
    """The direction of each joint in each servo cycle, or of its last move, 0 before the first; and where it lasts.

    The cycle before a reversal is left out of the latter: the velocity turns there, a cycle before the position does.
    """
    direction = np.zeros_like(joint)
    direction[1:] = np.sign(np.diff(joint, axis=0))
    for row in range(1, len(direction)):
        direction[row] = np.where(direction[row] == 0, direction[row - 1], direction[row])
    return direction, np.append(direction[:-1] == direction[1:], np.ones_like(direction[:1], bool), axis=0)


def check_motors(samples, direction, ramp):
    """Motor = joint + correction, save during the `ramp`, in servo cycles, after a reversal."""
    reversals = np.flatnonzero(np.diff(direction, axis=0).any(axis=1))
    after = np.arange(len(direction))[:, None] - reversals
    settled = ~((after >= 0) & (after <= ramp)).any(axis=1)
    assert settled[-1]
    assert samples.motor[settled] == pytest.approx((samples.joint + samples.correction)[settled], abs=EXACT)


def table(rows, kind):
    return Table("".join(" ".join(map(repr, row)) + "\n" for row in rows.tolist()), kind)


def test_compensation_tables(linuxcnc_sim):
    """Type 1 holds the correction to add to a joint, type 0 where the joint is without it."""
    corrections = table(TABLE_ROWS, 1)
    measured = table(TABLE_ROWS[:, :1] - TABLE_ROWS * [0, 1, 1], 0)
    config = Config(
        "XYZC",
        tables={"X": corrections, "Y": measured, "C": corrections},
        backlash={"X": 0.5, "Z": 0.02},  # a table switches it off
        velocity=500.0,
        acceleration=5000.0,
    )
    sweep = "G0 X-150 Y-150 Z-150 C-150\nG93 G1 F60 X200 Y200 Z200 C200\nX-150 Y-150 Z-150 C-150 F60\nM2\n"
    samples = linuxcnc_sim.run(config, sweep)
    direction, lasts = travelled(samples.joint)
    for joint in (0, 1, 3):
        up, down = (np.interp(samples.joint[:, joint], TABLE_ROWS[:, 0], column) for column in TABLE_ROWS.T[1:])
        expected = np.select([direction[:, joint] > 0, direction[:, joint] < 0], [up, down])
        shown = lasts[:, joint]
        assert samples.correction[shown, joint] == pytest.approx(expected[shown], abs=SINGLE)
    assert samples.correction[lasts[:, 2], 2] == pytest.approx(0.01 * direction[lasts[:, 2], 2], abs=EXACT)
    check_motors(samples, direction, ramp=15)


def test_backlash_in_a_program_with_reversals(linuxcnc_sim):
    """Half the BACKLASH, to the side the joint moves to; nothing until it first moves."""
    config = Config("XYZ", backlash={"X": 0.02, "Y": 0.05}, velocity=200.0, acceleration=4000.0)
    corners = [(30, 0), (10, 5), (20, 5), (20, -5), (0, 0)]
    samples = linuxcnc_sim.run(config, "\n".join(["F3000", *(f"G1 X{x} Y{y}" for x, y in corners), "M2\n"]))
    for corner in corners:  # exact stops
        assert np.abs(samples.axis[:, :2] - corner).max(axis=1).min() <= EXACT
    direction, lasts = travelled(samples.joint)
    assert set(direction[:, 0]) == set(direction[:, 1]) == {-1.0, 0.0, 1.0}
    expected = direction * [0.01, 0.025, 0.0]
    assert samples.correction[lasts] == pytest.approx(expected[lasts], abs=EXACT)
    check_motors(samples, direction, ramp=15)


@pytest.mark.parametrize(
    ("config", "program", "said"),
    [
        (Config("XYZ"), "G0 X1\nM128\nM2\n", "Unknown m code used"),
        (Config("XYZ"), "G4 P100\nM2\n", "out of time while waiting for the end of the program"),
        (Config("XYZ", "nokins"), "M2\n", "nokins.so: cannot open shared object file"),
        (Config("XYZ", hal=["setp none.such 1"]), "M2\n", "parameter or pin 'none.such' not found"),
        (Config("XYZ", tables={"Y": Table("0 0 0\n0 1 1\n")}), "M2\n", "joint 1: compensation values must increase"),
    ],
    ids=["refused block", "too long", "no such kinematics", "no such pin", "bad table"],
)
def test_failures_say_why(linuxcnc_sim, config, program, said):
    with pytest.raises(SimulatorError, match=said):
        linuxcnc_sim.run(config, program, timeout=3.0)


def test_a_fault_of_its_own_is_told_from_a_refusal(linuxcnc_sim):
    """The former ends a run that would go well when repeated."""
    kinds = [type(linuxcnc_sim._error([message], "")) for message in (*linuxcnc_sim.OWN_FAULTS, "Unknown g code")]
    assert kinds == [OwnFault, OwnFault, SimulatorError]
