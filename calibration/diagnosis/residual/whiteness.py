"""Tests whether the residuals of a fit are noise alone.

Under pure noise the whitened residuals r, in one vector, are N(0, M) with M = I - W W^T: the fit removed W. Two kinds
of test, both relative to the size of r, so that they hold for any variance factor of the noise:

- r^T A r / r^T r, where A joins rows near each other in time or along an axis (von Neumann, Moran): large where
  neighbours deviate alike. Its p-value is by the first three cumulants of r^T (A - q I) r.
- F, with columns G: r^T G (G^T M G)^-1 G^T r, for means that differ by direction, run or station, and for slopes in
  time and temperatures.

The last test compares the size of r with the instrument specification. M matters: a fit makes neighbours slightly
anticorrelated, and a test that assumes independence would miss much.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from scipy import special

from calibration.fit.linear import column_space, pseudo_inverse
from kinematics.transforms import Array

CELL = 3
"""Approximate number of rows in the smallest cells along time or an axis."""
FEWEST = 10
"""Number of rows below which nothing is tested."""
ABSORBED = 0.05
"""Share of a test's variance below which the fit has absorbed its signal; its p-value is then 1."""
ALONG_TIME = "along time"
"""Name of the test whether neighbours in time deviate alike."""
SIZE = "size (chi2)"
"""Name of the test of the residuals' size against the instrument specification."""
STRAIGHT = 1e-5
"""Skewness below which a distribution counts as normal."""


class Test(NamedTuple):
    """Result of one test of the residuals."""

    name: str
    p_value: float
    """Chance of a statistic at least as large under pure noise."""
    statistic: float
    """Correlation of neighbours, F, or chi2 per degree of freedom."""
    hint: str
    """Candidates to search for, or options of the command."""


@dataclass(frozen=True)
class Columns:
    """Variables that residuals of n rows may depend on, as far as recorded; every array `(n,)`."""

    time: Array | None = None
    positions: Mapping[str, Array] = field(default_factory=dict)
    """Positions by axis."""
    approach: Mapping[str, Array] = field(default_factory=dict)
    """Approach direction by axis: -1, 0 or 1."""
    runs: np.ndarray | None = None
    stations: np.ndarray | None = None
    temperatures: Mapping[str, Array] = field(default_factory=dict)


class _Noise(NamedTuple):
    """Residuals without their mean, and their covariance `scale (I - W W^T)` under pure noise."""

    residual: Array
    """`(n, d)`."""
    absorbed: Array
    """W `(n, d, p)`; the first d columns are the means."""
    scale: float

    @property
    def degrees_of_freedom(self) -> float:
        return self.scale * (self.residual.size - float(np.sum(self.absorbed**2)))


def whiteness(
    white: Array, columns: Columns, effective_parameters: float = 0.0, absorbed: Array | None = None
) -> list[Test]:
    """All tests that the columns allow, of whitened residuals `(n, d)`; none below `FEWEST` rows.

    effective_parameters: degrees of freedom that the fit used. absorbed `(n d, p)`: W, rows as in `white.ravel()`. Of
    a fit without priors, W is any orthonormal basis of its whitened derivatives J; with priors of unit weight,
    U s / sqrt(1 + s^2) of J = U s V^T. Then `effective_parameters` is the sum of its squares. Without W, the fit is
    assumed to absorb the same share in every direction: p-values are then too large for signals that the fit can
    imitate, and somewhat too small for all others.
    """
    if len(white) < FEWEST:
        return []
    taken = effective_parameters if absorbed is None else float(np.sum(absorbed**2))
    noise = _centred(white, effective_parameters, absorbed)
    tests = [*_neighbours(noise, columns), *_regressions(noise, columns)]
    return [*tests, _size(white, taken)]


def combined(tests: Sequence[Test], level: float) -> list[Test]:
    """The significant tests, the clearest first; the chance of any under pure noise is at most `level` (Holm)."""
    ranked = sorted(tests, key=lambda test: test.p_value)
    for i, test in enumerate(ranked):
        if test.p_value > level / (len(ranked) - i):
            return ranked[:i]
    return ranked


def _centred(white: Array, effective_parameters: float, absorbed: Array | None) -> _Noise:
    n, d = white.shape
    means = np.broadcast_to(np.eye(d) / np.sqrt(n), (n, d, d))
    if absorbed is None:
        return _Noise(white - white.mean(axis=0), means, 1.0 - effective_parameters / white.size)
    taken = absorbed.reshape(n, d, -1)
    return _Noise(white - white.mean(axis=0), np.concatenate([means, taken - taken.mean(axis=0)], axis=2), 1.0)


def _neighbours(noise: _Noise, columns: Columns) -> Iterator[Test]:
    if columns.time is not None and np.ptp(columns.time) > 0.0:
        yield _along(noise, columns.time, ALONG_TIME, "drift: a term in time or temperature; noise with a memory")
    for axis, position in columns.positions.items():
        if np.ptp(position) > 0.0:
            yield _along(noise, position, f"along {axis}", f"a finer basis for the error motions of {axis}, or cyclic")


def _regressions(noise: _Noise, columns: Columns) -> Iterator[Test]:
    for axis, side in columns.approach.items():
        if np.ptp(side) > 0.0:
            yield _regression(noise, side[:, None], f"direction of {axis}", f"--effect backlash:axis={axis},width=0")
    if columns.time is not None and np.ptp(columns.time) > 0.0:
        hint = "--effect thermal-drift:component=Z,rate=0 or thermal-scale:axis=...,rate=0"
        yield _regression(noise, columns.time[:, None], "time", hint)
    for name, temperature in columns.temperatures.items():
        if np.ptp(temperature) > 0.0:
            hint = f"--effect thermal-scale-sensor:axis=...,sensor={name},coefficient=0 or thermal-drift-sensor:..."
            yield _regression(noise, temperature[:, None], f"temperature {name}", hint)
    labelled = [
        ("run", columns.runs, "drift between runs: a term in time or temperature; a target or set-up that moved"),
        ("station", columns.stations, "a registration of its own for each station; an effect of the instrument"),
    ]
    for name, labels, hint in labelled:
        if labels is not None and len(np.unique(labels)) > 1:
            names, number = np.unique(labels, return_inverse=True)
            yield _regression(noise, np.eye(len(names))[number][:, 1:], name, hint)


