"""Causes that the design of a measurement can show and separate, by their columns alone: no reading enters.

A cause is not visible where model and registration imitate nearly all of its signal. It is tied to another one that
imitates the visible part of its signal with no more free choices, whatever their sizes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal, NamedTuple

import numpy as np

from calibration.diagnosis.not_visible import shown_by
from calibration.diagnosis.search.candidates import Candidate
from calibration.diagnosis.search.evaluation import EVEN, SEEN, complexity
from calibration.diagnosis.search.linearised_fit import LinearisedFit
from calibration.diagnosis.search.score import Projected
from calibration.fit.linear import pseudo_inverse
from kinematics.transforms import Array

ROWS = 1500
"""Most rows, evenly spread, on which columns are compared."""
SAME = 6
"""Decimals of a cosine, beyond which causes with equal signals differ by rounding only: they are ordered by name."""
ALIKE = 0.9
"""Cosine from which a design does not separate two causes."""
PARALLEL = 1e-9
"""Share of the largest eigenvalue below which a combination of columns counts as parallel to others."""


class Separability(NamedTuple):
    """A cause of the library in the design of a measurement."""

    kind: str
    name: str
    verdict: Literal["visible", "tied", "not visible"]
    share: float
    """Share of its signal that neither the model nor the registration can imitate."""
    tied_with: tuple[tuple[str, float], ...]
    """Names of the causes from which it cannot be separated, the most similar first, with the cosines."""
    remedy: str
    """Measurement that would show it."""


def separability(linearised: LinearisedFit, library: Sequence[Candidate]) -> list[Separability]:
    """Each cause of a library, by its first variant, in the design of a linearised fit."""
    linearised = _unweighted(linearised.thinned(ROWS))
    causes = list({each.effect.name: each for each in reversed(library)}.values())[::-1]
    apart = linearised.candidates([each.effect for each in causes])
    seen = [i for i, one in enumerate(apart) if one.visible >= SEEN]
    ties: dict[int, list[tuple[str, float]]] = {i: [] for i in range(len(causes))}
    for (i, j), cosine in _cosines([apart[i] for i in seen]).items():
        own, other = causes[seen[i]], causes[seen[j]]
        log_odds = (complexity(other) - complexity(own)) * float(np.log(linearised.scalars)) / 2.0
        if log_odds < EVEN:
            ties[seen[i]].append((other.effect.name, cosine))
    return [
        Separability(
            each.kind,
            each.effect.name,
            "not visible" if one.visible < SEEN else "tied" if ties[i] else "visible",
            one.visible,
            tuple(sorted(ties[i], key=lambda tie: (-round(tie[1], SAME), tie[0]))),
            shown_by(each),
        )
        for i, (each, one) in enumerate(zip(causes, apart, strict=True))
    ]


def _unweighted(linearised: LinearisedFit) -> LinearisedFit:
    """The linearised fit with the specified noise in every row: robust weights and a variance factor are readings'."""
    factor = np.sqrt(linearised.fit.variance_factor / linearised.weights)
    rows = np.repeat(factor, linearised.scalars // len(factor))
    return replace(
        linearised,
        white=linearised.white * factor[:, None, None],
        transform=linearised.transform * factor[:, None, None],
        design=linearised.design * rows[:, None],
        weights=np.ones(len(factor)),
    )


def _cosines(apart: Sequence[Projected]) -> dict[tuple[int, int], float]:
    """Cosines from `ALIKE` on between the signal of one cause, of any size, and the columns of another."""
    if not apart:
        return {}
    ends = np.cumsum([0, *(len(one.schur) for one in apart)])
    columns = np.concatenate([one.columns for one in apart], axis=1)
    through = np.concatenate([one.through for one in apart], axis=1)
    shared: Array = columns.T @ columns - through.T @ through
    found = {}
    for j, other in enumerate(apart):
        root = pseudo_inverse((other.schur + other.schur.T) / 2.0, PARALLEL).root
        along = root.T @ shared[ends[j] : ends[j + 1]]
        imitated = np.add.reduceat(np.sum(along**2, axis=0), ends[:-1])
        for i, own in enumerate(apart):
            cosine = float(np.sqrt(min(imitated[i] / np.trace(own.schur), 1.0)))
            if i != j and cosine >= ALIKE:
                found[i, j] = cosine
    return found
