"""I-optimal choice among candidates: the rows whose fit has the least mean variance over the evaluated positions.

The variance is tr(B V), V = (P + sum F'F)^-1 over the rows F of the chosen candidates. B = G'G / n over the evaluated
positions; P is the information of the priors. Candidates are first chosen one by one, each with the largest reduction
of the variance. Then the least useful one is exchanged for the most useful one (Fedorov) until no exchange is an
improvement.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from kinematics.transforms import Array

LOOKED_AT = 48
"""Number of candidates whose improvement is computed anew at a time; earlier values are upper limits for all others."""
TRIED_EXCHANGES = 12
"""Number of exchanges that are tried, from the least useful chosen candidate on, before the search ends."""
LEAST_REDUCTION = 1e-4
"""Smallest reduction of the variance by an exchange, as a share of the variance."""


@dataclass
class Selection:
    """The candidates chosen, with V and W = V B V."""

    rows: Array
    """F `(candidates, d, p)`, whitened, parameters in units of their priors."""
    prior: Array
    """P `(p, p)`."""
    evaluated: Array
    """B `(p, p)`."""
    chosen: np.ndarray
    """Mask `(candidates,)`."""

    def __post_init__(self) -> None:
        some = self.rows[self.chosen].reshape(-1, self.rows.shape[2])
        self._information = self.prior + some.T @ some
        self._renew()

    @property
    def variance(self) -> float:
        """tr(B V)."""
        return float(np.sum(self.evaluated * self.spread))

    def improvements(self, which: np.ndarray) -> Array:
        """Reductions `(n,)` of the variance by each of these candidates."""
        inner, outer = self._through(which)
        return np.asarray(np.einsum("nij,nji->n", np.linalg.inv(np.eye(inner.shape[1]) + inner), outer))

    def losses(self, which: np.ndarray) -> Array:
        """Increases `(n,)` of the variance without each of these chosen candidates."""
        inner, outer = self._through(which)
        return np.asarray(np.einsum("nij,nji->n", np.linalg.inv(np.eye(inner.shape[1]) - inner), outer))

    def change(self, candidate: int, sign: int) -> None:
        """Add a candidate (+1), or remove it (-1)."""
        F = self.rows[candidate]
        self._information = self._information + sign * F.T @ F
        self.chosen[candidate] = sign > 0
        self._renew()

    def _through(self, which: np.ndarray) -> tuple[Array, Array]:
        """F V F' and F W F' of some candidates."""
        F = self.rows[which]
        flat = F.reshape(-1, F.shape[2])  # one product of two matrices, not one for each candidate
        left = ((flat @ matrix).reshape(F.shape) for matrix in (self.spread, self.weighted))
        inner, outer = (np.einsum("nip,njp->nij", some, F) for some in left)
        return inner, outer

    def _renew(self) -> None:
        """V and W from the information: without rank updates, in which the rounding of the first large V would stay."""
        self.spread = np.linalg.inv(self._information)
        self.weighted = self.spread @ self.evaluated @ self.spread


def filled(
    selection: Selection, number: int, allowed: np.ndarray, done: Callable[[int], None] = lambda _: None
) -> None:
    """Choose the most useful of the allowed candidates, a mask, one by one until `number` are chosen.

    done: called with the number of those chosen.
    """
    improvements = np.where(allowed & ~selection.chosen, np.inf, -np.inf)
    while (chosen := int(np.count_nonzero(selection.chosen))) < number:
        done(chosen)
        order = np.argsort(-improvements)
        start = 0
        while True:
            some = order[start : start + LOOKED_AT]
            some = some[improvements[some] > -np.inf]
            if not len(some):
                break
            improvements[some] = selection.improvements(some)
            start += len(some)
            if start >= len(order) or improvements[order[:start]].max() >= improvements[order[start]]:
                break
        best = int(np.argmax(improvements))
        if improvements[best] == -np.inf:
            return
        selection.change(best, 1)
        improvements[best] = -np.inf


def exchanged(
    selection: Selection, allowed: np.ndarray, rounds: int, group: np.ndarray | None = None, least: int = 0
) -> int:
    """Exchange chosen candidates for allowed ones that reduce the variance; the number of exchanges.

    group `(candidates,)`: a group of which no more than `least` are chosen keeps their number.
    """
    groups = np.zeros(len(allowed)) if group is None else group
    done = 0
    for _ in range(rounds):
        inside = np.flatnonzero(selection.chosen)
        ranked = inside[np.argsort(selection.losses(inside))]
        if not _one(selection, ranked[:TRIED_EXCHANGES], allowed, groups, least):
            break
        done += 1
    return done


def _one(selection: Selection, ranked: np.ndarray, allowed: np.ndarray, groups: np.ndarray, least: int) -> bool:
    before = selection.variance
    for candidate in ranked.tolist():
        selection.change(candidate, -1)
        own = groups == groups[candidate]
        keeps = np.count_nonzero(selection.chosen & own) >= least
        free = np.flatnonzero(allowed & ~selection.chosen & (own | keeps))
        best = int(free[np.argmax(selection.improvements(free))])
        selection.change(best, 1)
        if selection.variance < before * (1 - LEAST_REDUCTION):
            return True
        selection.change(best, -1)
        selection.change(candidate, 1)
    return False
