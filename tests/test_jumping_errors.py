"""Errors that jump, as tables of a control have them: where the target lies in the jump, the better side is taken."""

import numpy as np
import pytest
from hypothesis import strategies as st
from support.programs import WHOLE, correct, load, model_of, random_model, read
from support.tiers import drawn

from kinematics.correction import correct_position
from kinematics.effects import QuantisedCompensation
from kinematics.forward import tool_point
from kinematics.state import State
from kinematics.user_error import UserError

GANTRY, DMU50 = load("gantry"), load("dmu50")
sizes = st.floats(0.5, 40.0)


def jumping(machine, step, pitch, axes="XYZ"):
    return model_of(machine, *(QuantisedCompensation(axis, step, pitch, 10.0) for axis in axes))


@drawn(few=12, many=40, step=sizes, pitch=st.floats(5.0, 80.0), seed=st.integers(0, 2**32 - 1))
def test_no_position_is_worse_and_most_are_right(step, pitch, seed):
    rng = np.random.default_rng(seed)
    model = jumping(GANTRY, step, pitch)
    edges = 10.0 + pitch * np.arange(1, 6)
    q = rng.choice(edges, (200, 3)) + rng.uniform(-2e-3, 2e-3, (200, 3)) * step
    tool, movable = np.zeros((200, 3)), np.ones((200, 3), bool)

    def errors(at):
        return model.errors(GANTRY, State(at))

    def missed(at):
        return np.linalg.norm(tool_point(GANTRY, at, tool, errors(at)) - tool_point(GANTRY, q, tool), axis=1)

    found = correct_position(GANTRY, errors, q, tool, movable)
    assert (missed(found) <= missed(q) + 1e-9).all()
    assert missed(found).max() <= np.sqrt(3.0) * (0.5e-3 * step + 2e-4)


def test_the_edge_itself():
    """X jumps at 60: before it the machine is 5 um short of where it is behind it; 60.001 cannot be reached."""
    text = "G21 G90\nG0 X50.0 Y0 Z0\nX60.001\nX59.999\nX61\n"
    result = correct(text, GANTRY, jumping(GANTRY, 5.0, 50.0, "X"))
    reached = read(result.text, GANTRY).machine_target[:, 0]
    model = jumping(GANTRY, 5.0, 50.0, "X")
    actual = reached + model.errors(GANTRY, State(read(result.text, GANTRY).machine_target))[:, 0, 0]
    off = np.abs(actual - [50.0, 60.001, 59.999, 61.0])
    assert off[[0, 3]].max() < 1e-4
    assert off.max() < 2.7e-3


@pytest.mark.parametrize("machine", [GANTRY, DMU50])
def test_programs(machine):
    """Steps beside smooth errors, on lines and arcs: corrected, and better between the ends too."""
    x, y, z = (sum(machine.axes[machine.index(axis)].travel) / 2 for axis in "XYZ")
    text = (
        f"G21 G90 G17\nG0 X{x:.3f} Y{y:.3f} Z{z:.3f}\nG1 X{x + 90:.3f} F500\nG2 X{x + 50:.3f} I-20\nG1 Y{y + 60:.3f}\n"
    )
    model = model_of(machine, *random_model(machine, 3).effects, *jumping(machine, 5.0, 50.0).effects)
    result = correct(text, machine, model, **WHOLE)
    assert result.report.after.largest < 3.0 < result.report.before.largest


def test_what_does_not_settle_at_all_is_refused():
    """Errors that grow three times as fast as the position goes."""
    tool, movable, q = np.zeros((1, 3)), np.ones((1, 3), bool), np.full((1, 3), 500.0)

    def errors(at):
        found = np.zeros((len(at), 4, 6))
        found[:, 1, 0] = 1e-3 - 3.0 * (at - q)[:, 0]
        return found

    with pytest.raises(UserError, match="the correction does not converge"):
        correct_position(GANTRY, errors, q, tool, movable)
