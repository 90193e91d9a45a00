"""A rigid best fit of a stream of deviations, as a coordinate measuring machine aligns a part to its drawing."""

from __future__ import annotations

from typing import Any

import numpy as np

from kinematics.transforms import Array, by_turn

NULL_SINGULAR_VALUE = 1e-12
"""Ratio to the largest singular value below which a rotation has no effect: points on one line."""


class BestFit:
    """Least squares of three shifts and three small rotations over deviations at points, mm, added in parts.

    Only the sums of the normal equations are kept, about the centre of the first points and scaled by their size, so
    that memory does not grow with the program. They are solved about the mean of all points, so that the result does
    not depend on the parts.
    """

    def __init__(self) -> None:
        self.count = 0
        self._centre: Array | None = None
        self._size = 1.0
        self._normal, self._right, self._squares, self._points = np.zeros((6, 6)), np.zeros(6), 0.0, np.zeros(3)

    def add(self, points: Array, deviations: Array) -> None:
        """Add points and their deviations, both `(n, 3)`, mm."""
        if not len(points):
            return
        if self._centre is None:
            self._centre = points.mean(axis=0)
            self._size = max(float(np.abs(points - self._centre).max()), 1.0)
        from_first, um = points - self._centre, deviations * 1e3
        arms = from_first / self._size
        # sums over the rows of the columns [1, by_turn(arms)]
        squares, turned = arms.T @ arms, by_turn(arms.sum(axis=0))
        self._normal[:3, :3] += len(points) * np.eye(3)
        self._normal[:3, 3:] += turned
        self._normal[3:, :3] += turned.T
        self._normal[3:, 3:] += np.trace(squares) * np.eye(3) - squares
        moments = arms.T @ um
        self._right[:3] += um.sum(axis=0)
        self._right[3:] += [moments[i, j] - moments[j, i] for i, j in ((1, 2), (2, 0), (0, 1))]
        self._squares += float((um * um).sum())
        self._points += from_first.sum(axis=0)
        self.count += len(points)

    def json(self) -> dict[str, Any]:
        """RMS of the residuals, um; shift, um, and rotation, urad, of the fit about `about_mm`, the mean point."""
        if self._centre is None:
            return {"rms": 0.0, "shift_um": [0.0] * 3, "turn_urad": [0.0] * 3, "about_mm": [0.0] * 3, "count": 0}
        away, size = self._points / self.count, self._size  # mean of all points minus the centre of the first ones
        squared = np.trace(self._normal[3:, 3:]) / 2.0 * size**2 / self.count - away @ away
        spread = np.sqrt(max(float(squared), 1.0))
        anew = np.eye(6)
        anew[:3, 3:], anew[3:, 3:] = by_turn(-away[None])[0] / spread, np.eye(3) * size / spread
        right = anew.T @ self._right
        fitted = np.linalg.lstsq(anew.T @ self._normal @ anew, right, rcond=NULL_SINGULAR_VALUE)[0]
        left = max(self._squares - float(fitted @ right), 0.0)
        numbers = {"shift_um": fitted[:3], "turn_urad": fitted[3:] * 1e3 / spread, "about_mm": self._centre + away}
        rounded = {name: np.round(values, 4).tolist() for name, values in numbers.items()}
        return {"rms": round(float(np.sqrt(left / self.count)), 4), **rounded, "count": self.count}
