"""How residuals depend on each variable alone: against definitions, level under noise, blocks."""

from collections import Counter

import numpy as np
import pytest
from calibration.diagnosis.residual.distance_correlation import ROWS, dependences, distance_correlation
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats
from support.dependent_residuals import logged, remembering


def test_distance_correlation_by_its_definition():
    """Szekely and Rizzo 2013, (2.1) to (2.8): U-centred distances, element by element."""
    rng = np.random.default_rng(0)
    x, y = rng.normal(size=9), rng.normal(size=(9, 2))

    def centred(points):
        n = len(points)
        between = [[float(np.linalg.norm(np.subtract(p, q))) for q in points] for p in points]
        rows, whole = [sum(row) for row in between], sum(map(sum, between))
        return [
            [
                between[i][j] - rows[i] / (n - 2) - rows[j] / (n - 2) + whole / ((n - 1) * (n - 2)) if i != j else 0.0
                for j in range(n)
            ]
            for i in range(n)
        ]

    def inner(a, b):
        return sum(p * q for one, other in zip(a, b, strict=True) for p, q in zip(one, other, strict=True))

    a, b = centred([[value] for value in x]), centred(y)
    assert distance_correlation(x, y) == pytest.approx(inner(a, b) / np.sqrt(inner(a, a) * inner(b, b)))


@pytest.mark.parametrize(
    ("of", "expected"), [(lambda x: x, -0.16103867711037848), (np.cos, -0.05101406326714144)], ids=["x", "cos x"]
)
def test_distance_correlation_as_dcor_has_it(of, expected):
    """dcor 0.7, `u_distance_correlation_sqr`."""
    x = np.arange(12.0)
    y = np.stack([x * 7.0 % 12.0, x * x % 11.0], axis=1)
    assert distance_correlation(of(x), y) == pytest.approx(expected, rel=1e-9)


@given(st.integers(0, 99), st.floats(1e-3, 1e3), st.floats(-10.0, 10.0), st.floats(0.0, 6.0))
def test_distance_correlation_knows_no_units(seed, scale, shift, angle):
    rng = np.random.default_rng(seed)
    x, y = rng.normal(size=15), rng.normal(size=(15, 2))
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    found = distance_correlation(scale * x + shift, y @ turn)
    assert found == pytest.approx(distance_correlation(x, y), abs=1e-8)
    assert found == pytest.approx(distance_correlation(y, x), abs=1e-8)
    assert distance_correlation(x, -scale * x) == pytest.approx(1.0)


def test_distance_correlation_of_what_does_not_vary_and_of_many_rows():
    rng = np.random.default_rng(1)
    x = np.linspace(-1.0, 1.0, 5 * ROWS)
    assert distance_correlation(np.ones(20), rng.normal(size=20)) == 0.0
    assert abs(distance_correlation(x, rng.normal(size=(len(x), 3)))) < 0.02
    assert distance_correlation(x, x**2) > 0.2  # uncorrelated


@pytest.mark.statistical
def test_each_variable_alone_has_uniform_p_values_under_noise():
    p_values = []
    for seed in range(120):
        rng = np.random.default_rng(seed)
        p_values += [one.p_value for one in dependences(rng.normal(size=(50, 3)), {"X": rng.uniform(size=50)}, rng)]
    assert stats.kstest(p_values, "uniform").pvalue > 1e-3


def test_a_variable_that_matters_comes_first():
    significant: Counter[str] = Counter()
    for seed in range(10):
        rng = np.random.default_rng(seed)
        variables = logged(rng, 150)
        white = rng.normal(size=(150, 3)) + np.outer((variables["Y"] - 0.5) ** 2 * 10.0, [1.0, 0.0, 0.0])
        found = dependences(white, variables, rng)
        assert found[0].variable == "Y"
        significant.update(one.variable for one in found if one.adjusted < 0.05)
    assert significant["Y"] >= 9
    assert significant.total() <= 13
    assert dependences(white, {}, rng) == []


@pytest.mark.statistical
def test_blocks_keep_the_level_where_noise_has_a_memory():
    """X goes slowly back and forth: rows permuted one by one find a dependence that is not there."""
    in_blocks, singly = [], []
    for seed in range(30):
        rng = np.random.default_rng(seed)
        white = remembering(rng, 160, memory=0.7)
        variables = {"X": np.abs(np.arange(160) % 64 - 32.0)}
        in_blocks += [one.p_value for one in dependences(white, variables, rng)]
        singly += [one.p_value for one in dependences(white, variables, rng, np.arange(160))]
    assert np.mean(np.array(in_blocks) <= 0.05) <= 0.15
    assert np.mean(np.array(singly) <= 0.05) >= 0.4


def test_adjusted_p_values_as_scipy_has_them():
    rng = np.random.default_rng(2)
    variables = logged(rng, 60)
    found = dependences(rng.normal(size=(60, 2)) + variables["X"][:, None], variables, rng)
    expected = stats.false_discovery_control([one.p_value for one in found])
    np.testing.assert_allclose([one.adjusted for one in found], expected)
