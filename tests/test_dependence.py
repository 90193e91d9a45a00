"""Which set of variables residuals depend on: against dense matrices, level under noise, power for what acts jointly."""

from collections import Counter

import numpy as np
import pytest
from calibration.diagnosis.residual.dependence import explaining_variables
from calibration.diagnosis.residual.permuted_blocks import blocks_in_time, permuted
from calibration.diagnosis.residual.smooth import AMPLITUDES, Kernels, log_evidence, smooth_part
from hypothesis import given
from hypothesis import strategies as st
from support.dependent_residuals import joint, logged, remembering
from support.tiers import quick


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
    assert log_evidence(modes, y[:, None, None])[0] == pytest.approx(max(odds), abs=0.05)
    np.testing.assert_allclose(smooth_part(modes, y[:, None])[:, 0], means[int(np.argmax(odds))], atol=0.02)


def test_evidence_does_not_depend_on_the_directions_of_components():
    rng = np.random.default_rng(5)
    x = rng.uniform(0.0, 1.0, 80)
    y = np.outer(np.sin(6.0 * x), [1.0, 2.0, 0.0]) + rng.normal(size=(80, 3))
    y -= y.mean(axis=0)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    modes = Kernels([x], np.arange(0, 80, 3)).modes({0: 0.3})
    both = log_evidence(modes, y[:, None]), log_evidence(modes, (y @ turn)[:, None])
    assert both[0] == pytest.approx(both[1])
    np.testing.assert_allclose(smooth_part(modes, y @ turn), smooth_part(modes, y) @ turn, atol=1e-9)


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
    assert found_sets(2, 150, nothing)[None] == 2


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


@pytest.mark.parametrize("names", [("Y",), pytest.param(("B", "temperature"), marks=pytest.mark.statistical)])
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


@pytest.mark.parametrize("grid", quick([False, True], [], [False]))
def test_level_of_sets(grid):
    assert found_sets(100, 300, nothing, grid)[None] >= 98


@pytest.mark.parametrize("n", quick([300, 1000], [], [300]))
def test_power_of_sets(n):
    assert found_sets(40, n, joint)["X", "Z", "time"] >= 36
