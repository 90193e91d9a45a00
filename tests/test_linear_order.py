"""The order of linear axes in the machine's chain, by the lever arms of their angular errors."""

from dataclasses import replace

import numpy as np
import pytest
from calibration.diagnosis.linear_order import other_order
from support.diagnosis_cases import data_with
from support.virtual_measurements import THREE, measured, positions, truth

import machines
from calibration.fit.bases.search import Choice
from calibration.observation.full_model import BasisChoice
from kinematics.effects import Backlash, CrossAxis

CHOICE = Choice(dict.fromkeys("XYZ", BasisChoice("legendre", 5)))


def in_order(machine, names):
    return replace(machine, axes=tuple(machine.axes[machine.index(name)] for name in names))


def of_machine(name, true_order, size, n=150):
    """A measurement of a machine with another order of its axes, under the machine of the file."""
    machine, rng = machines.load(name), np.random.default_rng(4)
    true = in_order(machine, true_order)
    data = measured(true, positions(true, n, rng), THREE, truth(true, rng, size), rng)
    order = [true.index(axis) for axis in machine.names]
    state = data.state
    columns = {key: getattr(state, key)[:, order] for key in ("positions", "approach", "last_move")}
    return replace(data, machine=machine, state=replace(state, **columns))


@pytest.mark.parametrize(
    ("name", "true_order", "size", "chain", "other"),
    [
        ("gantry", "YXZ", 100.0, "w b X Y Z t", "w b Y X Z t"),
        pytest.param("cframe", "YXZ", 300.0, "w X Y b Z t", "w Y X b Z t", marks=pytest.mark.statistical),
    ],
)
def test_the_order_that_predicts_better_is_named(name, true_order, size, chain, other):
    found = other_order(of_machine(name, true_order, size), CHOICE)
    assert found.startswith(f"the data fit the chain {other} better than {chain} of the machine's file: held-out ")
    assert found.endswith("the file's order is used, and a cross-axis error may be a consequence of it")


def test_the_right_order_is_not_doubted():
    assert not other_order(of_machine("gantry", "XYZ", 100.0), CHOICE)


@pytest.mark.parametrize(
    "effect",
    [Backlash("X", 60.0), CrossAxis("Z", "X", "Y", (0.0, 400.0), (0.0, 400.0), 2, 1, (0.0, 0.0, 90.0))],
    ids=lambda effect: effect.name,
)
def test_a_cause_does_not_make_the_order_doubtful(effect):
    assert not other_order(data_with(effect), CHOICE)


def test_axes_that_stand_still_have_no_order():
    data = of_machine("gantry", "YXZ", 100.0)
    q = data.state.positions.copy()
    q[:, 1] = 1000.0
    assert not other_order(replace(data, state=replace(data.state, positions=q)), replace(CHOICE))
