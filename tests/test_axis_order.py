"""The order of linear axes in the machine's chain, by the lever arms of their angular errors."""

from dataclasses import replace

import numpy as np
import pytest
from support.diagnosis_cases import data_with
from support.virtual_measurements import THREE, measured, positions, truth

import machines
import ncomp
from kinematics.effects import Backlash, CrossAxis


def in_order(machine, names):
    return replace(machine, axes=tuple(machine.axes[machine.index(name)] for name in names))


def of_machine(name, true_order, size, n=80):
    """A measurement of a machine with another order of its axes, under the machine of the file."""
    machine, rng = machines.load(name), np.random.default_rng(4)
    true = in_order(machine, true_order)
    data = measured(true, positions(true, n, rng), THREE, truth(true, rng, size), rng)
    order = [true.index(axis) for axis in machine.names]
    state = data.state
    columns = {key: getattr(state, key)[:, order] for key in ("positions", "approach", "last_move")}
    return replace(data, machine=machine, state=replace(state, **columns))


def chains(measurement):
    """What a diagnosis says of the chain."""
    return [each.message for each in ncomp.diagnose(measurement).findings if each.check == "chain"]


@pytest.mark.parametrize(
    ("name", "true_order", "size", "chain", "other"),
    [
        ("gantry", "YXZ", 100.0, "w b X Y Z t", "w b Y X Z t"),
        pytest.param("cframe", "YXZ", 300.0, "w X Y b Z t", "w Y X b Z t", marks=pytest.mark.statistical),
    ],
)
def test_the_order_that_is_likelier_is_named(name, true_order, size, chain, other):
    (found,) = chains(of_machine(name, true_order, size))
    assert found.startswith(f"the data fit the chain {other} better than {chain} of the machine's file")
    assert found.endswith("the file's order is used, and a cross-axis error may be a consequence of it")


@pytest.mark.parametrize(
    "data",
    [
        pytest.param(lambda: of_machine("gantry", "XYZ", 100.0), id="no cause", marks=pytest.mark.statistical),
        pytest.param(lambda: data_with(Backlash("X", 60.0)), id="backlash", marks=pytest.mark.statistical),
        pytest.param(
            lambda: data_with(CrossAxis("Z", "X", "Y", (0.0, 400.0), (0.0, 400.0), 2, 1, (0.0, 0.0, 90.0))),
            id="cross-axis",
        ),
    ],
)
def test_the_right_order_is_not_doubted(data):
    assert chains(data()) == []
