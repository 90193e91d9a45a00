"""How a function of an axis position is written: columns of basis functions, linear in their parameters.

Positions are in file units (mm or degrees). Outside its interval a function keeps the value it has at the nearer end,
as the compensation tables of controls do, so no basis extrapolates; `kinematics.turn` closes the turn of a rotary axis.
"""

from __future__ import annotations

import math
from typing import Annotated, Literal

import msgspec
import numpy as np

from kinematics.transforms import Array

Interval = tuple[float, float]
Degree = Annotated[int, msgspec.Meta(ge=0, le=50)]


class _Scaled(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A basis on an interval; subclasses see positions scaled to u = 0 at its lower and 1 at its upper end."""

    interval: Interval

    def __post_init__(self) -> None:
        low, high = self.interval
        if not (math.isfinite(low) and math.isfinite(high) and low < high):
            raise ValueError(f"interval [{low}, {high}] must go from a lower to a higher position")

    def _scaled(self, x: Array) -> Array:
        low, high = self.interval
        return np.asarray((np.clip(x, low, high) - low) / (high - low))

    @property
    def kinks(self) -> tuple[float, ...]:
        """Positions at which its functions have a kink: the ends, beyond which they are constant."""
        return self.interval

    @property
    def wave_length(self) -> float | None:
        """Length of its shortest wave, mm or degrees; None for functions that do not repeat."""
        return None

    @property
    def _width(self) -> float:
        return self.interval[1] - self.interval[0]


class Polynomial(_Scaled, frozen=True, tag_field="kind", tag="polynomial"):
    """1, u, u^2, ... u^degree with u = 0..1 over the interval."""

    degree: Degree

    @property
    def size(self) -> int:
        """Number of parameters."""
        return self.degree + 1

    def columns(self, x: Array) -> Array:
        """Basis functions `(n, size)` at positions `(n,)`."""
        return np.vander(self._scaled(x), self.size, increasing=True)

    @property
    def feature_length(self) -> float:
        """Shortest feature length of its functions, mm or degrees: it is least near the ends."""
        return _feature_length(self._width, self.degree)


class Legendre(_Scaled, frozen=True, tag_field="kind", tag="legendre"):
    """Legendre polynomials P_0 ... P_degree over the interval taken as -1..1."""

    degree: Degree

    @property
    def size(self) -> int:
        """Number of parameters."""
        return self.degree + 1

    def columns(self, x: Array) -> Array:
        """Basis functions `(n, size)` at positions `(n,)`."""
        t = 2.0 * self._scaled(x) - 1.0
        columns = np.ones((self.size, len(t)))
        columns[1:2] = t
        for k in range(2, self.size):  # Bonnet's recurrence; numpy.polynomial would be loaded for it alone
            columns[k] = (columns[k - 1] * t * (2 * k - 1) - columns[k - 2] * (k - 1)) / k
        return columns.T

    @property
    def feature_length(self) -> float:
        """Shortest feature length of its functions, mm or degrees: it is least near the ends."""
        return _feature_length(self._width, self.degree)


class Fourier(_Scaled, frozen=True, tag_field="kind", tag="fourier"):
    """1, u, then sin(n pi u), cos(n pi u) per harmonic n: the errors of the virtual calibration paper, Table 1."""

    harmonics: tuple[float, ...]

    @property
    def size(self) -> int:
        """Number of parameters."""
        return 2 + 2 * len(self.harmonics)

    def columns(self, x: Array) -> Array:
        """Basis functions `(n, size)` at positions `(n,)`."""
        u = self._scaled(x)
        waves = [wave(n * np.pi * u) for n in self.harmonics for wave in (np.sin, np.cos)]
        return np.stack([np.ones_like(u), u, *waves], axis=1)

    @property
    def wave_length(self) -> float | None:
        """Length of its shortest wave, mm or degrees; None without waves."""
        return 2 * self._width / max(self.harmonics) if self.harmonics else None

    @property
    def feature_length(self) -> float:
        """Shortest feature length of its functions, mm or degrees: half the shortest wave."""
        highest = max(map(abs, self.harmonics), default=0.0)
        return self._width / highest if highest else math.inf


class Harmonics(_Scaled, frozen=True, tag_field="kind", tag="harmonics"):
    """1, then sin(n q), cos(n q) for n = 1 ... order: repeats with the turn of a rotary axis at q degrees.

    The interval is the measured one; the functions continue over the whole turn.
    """

    order: Degree

    @property
    def size(self) -> int:
        """Number of parameters."""
        return 1 + 2 * self.order

    def columns(self, x: Array) -> Array:
        """Basis functions `(n, size)` at positions `(n,)`, degrees."""
        q = np.deg2rad(x)
        waves = [wave(n * q) for n in range(1, self.order + 1) for wave in (np.sin, np.cos)]
        return np.stack([np.ones_like(q), *waves], axis=1)

    @property
    def wave_length(self) -> float | None:
        """Length of its shortest wave, degrees; None without waves."""
        return 360.0 / self.order if self.order else None

    @property
    def feature_length(self) -> float:
        """Shortest feature length of its functions, degrees: half the shortest wave."""
        return 180.0 / self.order if self.order else math.inf


class BSpline(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="kind", tag="b-spline"):
    """B-spline over ascending nodes: degree 1 is an interpolated table of node values, degree 3 a cubic spline.

    Clamped at both ends, so the first and last parameters are the end values. Columns by the Cox-de Boor recursion
    (scipy.interpolate has the same; a run that corrects a program does not wait for its import).
    """

    nodes: tuple[float, ...]
    degree: Literal[1, 3]

    def __post_init__(self) -> None:
        if len(self.nodes) < 2 or not np.all(np.diff(self.nodes) > 0) or not np.all(np.isfinite(self.nodes)):
            raise ValueError("nodes must be at least two, finite and ascending")

    @property
    def interval(self) -> Interval:
        """From the first to the last node."""
        return self.nodes[0], self.nodes[-1]

    @property
    def kinks(self) -> tuple[float, ...]:
        """Positions at which its functions have a kink, or a jump of a higher derivative: the nodes."""
        return self.nodes

    @property
    def wave_length(self) -> float | None:
        """None: its functions do not repeat."""
        return None

    @property
    def size(self) -> int:
        """Number of parameters."""
        return len(self.nodes) + self.degree - 1

    def columns(self, x: Array) -> Array:
        """Basis functions `(n, size)` at positions `(n,)`."""
        p, n = self.degree, len(x)
        knots = np.concatenate([[self.nodes[0]] * p, self.nodes, [self.nodes[-1]] * p])
        x = np.clip(x, *self.interval)
        span = np.clip(np.searchsorted(knots, x, side="right") - 1, p, len(knots) - p - 2)
        local = np.ones((n, 1))
        for k in range(1, p + 1):
            # of the k + 1 functions alive in the span, each is a blend of two of one degree less
            left = knots[span[:, None] + np.arange(1 - k, 1)]
            right = knots[span[:, None] + np.arange(1, k + 1)]
            weight = local / (right - left)
            local = np.zeros((n, k + 1))
            local[:, :-1] += (right - x[:, None]) * weight
            local[:, 1:] += (x[:, None] - left) * weight
        columns = np.zeros((n, self.size))
        np.put_along_axis(columns, span[:, None] + np.arange(-p, 1), local, axis=1)
        return columns

    @property
    def feature_length(self) -> float:
        """Shortest feature length of its functions, mm or degrees: the distance between two nodes."""
        return float(np.diff(self.nodes).min())


def _feature_length(width: float, degree: int) -> float:
    """Shortest feature length of polynomials; infinite for a straight line."""
    return 2.0 * width / (degree * (degree + 1)) if degree > 1 else math.inf


Basis = Polynomial | Legendre | Fourier | Harmonics | BSpline
