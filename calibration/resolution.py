"""How finely the error motions of each axis are written: chosen by the evidence, the probability of the data.

Too coarse a basis leaves a misfit that no number of points averages out; too fine a one is paid for in the determinant.
All sizes of one axis after the other are tried until none is better.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from itertools import pairwise

import msgspec
import numpy as np

from calibration import equations
from calibration.cores import each
from calibration.fit import Fit, Progress, fit
from calibration.measurement import Measurement
from calibration.models import (
    BasisChoice,
    axis_effects,
    distinct_positions,
    moving_axes,
    parse_basis,
    priors,
    with_effects,
)
from calibration.normal import Normal, residuals, whitened, whiteners
from calibration.problem import solution
from kinematics.effects import Effect
from kinematics.errors import UserError
from kinematics.model import Design, ErrorModel, no_errors
from kinematics.transforms import Array

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
FINEST = 48
"""Parameters of a linear axis at most."""
FINE = 24
"""Nodes of the first fit."""
ROWS = 5000
"""At most so many rows, evenly spread, decide."""
KEPT = 250_000_000
"""Bytes of columns that are kept, beside the blocks."""
Part = tuple[str, str]
"""Axis and basis, or one of the two others."""
REGISTRATION: Part = ("", "registration")
BESIDES: Part = ("", "besides")


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
    finest: int = FINEST,
    progress: Progress = lambda _: None,
) -> Choice:
    """The choice with the greatest evidence, all axes in the same kind of basis, one of `kinds`.

    rotary_kind: another kind for rotary axes. effects: what is fitted besides. A given prior_scale stays. No axis gets
    more parameters than there are positions of it, and no linear one more than `finest`. A first fit finds outliers,
    registration and, where the sheet promises too much, the size of the noise. UserError for a kind that there is not.
    """
    check_kinds(kinds)
    axes = list(moving_axes(measurement))
    most = {axis: distinct_positions(measurement, axis) for axis in axes}
    most |= {axis: min(number, finest) for axis, number in most.items() if axis[0] not in "ABC"}
    fine = {axis: BasisChoice("b-spline", max(2, min(FINE, most[axis]))) for axis in axes}
    first = fit(measurement, with_effects(measurement, fine, effects, 1.0)[0], variance="estimate")
    evidence = Evidence(first, effects)
    parts = [*axes, *([PRIOR] if prior_scale is None else [])]
    found = []
    for kind in kinds:
        own = {axis: rotary_kind if rotary_kind and axis[0] in "ABC" else kind for axis in axes}
        start = Choice({axis: BasisChoice(own[axis], SIZES[own[axis]][START]) for axis in axes}, prior_scale or 1.0)
        for axis in axes:
            start = start.variants(axis, most)[:START][-1]
        found.append(_climb(start, parts, most, evidence, progress))
    return max(found, key=evidence)


def finer(choice: Choice, measurement: Measurement, margin: int) -> Choice:
    """The choice with the bases of all axes so many sizes finer, as far as there are positions.

    The evidence tolerates a misfit of the order of u, which u does not hold; where data are dense, a finer basis costs
    less than that.
    """
    bases = dict(choice.bases)
    for axis, basis in choice.bases.items():
        most = min(distinct_positions(measurement, axis), FINEST if axis[0] not in "ABC" else np.inf)
        sizes = [size for size in SIZES[basis.kind] if size > basis.size]
        few = [BasisChoice(basis.kind, s) for s in sizes if BasisChoice(basis.kind, s).over((0.0, 1.0)).size <= most]
        bases[axis] = few[:margin][-1] if few[:margin] else basis
    return replace(choice, bases=bases)


def check_kinds(kinds: Sequence[str]) -> None:
    """UserError for a kind of basis that there is not."""
    unknown = [kind for kind in kinds if kind not in SIZES]
    if unknown:
        raise UserError(f"basis auto:{unknown[0]}: there is none of that kind ({', '.join(SIZES)})")


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
            own = evidence(best)
            others = [choice for choice in best.variants(part, most) if choice != best]
            found = [own, *each(evidence, others)]
            best = [best, *others][int(np.argmax(found))]
        if best == before:
            return best


class Evidence:
    """Log marginal likelihood of choices, up to a constant of the data, to first order about a first fit.

    The normal equations of a choice are put together from blocks, one for each pair of its parts (registration, each
    axis in its basis, what is fitted besides): each block is made once, however many choices share it.
    """

    def __init__(self, first: Fit, effects: Sequence[Effect]) -> None:
        rows = np.flatnonzero(first.kept)
        some = rows[np.linspace(0, len(rows) - 1, min(len(rows), ROWS)).astype(int)]
        self._measurement, self._registration = first.measurement.rows(some), first.registration
        self._factor = max(first.variance_factor, 1.0)
        self._effects = tuple(effects)
        # what is fitted besides stays as the first fit found it, and may move from there
        besides = sum(len(effect.parameters) for effect in effects)
        self._besides = first.model.parameters[len(first.prior) - besides :]
        self._white = whiteners(self._measurement) / np.sqrt(self._factor)
        self._transform = self._white @ equations.transform(self._measurement, self._registration)
        at_start = msgspec.structs.replace(no_errors(self._measurement.machine), effects=self._effects)
        left = residuals(self._measurement, at_start.with_parameters(self._besides), self._registration)
        self._residual = whitened(self._white, left).reshape(-1)
        widest = 6 * (FINEST + 2) * self._residual.nbytes
        self._columns = lru_cache(maxsize=max(KEPT // widest, len(self._measurement.machine.axes) + 4))(self._made)
        self._right = cache(self._along)
        self._priors = cache(self._typical)
        own = self._priors(BESIDES)
        start = np.array([value for effect in effects for value in effect.parameters])
        self._moved = np.where(np.isfinite(own), (self._besides - start) / own, 0.0)
        self._blocks: dict[tuple[Part, Part], Array] = {}
        self._known: dict[str, float] = {}

    def __call__(self, choice: Choice) -> float:
        """The evidence of a choice."""
        key = repr(choice)
        if key not in self._known:
            self._known[key] = self._evidence(choice)
        return self._known[key]

    def _evidence(self, choice: Choice) -> float:
        axes: list[Part] = [(axis, str(basis)) for axis, basis in choice.bases.items()]
        parts = [REGISTRATION, *axes, BESIDES]
        right = np.concatenate([self._right(part) for part in parts])
        matrix, ends = np.empty((len(right),) * 2), np.cumsum([0, *(len(self._right(part)) for part in parts)])
        places = [slice(start, end) for start, end in pairwise(ends.tolist())]
        for a, rows in zip(parts, places, strict=True):
            for b, columns in zip(parts, places, strict=True):
                matrix[rows, columns] = self._block(a, b)
        prior = np.concatenate([*(choice.prior_scale * self._priors(part) for part in axes), self._priors(BESIDES)])
        away = np.zeros(len(prior))
        away[len(prior) - len(self._moved) :] = self._moved
        solved = solution(Normal(matrix, right), self._registration, prior, away)
        return -0.5 * (float(self._residual @ self._residual) - solved.reduction + solved.log_determinant)

    def _block(self, a: Part, b: Part) -> Array:
        if (a, b) not in self._blocks:
            self._blocks[a, b] = self._columns(a).T @ self._columns(b)
            self._blocks[b, a] = self._blocks[a, b].T
        return self._blocks[a, b]

    def _along(self, part: Part) -> Array:
        """The residual `(parameters,)` along the columns of a part."""
        return np.asarray(self._residual @ self._columns(part))

    def _typical(self, part: Part) -> Array:
        """Priors `(parameters,)` of a part."""
        return priors(self._model(part))

    def _made(self, part: Part) -> Array:
        """Whitened derivatives `(n * d, parameters)` by the parameters of a part."""
        if part == REGISTRATION:
            columns = self._white @ equations.registration_design(self._measurement, self._registration)
        else:
            machine, state = self._measurement.machine, self._measurement.state
            columns = Design(self._model(part), machine, state, with_instrument=True).of(slice(None), self._transform)
        return np.asarray(columns.reshape(len(self._residual), -1))

    def _model(self, part: Part) -> ErrorModel:
        """The effects of a part: of an axis in its basis, or those fitted besides."""
        axis, basis = part
        own = self._effects if part == BESIDES else axis_effects(self._measurement, axis, parse_basis(basis))
        model = msgspec.structs.replace(no_errors(self._measurement.machine), effects=tuple(own))
        return model.with_parameters(self._besides) if part == BESIDES else model
