"""Which variables the residuals that are left depend on.

Two views: each variable alone, by distance correlation, which vanishes only for independent ones (Szekely, Rizzo and
Bakirov 2007; without bias: Szekely and Rizzo 2013); and the set of variables a smooth function of which explains the
residuals, also when they act only jointly.

Chances are those among residuals with their rows permuted. Where rows in succession err alike, whole blocks of them are
permuted, which leaves noise with a memory as it is. Rows are in the order of acquisition.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np

from calibration.cores import each
from calibration.diagnosis.smooth import Kernels, log_evidence, smooth_part
from kinematics.transforms import Array

ROWS = 1000
"""Rows, evenly taken, of a distance correlation."""
PERMUTATIONS = 499
"""Of each variable alone; of sets, `SET_PERMUTATIONS`."""
SET_PERMUTATIONS = 199
LEVEL = 0.01
"""Chance that any set of variables is found to explain pure noise."""
EVIDENCE = 5.0
"""Log odds by which a set must gain from each of its variables."""
LENGTHS = (0.08, 0.13, 0.2, 0.3, 0.45, 0.7, 1.1)
"""Of a smooth function, in parts of a variable's range."""
FIRST_LENGTHS = (0.2, 0.45)
"""With which all singles, pairs and triples are tried."""
MOST = 4
"""Variables of a set."""
TUNED = 4
"""Changes of a set, the likeliest ones, for which lengths are looked for."""
MEMORIES = 4
"""Length of a block, in rows that residuals remember."""
CENTRES = 80
"""Rows that a smooth function stands on."""


class Dependence(NamedTuple):
    """How the residuals depend on one variable."""

    variable: str
    correlation: float
    """Squared distance correlation without bias; about 0 where independent, negative too."""
    p_value: float
    adjusted: float
    """p-value by Benjamini and Hochberg: of all variables below a level q, a share q at most is there by chance."""


class Unexplained(NamedTuple):
    """A smooth function that explains residuals."""

    variables: tuple[str, ...]
    lengths: tuple[float, ...]
    """Of each variable, in parts of its range: how far apart the function still knows of itself."""
    p_value: float
    """Chance that any set of up to three variables explains permuted residuals as well."""
    rms: float
    """Of the function, per scalar, in units of the residuals."""
    shape: Array
    """The function at the rows `(n, d)`."""


def distance_correlation(x: Array, y: Array) -> float:
    """Squared distance correlation without bias of `x` and `y`, each `(n,)` or `(n, k)`; of `ROWS` rows if more.

    0 where one of them does not vary.
    """
    rows = _evenly(len(x), ROWS)
    return float(np.vdot(_distances(x[rows]), _distances(y[rows])))


def dependences(
    white: Array, variables: Mapping[str, Array], rng: np.random.Generator, blocks: np.ndarray | None = None
) -> list[Dependence]:
    """How residuals `(n, d)` depend on each variable `(n,)`, the clearest first.

    blocks: labels `(n,)` of rows to be permuted as one; by `blocks_in_time` when None.
    """
    from scipy import stats

    if not variables:
        return []
    rows = _evenly(len(white), ROWS)
    labels = (blocks_in_time(white) if blocks is None else blocks)[rows]
    ours, theirs = _distances(white[rows]), [_distances(values[rows]) for values in variables.values()]
    flat = np.stack([one.ravel() for one in theirs])
    found = flat @ ours.ravel()
    reached = np.ones(len(found))
    for order in permuted(labels, PERMUTATIONS, rng):
        reached += flat @ ours[order][:, order].ravel() >= found
    p_values = reached / (PERMUTATIONS + 1)
    adjusted = stats.false_discovery_control(p_values)
    rated = map(Dependence, variables, found.tolist(), p_values.tolist(), adjusted.tolist())
    return sorted(rated, key=lambda one: (one.p_value, -one.correlation))


