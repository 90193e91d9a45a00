"""Bases: a table of examples that all contract tests run over, and each kind against an independent oracle."""

import json
import re

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.polynomial import Polynomial as NumpyPolynomial
from numpy.polynomial import legendre
from scipy.interpolate import BSpline as ScipySpline
from support.basis_examples import BASES

from kinematics.basis import Basis, BSpline, Fourier, Harmonics, Legendre, Polynomial

every_basis = pytest.mark.parametrize("basis", BASES.values(), ids=BASES)


@st.composite
def splines(draw: st.DrawFn) -> BSpline:
    gaps = draw(st.lists(st.floats(1e-3, 1e3), min_size=1, max_size=8))
    nodes = draw(st.floats(-1e3, 1e3)) + np.cumsum([0.0, *gaps])
    return BSpline(tuple(nodes.tolist()), draw(st.sampled_from([1, 3])))


def inside(basis: Basis, n: int = 101) -> np.ndarray:
    return np.linspace(*basis.interval, n)


def test_every_kind_has_an_example():
    assert {type(basis) for basis in BASES.values()} == set(Basis.__args__)


@every_basis
def test_one_column_per_parameter(basis):
    x = inside(basis)
    columns = basis.columns(x)
    assert columns.shape == (101, basis.size)
    assert np.linalg.matrix_rank(basis.columns(inside(basis, 2001))) == basis.size
    assert basis.columns(x[:0]).shape == (0, basis.size)
    assert (basis.columns(x[::-1]) == columns[::-1]).all()


@every_basis
def test_held_at_the_end_values_outside(basis):
    low, high = basis.interval
    if isinstance(basis, Harmonics):  # repeats with the turn instead
        np.testing.assert_allclose(basis.columns(inside(basis) + 720.0), basis.columns(inside(basis)), atol=1e-12)
        return
    ends = basis.columns(np.array([low, high]))
    assert (basis.columns(np.array([low - 1e-9, low - 7.0, -1e9])) == ends[0]).all()
    assert (basis.columns(np.array([high + 1e-9, high + 7.0, 1e9])) == ends[1]).all()


@every_basis
def test_continuous(basis):
    x = np.unique([*inside(basis), *getattr(basis, "nodes", ())])
    step = 1e-9 * (x[-1] - x[0])
    assert np.abs(basis.columns(x + step) - basis.columns(x - step)).max() < 2e-6


@every_basis
def test_json_round_trip(basis):
    assert msgspec.json.decode(msgspec.json.encode(basis), type=Basis) == basis


def test_polynomial_and_legendre_equal_numpy():
    p, x = np.arange(1.0, 6.0), np.linspace(-250, 250, 33)
    polynomial = NumpyPolynomial(p, domain=(-250, 250), window=(0, 1))
    assert Polynomial((-250.0, 250.0), 4).columns(x) @ p == pytest.approx(polynomial(x), abs=1e-12)
    series = legendre.Legendre(p, domain=(-250, 250))
    assert Legendre((-250.0, 250.0), 4).columns(x) @ p == pytest.approx(series(x), abs=1e-12)


def test_fourier_is_table_1_of_the_virtual_calibration_paper():
    u = np.linspace(0, 1, 33)
    expected = [u**0, u, np.sin(3 * np.pi * u), np.cos(3 * np.pi * u), np.sin(0.5 * np.pi * u), np.cos(0.5 * np.pi * u)]
    assert Fourier((100.0, 300.0), (3.0, 0.5)).columns(100 + 200 * u) == pytest.approx(np.transpose(expected))


@given(splines(), st.lists(st.floats(0, 1), max_size=20))
def test_spline_equals_scipy(spline, shares):
    low, high = spline.interval
    x = np.clip([low + share * (high - low) for share in shares] + list(spline.nodes), low, high)
    p = spline.degree
    knots = np.concatenate([[low] * p, spline.nodes, [high] * p])
    expected = ScipySpline.design_matrix(x, knots, p).toarray()
    assert np.abs(spline.columns(x) - expected).max() < 1e-12


