"""Error motions in tables are those of the model."""

import dataclasses

import msgspec
import numpy as np
import pytest
from hypothesis import strategies as st
from support.effect_examples import BACKWARD, DMU50, EXAMPLES
from support.programs import random_model
from support.tiers import drawn

import machines
from kinematics.basis import BSpline, Fourier, Harmonics, Legendre
from kinematics.effects import Backlash, CrossAxis, Cyclic, ErrorMotion, QuantisedCompensation, Reversal
from kinematics.error_model.model import ErrorModel, no_errors
from kinematics.machine import Machine
from kinematics.pieces import ErrorMotions
from kinematics.state import State
from kinematics.transforms import Array
from kinematics.user_error import UserError

MACHINES = [machines.load(name) for name in machines.names()]


def constant(positions: Array, approach: Array | None = None) -> State:
    """A warm machine."""
    n = len(positions)
    temperatures = {"spindle": np.full(n, 7.0), "column": np.full(n, -3.0)}
    return State(positions, approach, time=np.full(n, 5000.0), temperatures=temperatures)


def positions(machine: Machine, n: int, seed: int) -> tuple[Array, Array]:
    """Random positions inside the travel, unlimited axes within 1000 mm or degrees, and directions."""
    rng, axes = np.random.default_rng(seed), len(machine.axes)
    low, high = np.clip(machine.travel / machine.scale, -700.0, 700.0) * machine.scale
    return rng.uniform(low, high, (n, axes)), rng.choice([-1.0, 0.0, 1.0], (n, axes))


def assert_agrees(model: ErrorModel, machine: Machine, seed: int = 1, n: int = 2000) -> ErrorMotions:
    motions, (q, approach) = ErrorMotions(machine, model, constant), positions(machine, n, seed)
    expected = model.errors(machine, constant(q, approach))
    assert np.abs(motions.at(q, approach) - expected).max() < 1e-12
    return motions


def model_of(machine, *effects):
    return msgspec.structs.replace(no_errors(machine), effects=effects)


STEADY = {"approach", "time", "temperatures"}
AT_CONSTANT = [e for e in EXAMPLES if e.effect.ACTS_ON != "instrument" and STEADY.issuperset(e.effect.needs)]


@pytest.mark.parametrize("example", AT_CONSTANT, ids=lambda example: example.name)
def test_every_effect_at_constant_conditions(example):
    motions = assert_agrees(model_of(example.machine, example.effect), example.machine)
    fine = example.name == "cyclic E_CY"  # its waves are shorter than a table is made for
    assert motions.complete == (example.effect.position_bases is not None and not fine)


def test_effects_that_no_table_holds_say_so():
    free = [e.effect.position_bases is None for e in AT_CONSTANT]
    several = [len(e.effect.axes) > 1 and not e.name.startswith("racking") for e in AT_CONSTANT]
    assert all(none for none, more in zip(free, several, strict=True) if more)


@pytest.mark.parametrize("machine", MACHINES, ids=lambda machine: machine.name)
def test_whole_models(machine):
    for seed in range(3):
        assert assert_agrees(random_model(machine, seed), machine, seed).complete


@drawn(few=3, many=60, seed=st.integers(0, 2**32 - 1), machine=st.sampled_from([*MACHINES, BACKWARD]))
def test_models_with_play_and_effects_of_several_axes(seed, machine):
    rng = np.random.default_rng(seed)
    linear = [axis for axis in machine.axes if not axis.rotary][:2]
    more = [Backlash(axis.name, float(rng.normal(0, 9)), 30.0) for axis in machine.axes]
    more += [
        Reversal("X", axis.name, BSpline((0.0, 20.0, 70.0), 3), tuple(rng.normal(0, 5, 5))) for axis in machine.axes
    ]
    if len(linear) == 2:
        first, second = linear
        more.append(
            CrossAxis("Z", first.name, second.name, (-50.0, 90.0), (0.0, 80.0), 2, 2, tuple(rng.normal(0, 9, 6)))
        )
    model = random_model(machine, seed)
    motions = assert_agrees(model_of(machine, *model.effects, *more), machine, seed, 300)
    assert motions.complete == (len(linear) < 2)


ENDLESS = dataclasses.replace(
    DMU50,
    axes=tuple(
        dataclasses.replace(axis, travel=(-np.inf, np.inf)) if axis.name == "C" else axis for axis in DMU50.axes
    ),
)
TURNING = [
    Harmonics((20.0, 340.0), 4),
    Legendre((-30.0, 310.0), 5),
    Legendre((0.0, 360.0), 5),
    Fourier((0.0, 720.0), (1.0, 2.0)),
    BSpline((0.0, 60.0, 200.0, 360.0), 1),
    BSpline((-90.0, 60.0, 190.0), 3),
]


