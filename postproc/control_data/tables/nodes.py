"""Positions and values of the nodes of a table, for the least residual of a curve in least squares.

Free nodes are the best choice among the positions at which the curve is known, by dynamic programming over all of them
(Bellman and Roth, Curve fitting by segmented straight lines, 1969); equidistant ones, the best number of them. Values
are then fitted, not sampled.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from kinematics.transforms import Array
from kinematics.user_error import UserError
from postproc.control_data.tables.limits import Limits
from postproc.control_data.tables.terms import to_steps

ENOUGH_RESOLUTION_SHARE = 0.25
"""Share of the resolution of values: below this RMS no further nodes are added."""


def choose_nodes(x: Array, curves: Array, limits: Limits, home: float, *, closing: bool = False) -> Array:
    """Nodes for one or more curves that share them.

    x `(m,)`: ascending; curves `(m, c)`: values there. home: the reference position, on which an equidistant node lies;
    those of a closing table divide the distance from the first to the last position.
    """
    enough = len(x) * max(ENOUGH_RESOLUTION_SHARE * limits.resolution, limits.finest) ** 2
    if closing and limits.interval:
        _check_divides(float(x[-1] - x[0]), limits.interval, limits)
    if limits.equidistant:
        return _equidistant(x, curves, limits, None if closing else home, enough)
    if limits.on_grid and limits.interval:
        on = _around(home, limits.interval, x[0], x[-1])
        curves = np.stack([np.interp(on, x, curve) for curve in curves.T], axis=1)
        return _free(on, curves, limits.points, enough)
    nodes = _free(x, curves, limits.points, enough)
    return np.unique(to_steps(nodes, limits.spacing_step, 9))


def fitted(x: Array, curves: Array, nodes: Array) -> Array:
    """Values `(k, c)` at the nodes whose interpolation is nearest to curves `(m, c)` at x `(m,)`, in least squares."""
    from scipy.linalg import solveh_banded

    i = np.clip(np.searchsorted(nodes, x, side="right") - 1, 0, len(nodes) - 2)
    t = np.clip((x - nodes[i]) / (nodes[i + 1] - nodes[i]), 0.0, 1.0)
    k = len(nodes)
    banded = np.zeros((2, k))
    banded[1] = np.bincount(i, (1 - t) ** 2, k) + np.bincount(i + 1, t**2, k)
    banded[0, 1:] = np.bincount(i, t * (1 - t), k)[: k - 1]
    sampled = np.stack([np.interp(nodes, x, curve) for curve in curves.T], axis=1)
    ridge = 1e-9  # nodes that no sample lies between take the curve's own value
    banded[1] += ridge
    right = [np.bincount(i, (1 - t) * c, k) + np.bincount(i + 1, t * c, k) for c in curves.T]
    return np.asarray(solveh_banded(banded, np.stack(right, axis=1) + ridge * sampled))


def squared_residual(x: Array, curves: Array, nodes: Array, values: Array) -> float:
    """Sum of squares of the interpolation error."""
    approximations = np.stack([np.interp(x, nodes, column) for column in values.T], axis=1)
    return float(np.sum((curves - approximations) ** 2))


def _free(x: Array, curves: Array, points: int, enough: float) -> Array:
    cost = sum((_chord_costs(x, curve) for curve in curves.T), np.zeros((len(x), len(x))))
    best, came = cost[0].copy(), []  # of paths from the first position to each, with one segment, two, ...
    totals = [best[-1]]
    for _ in range(min(points, len(x)) - 2):
        if totals[-1] <= enough:
            break
        through = best[:, None] + cost
        before = np.argmin(through, axis=0)
        best = through[before, np.arange(len(x))]
        came.append(before)
        totals.append(best[-1])
    worth = max(enough, totals[-1] * (1 + 1e-9))
    segments = next(k for k, total in enumerate(totals) if total <= worth)
    chosen = [len(x) - 1]
    for before in reversed(came[:segments]):
        chosen.append(int(before[chosen[-1]]))
    return np.unique(x[[0, *chosen]])


def _chord_costs(x: Array, f: Array) -> Array:
    """`(m, m)`: sum of squares between curve and chord over positions i ... j; infinite for j <= i."""
    u = (x - x[0]) / (x[-1] - x[0])
    sums = [np.concatenate([[0.0], np.cumsum(v)]) for v in (np.ones_like(u), u, u * u, f, u * f, f * f)]

    def over(k: int) -> Array:
        return np.asarray(sums[k][None, 1:] - sums[k][:-1, None])

    n, s_u, s_uu, s_f, s_uf, s_ff = (over(k) for k in range(6))
    with np.errstate(divide="ignore", invalid="ignore"):
        slope = (f[None, :] - f[:, None]) / (u[None, :] - u[:, None])
        base = f[:, None] - slope * u[:, None]
        cost = s_ff - 2 * base * s_f - 2 * slope * s_uf + base**2 * n + 2 * base * slope * s_u + slope**2 * s_uu
    cost = np.maximum(cost, 0.0)
    cost[np.tril_indices(len(x))] = np.inf
    return np.asarray(cost)


def _check_divides(turn: float, interval: float, limits: Limits) -> None:
    """UserError, with the next intervals that do, unless whole intervals make a turn of an axis that closes."""
    if _is_whole(turn / interval):
        return
    even = [turn / n for n in range(1, limits.points) if _is_whole(turn / n / limits.spacing_step)]
    narrower, wider = [e for e in even if e < interval], [e for e in even if e > interval]
    near = [f"{e:g}" for e in [*narrower[:1], *wider[-1:]]]
    raise UserError(
        f"an interval of {interval:g} does not divide the {turn:g} degrees of an axis that turns fully, after which "
        f"its table begins again: give {' or '.join(near)}"
    )


def _is_whole(ratio: float) -> bool:
    return abs(ratio - round(ratio)) < 1e-9


def _equidistant(x: Array, curves: Array, limits: Limits, home: float | None, enough: float) -> Array:
    """Without home, nodes that divide the whole distance."""
    best: Array | None = None
    least = np.inf
    for spacing in _spacings(x, limits):
        if home is None and not _is_whole((x[-1] - x[0]) / spacing):
            continue
        nodes = _around(x[0] if home is None else home, spacing, x[0], x[-1])
        if len(nodes) > limits.points:
            continue
        values = fitted(x, curves, nodes)
        if np.abs(np.diff(values, axis=0)).max() > limits.steepest - limits.resolution / 2:
            continue
        residual = squared_residual(x, curves, nodes, values)
        if residual < least * (1 - 1e-6) - 1e-30:
            best, least = nodes, residual
        if least <= enough:
            break
    if best is None:
        apart = f" {limits.interval:g} apart" if limits.interval else ""
        steep = "" if np.isinf(limits.steepest) else f" in steps of at most {limits.steepest:g}"
        raise UserError(f"{limits.points} points{apart} do not reach from {x[0]:g} to {x[-1]:g}{steep}")
    return best


def _spacings(x: Array, limits: Limits) -> Sequence[float]:
    """From wide to narrow, in whole steps."""
    if limits.interval is not None:
        return [limits.interval]
    numbers = np.arange(1, limits.points)
    if len(numbers) > 256:
        numbers = np.unique(np.concatenate([numbers[:200], np.geomspace(200, limits.points - 1, 56).astype(int)]))
    spacing = np.ceil((x[-1] - x[0]) / numbers / limits.spacing_step - 1e-9) * limits.spacing_step
    return [float(s) for s in np.unique(np.round(spacing, 9))[::-1]]


def _around(home: float, spacing: float, low: float, high: float) -> Array:
    """Nodes at whole spacings from home that cover low ... high, at least two."""
    first = int(np.floor((low - home) / spacing + 1e-9))
    last = max(int(np.ceil((high - home) / spacing - 1e-9)), first + 1)
    return np.round(home + spacing * np.arange(first, last + 1), 9)
