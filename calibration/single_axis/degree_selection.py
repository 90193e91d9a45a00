"""Degrees of the six error curves of an axis, selected and weighted by Akaike's information criterion."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from calibration.single_axis.error_curves import HOLDS, Candidates, Shape, across, sideways, weighted_design
from calibration.single_axis.rigid_motions import RigidMotions
from kinematics.basis import Harmonics, Interval, Legendre
from kinematics.effects import COMPONENTS
from kinematics.machine import Axis
from kinematics.transforms import Array
from kinematics.turn import gap_of
from kinematics.user_error import UserError

HIGHEST_DEGREE = 15
"""Highest degree in the selection, if the number of positions allows it."""
STEADY = 2.45
"""Factor of sqrt(n) for the highest degree: least-squares polynomials through n evenly spaced positions oscillate from
a degree of about 2 sqrt(n) on (Dahlquist and Bjorck, Numerical Methods, 4.4.3): 8 for 11, 11 for 21."""
LEAST_WEIGHT = 0.01
"""Weight of a degree, among those of one curve, below which it is not used."""


def polynomials(
    axis: Axis, positions: Array, motions: RigidMotions, given: Mapping[str, int], arc: Interval
) -> Candidates:
    """Polynomials of the degrees given by name of the component (XY: E_XY); other degrees are weighted by AIC.

    A straightness is at least a line, because its slope is the orientation of the axis. An axis that turns fully and
    was measured over the whole turn has harmonics; a degree is their number. UserError for a degree out of range.
    """
    least, most = _fewest(axis, arc), _most(axis, arc, len(positions))
    degrees = least.copy()
    open_ = []
    for j, name in enumerate(COMPONENTS):
        degree = given.get(f"{name}{axis.name}")
        if degree is None:
            open_.append(j)
        elif not least[j] <= degree <= most:
            raise UserError(
                f"degree {degree} of E_{name}{axis.name}: {len(positions)} positions allow {least[j]} to {most}"
            )
        else:
            degrees[j] = degree
    steady = most if _closed(axis, arc) else int(STEADY * np.sqrt(len(positions)))
    highest = max(min(HIGHEST_DEGREE, most - 1, steady), int(least.max()))
    return _by_aic(_Criterion(axis, arc, positions, motions, max(highest, *degrees)), degrees, open_, least, highest)


@dataclass(frozen=True)
class _Criterion:
    """Akaike's information criterion of six curves, for degrees up to the highest."""

    axis: Axis
    arc: Interval
    positions: Array
    motions: RigidMotions
    highest: int
    known: dict[tuple[int, ...], float] = field(default_factory=dict)
    """Values computed so far, by degrees."""

    def shape(self, degrees: Array) -> Shape:
        """The six curves of some degrees."""
        kind = Harmonics if _closed(self.axis, self.arc) else Legendre
        return Shape(self.axis, tuple(kind(self.arc, int(degree)) for degree in degrees))

    @cached_property
    def widest(self) -> tuple[Shape, Array, Array]:
        """The curves of the highest degrees, their equations, and the right-hand side of these."""
        weights, shape = self.motions.whitening, self.shape(np.full(6, self.highest))
        rows = weighted_design(shape, self.positions, weights, HOLDS[0])
        return shape, rows, np.append(weights @ self.motions.errors.reshape(-1), np.zeros(len(rows) - len(weights)))

    def __call__(self, degrees: Array) -> float:
        key = tuple(degrees.tolist())
        if key not in self.known:
            self.known[key] = self._value(self.shape(degrees))
        return self.known[key]

    def _value(self, shape: Shape) -> float:
        widest, every, observed = self.widest
        columns = [
            *(
                k
                for part, own in zip(widest.parts, shape.bases, strict=True)
                for k in range(part.start, part.start + own.size)
            ),
            *range(widest.parts[-1].stop, widest.size),
        ]  # a basis begins with its functions of lower degree
        rows = every[:, columns]
        left = observed - rows @ np.linalg.lstsq(rows, observed, rcond=1e-14)[0]
        return float(left @ left) + 2.0 * shape.size


def _by_aic(criterion: _Criterion, degrees: Array, open_: list[int], least: Array, highest: int) -> Candidates:
    """The shape that no change of a single degree improves, and the shapes that differ from it in one degree."""
    best, changed = criterion(degrees), True
    while changed:
        changed = False
        for j in open_:
            for other in range(least[j], highest + 1):
                trial = _with_degree(degrees, j, other)
                value = criterion(trial) if other != degrees[j] else best
                if value < best - 1e-9:
                    best, degrees, changed = value, trial, True
    trials = [[_with_degree(degrees, j, other) for other in range(least[j], highest + 1)] for j in open_]
    others = tuple(_weighted(criterion, each) for each in trials)
    unresolved = [
        j
        for j, shapes in zip(open_, others, strict=True)
        if min(shape.degrees[j] or 0 for shape, _ in shapes) >= max(highest - 1, least[j] + 1)
    ]
    return Candidates(criterion.shape(degrees), others, tuple(unresolved))


def _with_degree(degrees: Array, component: int, degree: int) -> Array:
    trial = degrees.copy()
    trial[component] = degree
    return trial


def _weighted(criterion: _Criterion, trials: list[Array]) -> tuple[tuple[Shape, float], ...]:
    """Shapes with their Akaike weights, of sum one."""
    values = np.array([criterion(trial) for trial in trials])
    weights = np.exp(-0.5 * (values - values.min()))
    weights = np.where(weights < LEAST_WEIGHT * weights.sum(), 0.0, weights)
    shares = (weights / weights.sum()).tolist()
    return tuple((criterion.shape(trial), share) for trial, share in zip(trials, shares, strict=True) if share)


def _closed(axis: Axis, arc: Interval) -> bool:
    """True if the whole turn was measured."""
    return axis.turns_fully and not gap_of(arc)


def _fewest(axis: Axis, arc: Interval) -> np.ndarray:
    """Least degree of each of the six curves; 1 across a rotary axis measured all round, for the gauge's harmonic."""
    if axis.rotary:
        return np.array([int(_closed(axis, arc) and across(axis, j)) for j in range(6)])
    return np.array([int(name in sideways(axis)) for name in COMPONENTS])


def _most(axis: Axis, arc: Interval, n: int) -> int:
    """Highest degree, or number of harmonics, that n positions determine."""
    return (n - 1) // 2 if _closed(axis, arc) else n - 1
