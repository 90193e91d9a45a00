"""Causes that are accepted together and mostly cancel each other: together they imitate one that has no name.

Signals of independent causes add up like noise: the square of their sum is about the sum of their squares. Where
several effects are combined to the form of another one, each is large and cancels the excess of the others.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.sparse.csgraph import connected_components

from calibration.diagnosis.search.linearised_fit import LinearisedFit
from calibration.diagnosis.search.stage import Accepted
from kinematics.transforms import Array

RATIO = 1.5
"""Least sum of squares of the signals of imitating causes, as a multiple of the square of their sum."""
ALIKE = 0.3
"""Least cosine, of either sign, between signals that are compared with each other."""
HEAT = ("thermal-drift", "thermal-scale")
"""Kinds whose effects are parts of one cause: a vector, and a growth whose fixed point may be anywhere."""
GEOMETRY = ("higher-frequency", "location", "scale", "wobble", "racking")
"""Kinds that are coefficients of one geometry: they may cancel each other."""


def cancelling(bare: LinearisedFit, accepted: Sequence[Accepted]) -> list[Accepted]:
    """Those of the accepted causes that mostly cancel each other; bare: the linearised fit without any of them."""
    judged = [each for each in accepted if each.candidate.kind not in GEOMETRY]
    groups = [[each for each in judged if each.candidate.kind in HEAT]]
    groups += [[each] for each in judged if each.candidate.kind not in HEAT]
    groups = [group for group in groups if group]
    if len(groups) < 2:
        return []
    signals = bare.projected(np.stack([_signal(bare, group) for group in groups], axis=1)).schur
    sizes = np.sqrt(np.maximum(np.diag(signals), 0.0))
    related = np.abs(signals) > ALIKE * np.outer(sizes, sizes)
    count, labels = connected_components(related, directed=False)
    found = []
    for label in range(count):
        own = np.flatnonzero(labels == label)
        if sizes[own] @ sizes[own] > RATIO * signals[np.ix_(own, own)].sum():
            found += [each for number in own.tolist() for each in groups[number]]
    return found


def _signal(bare: LinearisedFit, group: Sequence[Accepted]) -> Array:
    """Sum `(N,)` of the whitened signals of some causes."""
    return np.asarray(sum(bare.columns(each.candidate.effect) @ each.size for each in group))
