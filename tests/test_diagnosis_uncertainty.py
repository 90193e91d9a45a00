"""Uncertainties of a diagnosis' calibration: they hold at poses that were not measured, with a residual left too."""

from dataclasses import replace

import msgspec
import numpy as np
import pytest
from calibration.diagnosis.acceptance import against_learned
from calibration.diagnosis.residual.dependence import Unexplained
from calibration.diagnosis.unseen.unseen_states import moments
from calibration.diagnosis.widening import unseen_errors, widened
from support.diagnosis_cases import CFRAME, data_with, selector
from support.tiers import EXAM, STATISTICAL
from support.virtual_measurements import THREE, measured, positions, truth

from calibration.diagnosis.diagnose import diagnose
from calibration.fit.acceptance import without_clamp
from calibration.fit.prediction import relative
from kinematics.deviation import exact_deviation
from kinematics.effects import Cyclic, Unnamed
from kinematics.error_model.model import no_errors
from kinematics.forward import forward
from kinematics.state import State

TRAVELS = tuple(axis.travel for axis in CFRAME.axes)
TOOL = np.array([[0.0, 0.0, -120.0]])


def standardised(model, *effects, n=300, seed=99):
    """Errors `(n, 3)` of predictions at other positions, relative to their mean, in standard uncertainties."""
    state = State(positions(CFRAME, n, np.random.default_rng(seed)), np.zeros((n, 3)))
    tool = np.repeat(TOOL, n, axis=0)
    truth = msgspec.structs.replace(no_errors(CFRAME), effects=effects)
    found = relative(model, CFRAME, state, tool)
    true = 1e3 * exact_deviation(CFRAME, state.positions, truth.errors(CFRAME, state), tool).position
    return (found.deviation - (true - true.mean(axis=0))) / found.u


@pytest.mark.parametrize(
    ("size", "seeds"),
    [
        pytest.param(0.0, range(3, 4)),
        pytest.param(100.0, range(3, 4), marks=STATISTICAL),
        *(pytest.param(size, range(3, 13), marks=EXAM) for size in (0.0, 100.0)),
    ],
)
def test_predictions_are_as_uncertain_as_they_are_wrong(size, seeds):
    """A frame that warps with all three positions is in no library.

    The errors of one draw are those of a few smooth functions, so their size varies from draw to draw.
    """
    warped = Unnamed("Z", ("X", "Y", "Z"), TRAVELS, ((1, 1, 1),), (size,))
    squares = []
    for seed in seeds:
        found = diagnose(data_with(warped, n=240, seed=seed))
        assert (found.unexplained is not None) == (size > 0)
        assert (found.widened > 1.0) == (size > 0)
        squares.append(np.mean(standardised(found.model, warped) ** 2, axis=0))
    spread = np.sqrt(np.mean(squares, axis=0))
    assert 0.5 < spread[2] < 1.5
    assert spread.max() < 1.5


@pytest.mark.statistical
def test_an_unexplained_part_that_is_added_to_the_model_does_not_widen_it():
    warped = Unnamed("Z", ("X", "Y", "Z"), TRAVELS, ((1, 1, 1),), (100.0,))
    found = diagnose(data_with(warped, n=240), left_over="add")
    assert found.with_unnamed
    assert found.widened == 1.0


@pytest.mark.statistical
def test_widened_predictions_reach_their_errors():
    """Parameters that move the tool in one direction move it in others too."""
    data = data_with(n=120)
    model = diagnose(data).model
    own = widened(model, data, np.zeros(3))
    assert own.factor == 1.0
    design = np.concatenate([moment.design(model) for moment in moments(data)])
    before = np.mean(model.propagated(design) ** 2, axis=0)
    after = np.mean(widened(model, data, 9.0 * before).model.propagated(design) ** 2, axis=0)
    np.testing.assert_allclose(after, 9.0 * before, rtol=0.05)


@pytest.mark.parametrize("moves", [True, False])
def test_uncertainties_hold_errors_of_positions_that_a_smooth_function_leaves(moves):
    """A wave finer than any basis, which each visit repeats."""
    names, terms = (("X", "time"), (TRAVELS[0], (0.0, 3150.0))) if moves else (("X", "Y"), TRAVELS[:2])
    function, wave = Unnamed("Z", names, terms, ((1, 1),), (60.0,)), Cyclic("X", "X", 40.0, (20.0,), (0.0,))
    rng, model = np.random.default_rng(4), msgspec.structs.replace(no_errors(CFRAME), effects=(function, wave))
    visited = rng.permutation(np.repeat(positions(CFRAME, 70, rng), 3, axis=0))
    linearised = selector(measured(CFRAME, visited, THREE, model, rng)).stage([]).linearised
    dependence = Unexplained(names, (0.7, 0.4), 0.005, 1.0, np.zeros((len(visited), 3)))
    errors = unseen_errors(linearised, dependence, None, curves=False)
    assert np.sqrt(errors.squares[0]) == pytest.approx(20.0 / np.sqrt(2.0), rel=0.3)


@pytest.mark.parametrize("walks", [True, False])
def test_a_model_that_has_learned_a_wandering_is_none(walks):
    """A serpentine there, once: a tool that wanders looks like errors along the axes."""
    rng, grid = (
        np.random.default_rng(5),
        [np.linspace(*travel, n) for travel, n in zip(TRAVELS, (7, 6, 5), strict=True)],
    )
    q = np.array([(a, b, c) for k, c in enumerate(grid[2]) for b in grid[1][:: (-1) ** k] for a in grid[0]])
    machine = msgspec.structs.replace(no_errors(CFRAME), effects=truth(CFRAME, rng, 10.0).effects)
    data = measured(CFRAME, q, THREE, machine, rng)
    observed = data.observed + np.cumsum(rng.normal(scale=0.015, size=(len(q), 3)), axis=0) * walks
    stage = selector(replace(data, observed=observed, state=replace(data.state, observed=observed)), 6).stage([])
    wandering = Unexplained(("time",), (0.08,), 0.005, 1.0, np.zeros((len(q), 3)))
    found = unseen_errors(stage.linearised, wandering, None, curves=False)
    state = State(positions(CFRAME, 300, rng), np.zeros((300, 3)))
    tool = np.repeat(TOOL, 300, axis=0)
    less = without_clamp(forward(CFRAME, state.positions).apply(tool))
    beside = stage.fit.model if found.beside is None else found.beside[0].model
    own, with_function, true = (
        less @ (1e3 * exact_deviation(CFRAME, state.positions, model.errors(CFRAME, state), tool).position).reshape(-1)
        for model in (stage.fit.model, beside, machine)
    )
    error_um, beside_um, nominal_um = (
        3**0.5 * float(np.sqrt(np.mean(each**2))) for each in (own - true, with_function - true, true)
    )
    assert (error_um > nominal_um) == walks
    # beside the wandering it has learned far less of it, and says how uncertain it is
    assert bool(against_learned(found)) == walks == (beside_um > nominal_um)
    assert not walks or beside_um < 0.5 * error_um
    assert not walks or 0.5 < found.uncertain_um / beside_um < 2.0
