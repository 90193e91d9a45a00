"""Tests of whiteness: their level under pure noise that a fit has been through, and their power."""

from itertools import product

import numpy as np
import pytest
from calibration.diagnosis.residual.whiteness import Columns, _along, _cells, _centred, combined, whiteness
from scipy import linalg, stats
from support.tiers import quick

ROWS, SIDES = 250, 3


def design_of(columns, degree=6):
    """Orthonormal basis `(n d, p)` of what a fit with polynomials along each axis takes, means included."""
    blocks = []
    for position in columns.positions.values():
        one = np.polynomial.legendre.legvander(position / 500.0 - 1.0, degree)
        blocks.append(np.kron(one, np.eye(SIDES)))
    return linalg.orth(np.concatenate(blocks, axis=1), rcond=1e-9)


def columns_of(rng, n=ROWS, step=None):
    """A measurement of some hours; the axes at random positions, or at multiples of `step`."""
    positions = {axis: rng.uniform(0.0, 1000.0, n) for axis in "XYZ"}
    if step is not None:
        positions = {axis: np.round(position / step) * step for axis, position in positions.items()}
    return Columns(
        time=np.cumsum(rng.uniform(5.0, 20.0, n)),
        positions=positions,
        approach={axis: np.sign(np.diff(position, prepend=0.0)) for axis, position in positions.items()},
        runs=np.arange(n) * 4 // n,
        stations=rng.choice(["s1", "s2"], n),
        temperatures={"spindle": np.cumsum(rng.normal(size=n))},
    )


def noise(rng, taken, kind="normal"):
    raw = rng.normal(size=len(taken)) if kind == "normal" else rng.standard_t(5, len(taken)) / np.sqrt(5 / 3)
    return (raw - taken @ (taken.T @ raw)).reshape(-1, SIDES)


def levels(draws, design, known, kind="normal", step=None, rows=100):
    """p-values `(draws,)` of each test under pure noise."""
    found = {}
    for seed in range(draws):
        rng = np.random.default_rng(seed)
        columns = columns_of(rng, rows, step)
        taken = design(rng, columns)
        white = noise(rng, taken, kind)
        for test in whiteness(white, columns, taken.shape[1], taken if known else None):
            found.setdefault(test.name, []).append(test.p_value)
    assert len(found) == 12
    return {what: np.array(values) for what, values in found.items()}


def random_design(rng, columns):
    return np.linalg.qr(rng.normal(size=(len(columns.time) * SIDES, 60)))[0]


def smooth_design(_rng, columns):
    return design_of(columns)


@pytest.mark.statistical
@pytest.mark.parametrize(("design", "known"), [(random_design, False), (smooth_design, True)])
def test_p_values_are_uniform_under_pure_noise(design, known):
    for what, values in levels(300, design, known).items():
        assert stats.kstest(values, "uniform").pvalue > 1e-3, what


LEVELS = ["random", "smooth"], [None, 50.0], ["normal", "heavy"]


@pytest.mark.parametrize(
    ("design", "step", "kind"), quick(product(*LEVELS), [], [("random", None, "normal"), ("smooth", 50.0, "heavy")])
)
def test_levels_hold_on_grids_and_with_heavy_tails(design, step, kind):
    design, known = (random_design, False) if design == "random" else (smooth_design, True)
    for what, values in levels(1500, design, known, kind, step, ROWS).items():
        if kind == "normal" or what != "size (chi2)":
            assert stats.kstest(values, "uniform").pvalue > 1e-3, what
            assert np.mean(values < 0.01) < 0.02, what


@pytest.mark.parametrize("draws", quick([40, 100], [40]))
def test_an_unknown_design_only_makes_neighbours_look_more_alike_than_they_are(draws):
    for what, values in levels(draws, smooth_design, known=False).items():
        assert np.mean(values < 0.05) <= 0.12, what
        if what in ("along X", "along Y", "along Z"):
            assert np.mean(values < 0.05) <= 0.05, what


SIGNALS = {
    "along time": lambda c, _: np.sin(c.time / c.time[-1] * 12.0),
    "along X": lambda c, _: np.sin(c.positions["X"] / 1000.0 * 30.0),
    "direction of Y": lambda c, _: 0.6 * c.approach["Y"],
    "run": lambda c, rng: 0.8 * rng.permuted([-1.0, 1.0, -1.0, 1.0])[c.runs],
    "station": lambda c, _: 0.6 * np.where(c.stations == "s1", 1.0, -1.0),
    "time": lambda c, _: 2.0 * c.time / c.time[-1],
    "temperature spindle": lambda c, _: 0.7 * stats.zscore(c.temperatures["spindle"]),
    "size (chi2)": lambda _, rng: rng.normal(size=ROWS),
}