@pytest.mark.parametrize("basis", TURNING, ids=lambda basis: f"{type(basis).__name__} {basis.interval}")
def test_axes_that_turn_round(basis):
    values = tuple(np.random.default_rng(2).normal(0.0, 20.0, basis.size))
    for machine in (DMU50, ENDLESS):
        assert assert_agrees(
            model_of(machine, ErrorMotion("Y", "C", basis, values, u=(0.1,) * basis.size)), machine
        ).complete


def test_an_axis_far_beyond_its_turn_is_looked_up_whole_turns_back():
    """In one step with rows inside the turn, to EXACT; a wave that does not close with the turn is evaluated there."""
    closing = Cyclic("C", "C", 20.0, (9.0,), (4.0,))
    q = np.zeros((400, 5))
    q[:, 4], q[:, 0] = 100.0, np.linspace(-4000.0, 4000.0, 400) * np.pi / 180.0
    for wave, repeats in ((closing, True), (Cyclic("C", "C", 21.0, (9.0,), (4.0,)), False)):
        model = model_of(DMU50, *random_model(DMU50, 4).effects, wave, Backlash("C", 8.0))
        motions = ErrorMotions(DMU50, model, constant)
        approach = np.where(np.arange(400)[:, None] % 3, 1.0, -0.4) * np.ones(5)
        expected = model.errors(DMU50, constant(q, approach))
        np.testing.assert_allclose(motions.at(q, approach), expected, rtol=0.0, atol=2e-12)
        away = motions.turns_away(0, q[:, 0], q[:, 0])
        assert (away != 0.0).any() == repeats
        np.testing.assert_allclose(away, np.rint(away / (2.0 * np.pi)) * 2.0 * np.pi, atol=1e-12)


def test_positions_beyond_the_tables_are_evaluated_by_the_model():
    model, q = random_model(DMU50, 3), np.tile([0.0, 0.0, 9000.0, 0.0, 0.0], (3, 1))
    np.testing.assert_array_equal(ErrorMotions(DMU50, model, constant).at(q), model.errors(DMU50, constant(q)))


@pytest.mark.parametrize("name", ["dmu50", "trunnion_ac", "gantry"])
def test_positions_beyond_the_travel_have_the_errors_of_the_model(name):
    """Also in one step with positions inside; alone to the last bit, up to the length of the travel beyond it."""
    machine = machines.load(name)
    x = machine.index("X")
    low, high = machine.travel[:, x]
    wave = Cyclic("X", "X", (high - low) / 30.0, (3.0,), (1.0,))
    model = model_of(machine, *random_model(machine, 6).effects, wave, Backlash("Y", 8.0))
    q, approach = positions(machine, 300, 8)
    q[:, x] = np.linspace(low - 1.5 * (high - low), high + 1.5 * (high - low), 300)
    together = ErrorMotions(machine, model, constant).at(q, approach)
    assert np.abs(together - model.errors(machine, constant(q, approach))).max() < 1e-12
    alone = ErrorMotions(machine, model, constant)
    for row in range(60, 240, 23):
        np.testing.assert_array_equal(
            alone.at(q[row : row + 1], approach[row : row + 1]), together[row : row + 1], str(row)
        )


def test_play_needs_directions():
    motions = ErrorMotions(DMU50, model_of(DMU50, Backlash("X", 5.0)), constant)
    with pytest.raises(UserError, match="needs approach"):
        motions.at(np.zeros((2, 5)))


def test_a_row_does_not_depend_on_the_rows_beside_it():
    model = random_model(DMU50, 5)
    q, _ = positions(DMU50, 400, 6)
    q[200:] = q[200] + 1e-6 * np.arange(200)[:, None]
    together = ErrorMotions(DMU50, model, constant).at(q)
    for size in (1, 7, 150):
        motions = ErrorMotions(DMU50, model, constant)
        for first in range(0, len(q), size):
            np.testing.assert_array_equal(motions.at(q[first : first + size]), together[first : first + size])


@pytest.mark.parametrize("pitch", [3.0, 7.0, 23.0])
def test_slope_of_short_waves(pitch):
    """The slope of a wave, however its length goes into the travel."""
    cyclic = Cyclic("X", "X", pitch, (3.0,), (0.0,))
    found = ErrorMotions(DMU50, model_of(DMU50, cyclic), constant).slope
    assert found == pytest.approx(2.0 * np.pi * 3e-3 / pitch, rel=0.05)


def test_slope_of_errors_that_jump():
    assert ErrorMotions(DMU50, model_of(DMU50, QuantisedCompensation("X", 2.0, 50.0, 0.0)), constant).slope == np.inf
