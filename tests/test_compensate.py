"""The correction: the actual tool point, by the exact model, comes to lie where the nominal one should."""

import numpy as np
import pytest
from hypothesis import strategies as st
from support.programs import (
    FIVE_AXES,
    THREE_AXES,
    RandomProgram,
    load,
    model_of,
    random_model,
    random_setup,
    read,
    shifted,
)
from support.tiers import drawn

from kinematics.basis import BSpline, Polynomial
from kinematics.correction import correct_position
from kinematics.effects import ErrorMotion
from kinematics.error_model.model import no_errors
from kinematics.forward import tool_point
from kinematics.state import State
from kinematics.user_error import UserError
from postproc.compensation.correction import correct, pose_errors
from postproc.motion.moves import Kind, Known

ALL = (*FIVE_AXES, *THREE_AXES)
EXACT_UM = 0.01
seeds = st.integers(0, 2**32 - 1)


def correct_positions(machine, model, nominal, tool, movable):
    return correct_position(machine, lambda q: model.errors(machine, State(q)), nominal, tool, movable)


def positions(machine, seed, n=50):
    """Axis positions (n, axes), mm and rad, anywhere in the travels."""
    low, high = np.clip(machine.travel, -2 * np.pi, None).clip(None, 1e4)
    low = np.where(machine.rotary, low, machine.travel[0])
    high = np.where(machine.rotary, np.minimum(high, 2 * np.pi), machine.travel[1])
    return np.random.default_rng(seed).uniform(low, high, (n, len(machine.axes)))


def missed_by_hand(machine, model, q, nominal, tool):
    """Distance, mm, of the actual tool point from the nominal one: the whole matrix product written out again."""
    actual = tool_point(machine, q, tool, model.errors(machine, State(q)))
    return np.linalg.norm(actual - tool_point(machine, nominal, tool), axis=1)


@pytest.mark.parametrize("name", ALL)
@drawn(few=5, many=15, seed=seeds)
def test_nothing_is_missed_at_block_ends(name, seed):
    machine = load(name)
    model, nominal = random_model(machine, seed), positions(machine, seed)
    tool = np.zeros((len(nominal), 3))
    tool[:, 2] = -np.random.default_rng(seed).uniform(0, 250, len(nominal))
    q = correct_positions(machine, model, nominal, tool, np.ones_like(nominal, bool))
    assert missed_by_hand(machine, model, q, nominal, tool).max() <= EXACT_UM * 1e-3
    assert (q[:, machine.rotary] == nominal[:, machine.rotary]).all()
    before = missed_by_hand(machine, model, nominal, nominal, tool)
    assert before.max() > 0.02, "the model is no test"
    assert pose_errors(machine, model, nominal, nominal, tool).point_um == pytest.approx(before * 1e3)


@pytest.mark.parametrize("name", FIVE_AXES)
@pytest.mark.parametrize("tcp", [False, True])
@drawn(few=2, many=6, seed=seeds)
def test_nothing_is_missed_in_programs(name, tcp, seed):
    """The same through a program's frames: work offsets, tool lengths, the turning frame of G43.4."""
    machine = load(name)
    motions = read(RandomProgram(machine, seed, tcp=tcp).text(15), machine, **random_setup(machine))
    assert any(frame.tcp for frame in motions.frames) == tcp
    model, rows = random_model(machine, seed), motions.evaluated
    correction = correct(motions, model)
    q = motions.in_machine(correction.target)
    assert q == pytest.approx(correction.corrected, abs=1e-9)
    assert rows.sum() > 3
    pose_errors = missed_by_hand(machine, model, q[rows], motions.machine_target[rows], motions.tool[rows])
    assert pose_errors.max() <= EXACT_UM * 1e-3
    turned = (correction.target - motions.target)[:, machine.rotary]
    assert turned == pytest.approx(np.zeros_like(turned), abs=1e-9)


