"""An unnamed effect: a smooth function of axes, time and temperatures, known over what was measured and not beyond."""

from dataclasses import replace

import msgspec
import numpy as np
import pytest
from numpy.polynomial.legendre import legval
from support.effect_examples import DMU50, deviation_of, full_state

from kinematics.effects import Unnamed
from kinematics.error_model.model import no_errors
from kinematics.user_error import UserError
from postproc.compensation.conditions import make_conditions

RANGES = ((-200.0, 200.0), (0.0, 9000.0), (1.0, 5.0))
EFFECT = Unnamed("Y", ("X", "time", "temperature column"), RANGES, ((1, 0, 0), (2, 1, 3)), (4.0, -3.0))


def model_of(effect):
    return msgspec.structs.replace(no_errors(DMU50), effects=(effect,))


def test_it_is_a_sum_of_products_that_hold_their_end_values():
    state = full_state(DMU50, 60)
    state = replace(state, positions=state.positions * [0.0, 0.0, 1.0, 1.0, 1.0])  # the tool stands along Z
    columns = state.position(DMU50, "X"), state.time, state.temperatures["column"]
    x, t, k = (np.clip(2 * (c - a) / (b - a) - 1, -1, 1) for c, (a, b) in zip(columns, RANGES, strict=True))
    wanted = 4.0 * x - 3.0 * legval(x, [0, 0, 1]) * t * legval(k, [0, 0, 0, 1])
    moved = deviation_of(EFFECT, DMU50, state).position * 1e3
    np.testing.assert_allclose(moved, np.stack([0 * wanted, wanted, 0 * wanted], axis=1), atol=1e-9)


def test_the_model_tells_of_what_lies_outside():
    state = full_state(DMU50, 60)
    outside = model_of(EFFECT).outside(DMU50, state)
    columns = state.position(DMU50, "X"), state.time, state.temperatures["column"]
    told = ("", "mm"), (" in time", "s"), (" in temperature column", "K")
    wanted = {
        (f"{EFFECT.name}{end}", unit): max(float(low - c.min()), float(c.max() - high))
        for (end, unit), c, (low, high) in zip(told, columns, RANGES, strict=True)
    }
    assert outside == pytest.approx(wanted)
    assert model_of(EFFECT).outside(DMU50, state.rows(slice(0, 0))) == {}


def test_a_program_needs_its_time_and_temperatures():
    with pytest.raises(UserError, match="needs the temperature 'column'"):
        make_conditions().notes(model_of(EFFECT))
    with pytest.raises(UserError, match="needs the time since its zero: give --elapsed"):
        make_conditions(["column=22"]).notes(model_of(EFFECT))
    assert make_conditions(["column=22"], 60.0).notes(model_of(EFFECT)) == []
