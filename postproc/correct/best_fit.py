"""A rigid best fit of a stream of deviations, as a coordinate measuring machine aligns a part to its drawing."""

from __future__ import annotations

from typing import Any

import numpy as np

from kinematics.transforms import Array, by_turn

NULL = 1e-12
"""Share of the largest singular value below which a turn changes nothing: points on one line."""


class BestFit:
    """Least squares of three shifts and three small turns over deviations at points, mm, that come in parts.

    The sums of the normal equations are kept, about the first points and in units of their size: memory does not grow
    with the program.
    """

    def __init__(self) -> None:
        self.count = 0
        self._centre: Array | None = None
        self._size = 1.0
        self._normal, self._right, self._squares = np.zeros((6, 6)), np.zeros(6), 0.0

    def add(self, points: Array, deviations: Array) -> None:
        """Take in points and deviations there, both `(n, 3)`, mm."""
        if not len(points):
            return
        if self._centre is None:
            self._centre = points.mean(axis=0)
            self._size = max(float(np.abs(points - self._centre).max()), 1.0)
        columns = np.empty((len(points), 3, 6))
        columns[:, :, :3] = np.eye(3)
        columns[:, :, 3:] = by_turn((points - self._centre) / self._size)
        flat, um = columns.reshape(-1, 6), deviations.reshape(-1) * 1e3
        self._normal += flat.T @ flat
        self._right += flat.T @ um
        self._squares += float(um @ um)
        self.count += len(points)

    def json(self) -> dict[str, Any]:
        """RMS length left, um; the shift, um, at `about_mm`, and turn, urad, that were taken off."""
        if self._centre is None:
            return {"rms": 0.0, "shift_um": [0.0] * 3, "turn_urad": [0.0] * 3, "about_mm": [0.0] * 3, "count": 0}
        fitted = np.linalg.lstsq(self._normal, self._right, rcond=NULL)[0]
        left = max(self._squares - float(fitted @ self._right), 0.0)
        numbers = {"shift_um": fitted[:3], "turn_urad": fitted[3:] * 1e3 / self._size, "about_mm": self._centre}
        rounded = {name: np.round(values, 4).tolist() for name, values in numbers.items()}
        return {"rms": round(float(np.sqrt(left / self.count)), 4), **rounded, "count": self.count}