def explaining_variables(
    white: Array, variables: Mapping[str, Array], rng: np.random.Generator, blocks: np.ndarray | None = None
) -> Unexplained | None:
    """The smallest set of variables `(n,)` a smooth function of which explains residuals `(n, d)`; None for noise.

    All singles, pairs and triples are tried, and have to explain more than they explain of the residuals permuted; then
    variables are added, exchanged and dropped by their evidence, `EVIDENCE` each. blocks: as of `dependences`.
    """
    names = [name for name, values in variables.items() if np.ptp(values) > 0.0]
    residual = white - white.mean(axis=0)
    if not names or len(white) < 4 * MOST or not np.any(residual):
        return None
    kernels = Kernels([variables[name] for name in names], _centres(len(white), rng))
    sets = [each for size in (1, 2, 3) for each in combinations(range(len(names)), size)]
    starts = [dict.fromkeys(each, length) for each in sets for length in FIRST_LENGTHS]
    labels = blocks_in_time(white) if blocks is None else blocks
    evidence, p_value = _against_permuted(kernels, starts, residual, labels, rng)
    if p_value > LEVEL:
        return None
    lengths = _best_set(kernels, [starts[i] for i in _best_of_each_size(starts, evidence)], residual, len(names))
    if not lengths:
        return None
    chosen = sorted(lengths)
    return _shaped(kernels, residual, [names[i] for i in chosen], {i: lengths[i] for i in chosen}, p_value)


def of_variables(
    white: Array, variables: Mapping[str, Array], lengths: Mapping[str, float], p_value: float, rng: np.random.Generator
) -> Unexplained:
    """The smooth function of variables `(n,)` that are known to matter, with their lengths, in residuals `(n, d)`."""
    names = [name for name in variables if name in lengths]
    kernels = Kernels([variables[name] for name in names], _centres(len(white), rng))
    return _shaped(kernels, white - white.mean(axis=0), names, {i: lengths[n] for i, n in enumerate(names)}, p_value)


def _centres(n: int, rng: np.random.Generator) -> np.ndarray:
    return np.sort(rng.choice(n, min(CENTRES, n), replace=False))


def _shaped(
    kernels: Kernels, residual: Array, names: Sequence[str], lengths: dict[int, float], p_value: float
) -> Unexplained:
    shape = smooth_part(*kernels.modes(lengths), residual)
    rms = float(np.sqrt(np.mean(shape**2)))
    return Unexplained(tuple(names), tuple(lengths.values()), p_value, rms, shape)


