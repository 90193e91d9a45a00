"""What location errors mean at the machine.

Signs. All errors are counted as *tool relative to workpiece*, angles as right-handed rotations. Physically:

- linear axis on either side: E_C0Y = g means that the line of Y lies turned by +g about z. The tool's displacement
  relative to the workpiece is turned alike, whichever of the two the axis carries.
- rotary axis that carries the tool: E_X0C = e, E_A0C = g mean that the line of C, with all that it carries towards
  the tool, lies at +e, tilted by +g about x through `axis.point`, as seen from the part that carries C.
- rotary axis that carries the workpiece: the line of C, with the table and all that it carries towards the
  workpiece, lies at **-e**, tilted by **-g**: the tool is at +e relative to the workpiece on the displaced table.
"""

from dataclasses import replace

import msgspec
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import machines
from kinematics.basis import Polynomial
from kinematics.deviation import Deviation, exact_deviation
from kinematics.effects import COMPONENTS, Effect, ErrorMotion, LocationError
from kinematics.error_model.model import ErrorModel, no_errors
from kinematics.forward import forward, tool_point
from kinematics.machine import Machine, make_axis
from kinematics.state import State
from kinematics.transforms import Array, Pose, turn

TOOL = np.array([10.0, -20.0, -120.0])


def model_of(machine: Machine, *effects: Effect) -> ErrorModel:
    return msgspec.structs.replace(no_errors(machine), effects=effects)


def states(machine: Machine, n: int, seed: int = 1) -> State:
    """Random positions inside travel, unlimited axes within a turn each way."""
    travel = np.where(machine.rotary, np.clip(machine.travel, -2 * np.pi, 2 * np.pi), machine.travel)
    return State(np.random.default_rng(seed).uniform(*travel, (n, len(machine.axes))))


# --- linear axes

ANGLE = 80e-6
# where the tool goes, per mm of travel and rad, by hand: letter x direction of the axis
SIDEWAYS = {
    ("C", "Y"): (-1, 0, 0), ("C", "X"): (0, 1, 0), ("B", "Z"): (1, 0, 0),
    ("A", "Z"): (0, -1, 0), ("A", "Y"): (0, 0, 1), ("B", "X"): (0, 0, -1),
    ("A", "X"): (0, 0, 0), ("B", "Y"): (0, 0, 0), ("C", "Z"): (0, 0, 0),
}  # fmt: skip
every_orientation = pytest.mark.parametrize(("letter", "axis"), SIDEWAYS, ids=[f"E_{a}0{b}" for a, b in SIDEWAYS])


def with_location(machine: Machine, component: str, axis: str, value: float) -> ErrorModel:
    """value in mm or rad."""
    return model_of(machine, LocationError(component, axis, value * (1e3 if component in "XYZ" else 1e6)))


def deviation(machine: Machine, model: ErrorModel, q: Array) -> Deviation:
    return exact_deviation(machine, q, model.errors(machine, State(np.atleast_2d(q))), TOOL)


@pytest.mark.parametrize("name", ["gantry", "cframe"])
@every_orientation
def test_squareness_displaces_the_tool_sideways_in_proportion_to_travel(name, letter, axis):
    """On the gantry all axes carry the tool; on the C-frame X and Y carry the workpiece."""
    machine = machines.load(name)
    q = np.tile(machine.travel.mean(axis=0), (3, 1))
    q[:, machine.index(axis)] = travel = np.array([0.0, 100.0, 300.0])
    found = deviation(machine, with_location(machine, letter, axis, ANGLE), q)
    assert found.position == pytest.approx(ANGLE * np.outer(travel, SIDEWAYS[letter, axis]), abs=1e-12)
    assert not found.orientation.any()


