"""Bounds of second differences of the tool point error: never exceeded, and nearly reached."""

import msgspec
import numpy as np
import pytest
from hypothesis import strategies as st
from support.programs import FIVE_AXES, load, random_model
from support.tiers import drawn

from kinematics.basis import BSpline, Polynomial
from kinematics.columns import ChainColumns, length, minus, plus, rows_of, vector
from kinematics.effects import CrossAxis, ErrorMotion, ThermalDrift
from kinematics.error_model.model import no_errors
from kinematics.inverse import linear_positions
from kinematics.pieces import ErrorMotions
from kinematics.second_differences import SecondDifferences
from kinematics.state import State
from kinematics.transforms import Array

TOOL = (0.0, 0.0, -80.0)
ROUNDING = 1e-12
GANTRY, DMU50 = load("gantry"), load("dmu50")


def states(positions: Array, approach: Array | None = None) -> State:
    return State(positions, approach, time=np.full(len(positions), 3600.0))


def compared(machine, model, start, end, *, tcp=False, turned=False, datum=(0.0, 0.0, 0.0)) -> tuple[Array, Array]:
    """Second differences of the exact model, and their bounds, of paths between axis positions."""
    n, tip = len(start), vector(TOOL)
    motions = ErrorMotions(machine, model, states)
    middle = (start + end) / 2.0
    if tcp:
        ends = (ChainColumns(machine, q).point(tip) for q in (start, end))
        middle = linear_positions(machine, middle, rows_of(plus(*ends), n) / 2.0, TOOL)
    errors = []
    for q in (start, middle, end):
        chain = ChainColumns(machine, q)
        error = minus(chain.point(tip, model.errors(machine, states(q))), plus(chain.point(tip), vector(datum)))
        errors.append(chain.linear_steps(error) if turned else error)
    before, there, after = errors
    found = length(minus(plus(before, after), plus(there, there)))
    shifts, flags = np.broadcast_to(datum, (n, 3)), (np.full(n, tcp), np.full(n, turned))
    bounds = SecondDifferences(motions).bounds(start, end, np.tile(TOOL, (n, 1)), *flags, shifts)
    return found, bounds


def moves(machine, rng, n=200):
    """Moves of all lengths inside the travel."""
    low, high = np.clip(machine.travel / machine.scale, -400.0, 400.0) * machine.scale
    start, size = rng.uniform(low, high, (n, len(machine.axes))), 10.0 ** rng.uniform(-4.0, 0.0, (n, 1))
    size = size * (rng.random((n, len(machine.axes))) < 0.7)
    return start, np.clip(start + size * (rng.uniform(low, high, start.shape) - start), low, high)


@drawn(
    few=12,
    many=300,
    seed=st.integers(0, 2**32 - 1),
    machine=st.sampled_from([load(name) for name in ("gantry", "bzt_pfu", *FIVE_AXES)]),
    way=st.sampled_from(["axes", "turned", "tcp"]),
)
def test_the_second_difference_is_never_above_its_bound(seed, machine, way):
    rng = np.random.default_rng(seed)
    model = random_model(machine, seed, 10.0 ** rng.uniform(0.0, 4.0))
    drift = ThermalDrift(component="A", rate=50.0)
    model = msgspec.structs.replace(model, effects=(*model.effects, drift))
    datum = tuple(rng.normal(0.0, 0.05, 3))
    found, bounds = compared(
        machine, model, *moves(machine, rng), tcp=way == "tcp", turned=way == "turned", datum=datum
    )
    known = np.isfinite(bounds)
    assert (found[known] <= bounds[known] + ROUNDING).all()


@drawn(
    few=12,
    many=300,
    seed=st.integers(0, 2**32 - 1),
    machine=st.sampled_from([load(name) for name in ("gantry", *FIVE_AXES)]),
    n=st.integers(0, 200),
    tcp=st.booleans(),
)
def test_bounds_are_the_same_with_neighbours(seed, machine, n, tcp):
    """Long and short moves, some of them outside the travel."""
    rng = np.random.default_rng(seed)
    start, end = moves(machine, rng, n)
    short = rng.random(n) < 0.9
    end[short] = start[short] + 1e-3 * (end - start)[short]
    start[rng.random(n) < 0.05] *= 100.0
    bounds = SecondDifferences(ErrorMotions(machine, random_model(machine, seed), states)).bounds
    flags = np.full(n, tcp) & (rng.random(n) < 0.1), rng.random(n) < 0.5
    rest = rng.normal(0.0, 100.0, (n, 3)), *flags, rng.normal(0.0, 0.05, (n, 3))
    single = bounds(start, end, *rest)
    for least in (0.0, 1e-6, 1e-4, 1.0):
        assert (bounds(start, end, *rest, least) == np.maximum(single, least)).all()


def model_of(machine, *effects):
    return msgspec.structs.replace(no_errors(machine), effects=effects)


def across(machine, axis, low, high):
    """One move of one axis."""
    ends = np.zeros((2, 1, len(machine.axes)))
    ends[:, 0, machine.index(axis)] = np.array([low, high]) * machine.scale[machine.index(axis)]
    return ends[0], ends[1]


KINK = ErrorMotion("Y", "X", BSpline((0.0, 200.0, 400.0), 1), (0.0, 50.0, 0.0), u=(0.0,) * 3)
BEND = ErrorMotion("X", "X", Polynomial((0.0, 400.0), 2), (0.0, 0.0, 80.0), u=(0.0,) * 3)
TILT = ErrorMotion("A", "X", BSpline((0.0, 200.0, 400.0), 1), (0.0, 50.0, 0.0), u=(0.0,) * 3)
STEADY = ErrorMotion("X", "Y", Polynomial((-200.0, 200.0), 0), (80.0,), u=(0.0,))
NEARLY = {
    "kink": (GANTRY, KINK, ("X", 199.0, 201.0), {}),
    "bend": (GANTRY, BEND, ("X", 20.0, 60.0), {}),
    "kink of a tilt": (GANTRY, TILT, ("X", 195.0, 205.0), {}),
    "error that turns with the table": (DMU50, STEADY, ("C", 0.0, 20.0), {}),
    "touched off, rotary axes turn": (DMU50, STEADY, ("C", 0.0, 20.0), {"turned": True, "datum": (0.0, 0.5, 0.0)}),
}


@pytest.mark.parametrize("case", NEARLY.values(), ids=NEARLY)
def test_half_of_the_bound_would_be_too_little(case):
    machine, effect, move, options = case
    found, bounds = compared(machine, model_of(machine, effect), *across(machine, *move), **options)
    assert bounds / 2.0 < found <= bounds + ROUNDING


def test_paths_without_a_bound():
    start, end = moves(DMU50, np.random.default_rng(1), 5)
    cross = CrossAxis("Z", "X", "Y", (-50.0, 90.0), (0.0, 80.0), 1, 1, (3.0, 4.0))
    assert np.isinf(compared(DMU50, model_of(DMU50, cross), start, end)[1]).all()
    far = end.copy()
    far[2:, DMU50.index("X")] = 1e4
    bounds = compared(DMU50, random_model(DMU50, 1), start, far)[1]
    assert np.isfinite(bounds).tolist() == [True, True, False, False, False]