@given(splines(), st.lists(st.floats(-3e3, 1e4), min_size=1, max_size=20))
def test_spline_is_a_partition_of_unity(spline, x):
    columns = spline.columns(np.array(x))
    assert columns.min() >= 0
    assert columns.sum(axis=1) == pytest.approx(1.0, abs=1e-14)
    assert np.count_nonzero(columns, axis=1).max() <= spline.degree + 1


@given(splines(), st.data())
def test_spline_of_degree_1_is_an_interpolated_table(spline, data):
    table = BSpline(spline.nodes, 1)
    values = np.random.default_rng(1).normal(0, 50, table.size)
    x = np.array(data.draw(st.lists(st.floats(-3e3, 1e4), min_size=1, max_size=20)))
    assert np.abs(table.columns(x) @ values - np.interp(x, table.nodes, values)).max() < 1e-11
    assert np.abs(table.columns(np.array(table.nodes)) - np.eye(table.size)).max() < 1e-15


def test_cubic_spline_takes_its_ends_from_the_end_parameters_and_contains_every_cubic():
    basis = BASES["cubic spline"]
    assert np.abs(basis.columns(np.array(basis.interval)) - np.eye(basis.size)[[0, -1]]).max() < 1e-15
    x = inside(basis)
    cubic = np.polynomial.polynomial.polyval(x / 250, [1.0, -2.0, 3.0, -4.0])
    columns = basis.columns(x)
    assert columns @ np.linalg.lstsq(columns, cubic, rcond=None)[0] == pytest.approx(cubic, abs=1e-12)


REVERSED = "interval [5.0, 5.0] must go from a lower to a higher position"
NODES_MESSAGE = "nodes must be at least two, finite and ascending"


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Polynomial((5.0, 5.0), 1), REVERSED),
        (lambda: Legendre((5.0, 5.0), 1), REVERSED),
        (lambda: Fourier((5.0, 5.0), ()), REVERSED),
        (
            lambda: Legendre((0.0, float("inf")), 1),
            "interval [0.0, inf] must go from a lower to a higher position",
        ),
        (
            lambda: Legendre((float("nan"), 0.0), 1),
            "interval [nan, 0.0] must go from a lower to a higher position",
        ),
        (lambda: BSpline((1.0,), 1), NODES_MESSAGE),
        (lambda: BSpline((1.0, 1.0), 1), NODES_MESSAGE),
        (lambda: BSpline((1.0, 2.0, 1.5), 3), NODES_MESSAGE),
        (lambda: BSpline((1.0, float("nan")), 1), NODES_MESSAGE),
        (lambda: BSpline((1.0, float("inf")), 1), NODES_MESSAGE),
    ],
)
def test_refused_arguments(make, message):
    with pytest.raises(ValueError, match=f"^{re.escape(message)}$"):
        make()


@pytest.mark.parametrize(
    ("entries", "message"),
    [
        ({"kind": "wavelet"}, "Invalid value 'wavelet' - at `$.kind`"),
        ({"degree": 51}, "Expected `int` <= 50 - at `$.degree`"),
        ({"degree": -1}, "Expected `int` >= 0 - at `$.degree`"),
        ({"degree": 2.5}, "Expected `int`, got `float` - at `$.degree`"),
        ({"interval": [0, 1, 2]}, "Expected `array` of length 2"),
        ({"interval": [1, 0]}, "interval [1.0, 0.0] must go from a lower to a higher position"),
        ({"weight": 1}, "Object contains unknown field `weight`"),
        ({"kind": "b-spline", "nodes": [0, 1], "degree": 2, "interval": None}, "Invalid enum value 2 - at `$.degree`"),
    ],
)
def test_refused_json(entries, message):
    data = {"kind": "legendre", "interval": [0, 1], "degree": 3} | entries
    data = {key: value for key, value in data.items() if value is not None}
    with pytest.raises(msgspec.ValidationError, match=f"^{re.escape(message)}"):
        msgspec.json.decode(json.dumps(data).encode(), type=Basis)