@pytest.mark.parametrize("draws", quick([8, 20], [8]))
@pytest.mark.parametrize("what", list(SIGNALS))
def test_what_is_missing_is_seen(what, draws):
    """A signal of less than a standard uncertainty in one of three components."""
    seen = 0
    for seed in range(draws):
        rng = np.random.default_rng(seed)
        columns = columns_of(rng)
        taken = design_of(columns)
        signal = np.outer(SIGNALS[what](columns, rng), [0.0, 1.0, 0.0]).ravel()
        white = noise(rng, taken) + (signal - taken @ (taken.T @ signal)).reshape(-1, SIDES)
        seen += what in [test.name for test in combined(whiteness(white, columns, absorbed=taken), 0.01)]
    assert seen >= 0.9 * draws


def test_neighbours_against_the_definition():
    """Statistic and its moments, from the dense matrices; the tail from draws."""
    rng = np.random.default_rng(1)
    values = np.concatenate([rng.uniform(0.0, 1.0, 25), np.repeat(rng.uniform(0.0, 1.0, 3), [2, 4, 7])])
    n, cell = len(values), _cells(values)
    size = np.bincount(cell)[cell]
    near = np.abs(cell[:, None] - cell) <= 1
    joins = near / np.sqrt(np.outer(size, size)) - np.diag(1.0 / size)
    taken = np.linalg.qr(rng.normal(size=(n * 2, 9)))[0]
    left = np.kron(np.eye(n) - 1.0 / n, np.eye(2)) @ (np.eye(2 * n) - taken @ taken.T)
    draws = rng.normal(size=(20_000, 2 * n)) @ left.T
    ratios = np.einsum("ij,sia,sja->s", joins, *(draws.reshape(-1, n, 2),) * 2, optimize=True)
    ratios /= np.sum(draws**2, axis=1)
    for row in (3, 4, 5):
        test = _along(_centred(draws[row].reshape(n, 2), 0.0, taken), values, "", "")
        assert test.statistic == pytest.approx(ratios[row])
        assert test.p_value == pytest.approx(np.mean(ratios >= ratios[row]), abs=0.015)


@pytest.mark.parametrize("draws", quick([40, 100], [40]))
def test_priors_of_unit_weight(draws):
    """Truth drawn from the prior: W = U s / sqrt(1 + s^2) makes the size a chi2 test of the right level."""
    rng = np.random.default_rng(2)
    columns = columns_of(rng)
    derivatives = design_of(columns) * np.geomspace(0.05, 50.0, design_of(columns).shape[1])
    sides, sizes, _ = np.linalg.svd(derivatives, full_matrices=False)
    absorbed = sides * (sizes / np.sqrt(1.0 + sizes**2))
    p_values = {}
    for _ in range(draws):
        truth = rng.normal(size=derivatives.shape[1])
        observed = derivatives @ truth + rng.normal(size=len(derivatives))
        white = (observed - sides @ (sizes**2 / (1.0 + sizes**2) * (sides.T @ observed))).reshape(-1, SIDES)
        for test in whiteness(white, columns, absorbed=absorbed):
            p_values.setdefault(test.name, []).append(test.p_value)
    for what in ("along time", "along X", "time", "direction of X"):
        assert stats.kstest(p_values[what], "uniform").pvalue > 1e-3, what


def test_what_the_fit_has_absorbed_is_not_blamed():
    """A drift that the fit contains leaves nothing to test."""
    rng = np.random.default_rng(3)
    columns = columns_of(rng)
    taken = linalg.orth(np.kron(np.stack([columns.time / columns.time[-1], np.ones(ROWS)], axis=1), np.eye(SIDES)))
    tests = {test.name: test for test in whiteness(noise(rng, taken), columns, absorbed=taken)}
    assert tests["time"].p_value == 1.0


def test_what_does_not_vary_is_not_tested():
    rng = np.random.default_rng(4)
    still = Columns(time=np.zeros(50), positions={"X": np.ones(50)}, approach={"X": np.ones(50)}, runs=np.zeros(50))
    assert [test.name for test in whiteness(rng.normal(size=(50, 1)), still)] == ["size (chi2)"]
    assert whiteness(rng.normal(size=(9, 3)), still) == []


def test_places_keep_equal_values_together():
    assert _cells(np.array([0.0, 5.0, 5.0, 5.0, 5.0, 1.0, 2.0, 3.0])).tolist() == [0, 1, 1, 1, 1, 0, 0, 1]
    assert _cells(np.array([1.0, 2.0, 1.0 + 1e-9, 2.0, 1.0, 2.0])).tolist() == [0, 1, 0, 1, 0, 1]
    alone = Columns(positions={"X": np.repeat([0.0, 1.0], [2, 48])})
    assert whiteness(np.random.default_rng(0).normal(size=(50, 3)), alone)[0].p_value == 1.0


def test_holm():
    rng = np.random.default_rng(5)
    tests = whiteness(rng.normal(size=(100, 3)), columns_of(rng, 100))
    given = [test._replace(p_value=p) for test, p in zip(tests, [0.011, 0.9, 0.001, 0.02, *[1.0] * 8], strict=True)]
    assert [test.p_value for test in combined(given, 0.05)] == [0.001]
    assert [test.p_value for test in combined(given[:4], 0.05)] == [0.001, 0.011, 0.02]
    assert combined(given, 0.001) == []