@pytest.mark.parametrize("name", ALL)
def test_axes_that_may_not_move_do_not(name):
    machine = load(name)
    model, nominal = random_model(machine, 3), positions(machine, 3)
    movable = np.random.default_rng(1).random(nominal.shape) < 0.5
    q = correct_positions(machine, model, nominal, np.zeros((len(nominal), 3)), movable)
    assert (q[~movable] == nominal[~movable]).all()
    translators = np.zeros_like(movable)
    translators[:, machine.translators] = movable[:, machine.translators]
    assert (q[translators] != nominal[translators]).mean() > 0.99


def test_no_errors_no_correction():
    for name in ALL:
        machine = load(name)
        nominal = positions(machine, 1)
        tool = np.zeros((len(nominal), 3))
        q = correct_positions(machine, no_errors(machine), nominal, tool, np.ones_like(nominal, bool))
        assert q == pytest.approx(nominal, abs=1e-9)


def test_constant_shift():
    machine = load("gantry")
    nominal = positions(machine, 1)
    model = shifted(machine, X=10.0, Y=-20.0, Z=30.0)
    q = correct_positions(machine, model, nominal, np.zeros((len(nominal), 3)), np.ones_like(nominal, bool))
    assert q - nominal == pytest.approx(np.tile([-0.01, 0.02, -0.03], (len(nominal), 1)), abs=1e-9)
    actual = tool_point(machine, q, (0.0, 0.0, 0.0), model.errors(machine, State(q)))
    assert actual == pytest.approx(tool_point(machine, nominal), abs=1e-9)


def test_sign_by_hand():
    """An X scale that is 100 um long at 1000 mm: the axis has to be told 999.9."""
    machine = load("gantry")
    long = ErrorMotion("X", "X", Polynomial((0.0, 1000.0), 1), (0.0, 100.0), u=(1.0, 1.0))
    q = correct_positions(
        machine, model_of(machine, long), np.array([[1000.0, 0, 0]]), np.zeros((1, 3)), np.ones((1, 3), bool)
    )
    assert q[0, 0] == pytest.approx(1000 - 0.1 / 1.0001, abs=1e-9)


def test_too_steep_a_model_is_refused():
    machine = load("gantry")
    jagged = ErrorMotion("X", "X", BSpline((0.0, 0.01, 0.02, 5000.0), 1), (0.0, 2e4, -2e4, 0.0), u=(1.0,) * 4)
    with pytest.raises(UserError, match="the correction does not converge"):
        correct_positions(
            machine, model_of(machine, jagged), np.array([[0.005, 0, 0]]), np.zeros((1, 3)), np.ones((1, 3), bool)
        )


def test_only_what_the_program_has_said_is_corrected():
    machine = load("gantry")
    motions = read("G0 X10 Y10\nG53 Z5\nX20\nZ7\nG55 X5\nG28 Y0\nX6\n", machine)
    correction = correct(motions, shifted(machine, X=10.0, Y=10.0, Z=10.0))
    moved = correction.target != motions.target
    assert (moved == (motions.known == Known.PROGRAM) & (motions.kind != Kind.MACHINE)[:, None]).all()
    assert moved.tolist() == [
        [True, True, False],
        [False, False, False],
        [True, True, False],
        [True, True, True],
        [True, False, False],
        [True, False, False],
    ]


def test_arc_middles():
    """A half circle's middle lies at (10, 10): where the scale error of X by then has grown to half."""
    machine = load("gantry")
    model = model_of(machine, ErrorMotion("X", "X", Polynomial((0.0, 20.0), 1), (0.0, 20.0), u=(1.0, 1.0)))
    motions = read("G0 X0 Y0 Z0\nG2 X20 Y0 I10 J0\n", machine)
    correction = correct(motions, model)
    assert correction.middle_shift[1] == pytest.approx([-0.01 / 1.001, 0, 0], abs=1e-7)
