"""Gaussian processes of error motions, and their evidence: Rasmussen and Williams, Gaussian Processes for Machine
Learning (2006), sections 2.7 (explicit line), 4.2 (Matern class) and 5.4.1 (evidence).

An error motion is a straight line and a process of some size, correlation length and smoothness. The error motions of
an axis have the same length and smoothness, and those of one class (positioning, straightness, angular) the same size.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.linalg import lapack

from kinematics.transforms import Array, read_only

PROCESS_SIZES_UM = read_only(10.0 * 2.0 ** (np.arange(-14, 13) / 2.0))
"""Standard deviations of a process that are tried, um or urad."""
SHORTEST_CORRELATION = 0.5
"""Least correlation length, in mean distances of positions: the data do not distinguish shorter ones."""
TYPICAL_SIZE = 10.0
"""Size, um or urad, that is expected before the data are seen (Type B), where nothing else is stated."""
TYPICAL_SHARE, TYPICAL_LENGTH = 1.0 / 6.0, 2.0
"""Length that is expected, as a share of the measured range; but at least this number of mean distances (Type B)."""
SIZE_SPREAD, LENGTH_SPREAD = 1.5, 1.0
"""Standard deviations of the logarithms of size and length about these."""
LEAST_PROCESS_PROBABILITY = 1e-3
"""Probability below which a process does not count."""
JITTER = 1e-9
"""Share of a variance that is added to it, against rounding."""


def _never(r: Array) -> Array:
    return np.asarray(np.exp(-r))


def _once(r: Array) -> Array:
    return np.asarray((1.0 + 3**0.5 * r) * np.exp(-(3**0.5) * r))


def _twice(r: Array) -> Array:
    return np.asarray((1.0 + 5**0.5 * r + 5.0 * r**2 / 3.0) * np.exp(-(5**0.5) * r))


def _always(r: Array) -> Array:
    return np.asarray(np.exp(-0.5 * r**2))


Correlation = Callable[[Array], Array]
CORRELATIONS: Mapping[Correlation, float] = {_always: 0.3, _twice: 0.3, _once: 0.3, _never: 0.1}
"""Correlations by distance in correlation lengths, named by how often their processes can be differentiated, with the
probabilities that are expected before the data are seen: carriages average the form of their guideways (Type B)."""


class Process(NamedTuple):
    """A Gaussian process of the error motions of an axis."""

    correlation: Correlation
    length: float
    """Correlation length in mean distances of positions."""
    sizes: Mapping[str, int]
    """Index in `PROCESS_SIZES_UM` by class of error motions."""


@dataclass(frozen=True)
class Processes:
    """The processes of an axis that its data leave possible, with their probabilities."""

    positions: Array
    """Measured positions `(k,)`, ascending, mm or degrees."""
    trends: tuple[float, ...]
    """Standard deviation of constant and slope over the measured range, um or urad, of each error motion."""
    classes: tuple[str, ...]
    """Class of each error motion."""
    typical_size: float = TYPICAL_SIZE
    """Size, um or urad, that is expected before the data are seen."""
    possible: tuple[tuple[float, Process], ...] = ()
    """Probabilities and processes; the expected one before the data are seen."""

    @classmethod
    def about(
        cls,
        positions: Array,
        trends: Sequence[float],
        values: Sequence[tuple[str, Array]],
        typical_size: float = TYPICAL_SIZE,
    ) -> Processes:
        """A first guess from values `(k,)` at the positions, with the class of each error motion."""
        line = np.linalg.qr(np.vander(positions - positions.mean(), 2))[0]
        squares: dict[str, list[float]] = {}
        for which, own in values:
            squares.setdefault(which, []).append(float(np.mean((own - line @ (line.T @ own)) ** 2)))
        sizes = {
            which: int(
                np.argmin(np.abs(np.log(PROCESS_SIZES_UM) - 0.5 * np.log(max(np.mean(own), PROCESS_SIZES_UM[0] ** 2))))
            )
            for which, own in squares.items()
        }
        nothing = cls(positions, tuple(trends), tuple(which for which, _ in values), typical_size)
        return replace(nothing, possible=((1.0, Process(_twice, nothing.typical_length, sizes)),))

    @property
    def typical_length(self) -> float:
        """Correlation length that is expected before the data are seen, in mean distances of positions."""
        return max(TYPICAL_LENGTH, TYPICAL_SHARE * (len(self.positions) - 1))

    def away(self, process: Process) -> float:
        """Negative log probability of a process before the data are seen, up to a constant."""
        sizes = np.log(PROCESS_SIZES_UM[list(process.sizes.values())] / self.typical_size) / SIZE_SPREAD
        length = np.log(process.length / self.typical_length) / LENGTH_SPREAD
        return 0.5 * float(sizes @ sizes + length**2) - float(np.log(CORRELATIONS[process.correlation]))

    def size(self, which: str) -> float:
        """Standard deviation of the error motions of a class about a straight line, um or urad."""
        return float(np.sqrt(sum(p * PROCESS_SIZES_UM[process.sizes[which]] ** 2 for p, process in self.possible)))

    def covariance(self, x: Array, motion: int) -> Array:
        """Covariance of the values at positions `(m,)` of an error motion, given by its number, um2 or urad2."""
        which = self.classes[motion]
        own = sum(
            p * PROCESS_SIZES_UM[process.sizes[which]] ** 2 * self._correlation(process, x)
            for p, process in self.possible
        )
        return self._with_line(x, self.trends[motion], np.asarray(own))

    def between(self, motion: int) -> float:
        """Largest standard deviation half-way between positions if the values at these are known, um or urad."""
        k, middle = len(self.positions), (self.positions[1:] + self.positions[:-1]) / 2.0
        whole = self.covariance(np.concatenate([self.positions, middle]), motion)
        known = np.linalg.solve(whole[:k, :k], whole[:k, k:])
        variances = np.diag(whole[k:, k:]) - np.sum(whole[:k, k:] * known, axis=0)
        return float(np.sqrt(max(variances.max(), 0.0)))

    def given(self, information: Array, right: Array) -> Processes:
        """The possible processes, given the information on the values of all error motions at the positions.

        information `(q, q)` and its product with the values `(q,)`, error motion by error motion.
        """
        sizes, longest = self.possible[0][1].sizes, 2.0 * self.typical_length
        lengths = SHORTEST_CORRELATION * 2.0 ** np.arange(int(np.log2(longest / SHORTEST_CORRELATION)) + 1)
        starts = [Process(correlation, length, sizes) for correlation in CORRELATIONS for length in lengths.tolist()]
        found = _Evidence(self, information, right).climbed(starts)
        most = max(value for value, _ in found)
        odds = [(float(np.exp(value - most)), process) for value, process in found]
        whole = sum(p for p, _ in odds)
        likely = sorted(
            ((p / whole, process) for p, process in odds if p > LEAST_PROCESS_PROBABILITY * whole),
            key=lambda each: -each[0],
        )
        return replace(self, possible=tuple(likely))

    def root(self, process: Process, motion: int) -> Array:
        """Root of the covariance of the values of an error motion at the positions under one process."""
        x, size = self.positions, PROCESS_SIZES_UM[process.sizes[self.classes[motion]]]
        own = size**2 * self._correlation(process, x)
        return np.asarray(np.linalg.cholesky(self._with_line(x, self.trends[motion], own)))

    def _correlation(self, process: Process, x: Array) -> Array:
        distance = (self.positions[-1] - self.positions[0]) / (len(self.positions) - 1)
        return process.correlation(np.abs(x[:, None] - x) / (process.length * distance))

    def _with_line(self, x: Array, trend: float, own: Array) -> Array:
        low, high = self.positions[[0, -1]]
        u = (2.0 * x - low - high) / (high - low)
        whole = trend**2 * (1.0 + np.outer(u, u)) + own
        return np.asarray(whole + JITTER * np.diag(np.diag(whole)))


def log_evidence(information: Array, right: Array) -> float:
    """Log probability of the data, up to a constant.

    information `(q, q)` on the values, in units of a root of their covariance, and its product with them `(q,)`.
    """
    factor = np.linalg.cholesky(np.eye(len(right)) + information)
    explained, _ = lapack.dtrtrs(factor.T, right, lower=False, trans=True)
    return 0.5 * float(explained @ explained) - float(np.log(np.diag(factor)).sum())


@dataclass(frozen=True)
class _Evidence:
    """Log probability of the data and of processes of one axis, up to a constant."""

    processes: Processes
    information: Array
    right: Array

    @cached_property
    def _roots(self) -> dict[tuple[Correlation, float, int, float], Array]:
        return {}

    @cached_property
    def _known_products(self) -> dict[tuple[Correlation, float, int, int], tuple[Array, Array]]:
        return {}

    @cached_property
    def _known(self) -> dict[tuple[object, ...], float]:
        return {}

    def of(self, tried: Sequence[Process]) -> Array:
        """The values `(n,)` of n processes."""
        keys = [(process.correlation, process.length, *process.sizes.values()) for process in tried]
        for key, process in zip(keys, tried, strict=True):
            if key not in self._known:
                self._known[key] = self._of(process)
        return np.array([self._known[key] for key in keys])

    def _of(self, process: Process) -> float:
        k, motions = len(self.processes.positions), range(len(self.processes.classes))
        roots = np.stack([self._root(process, motion) for motion in motions])
        columns, along = zip(*(self._products(process, motion) for motion in motions), strict=True)
        whole = np.concatenate(columns, axis=1).reshape(len(motions), k, -1)
        whole = (roots.transpose(0, 2, 1) @ whole).reshape(len(self.right), -1)
        return log_evidence(whole, np.concatenate(along)) - self.processes.away(process)

    def _root(self, process: Process, motion: int) -> Array:
        which = self.processes.classes[motion]
        key = process.correlation, process.length, process.sizes[which], self.processes.trends[motion]
        if key not in self._roots:
            self._roots[key] = self.processes.root(process, motion)
        return self._roots[key]

    def _products(self, process: Process, motion: int) -> tuple[Array, Array]:
        """Products of information and right side with the root of an error motion `(q, k)` and `(k,)`."""
        key = process.correlation, process.length, process.sizes[self.processes.classes[motion]], motion
        if key not in self._known_products:
            k, root = len(self.processes.positions), self._root(process, motion)
            part = slice(k * motion, k * (motion + 1))
            self._known_products[key] = self.information[:, part] @ root, root.T @ self.right[part]
        return self._known_products[key]

    def climbed(self, starts: Sequence[Process]) -> list[tuple[float, Process]]:
        """From each start the process that no step of one size makes likelier, with its value."""
        found = list(zip(self.of(starts).tolist(), starts, strict=True))
        moving = list(range(len(found)))
        while moving:
            before = [found[i][1] for i in moving]
            for which in dict.fromkeys(self.processes.classes):
                varied = [(i, other) for i in moving for other in _varied(found[i][1], which)]
                values = self.of([process for _, process in varied]).tolist()
                for (i, process), value in zip(varied, values, strict=True):
                    if value > found[i][0]:
                        found[i] = value, process
            moving = [i for i, old in zip(moving, before, strict=True) if found[i][1] != old]
        return found


def _varied(process: Process, which: str) -> list[Process]:
    """Processes with the next smaller and larger size of a class."""
    sizes = (process.sizes[which] + step for step in (1, -1))
    return [process._replace(sizes={**process.sizes, which: k}) for k in sizes if 0 <= k < len(PROCESS_SIZES_UM)]
