"""State: rows of all columns, and what is not known."""

from dataclasses import fields

import numpy as np
import pytest
from support.effect_examples import DMU50, full_state

from kinematics.basis import Polynomial
from kinematics.state import State
from kinematics.user_error import UserError


@pytest.mark.parametrize("rows", [slice(2, 5), slice(0, 0), np.array([4, 1])], ids=["slice", "none", "index"])
def test_rows_of_every_column(rows):
    state = full_state(DMU50, 6)
    some = state.rows(rows)
    assert len(some) == len(state.positions[rows])
    for field in fields(State):
        column, part = getattr(state, field.name), getattr(some, field.name)
        if isinstance(column, dict):
            assert all((part[sensor] == column[sensor][rows]).all() for sensor in column)
        elif field.name == "past":
            assert part is column
        else:
            assert (part == column[rows]).all()


def test_rows_of_what_is_not_known():
    some = State(np.zeros((4, 5)), time=np.arange(4.0)).rows(slice(1, 3))
    assert some.time.tolist() == [1.0, 2.0]
    assert some.approach is None
    assert some.temperatures == {}


def test_columns_of_a_basis_are_those_of_the_axis_and_the_basis():
    state = full_state(DMU50, 6)
    for axis, basis in (("X", Polynomial((-250.0, 250.0), 2)), ("B", Polynomial((0.0, 180.0), 2))):
        for chosen in (basis, Polynomial(basis.interval, 1)):
            for _ in range(2):
                found = state.basis_columns(DMU50, axis, chosen)
                assert (found == chosen.columns(state.position(DMU50, axis))).all()
    assert state.rows(slice(3, 4)).basis_columns(DMU50, "X", Polynomial((-250.0, 250.0), 2)).shape == (1, 3)


def test_what_is_not_known_is_said():
    state = State(np.zeros((1, 5)))
    with pytest.raises(UserError, match=r"^backlash X needs approach, which these data do not give$"):
        state.need("approach", "backlash X")
    with pytest.raises(UserError, match=r"^growth needs last move, which"):
        state.need("last_move", "growth")
    with pytest.raises(UserError, match=r"^growth needs the temperature 'bed', which these data do not give$"):
        state.temperature("bed", "growth")


def test_all_rows_of_a_state_are_the_state_itself():
    state = full_state(DMU50, 30)
    assert state.rows(slice(None)) is state
    assert state.rows(np.arange(30)) is state
    assert state.rows(np.arange(30)[::-1]) is not state
    np.testing.assert_array_equal(state.rows(np.arange(30)[::-1]).positions, state.positions[::-1])
    assert len(state.rows(np.arange(30) > 20)) == 9
