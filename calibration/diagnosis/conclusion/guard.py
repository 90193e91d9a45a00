"""Held-out blocks: what a structure predicts of rows from the others, against its geometry alone, and against nothing.

One rule: a result that predicts the blocks worse than no model at all is not written; beside a calibration of the same
machine, of which there is little to learn, where it does so beyond the spread of the blocks.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy import linalg

from calibration.fit.cross_validation import Gains
from calibration.gaussian_terms.structure import Structure
from kinematics.transforms import Array

HELD_OUT_BLOCKS = 8
"""Number of held-out blocks: rows that follow each other, so that an error that changes slowly is not learned from the
rows beside."""


class HeldOut(NamedTuple):
    """RMS of held-out blocks that a structure predicts from the others, um per scalar."""

    with_all: float
    """With all terms."""
    without: tuple[float, ...]
    """Without each term of the structure."""
    geometry: float
    """With the geometry alone."""
    nothing: float
    """With a registration alone."""
    gains: Gains
    """Of each block: squares with nothing, minus those with all terms."""
    beside_given: bool
    """True where nothing is the calibration that was given."""

    @property
    def worse(self) -> bool:
        """True where no model at all predicts better."""
        return self.gains.worse if self.beside_given else self.with_all > self.nothing


def held_out(structure: Structure) -> HeldOut:
    """Held-out blocks of the rows that are no outliers."""
    geometry, total = structure.data.geometry.width, len(structure.sizes)
    ends = np.cumsum([geometry, *(term.width for term in structure.terms)])
    everything = np.arange(total)
    each = [everything[low:high] for low, high in pairwise(ends.tolist())]
    residuals = [structure.equations.residual, *_predicted(structure, [everything[:0], everything[geometry:], *each])]
    nothing, with_all, alone, *without = (rms_um(structure, residual) for residual in residuals)
    given = structure.data.observations.given is not None
    return HeldOut(with_all, tuple(without), alone, nothing, gains(structure, *residuals[:2]), given)


def gains(structure: Structure, other: Array, own: Array) -> Gains:
    """Squares of the residuals `(N,)` of another prediction minus those of this one, of each block."""
    observations, labels = structure.data.observations, blocks_of(structure)
    inside = labels >= 0
    noise = np.bincount(labels[inside], (other**2 - own**2)[inside], HELD_OUT_BLOCKS) / structure.noise.factor
    micro = [in_units(structure, each) * observations.measurement.per_micro for each in (other, own)]
    um = np.bincount(labels[inside], (micro[0] ** 2 - micro[1] ** 2).ravel(), HELD_OUT_BLOCKS)
    return Gains(np.asarray(um, float), np.asarray(noise, float))


def _predicted(structure: Structure, dropped: Sequence[np.ndarray]) -> list[Array]:
    """Whitened residuals `(N,)` of all blocks, each predicted from the others, without some columns of the terms."""
    equations, sizes, start = structure.equations, structure.sizes, structure.data.geometry.width
    labels, design = blocks_of(structure), structure.whitened
    found = [equations.residual.copy() for _ in dropped]
    for block in range(HELD_OUT_BLOCKS):
        mine = labels == block
        own, seen = design[mine], equations.residual[mine]
        gram = (equations.gram - own.T @ own) * sizes[:, None] * sizes
        gram[np.diag_indices_from(gram)] += structure.noise.factor
        right = np.column_stack([(equations.along - own.T @ seen) * sizes, np.eye(len(gram))[:, start:]])
        solved = linalg.solve(gram, right, assume_a="pos", overwrite_a=True).T
        mean, moves = solved[0], solved[1:]
        for columns, residual in zip(dropped, found, strict=True):
            moved = moves[columns - start]
            left = mean - np.linalg.solve(moved[:, columns], mean[columns]) @ moved
            residual[mine] -= own @ (sizes * left)
    return found


def blocks_of(structure: Structure) -> np.ndarray:
    """Number of the block of each scalar `(N,)`; the rows of a stop are in one block, stated values in none."""
    observations = structure.data.observations
    stop = observations.measurement.stops
    first = np.flatnonzero(np.append(True, np.diff(stop) != 0))
    starts = np.repeat(first, np.diff(np.append(first, len(stop))))
    rows = np.repeat(starts * HELD_OUT_BLOCKS // len(stop), observations.components)
    return np.concatenate([rows, np.full(len(observations.stated), -1)])


def in_units(structure: Structure, residual: Array) -> Array:
    """Residuals `(n, d)`, mm and rad, of whitened ones `(N,)`; 0 of outliers."""
    observations = structure.data.observations
    n, d = observations.residual.shape
    white, found = residual[: n * d].reshape(n, d), np.zeros((n, d))
    for stops, matrices in zip(structure.data.stops, structure.whitener.matrices, strict=True):
        own = white[stops.rows].reshape(len(stops.rows), -1, 1)
        found[stops.rows] = np.linalg.solve(matrices, own).reshape(*stops.rows.shape, d)
    found[structure.noise.left_out] = 0.0
    return found


def rms_um(structure: Structure, residual: Array) -> float:
    """RMS, um per scalar, of whitened residuals `(N,)`, outliers apart."""
    micro = in_units(structure, residual) * structure.data.observations.measurement.per_micro
    inside = ~structure.noise.left_out
    return float(np.sqrt(np.mean(micro[inside] ** 2)))
