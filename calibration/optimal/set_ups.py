"""Where the instrument stands, and which targets it measures: the best of possible ones, by their information.

A place with a target gives the mean information of all positions that it sees there. The registration of a station, its
pose or its position with its dead lengths, is eliminated; the information of the stations then adds up. Stations are
chosen one by one, targets left out one by one, and both are exchanged until no exchange is an improvement.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache

import numpy as np

from kinematics.state import State
from kinematics.transforms import Array

FREE_REGISTRATION_SHARE = 1e-9
"""Information on the registration before the measurement, as a share of that of the measurement."""

Names = tuple[str, ...]


class SetUps:
    """The information of each station with each target, and the variance that some of them leave."""

    def __init__(self, state: State, rows: Array, machine: slice, prior: Array, evaluated: Array) -> None:
        """Rows `(n, d, p)` of the states, prior and evaluated `(p, p)` as of `Selection`; machine: its parameters."""
        assert state.station is not None
        assert state.target is not None
        self._prior, self._evaluated = prior[machine, machine], evaluated[machine, machine]
        self._own: dict[str, int] = {}
        self._each: dict[tuple[str, str], Array] = {}
        for station in np.unique(state.station).tolist():
            here = np.flatnonzero(state.station == station)
            own = np.flatnonzero(rows[here, :, : machine.start].any(axis=(0, 1)))
            some = np.concatenate([rows[here][:, :, own], rows[here][:, :, machine]], axis=2)
            self._own[station] = len(own)
            for target in np.unique(state.target[here]).tolist():
                flat = some[state.target[here] == target]
                self._each[station, target] = np.einsum("ndp,ndq->pq", flat, flat, optimize=True) / len(flat)
        self._of_station = lru_cache(maxsize=None)(self._registered)

    def variance(self, stations: Names, targets: Names, number: int) -> float:
        """Mean variance of the volumetric error, um2, by a number of rows divided equally among the set-ups."""
        share = number / (len(stations) * len(targets))
        information = self._prior + share * sum(self._of_station(station, targets) for station in stations)
        return float(np.trace(np.linalg.solve(information, self._evaluated)))

    def _registered(self, station: str, targets: Names) -> Array:
        """Information `(p, p)` on the machine by one row with each target, the registration eliminated."""
        seen = [each for target in targets if (each := self._each.get((station, target))) is not None]
        k = self._own[station]
        if not seen:
            return np.zeros_like(self._prior)
        whole = np.sum(seen, axis=0)
        own = whole[:k, :k] + FREE_REGISTRATION_SHARE * np.trace(whole[:k, :k]) / k * np.eye(k)
        return np.asarray(whole[k:, k:] - whole[k:, :k] @ np.linalg.solve(own, whole[:k, k:]))


def best_set_ups(
    set_ups: SetUps, stations: Names, targets: Names, counts: tuple[int, int], number: int
) -> tuple[Names, Names]:
    """So many stations and targets of all that leave the least variance, for a number of rows."""
    chosen: Names = ()
    used = targets
    for _ in range(counts[0]):
        free = [name for name in stations if name not in chosen]
        chosen = min(((*chosen, name) for name in free), key=lambda some: set_ups.variance(some, used, number))
    chosen = _exchanged(chosen, stations, lambda some: set_ups.variance(some, used, number))
    while len(used) > counts[1]:
        fewer = [tuple(name for name in used if name != left) for left in used]
        used = min(fewer, key=lambda some: set_ups.variance(chosen, some, number))
    if len(used) < len(targets):
        used = _exchanged(used, targets, lambda some: set_ups.variance(chosen, some, number))
        chosen = _exchanged(chosen, stations, lambda some: set_ups.variance(some, used, number))
    return _in_order(chosen, stations), _in_order(used, targets)


def _exchanged(chosen: Names, every: Names, variance: Callable[[Names], float]) -> Names:
    """The names after exchanges, each the best one, until none is an improvement."""
    least = variance(chosen)
    while True:
        others = [name for name in every if name not in chosen]
        tried = [_in_order((*chosen[:k], *chosen[k + 1 :], name), every) for k in range(len(chosen)) for name in others]
        best = min(tried, key=variance, default=chosen)
        if not tried or (found := variance(best)) >= least:
            return chosen
        chosen, least = best, found


def _in_order(some: Sequence[str], every: Names) -> Names:
    return tuple(name for name in every if name in some)
