"""Blocks of the rows of a linearised fit, each predicted by a fit of all the others, to first order."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from calibration.diagnosis.search.score import GENEROUS, Projected
from calibration.fit.cross_validation import less_columns, registered
from calibration.fit.linear import Posterior
from calibration.measurement.measurement import Measurement
from kinematics.transforms import Array

LIKELY = 2.0
"""Prior standard deviation of a parameter in the fit of some rows, as a multiple of the RMS estimate from all rows."""
SILENT = 0.01
"""Squares of a signal in a block, as a share of the mean of all blocks, up to which it does not act there."""
RIDGE = 1e-9
"""Ridge on the diagonal of H without a block."""


class HeldBlock(NamedTuple):
    """Rows that a fit of all the others predicts."""

    rows: np.ndarray
    """Mask `(N,)`."""
    posterior: Posterior
    """H without these rows, factorised."""
    moved: Array
    """Parameters `(q,)` of the fit of all rows less those of the fit of all the others."""
    held_residual: Array
    """Whitened residuals of these rows under the fit of all the others."""
    counted: np.ndarray
    """False where the other rows do not determine the set-up or the target."""
    zeros: Array
    """Whitened columns `(m, p)` of the zeros of an interferometer's runs that the other rows lack."""


class _Others(NamedTuple):
    """The parts of a `HeldBlock` that do not depend on the residual."""

    rows: np.ndarray
    posterior: Posterior
    counted: np.ndarray
    zeros: Array


class HeldResiduals(NamedTuple):
    """Residuals of rows under fits without them."""

    residual_um: Array
    """`(n, d)`; urad on rotary axes of an interferometer."""
    counted: np.ndarray
    """`(n,)`"""
    blocks: int
    name: str
    """Name of the blocks, plural."""

    @property
    def rms_um(self) -> float:
        """RMS per scalar of the rows that count, um (rotary axes: urad); NaN without any."""
        return float(np.sqrt(np.mean(self.residual_um[self.counted] ** 2))) if self.counted.any() else float("nan")


class _Products(NamedTuple):
    """Products of columns G `(N, k)` of a candidate over all rows."""

    shared: Array
    """J'G `(q, k)`."""
    squares: Array
    """G'G `(k, k)`."""
    along: Array
    """G'r `(k,)`."""


@dataclass(frozen=True)
class HeldOut:
    """The rows of a linearised fit with the labels of their blocks."""

    measurement: Measurement
    """The rows of the linearised fit alone."""
    labels: np.ndarray
    """Label `(n,)` of the block of each row; -1 for rows of none."""
    design: Array
    """J `(N, q)`, as that of the linearised fit."""
    residual: Array
    """r `(N,)`"""
    information: Array
    """J'J `(q, q)`."""
    limited: Array
    """Diagonal `(q,)` of the priors' part of H."""
    runs: int
    """Number of the first columns of the design that are zeros of runs of an interferometer."""

    def with_residual(self, residual: Array) -> HeldOut:
        """The same rows with another residual; the fits of the others do not depend on it."""
        other = replace(self, residual=residual)
        vars(other)["_others"] = self._others
        return other

    @cached_property
    def _others(self) -> list[_Others]:
        """For each block the fit of all others."""
        found = []
        for label in np.unique(self.labels[self.labels >= 0]):
            inside = self.labels == label
            mine = np.repeat(inside, self.measurement.components)
            design = self.design[mine]
            posterior = Posterior(self.information - design.T @ design, self.limited + RIDGE)
            counted = np.repeat(registered(self.measurement, ~inside)[inside], self.measurement.components)
            found.append(_Others(mine, posterior, counted, self._own_zeros(mine)))
        return found

    @cached_property
    def blocks(self) -> list[HeldBlock]:
        """The blocks, each with the fit of all the others."""
        found = []
        for mine, posterior, counted, zeros in self._others:
            design, residual = self.design[mine], self.residual[mine]
            moved = posterior.solve(design.T @ residual)
            held_residual = less_columns((residual + design @ moved)[:, None], zeros)[:, 0]
            found.append(HeldBlock(mine, posterior, moved, held_residual, counted, zeros))
        return found

    def _own_zeros(self, block: np.ndarray) -> Array:
        """Columns `(m, p)` of the zeros of an interferometer's runs that only rows of the block `(N,)` have."""
        own = self.design[:, : self.runs]
        only = own[block].any(axis=0) & ~own[~block].any(axis=0)
        return np.asarray(own[block][:, only])

    @property
    def held_residual(self) -> tuple[Array, np.ndarray]:
        """Whitened residuals `(N,)` of all rows under the fits without their blocks, 0 for rows of none; those that
        count `(N,)`."""
        found, counted = np.zeros(len(self.residual)), np.zeros(len(self.residual), bool)
        for block in self.blocks:
            found[block.rows], counted[block.rows] = block.held_residual, block.counted
        return found, counted

    def gains(self, candidates: Sequence[Projected], sizes: Sequence[Array], numbers: Sequence[int]) -> Array:
        """Reduction of the squares of the counted residuals of blocks by a candidate in the fit of the other blocks.

        One candidate for each of these blocks, which are given by number, with its sizes `(k,)` in the fit of all rows.
        """
        whole = {key: self._products(one) for key, one in {id(one): one for one in candidates}.items()}
        every = zip(candidates, sizes, (self.blocks[number] for number in numbers), strict=True)
        found = [self._gain(one.columns, whole[id(one)], size, block) for one, size, block in every]
        gains, signals = np.array([gain for gain, _ in found]), np.array([signal for _, signal in found])
        acting = signals > SILENT * np.mean(signals)
        return gains[acting] if np.count_nonzero(acting) > 1 else gains

    def _products(self, candidate: Projected) -> _Products:
        columns = candidate.columns
        return _Products(self.design.T @ columns, columns.T @ columns, columns.T @ self.residual)

    def _gain(self, columns: Array, whole: _Products, size: Array, block: HeldBlock) -> tuple[float, float]:
        """Reduction of the squares of a block's counted residuals by a candidate, and the squares of its signal."""
        # the size stays in this range where the other blocks do not determine it
        softened = max(LIKELY * float(np.sqrt(np.mean(size**2))), 1.0 / GENEROUS) ** -2 * np.eye(len(size))
        own, design = columns[block.rows], self.design[block.rows]
        others = whole.shared - design.T @ own
        step = block.posterior.solve(others)
        schur = whole.squares - own.T @ own - others.T @ step
        slope = whole.along - own.T @ self.residual[block.rows] + others.T @ block.moved
        seen = less_columns(own - design @ step, block.zeros)
        after = block.held_residual - seen @ np.linalg.solve(schur + softened, slope)
        gain = float(np.sum(block.held_residual[block.counted] ** 2) - np.sum(after[block.counted] ** 2))
        return gain, float(np.sum((seen @ size)[block.counted] ** 2))
