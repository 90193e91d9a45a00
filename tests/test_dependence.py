"""Which variables residuals depend on: against definitions, level under noise, power for what acts only jointly."""

from collections import Counter

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from calibration.diagnosis.dependence import (
    ROWS,
    blocks_in_time,
    dependences,
    distance_correlation,
    explaining_variables,
    permuted,
)
from calibration.diagnosis.smooth import AMPLITUDES, Kernels, log_evidence, smooth_part


def remembering(rng, n, d=3, memory=0.6):
    """Noise of variance 1 in which a row resembles the one before."""
    noise = rng.normal(size=(n, d))
    for i in range(1, n):
        noise[i] = memory * noise[i - 1] + np.sqrt(1.0 - memory**2) * noise[i]
    return noise


def logged(rng, n, grid=False):
    """What is known of n rows of a five-axis machine; temperature swings several times."""
    time = np.cumsum(rng.uniform(5.0, 20.0, n))
    axes = {axis: rng.uniform(0.0, 1.0, n) for axis in "XYZBC"}
    if grid:
        axes = {axis: np.round(position * 10.0) / 10.0 for axis, position in axes.items()}
    swing = np.sin(rng.uniform(12.0, 25.0) * time / time[-1] + rng.uniform(0.0, 6.0))
    temperature = swing + 0.05 * np.cumsum(rng.normal(size=n))
    return axes | {"time": time, "temperature": temperature, "way of X": np.sign(np.diff(axes["X"], prepend=-1.0))}


def joint(variables):
    """2 bump(X) bump(Z) sin(2 pi t / T), in three components."""
    bumps = [np.exp(-0.5 * ((variables[axis] - 0.5) / 0.2) ** 2) for axis in "XZ"]
    wave = np.sin(2.0 * np.pi * variables["time"] / variables["time"][-1])
    return 2.0 * np.outer(bumps[0] * bumps[1] * wave, [1.0, 1.0, -1.0])


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


@given(st.lists(st.integers(1, 9), min_size=2, max_size=12), st.integers(0, 99))
def test_permuted_blocks_stay_in_order(sizes, seed):
    labels = np.repeat(np.arange(len(sizes)), sizes)
    n = len(labels)
    for order in permuted(labels, 5, np.random.default_rng(seed)):
        assert sorted(order.tolist()) == list(range(n))
        assert np.sum((np.diff(order) - 1) % n == 0) >= n - len(sizes)


def test_blocks_are_as_long_as_residuals_remember():
    rng = np.random.default_rng(3)
    assert len(np.unique(blocks_in_time(rng.normal(size=(400, 3))))) == 400
    assert 12 <= len(np.unique(blocks_in_time(remembering(rng, 400)))) <= 30
    assert len(np.unique(blocks_in_time(np.arange(240.0)[:, None]))) == 12


def test_evidence_and_smooth_part_against_dense_matrices():
    """With every row a centre: the marginal likelihoods of a Gaussian process, its noise the most likely one."""
    rng = np.random.default_rng(4)
    n = 60
    x, z = rng.uniform(0.0, 1.0, (2, n))
    x[:2], z[:2] = [0.0, 1.0], [0.0, 1.0]
    y = np.sin(6.0 * x) * z + 0.3 * rng.normal(size=n)
    y -= y.mean()
    modes = Kernels([x, z], np.arange(n)).modes({0: 0.3, 1: 0.7})
    squares = ((x[:, None] - x) / 0.3) ** 2 + ((z[:, None] - z) / 0.7) ** 2
    centring = np.eye(n) - 1.0 / n
    kernel = centring @ np.exp(-0.5 * squares) @ centring
    odds, means = [], []
    for amplitude in AMPLITUDES:
        covariance = np.eye(n) + amplitude * kernel
        weights = np.linalg.solve(covariance, y)
        odds.append(-0.5 * n * np.log(y @ weights / (y @ y)) - 0.5 * np.linalg.slogdet(covariance)[1])
        means.append(amplitude * kernel @ weights)
    assert log_evidence(*modes, y[:, None, None])[0] == pytest.approx(max(odds), abs=0.05)
    np.testing.assert_allclose(smooth_part(*modes, y[:, None])[:, 0], means[int(np.argmax(odds))], atol=0.02)


def test_evidence_does_not_depend_on_the_directions_of_components():
    rng = np.random.default_rng(5)
    x = rng.uniform(0.0, 1.0, 80)
    y = np.outer(np.sin(6.0 * x), [1.0, 2.0, 0.0]) + rng.normal(size=(80, 3))
    y -= y.mean(axis=0)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    modes = Kernels([x], np.arange(0, 80, 3)).modes({0: 0.3})
    both = log_evidence(*modes, y[:, None]), log_evidence(*modes, (y @ turn)[:, None])
    assert both[0] == pytest.approx(both[1])
    np.testing.assert_allclose(smooth_part(*modes, y @ turn), smooth_part(*modes, y) @ turn, atol=1e-9)


def found_sets(draws, n, signal, grid=False):
    """How often which set is found."""
    sets: Counter[tuple[str, ...] | None] = Counter()
    for seed in range(draws):
        rng = np.random.default_rng(seed)
        variables = logged(rng, n, grid)
        found = explaining_variables(rng.normal(size=(n, 3)) + signal(variables), variables, rng)
        sets[found and found.variables] += 1
    return sets


def nothing(variables):
    return np.zeros((len(variables["time"]), 3))


def test_pure_noise_depends_on_nothing():
    assert found_sets(3, 150, nothing)[None] >= 2


def test_what_acts_only_jointly_is_found():
    rng = np.random.default_rng(6)
    variables = logged(rng, 300)
    signal = joint(variables)
    found = explaining_variables(rng.normal(size=(300, 3)) + signal, variables | {"still": np.ones(300)}, rng)
    assert found is not None
    assert found.variables == ("X", "Z", "time")
    assert found.p_value < 0.01
    assert found.rms == pytest.approx(np.sqrt(np.mean(signal**2)), rel=0.2)
    assert np.sqrt(np.mean((found.shape - signal) ** 2)) < 0.25


@pytest.mark.parametrize("names", [("Y",), ("B", "temperature")])
def test_fewer_variables_are_found_alone(names):
    rng = np.random.default_rng(7)
    variables = logged(rng, 300)
    signal = np.prod([np.sin(5.0 * variables[name]) for name in names], axis=0)
    found = explaining_variables(rng.normal(size=(300, 3)) + np.outer(signal, [1.0, 0.0, 1.0]), variables, rng)
    assert found is not None
    assert found.variables == names


def test_nothing_to_look_at():
    rng = np.random.default_rng(8)
    assert explaining_variables(rng.normal(size=(100, 3)), {}, rng) is None
    assert explaining_variables(rng.normal(size=(100, 3)), {"X": np.ones(100)}, rng) is None
    assert explaining_variables(np.zeros((100, 3)), {"X": np.arange(100.0)}, rng) is None


@pytest.mark.slow
@pytest.mark.parametrize("grid", [False, True])
def test_level_of_sets(grid):
    assert found_sets(100, 300, nothing, grid)[None] >= 98


@pytest.mark.slow
@pytest.mark.parametrize("n", [300, 1000])
def test_power_of_sets(n):
    assert found_sets(40, n, joint)["X", "Z", "time"] >= 36
