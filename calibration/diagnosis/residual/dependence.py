"""Sets of variables of which a smooth function explains residuals, also where they act only jointly.

p-values are by permutation of the residuals in blocks. Rows are in the order of acquisition.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np

from calibration.cores import each
from calibration.diagnosis.residual.permuted_blocks import blocks_in_time, permuted
from calibration.diagnosis.residual.smooth import Kernels, log_evidence, smooth_part
from kinematics.transforms import Array

PERMUTATIONS = 199
LEVEL = 0.01
"""Chance that any set of variables is found in pure noise."""
EVIDENCE = 5.0
"""Log odds that each variable of a set must add."""
LENGTHS = (0.08, 0.13, 0.2, 0.3, 0.45, 0.7, 1.1)
"""Lengths of a smooth function, as fractions of a variable's range."""
FIRST_LENGTHS = (0.2, 0.45)
"""Lengths with which all singles, pairs and triples are tried."""
BESIDE_SHORT = 0.3
"""Length with which the others are tried beside a variable in which a function may be short."""
MOST = 4
"""Most variables of a set."""
TUNED = 4
"""Number of changes of a set, the likeliest ones, for which lengths are searched."""
READINGS = ("azimuth", "elevation", "distance")
"""Variables of an error of a tracker's readings."""
CENTRES = 80
"""Most centres of a smooth function: the rows that represent it."""


class Function(NamedTuple):
    """A smooth function of some variables, of unknown size."""

    variables: tuple[str, ...]
    lengths: tuple[float, ...]
    """Correlation length in each variable, as a fraction of its range."""


class Unexplained(NamedTuple):
    """A smooth function that explains residuals."""

    variables: tuple[str, ...]
    lengths: tuple[float, ...]
    """Correlation length in each variable, as a fraction of its range."""
    p_value: float
    """Chance that any set of up to three variables explains permuted residuals as well."""
    rms: float
    """RMS of the function, per scalar, in units of the residuals."""
    shape: Array
    """The function at the rows `(n, d)`."""
    periods: tuple[float, ...] = ()
    """Periods, mm or degrees, of waves of the first variable that explain it equally; empty where none was found."""

    @property
    def of_readings(self) -> bool:
        """True for a function of the tracker's readings: an error of the instrument."""
        return set(self.variables) <= set(READINGS)

    @property
    def listed(self) -> str:
        """The variables, as text."""
        return ", ".join(self.variables) + " of the tracker's readings" * self.of_readings


def explaining_variables(
    white: Array, variables: Mapping[str, Array], rng: np.random.Generator, *, short: str = ""
) -> Unexplained | None:
    """The smallest set of variables `(n,)` of which a smooth function explains residuals `(n, d)`; None for noise.

    All singles, pairs and triples are tried, and must explain more than they explain of the permuted residuals. Then
    variables are added, exchanged and dropped by their evidence, `EVIDENCE` each. Rows are permuted in blocks, by
    `blocks_in_time`. short: a variable in which a function may be so short that longer ones do not show it.
    """
    names = [name for name, values in variables.items() if np.ptp(values) > 0.0]
    residual = white - white.mean(axis=0)
    if not names or len(white) < 4 * MOST or not np.any(residual):
        return None
    kernels = Kernels([variables[name] for name in names], _centres(len(white), rng))
    sets = [each for size in (1, 2, 3) for each in combinations(range(len(names)), size)]
    starts = [dict.fromkeys(each, length) for each in sets for length in FIRST_LENGTHS]
    if short in names:
        number = names.index(short)
        starts += [dict.fromkeys(each, BESIDE_SHORT) | {number: LENGTHS[0]} for each in sets if number in each]
    evidence, p_value = _against_permuted(kernels, starts, residual, blocks_in_time(white), rng)
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
    """The smooth function of given variables `(n,)` with given lengths in residuals `(n, d)`."""
    names = [name for name in variables if name in lengths]
    kernels = Kernels([variables[name] for name in names], _centres(len(white), rng))
    return _shaped(kernels, white - white.mean(axis=0), names, {i: lengths[n] for i, n in enumerate(names)}, p_value)


def log_odds(white: Array, variables: Mapping[str, Array], lengths: Mapping[str, float]) -> float:
    """Log odds of a smooth function of given variables `(n,)` in residuals `(n, d)` against noise."""
    kernels = Kernels([variables[name] for name in lengths], _centres(len(white), np.random.default_rng(0)))
    return _evidence(kernels, dict(enumerate(lengths.values())), white - white.mean(axis=0))


def _centres(n: int, rng: np.random.Generator) -> np.ndarray:
    return np.sort(rng.choice(n, min(CENTRES, n), replace=False))


def _shaped(
    kernels: Kernels, residual: Array, names: Sequence[str], lengths: dict[int, float], p_value: float
) -> Unexplained:
    shape = smooth_part(kernels.modes(lengths), residual)
    rms = float(np.sqrt(np.mean(shape**2)))
    return Unexplained(tuple(names), tuple(lengths.values()), p_value, rms, shape)


def _against_permuted(
    kernels: Kernels, starts: Sequence[dict[int, float]], residual: Array, labels: np.ndarray, rng: np.random.Generator
) -> tuple[Array, float]:
    """Evidence of each start, and the chance that the best start of permuted residuals has as much."""
    orders = permuted(labels, PERMUTATIONS, rng)
    tables = np.stack([residual, *(residual[order] for order in orders)], axis=1)
    evidence = np.array(each(lambda start: log_evidence(kernels.modes(start), tables), starts))
    best = evidence.max(axis=0)
    return evidence[:, 0], float(np.mean(best >= best[0]))


def _best_of_each_size(starts: Sequence[dict[int, float]], evidence: Array) -> list[int]:
    sizes = np.array([len(start) for start in starts])
    return [int(np.argmax(np.where(sizes == size, evidence, -np.inf))) for size in np.unique(sizes)]


def _best_set(kernels: Kernels, starts: Sequence[dict[int, float]], residual: Array, count: int) -> dict[int, float]:
    """Variables and their lengths: the best start, changed until no change adds enough evidence."""

    known: dict[frozenset[tuple[int, float]], float] = {}

    def value(lengths: dict[int, float]) -> float:
        key = frozenset(lengths.items())
        if key not in known:
            known[key] = _evidence(kernels, lengths, residual)
        return known[key]

    def rate(lengths: dict[int, float]) -> tuple[float, dict[int, float]]:
        return _tuned(value, lengths)

    def worth(lengths: dict[int, float]) -> float:
        return value(lengths) - EVIDENCE * len(lengths)

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


def _tuned(value: Callable[[dict[int, float]], float], lengths: dict[int, float]) -> tuple[float, dict[int, float]]:
    """Largest evidence of a function of these variables, lengths searched one after the other; and these lengths."""
    best, found = dict(lengths), value(lengths)
    for _ in range(2):
        before = found
        for variable in lengths:
            for length in LENGTHS:
                tried = best | {variable: length}
                if tried != best and (more := value(tried)) > found:
                    best, found = tried, more
        if found - before < 0.1:
            break
    return found, best


def _evidence(kernels: Kernels, lengths: dict[int, float], residual: Array) -> float:
    """Log odds of a function of these variables against noise; 0 without variables."""
    return float(log_evidence(kernels.modes(lengths), residual[:, None])[0]) if lengths else 0.0