def blocks_in_time(white: Array) -> np.ndarray:
    """Labels `(n,)` of blocks of rows in succession, `MEMORIES` times as long as residuals `(n, d)` remember.

    Single rows where they don't; at least twelve blocks.
    """
    n = len(white)
    residual = white - white.mean(axis=0)
    limit = 2.0 * np.sum(residual**2) / np.sqrt(residual.size)
    longest = max(n // 12, 1)
    lag = 1
    while MEMORIES * lag < longest and np.sum(residual[lag:] * residual[:-lag]) > limit:
        lag += 1
    return np.arange(n) // (1 if lag == 1 else min(MEMORIES * lag, longest))


def permuted(labels: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
    """Orders `(count, n)` of rows in which the blocks change places; each begins at a row of its own, going round."""
    names, number = np.unique(labels, return_inverse=True)
    n = len(labels)
    ranks = rng.permuted(np.broadcast_to(np.arange(len(names)), (count, len(names))), axis=1)[:, number]
    orders = np.argsort(ranks, axis=1, kind="stable")
    return np.asarray((orders + rng.integers(n, size=(count, 1))) % n)


def _evenly(n: int, most: int) -> np.ndarray:
    return np.linspace(0, n - 1, min(n, most)).astype(int)


def _distances(values: Array) -> Array:
    """U-centred distances `(n, n)`, of Euclidean norm 1; zeros where nothing varies."""
    n = len(values)
    table = (values - values.mean(axis=0)).reshape(n, -1)
    if table.shape[1] == 1:
        distances = np.abs(table - table.T)
    else:
        squares = np.sum(table**2, axis=1)
        distances = np.sqrt(np.maximum(squares[:, None] + squares - 2.0 * table @ table.T, 0.0))
    np.fill_diagonal(distances, 0.0)
    rows = distances.sum(axis=1) / (n - 2)
    centred = distances - rows[:, None] - rows + distances.sum() / ((n - 1) * (n - 2))
    np.fill_diagonal(centred, 0.0)
    size = np.linalg.norm(centred)
    return np.asarray(centred / size) if size > 0.0 else centred


def _against_permuted(
    kernels: Kernels, starts: Sequence[dict[int, float]], residual: Array, labels: np.ndarray, rng: np.random.Generator
) -> tuple[Array, float]:
    """Evidence of each start, and the chance that the best start of permuted residuals has as much."""
    orders = permuted(labels, SET_PERMUTATIONS, rng)
    tables = np.stack([residual, *(residual[order] for order in orders)], axis=1)
    evidence = np.array(each(lambda start: log_evidence(*kernels.modes(start), tables), starts))
    best = evidence.max(axis=0)
    return evidence[:, 0], float(np.mean(best >= best[0]))


def _best_of_each_size(starts: Sequence[dict[int, float]], evidence: Array) -> list[int]:
    sizes = np.array([len(start) for start in starts])
    return [int(np.argmax(np.where(sizes == size, evidence, -np.inf))) for size in np.unique(sizes)]


def _best_set(kernels: Kernels, starts: Sequence[dict[int, float]], residual: Array, count: int) -> dict[int, float]:
    """Variables and their lengths, from the best of the starts on, until no change is worth it."""

    def rate(lengths: dict[int, float]) -> tuple[float, dict[int, float]]:
        return _tuned(kernels, lengths, residual)

    def worth(lengths: dict[int, float]) -> float:
        return _evidence(kernels, lengths, residual) - EVIDENCE * len(lengths)

    evidence, best = max(each(rate, starts), key=lambda rated: rated[0])
    while True:
        others = [i for i in range(count) if i not in best]
        changed = [best | {i: 0.45} for i in others] if len(best) < MOST else []
        changed += [{j: best[j] for j in best if j != i} | {other: best[i]} for i in best for other in others]
        likeliest = np.argsort(each(worth, changed))[::-1][:TUNED].tolist()
        rated = each(rate, [changed[i] for i in likeliest])
        better = [(found - EVIDENCE * (len(lengths) - len(best)), lengths) for found, lengths in rated]
        gain, lengths = max(better, key=lambda rated: rated[0], default=(-np.inf, best))
        if gain <= evidence + 1e-6:
            break
        evidence, best = rate(lengths)
    while best:
        fewer = each(rate, [{j: best[j] for j in best if j != i} for i in best])
        found, lengths = max(fewer, key=lambda rated: rated[0])
        if found < evidence - EVIDENCE:
            break
        evidence, best = found, lengths
    return best


def _tuned(kernels: Kernels, lengths: dict[int, float], residual: Array) -> tuple[float, dict[int, float]]:
    """Evidence of a function of these variables with the most likely lengths, found one after the other; and these."""
    best, found = dict(lengths), _evidence(kernels, lengths, residual)
    for _ in range(2):
        before = found
        for variable in lengths:
            for length in LENGTHS:
                tried = best | {variable: length}
                if tried != best and (value := _evidence(kernels, tried, residual)) > found:
                    best, found = tried, value
        if found - before < 0.1:
            break
    return found, best


def _evidence(kernels: Kernels, lengths: dict[int, float], residual: Array) -> float:
    """Log odds of a function of these variables against noise; 0 for one of none."""
    return float(log_evidence(*kernels.modes(lengths), residual[:, None])[0]) if lengths else 0.0