@pytest.mark.parametrize("name", machines.names())
@every_orientation
def test_squareness_equals_a_machine_whose_axis_line_is_tilted(name, letter, axis):
    machine, i = machines.load(name), machines.load(name).index(axis)
    tilt = Rotation.from_rotvec(ANGLE * np.eye(3)["ABC".index(letter)])
    tilted = with_axis(machine, i, direction=tilt.apply(machine.axes[i].direction))
    state = states(machine, 50)
    errors = with_location(machine, letter, axis, ANGLE).errors(machine, state)
    gap = tool_point(machine, state.positions, TOOL, errors) - tool_point(tilted, state.positions, TOOL)
    assert np.abs(gap).max() < ANGLE**2 * np.abs(machine.travel[:, i]).max()


@pytest.mark.parametrize("letter", "ABC")
@pytest.mark.parametrize("chain", ["w Y b X Z t", "w b X Y Z t"])
def test_orientation_of_a_slanting_linear_axis_is_counted_in_its_error_frame(chain, letter):
    axes = "".join(f"axes.{name} = {{ travel = [0, 500] }}\n" for name in "XZ")
    slanting = "axes.Y = { travel = [0, 500], direction = [0.3, 1, -0.6] }"
    machine = machines.parse(f'name = "slanting"\nchain = "{chain}"\n{axes}{slanting}', "slanting")
    i = machine.index("Y")
    tilt = Rotation.from_rotvec(ANGLE * machine.axes[i].error_frame[:, "ABC".index(letter)])
    tilted = with_axis(machine, i, direction=tilt.apply(machine.axes[i].direction))
    state = states(machine, 20)
    errors = with_location(machine, letter, "Y", ANGLE).errors(machine, state)
    gap = tool_point(machine, state.positions, TOOL, errors) - tool_point(tilted, state.positions, TOOL)
    assert np.abs(gap).max() < ANGLE**2 * 500


@pytest.mark.parametrize(("name", "arm"), [("gantry", TOOL[0]), ("cframe", 300 + TOOL[0])])
def test_an_angular_error_motion_turns_about_the_carriage_point_which_travels(name, arm):
    """At X = 300 the gantry's carriage is above the tool as ever; the C-frame's table has gone to x = -300."""
    machine = machines.load(name)
    q = np.zeros(3)
    q[machine.index("X")] = 300.0
    yaw = ErrorMotion("C", "X", Polynomial((0.0, 600.0), 0), (ANGLE * 1e6,))
    found = deviation(machine, model_of(machine, yaw), q)
    assert found.position == pytest.approx(ANGLE * np.array([[-TOOL[1], arm, 0]]), abs=ANGLE**2 * 400)
    assert found.orientation == pytest.approx(np.array([[0, 0, ANGLE]]), abs=1e-15)


# --- rotary axes

# machine frame directions of the error motions x, y, z where they are not those of the machine: B of the DMU 50 slants
SLANTING = {("dmu50", "B"): np.array([[1, 0, 0], [0, 0.5**0.5, -(0.5**0.5)], [0, 0.5**0.5, 0.5**0.5]])}
FIVE_AXES = [
    (name, axis) for name in ("dmu50", "trunnion_bc", "trunnion_ac", "head_head", "head_table")
    for axis in machines.load(name).names if axis in "ABC"
]  # fmt: skip


def with_axis(machine: Machine, i: int, **changes: Array) -> Machine:
    """The machine with another direction or point of its axis i."""
    axis = machine.axes[i]
    geometry = {"direction": axis.direction, "point": axis.point} | changes
    other = make_axis(axis.name, axis.side, axis.travel, **geometry, home=axis.home)
    return replace(machine, axes=(*machine.axes[:i], other, *machine.axes[i + 1 :]))


def displaced(machine: Machine, i: int, by: Pose) -> Machine:
    """The machine with axis i, and all that it carries, displaced."""
    carried = range(i, len(machine.axes)) if machine.axes[i].side == "tool" else range(i + 1)
    for j in carried:
        axis = machine.axes[j]
        machine = with_axis(
            machine, j, direction=turn(by.rotation, axis.unit_direction)[0], point=by.apply(axis.point)[0]
        )
    return machine


