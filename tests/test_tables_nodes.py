"""Where nodes stand, and what tables hold there."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kinematics.user_error import UserError
from postproc.control_data.tables.limits import Limits
from postproc.control_data.tables.nodes import choose_nodes, fitted, squared_residual

X = np.linspace(0.0, 500.0, 201)
FINE = {"resolution": 1e-7, "finest": 1e-9}


def left(curves, nodes):
    return squared_residual(X, curves, nodes, fitted(X, curves, nodes))


@given(st.lists(st.integers(1, 199), min_size=1, max_size=6, unique=True), st.integers(0, 10_000))
def test_free_nodes_find_the_kinks(kinks, seed):
    """A table of few points on the places where it is known comes back whole."""
    nodes = X[[0, *sorted(kinks), 200]]
    values = np.random.default_rng(seed).normal(0, 0.02, len(nodes))
    curves = np.interp(X, nodes, values)[:, None]
    found = choose_nodes(X, curves, Limits(points=len(nodes), **FINE), 0.0)
    assert len(found) <= len(nodes)
    assert left(curves, found) < 1e-14


@pytest.mark.parametrize("points", [3, 5, 9, 17])
def test_free_nodes_beat_even_ones(points):
    curves = np.stack([np.exp(-X / 40) * 0.05, np.exp(-X / 40) * 0.05 + 0.01], axis=1)
    nodes = choose_nodes(X, curves, Limits(points=points, **FINE), 0.0)
    assert len(nodes) == points
    assert nodes[0] == 0.0
    assert nodes[-1] == 500.0
    assert left(curves, nodes) < 0.2 * left(curves, np.linspace(0, 500, points))


def test_free_nodes_are_the_best_of_all_choices():
    """By trying every one."""
    x, rng = np.linspace(0, 1, 9), np.random.default_rng(2)
    for _ in range(20):
        curve = rng.normal(size=(9, 1))
        found = choose_nodes(x, curve, Limits(points=4, **FINE), 0.0)

        def chord(nodes, curve=curve):
            return float(np.sum((np.interp(x, nodes, np.interp(nodes, x, curve[:, 0])) - curve[:, 0]) ** 2))

        every = [chord(x[[0, i, j, 8]]) for i in range(1, 8) for j in range(i + 1, 8)]
        assert chord(found) == pytest.approx(min(every), rel=1e-9)


@given(st.integers(0, 10_000), st.integers(2, 40))
def test_fitted_values_are_least_squares(seed, points):
    rng = np.random.default_rng(seed)
    curves = rng.normal(size=(201, 2))
    nodes = np.unique(np.concatenate([[0.0, 500.0], rng.choice(X, points)]))
    values = fitted(X, curves, nodes)
    best = squared_residual(X, curves, nodes, values)
    for _ in range(3):
        assert squared_residual(X, curves, nodes, values + rng.normal(size=values.shape) * 1e-3) >= best


def test_few_nodes_where_few_are_enough():
    line = (1e-5 * X)[:, None]
    assert choose_nodes(X, line, Limits(points=200, resolution=1e-4), 0.0).tolist() == [0.0, 500.0]


def test_equidistant_nodes_stand_on_the_reference_and_cover_the_travel():
    curves = np.sin(X / 60)[:, None] * 0.02
    limits = Limits(points=60, equidistant=True, spacing_step=0.01, **FINE)
    nodes = choose_nodes(X, curves, limits, 312.5)
    spacing = nodes[1] - nodes[0]
    assert np.ptp(np.diff(nodes)) < 1e-9
    assert 312.5 in nodes
    assert len(nodes) <= 60
    assert nodes[0] <= 0.0 < nodes[1]
    assert nodes[-2] < 500.0 <= nodes[-1]
    assert spacing / 0.01 == pytest.approx(round(spacing / 0.01), abs=1e-6)


def test_equidistant_nodes_hit_a_table_of_the_same_spacing():
    table = np.arange(0.0, 501.0, 25.0)
    curves = np.interp(X, table, np.random.default_rng(1).normal(0, 0.01, len(table)))[:, None]
    nodes = choose_nodes(X, curves, Limits(points=60, equidistant=True, **FINE), 500.0)
    assert left(curves, nodes) < 1e-14


def test_an_interval_that_does_not_reach_is_refused():
    limits = Limits(points=10, equidistant=True, interval=25.0, **FINE)
    with pytest.raises(UserError, match="10 points 25 apart do not reach from 0 to 500"):
        choose_nodes(X, X[:, None], limits, 0.0)


@pytest.mark.parametrize(
    ("asked", "near"), [(7.0, "6 or 7.2"), (25.0, "24 or 30"), (200.0, "180 or 360"), (360.0, ""), (7.2, "")]
)
@pytest.mark.parametrize("limits", [{"equidistant": True}, {"on_grid": True}])
def test_an_interval_of_an_axis_that_closes_divides_the_turn(asked, near, limits):
    x = np.linspace(0.0, 360.0, 361)
    limits = Limits(points=400, interval=asked, resolution=1e-4, spacing_step=1e-3, **limits)
    curves = 0.01 * np.sin(np.deg2rad(x))[:, None]
    if not near:
        assert choose_nodes(x, curves, limits, 0.0, closing=True)[[0, -1]].tolist() == [0.0, 360.0]
        return
    with pytest.raises(UserError, match=f"interval of {asked:g} does not divide the 360 degrees .*: give {near}$"):
        choose_nodes(x, curves, limits, 0.0, closing=True)
