"""The basis of every draw, chosen as `ncomp fit` does, for a whole chunk of draws at once.

Draws that stand at the same choice are judged together: each choice is factorised once for all of them.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibration.calibrate import SMALLER
from calibration.models import BasisChoice, distinct_positions, moving_axes
from calibration.resolution import FINEST, PRIOR, SIZES, START, Choice, check_kinds
from calibration.study.equations import BESIDES, Columns, Part, Sample
from calibration.study.solver import Fits
from calibration.study.unseen import Unseen
from kinematics.transforms import Array

Judge = Callable[[Choice, np.ndarray], Array]
"""Evidence `(draws,)` of a choice for some of the draws."""


@dataclass(frozen=True)
class Search:
    """What bases there are to choose from."""

    kinds: Sequence[str]
    rotary_kind: str | None
    prior_scale: float | None
    """None where the evidence decides."""
    most: Mapping[str, int]
    """Parameters of each axis at most."""

    @classmethod
    def of(cls, columns: Columns, kinds: Sequence[str], rotary_kind: str | None, prior_scale: float | None) -> Search:
        """The search for a measurement: no axis gets more parameters than there are positions of it."""
        check_kinds(kinds)
        measured = columns.measurement
        most = {axis: distinct_positions(measured, axis) for axis in moving_axes(measured)}
        few = {axis: number if axis[0] in "ABC" else min(number, FINEST) for axis, number in most.items()}
        return cls(kinds, rotary_kind, prior_scale, few)


def chosen(
    fits: Fits, drawn: Sample, search: Search, unseen: Unseen | None = None
) -> dict[tuple[tuple[Part, ...], float], np.ndarray]:
    """Numbers of the draws by the parts and the prior scale that they are fitted with.

    What their evidence prefers; of data on a few diagonals what best predicts lines `unseen`, if the prior is free.
    """
    evidence = _evidence(fits, drawn)
    best = _preferred(search, evidence, drawn)
    if unseen is not None and search.prior_scale is None:
        smaller = [_preferred(replace(search, prior_scale=scale), evidence, drawn) for scale in SMALLER]
        best = _predicting(unseen, drawn, best, smaller)
    return {(parts_of(fits, choice), choice.prior_scale): draws for choice, draws in _grouped(best)}


def _evidence(fits: Fits, drawn: Sample) -> Judge:
    right: dict[Part, Array] = {}

    def evidence(choice: Choice, draws: np.ndarray) -> Array:
        """Of one choice for each of some draws."""
        parts = parts_of(fits, choice)
        for part in parts:
            if part not in right:
                right[part] = fits.right(part, drawn)
        sums = np.concatenate([right[part][:, draws] for part in parts])
        made = fits.factorised(parts, choice.prior_scale)
        return np.asarray(0.5 * (np.sum(sums * made.solve(sums), axis=0) - made.log_determinant))

    return evidence


def _preferred(search: Search, evidence: Judge, drawn: Sample) -> list[Choice]:
    """The choice of each draw with the greatest evidence."""
    number = drawn.observed.shape[1]
    best, value = [_start(search.kinds[0], search)] * number, np.full(number, -np.inf)
    for kind in search.kinds:
        # from what all draws together prefer it is a short way for each of them
        start = _climbed([_start(kind, search)] * number, search, evidence, together=True)
        for choice, draws in _grouped(_climbed(start, search, evidence, together=False)):
            for draw, own in zip(draws.tolist(), evidence(choice, draws).tolist(), strict=True):
                if own > value[draw]:
                    best[draw], value[draw] = choice, own
    return best


def _predicting(
    unseen: Unseen, drawn: Sample, preferred: Sequence[Choice], smaller: Sequence[Sequence[Choice]]
) -> list[Choice]:
    """Of each draw's own choice and those with smaller priors, that whose fits best predict lines unseen."""
    best, least = list(preferred), np.full(len(preferred), np.inf)
    for choices in (preferred, *smaller):
        pairs = enumerate(zip(choices, preferred, strict=True))
        asked = [draw for draw, (one, own) in pairs if one is own or one.prior_scale < own.prior_scale]
        for choice, some in _grouped([choices[draw] for draw in asked]):
            draws = np.array(asked)[some]
            left = unseen.left(parts_of(unseen.fits, choice), choice.prior_scale, drawn.observed[:, draws])
            for draw in draws[left < least[draws]].tolist():
                best[draw] = choice
            least[draws] = np.minimum(least[draws], left)
    return best


def parts_of(fits: Fits, choice: Choice) -> tuple[Part, ...]:
    """The parts of the model of a choice."""
    return with_besides(fits.columns, choice.bases)


def with_besides(columns: Columns, bases: Mapping[str, BasisChoice]) -> tuple[Part, ...]:
    """The parts of a model with these bases."""
    besides = ((BESIDES, ""),) if columns.besides else ()
    return (*((axis, str(basis)) for axis, basis in bases.items()), *besides)


def _start(kind: str, search: Search) -> Choice:
    own = {axis: search.rotary_kind if search.rotary_kind and axis[0] in "ABC" else kind for axis in search.most}
    start = Choice(
        {axis: BasisChoice(own[axis], SIZES[own[axis]][START]) for axis in search.most}, search.prior_scale or 1.0
    )
    for axis in search.most:
        start = start.variants(axis, search.most)[:START][-1]
    return start


def _climbed(start: Sequence[Choice], search: Search, evidence: Judge, *, together: bool) -> list[Choice]:
    """Where each draw comes to, or all of them together, until no change of one part makes it better."""
    best, moving = list(start), np.arange(len(start))
    while len(moving):
        before = list(best)
        for part in [*search.most, *([PRIOR] if search.prior_scale is None else [])]:
            for choice, some in _grouped([best[draw] for draw in moving]):
                draws = moving[some]
                variants = [choice, *choice.variants(part, search.most)]
                values = np.stack([evidence(variant, draws) for variant in variants])
                if together:
                    values = np.broadcast_to(values.sum(axis=1, keepdims=True), values.shape)
                for k, draw in zip(np.argmax(values, axis=0).tolist(), draws.tolist(), strict=True):
                    best[draw] = variants[k]
        moving = np.array([draw for draw in moving if before[draw] != best[draw]], int)
    return best


def _grouped(choices: Sequence[Choice]) -> list[tuple[Choice, np.ndarray]]:
    """Numbers of the draws by their choice."""
    members: dict[str, list[int]] = defaultdict(list)
    for draw, choice in enumerate(choices):
        members[repr(choice)].append(draw)
    return [(choices[draws[0]], np.array(draws)) for draws in members.values()]