@pytest.mark.parametrize("component", COMPONENTS)
@pytest.mark.parametrize(("name", "axis"), FIVE_AXES)
def test_rotary_location_errors_equal_a_machine_whose_axis_is_displaced(name, axis, component):
    """Displaced by +value what carries the tool, by -value what carries the workpiece (see the top of this file).

    The workpiece is set up on the table where the table really is, and the tool in the head likewise, so the two
    machines differ by that displacement at the workpiece's, or the tool's, end of the chain.
    """
    machine, i = machines.load(name), machines.load(name).index(axis)
    on_tool_side = machine.axes[i].side == "tool"
    value = 0.01 if component in "XYZ" else 1e-4
    step = (value if on_tool_side else -value) * SLANTING.get((name, axis), np.eye(3))["XYZABC".index(component) % 3]
    if component in "XYZ":
        by = Pose(np.eye(3)[None], step[None])
    else:
        tilt, point = Rotation.from_rotvec(step).as_matrix(), np.array(machine.axes[i].point)
        by = Pose(tilt[None], (point - tilt @ point)[None])

    state = states(machine, 50)
    actual = forward(machine, state.positions, with_location(machine, component, axis, value).errors(machine, state))
    real = forward(displaced(machine, i, by), state.positions)
    for a, b in zip(actual if on_tool_side else by @ actual, real @ by if on_tool_side else real, strict=True):
        assert np.abs(a - b).max() < 1e-11
    nominal = forward(machine, state.positions)
    assert max(np.abs(actual[k] - nominal[k]).max() for k in (0, 1)) > 0.5 * value


def test_a_head_whose_C_line_stands_at_plus_x_has_a_positive_E_X0C():
    """C line, swivel and spindle nose 10 um to +x: so is the tool, whatever C."""
    machine = machines.load("head_head")
    q = np.zeros((3, 5))
    q[:, machine.index("C")] = np.radians([0, 90, 200])
    found = deviation(machine, with_location(machine, "X", "C", 0.01), q)
    assert found.position == pytest.approx(np.tile([0.01, 0, 0], (3, 1)), abs=1e-12)


def test_a_table_whose_C_line_stands_at_plus_x_has_a_negative_E_X0C():
    """Table centre 10 um to +x: the tool, sent there, is 10 um to -x of it in the machine, which the table sees turn.

    The machine frame, seen from the table, turns by +C (`tool relative to workpiece`), so at C = 90 deg what lies at
    -x in the machine lies at -y on the table.
    """
    machine = machines.load("trunnion_bc")
    q = np.zeros((3, 5))
    q[:, machine.index("C")] = np.radians([0, 90, 180])
    found = deviation(machine, with_location(machine, "X", "C", -0.01), q)
    assert found.position == pytest.approx(np.array([[-0.01, 0, 0], [0, -0.01, 0], [0.01, 0, 0]]), abs=1e-12)


def test_a_table_whose_C_line_leans_towards_y_has_a_positive_E_A0C():
    """E_A0C = +g: the line leans by -g about x, towards +y; the spindle along z leans away, towards -y, by +g."""
    machine = machines.load("trunnion_bc")
    found = deviation(machine, with_location(machine, "A", "C", 1e-4), np.zeros((1, 5)))
    assert found.orientation == pytest.approx(np.array([[1e-4, 0, 0]]), abs=1e-15)
    leaning = displaced(machine, 0, Pose(Rotation.from_rotvec([-1e-4, 0, 0]).as_matrix()[None], np.zeros((1, 3))))
    assert leaning.axes[0].unit_direction == pytest.approx([0, 1e-4, 1], abs=1e-8)


@pytest.mark.parametrize(("name", "axis"), FIVE_AXES)
def test_rotary_location_errors_are_constants_of_its_error_motions(name, axis):
    machine, i = machines.load(name), machines.load(name).index(axis)
    state = states(machine, 5)
    for k, component in enumerate(COMPONENTS):
        expected = np.zeros((5, 6, 6))
        expected[:, i, k] = 1e-3 if k < 3 else 1e-6
        assert (model_of(machine, LocationError(component, axis, 1.0)).errors(machine, state) == expected).all()
