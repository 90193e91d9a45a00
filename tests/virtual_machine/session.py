"""A measuring session: what is done when, one row per observation; and what follows from the order of rows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from virtual_machine.chain import Array, Chain, nominal_points


@dataclass(frozen=True)
class Session:
    """Columns over n observations, in the order of acquisition."""

    chain: Chain
    positions: Array
    """Commanded `(n, axes)`, mm and degrees."""
    target: np.ndarray
    """Name of the target observed `(n,)`."""
    targets: Mapping[str, Array]
    """Targets on the tool, from the tool reference point, mm."""
    references: Mapping[str, Array] = field(default_factory=dict)
    """Nests on the table, in the workpiece frame, mm: they see nothing of the machine."""
    time: Array | None = None
    """s."""
    temperatures: Mapping[str, Array] = field(default_factory=dict)
    """degC, by sensor."""
    feed: Array | None = None
    """mm/min; 0 is standing."""
    station: np.ndarray | None = None
    run: np.ndarray | None = None
    came: Mapping[str, Array] = field(default_factory=dict)
    """Direction `(n,)` that an axis came from, by its name, where it runs over and comes back between rows."""

    def __len__(self) -> int:
        return len(self.positions)

    @property
    def on_tool(self) -> np.ndarray:
        """Mask `(n,)` of the rows that see the machine."""
        return ~np.isin(self.target, list(self.references))

    @property
    def stations(self) -> np.ndarray:
        """Name of the set-up `(n,)`."""
        return np.full(len(self), "s1") if self.station is None else self.station

    @property
    def clock(self) -> Array:
        """Time `(n,)`, s; the number of the row where there is none."""
        return np.arange(len(self), dtype=float) if self.time is None else self.time

    def place(self, axis: str) -> Array:
        """Commanded positions `(n,)` of one axis, mm or degrees."""
        return np.asarray(self.positions[:, self.chain.index(axis)])

    def reflectors(self) -> Array:
        """Positions `(n, 3)` of the targets on the tool; zero in rows that see a nest on the table."""
        return np.array([self.targets.get(name, np.zeros(3)) for name in self.target.tolist()])

    def points(self) -> Array:
        """Nominal points `(n, 3)`, mm, workpiece frame."""
        seen = nominal_points(self.chain, self.chain.to_radians(self.positions), self.reflectors())
        for row in np.flatnonzero(~self.on_tool).tolist():
            seen[row] = self.references[str(self.target[row])]
        return seen

    def last_move(self, axis: str) -> Array:
        """The last move `(n,)` that the axis made, mm or degrees, signed; 0 until its first."""
        moves, last = np.diff(self.place(axis), prepend=self.place(axis)[:1]), 0.0
        result = np.zeros(len(self))
        for row, move in enumerate(moves.tolist()):
            last = move if abs(move) > 1e-9 else last
            result[row] = last
        return result

    def approach(self, axis: str) -> Array:
        """Direction `(n,)` of the last move, -1 or 1; 0 until the first."""
        return np.asarray(self.came.get(axis, np.sign(self.last_move(axis))))

    def velocity(self, axis: str) -> Array:
        """Speed `(n,)` of a linear axis, mm/s: rows in motion are passed on the straight way from the row before."""
        if self.feed is None:
            return np.zeros(len(self))
        columns = [self.chain.index(name) for name in self.chain.linear]
        way = np.diff(self.positions[:, columns], axis=0, prepend=self.positions[:1, columns])
        length = np.linalg.norm(way, axis=1)
        share = np.diff(self.place(axis), prepend=self.place(axis)[:1]) / np.where(length > 0, length, np.inf)
        return np.asarray(share * self.feed / 60.0)

    def visits(self) -> Array:
        """How often `(n,)` the row's position was observed with the row's target."""
        key = np.column_stack([np.round(self.positions, 6), np.unique(self.target, return_inverse=True)[1]])
        _, which, counts = np.unique(key, axis=0, return_inverse=True, return_counts=True)
        return np.asarray(counts[which.reshape(-1)], float)
