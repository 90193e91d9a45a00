"""How finely the error motions of each axis are written: chosen by the evidence, the probability of the data.

Too coarse a basis leaves a misfit that no number of points averages out; too fine a one is paid for in the determinant.
All sizes of one axis after the other are tried until none is better.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibration.fit import Fit, Progress, fit
from calibration.measurement import Measurement
from calibration.models import BasisChoice, distinct_positions, moving_axes, with_effects
from calibration.problem import Point, Problem
from kinematics.effects import Effect
from kinematics.errors import UserError

SIZES: Mapping[str, tuple[int, ...]] = {
    "b-spline": (2, 3, 4, 5, 6, 8, 10, 12, 16, 20, 24, 32, 48),
    "cubic": (2, 3, 4, 5, 6, 8, 10, 12, 16, 20, 24, 32, 48),
    "legendre": (1, 2, 3, 4, 5, 6, 8, 10, 12, 16),
    "polynomial": (1, 2, 3, 4, 5, 6, 8),
    "fourier": (1, 2, 3, 4, 6, 8, 12, 16),
}
PRIOR_SCALES = (0.1, 0.2, 0.3, 0.5, 1.0, 2.0, 5.0, 10.0)
"""Of the typical sizes."""
PRIOR = "prior"
START = 4
"""Where in SIZES the search begins."""
FINE = 24
"""Nodes of the first fit."""
ROWS = 5000
"""At most so many rows, evenly spread, decide."""


@dataclass(frozen=True)
class Choice:
    """Basis of each axis, and the size of the errors as a multiple of the typical ones."""

    bases: Mapping[str, BasisChoice]
    prior_scale: float = 1.0

    def variants(self, part: str, most: Mapping[str, int]) -> list[Choice]:
        """Choices that differ in one part: an axis, with at most so many parameters, or the prior."""
        if part == PRIOR:
            return [replace(self, prior_scale=scale) for scale in PRIOR_SCALES]
        kind = self.bases[part].kind
        sizes = [BasisChoice(kind, size) for size in SIZES[kind]]
        few = [basis for basis in sizes if basis.over((0.0, 1.0)).size <= most[part]]
        return [replace(self, bases={**self.bases, part: basis}) for basis in few or sizes[:1]]


def choose(
    measurement: Measurement,
    kinds: Sequence[str],
    *,
    rotary_kind: str | None = None,
    effects: Sequence[Effect] = (),
    prior_scale: float | None = None,
    progress: Progress = lambda _: None,
) -> Choice:
    """The choice with the greatest evidence, all axes in the same kind of basis, one of `kinds`.

    rotary_kind: another kind for rotary axes. effects: what is fitted besides. A given prior_scale stays. No axis gets
    more parameters than there are positions of it. A first fit finds outliers, registration and, where the sheet
    promises too much, the size of the noise. UserError for a kind that there is not.
    """
    unknown = [kind for kind in kinds if kind not in SIZES]
    if unknown:
        raise UserError(f"basis auto:{unknown[0]}: there is none of that kind ({', '.join(SIZES)})")
    axes = list(moving_axes(measurement))
    most = {axis: distinct_positions(measurement, axis) for axis in axes}
    fine = {axis: BasisChoice("b-spline", max(2, min(FINE, most[axis]))) for axis in axes}
    first = fit(measurement, with_effects(measurement, fine, effects, 1.0)[0], variance="estimate")
    known: dict[str, float] = {}

    def evidence(choice: Choice) -> float:
        key = repr(choice)
        if key not in known:
            known[key] = _evidence(first, choice, effects)
        return known[key]

    parts = [*axes, *([PRIOR] if prior_scale is None else [])]
    found = []
    for kind in kinds:
        own = {axis: rotary_kind if rotary_kind and axis[0] in "ABC" else kind for axis in axes}
        start = Choice({axis: BasisChoice(own[axis], SIZES[own[axis]][START]) for axis in axes}, prior_scale or 1.0)
        for axis in axes:
            start = start.variants(axis, most)[:START][-1]
        found.append(_climb(start, parts, most, evidence, progress))
    return max(found, key=evidence)


def _climb(
    best: Choice,
    parts: Sequence[str],
    most: Mapping[str, int],
    evidence: Callable[[Choice], float],
    progress: Progress,
) -> Choice:
    """The choice that no change of one part makes better."""
    while True:
        before = best
        for part in parts:
            progress("choosing the basis: " + ", ".join(f"{axis} {basis}" for axis, basis in best.bases.items()))
            best = max((best, *best.variants(part, most)), key=evidence)
        if best == before:
            return best


def _evidence(first: Fit, choice: Choice, effects: Sequence[Effect]) -> float:
    """Log marginal likelihood, up to a constant of the data, to first order about the first registration."""
    factor = max(first.variance_factor, 1.0)
    rows = np.flatnonzero(first.kept)
    some = rows[np.linspace(0, len(rows) - 1, min(len(rows), ROWS)).astype(int)]
    model, prior = with_effects(first.measurement, choice.bases, effects, choice.prior_scale)
    problem = Problem.of(first.measurement.rows(some), model, prior)
    # what is fitted besides stays as the first fit found it, and may move from there
    parameters = np.zeros(len(model.parameters))
    besides = sum(len(effect.parameters) for effect in effects)
    parameters[len(parameters) - besides :] = first.model.parameters[len(first.prior) - besides :]
    point = Point(parameters, first.registration)
    solved = problem.solve(point, np.ones(len(some)), factor)
    squares = float(np.sum(problem.distances(point))) / factor
    return -0.5 * (squares - solved.reduction + solved.log_determinant)
