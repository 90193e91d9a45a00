"""The linear axes' procedure of the thesis (Ellingsdalen, NTNU 2021) as it is published, for comparison only.

Faithful with its faults, none of which ncomp shares: P, Q and K are taken from the first position of each round; six of
the nine equations of (3.5) are chosen, to first order; the straight line and then a polynomial are fitted without
weights; the polynomial's constant is dropped (Listing 3.1) and it is read at the position rounded to 1 mm; squareness
is a sum of two angles whose signs are set by Listing 3.1 and used unchanged by Listing 3.4 (so the slopes of
E_XY and E_XZ come back with the wrong sign; E_XY got worse in the thesis too); angular errors are neglected; the
correction is one step, read at the nominal position.

Coordinates of the thesis: each axis counts from its first position, Z downward (the branch `Axis[-1] < 0`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from kinematics.transforms import Array

DEGREES = {"XX": 4, "YX": 5, "ZX": 8, "XY": 8, "YY": 6, "ZY": 4, "XZ": 4, "YZ": 4, "ZZ": 8}
"""Listing 3.4; those of E_XZ and E_YZ are missing in the available text; 4 is used instead."""

CHOSEN = {"X": "Px Py Qx Qz Ky Kz", "Y": "Py Pz Qy Kx Kz Px", "Z": "Pz Qx Qz Ky Px Py"}
"""Equations (32), (36), (37) of the specialisation project."""

SIGNS = {"YX": 1, "ZX": -1, "XY": -1, "ZY": 1, "XZ": -1, "YZ": 1}
"""Sign of the angle where the line rises along the travel, Listing 3.1."""


@dataclass(frozen=True)
class ThesisModel:
    """Polynomials (highest power first, um over mm) and angles (rad) by error motion."""

    polynomials: Mapping[str, Array]
    angles: Mapping[str, float]

    def error(self, name: str, position: float) -> float:
        """mm, at the position rounded to 1 mm."""
        return float(np.polyval(self.polynomials[name], round(position))) * 1e-3

    def squareness(self, first: str, second: str) -> float:
        """Listing 3.2."""
        return self.angles[f"{second}{first}"] + self.angles[f"{first}{second}"]

    def corrected(self, nominal: Array) -> Array:
        """Commands `(n, 3)` for nominal positions `(n, 3)`, mm, both in the thesis' coordinates; Listing 3.4."""
        return np.array([self._corrected(row) for row in nominal])

    def _corrected(self, at: Array) -> Array:
        _, y, z = at.tolist()
        e = {name: self.error(name, at["XYZ".index(name[1])]) for name in DEGREES}
        deviation = [
            e["XX"] + e["XY"] + y * self.squareness("Y", "X") + e["XZ"] - z * self.squareness("Z", "X"),
            e["YX"] + e["YY"] + e["YZ"] - z * self.squareness("Z", "Y"),
            e["ZX"] + e["ZY"] + e["ZZ"],
        ]
        return at - np.array(deviation)


def identify(series: Mapping[str, Array], travels: Mapping[str, Array]) -> ThesisModel:
    """The model from points `(rounds, positions, 3, 3)`, mm, in the aligned frame: P, Q, K from the spindle's centre.

    travels: positions `(n,)` of each axis in the thesis' coordinates, mm.
    """
    polynomials, angles = {}, {}
    for axis, points in series.items():
        travel = travels[axis]
        errors = np.mean([_six(axis, one, travel) for one in points], axis=0) * 1e3
        for j, component in enumerate("XYZ"):
            name, values = f"{component}{axis}", errors[:, j]
            if component != axis:
                slope = float(np.polyfit(travel, values, 1)[0])
                rise = slope * (travel[-1] - travel[0])
                angles[name] = SIGNS[name] * np.sign(rise) * abs(np.arctan(slope * 1e-3))
                values = values - slope * travel
            fitted = np.polyfit(travel, values, DEGREES[name])
            fitted[-1] = 0.0
            polynomials[name] = fitted
    return ThesisModel(polynomials, angles)


def _six(axis: str, points: Array, travel: Array) -> Array:
    """Error motions `(n, 6)`, mm and rad, of one round, points `(n, 3, 3)`."""
    away = points - points[0]
    away[:, :, "XYZ".index(axis)] -= travel[:, None]
    rows, values = [], []
    for point, direction in CHOSEN[axis].split():
        k, j = "PQK".index(point), "xyz".index(direction)
        rows.append([*np.eye(3)[j], *np.cross(np.eye(3), points[0, k])[:, j]])
        values.append(away[:, k, j])
    return np.asarray(np.linalg.solve(np.array(rows), np.array(values)).T)