def _cells(values: Array) -> np.ndarray:
    """Cell numbers `(n,)` in the order of the values: equal values share a cell of about `CELL` rows or more.

    Values are equal within a millionth of the range.
    """
    ordered = np.round((values - values.min()) / np.ptp(values) * 1e6)
    _, number, count = np.unique(ordered, return_inverse=True, return_counts=True)
    before = np.cumsum(count) - count
    return np.asarray(np.unique((before // CELL)[number], return_inverse=True)[1])


def _along(noise: _Noise, values: Array, name: str, hint: str) -> Test:
    """Test whether rows in the same cell or in neighbouring cells along `values` deviate alike.

    A_ij is 1 / m for two of the m rows of one cell, 1 / sqrt(m m') for rows of neighbouring cells.
    """
    from scipy import sparse

    cell = _cells(values)
    n, (size, d) = np.bincount(cell), noise.residual.shape
    k = len(n)
    if k < 2:
        return Test(name, 1.0, 0.0, hint)
    spread = sparse.csr_array((1.0 / np.sqrt(n[cell]), (np.arange(size), cell)), shape=(size, k))
    links = sparse.diags_array([[1.0]] * 3, offsets=[0, 1, -1], shape=(k, k))

    def joined(table: Array) -> Array:
        """A times the columns of a table `(n, ...)`."""
        flat = table.reshape(size, -1)
        return np.asarray(spread @ (links @ (spread.T @ flat)) - flat / n[cell][:, None]).reshape(table.shape)

    degree = np.asarray(links.sum(axis=0)) - 1.0  # A = spread links spread^T - D; traces of its powers:
    squared = d * (3.0 * k - 2.0 - np.sum(1.0 / n))
    cubed = d * np.sum(1.0 + 3.0 * degree - 3.0 * (1.0 + degree) / n + 3.0 / n**2 - 1.0 / n**2)
    taken = noise.absorbed.reshape(size * d, -1)
    once = joined(noise.absorbed)
    twice = joined(once).reshape(size * d, -1)
    once = once.reshape(size * d, -1)
    inner, inner_squared = taken.T @ once, once.T @ once
    traces = (
        taken.shape[0] - float(np.sum(taken**2)),
        -float(np.trace(inner)),
        squared - 2.0 * float(np.trace(inner_squared)) + float(np.sum(inner**2)),
        cubed - 3.0 * float(np.sum(once * twice)) + 3.0 * float(np.sum(inner * inner_squared))
        - float(np.trace(inner @ inner @ inner)),
    )  # fmt: skip
    if traces[2] < ABSORBED * squared:
        return Test(name, 1.0, 0.0, hint)
    q = float(np.sum(noise.residual * joined(noise.residual)) / np.sum(noise.residual**2))
    mean = traces[1] - q * traces[0]
    variance = 2.0 * (traces[2] - 2.0 * q * traces[1] + q**2 * traces[0])
    third = 8.0 * (traces[3] - 3.0 * q * traces[2] + 3.0 * q**2 * traces[1] - q**3 * traces[0])
    return Test(name, pearson_beyond(-mean / np.sqrt(variance), third / variance**1.5), q, hint)


def pearson_beyond(z: float, skew: float) -> float:
    """Chance that a Pearson III variable of mean 0, variance 1 and this skew is above z.

    As scipy.stats.pearson3, without its import: a gamma variable, shifted and scaled.
    """
    if abs(skew) < STRAIGHT:
        return float(special.ndtr(-z))
    shape = 4.0 / skew**2
    chance = special.gammaincc if skew > 0.0 else special.gammainc
    return float(chance(shape, max(shape + 2.0 * z / skew, 0.0)))


def _regression(noise: _Noise, columns: Array, name: str, hint: str) -> Test:
    """F test whether means depend on the columns `(n, q)`: all components together, each with its own coefficients."""
    sides = column_space(columns - columns.mean(axis=0), 1e-9).basis
    moments = (sides.T @ noise.residual).ravel()
    taken = np.einsum("nq,ndp->qdp", sides, noise.absorbed).reshape(len(moments), -1)
    inverse = pseudo_inverse(np.eye(len(moments)) - taken @ taken.T, ABSORBED, 1.0)
    explained, used = inverse.explained(moments), inverse.rank
    remaining, degrees_of_freedom = (
        float(np.sum(noise.residual**2)) - explained,
        noise.degrees_of_freedom - noise.scale * used,
    )
    if used == 0 or degrees_of_freedom <= 1.0 or remaining <= 0.0:
        return Test(name, 1.0, 0.0, hint)
    statistic = explained / used / (remaining / (degrees_of_freedom / noise.scale))
    return Test(name, float(special.fdtrc(used, degrees_of_freedom, statistic)), statistic, hint)


def _size(white: Array, effective_parameters: float) -> Test:
    total, degrees_of_freedom = float(np.sum(white**2)), max(white.size - effective_parameters, 1.0)
    hint = "an effect of many small parts, or noise above the instrument's specification (--noise estimate)"
    return Test(SIZE, float(special.chdtrc(degrees_of_freedom, total)), total / degrees_of_freedom, hint)
