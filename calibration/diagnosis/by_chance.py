"""Whether as much would have been found where there is nothing: in what is left, its signs at random.

Where much is left that no cause explains, residuals are neither even nor white, and a search over thousands of shapes
finds more in them than noise of their size allows; so may a cause that acts on a few rows. Signs drawn anew for every
row keep their sizes and whatever makes some rows larger than others, and destroy what a cause could follow (the wild
bootstrap of Wu 1986 and Liu 1988).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence

import numpy as np

from calibration.diagnosis import scans
from calibration.diagnosis.frame import Frame
from calibration.diagnosis.library import Candidate
from calibration.diagnosis.selection import Accepted

SMOOTH = (
    *("error-motion", "location", "cross-axis", "thermal-drift", "thermal-scale", "thermal-drift-sensor"),
    *("thermal-scale-sensor", "station-shift", "tracker-drift", "tracker-range", "air-scale", "tracker-angle"),
)
"""Kinds that do what another smooth function of their variables could do."""
DRAWS = 19
"""A cause that none of them matches is found by chance in at most one of twenty times."""
SEED = 1
SEARCHES: Mapping[str, Callable[[Frame], Iterable[Candidate]]] = {
    "cyclic": scans.waves,
    "quantised-compensation": scans.steps,
    "station-shift": scans.breaks,
}
"""How shapes are found, by kind of effect."""


def by_chance(frame: Frame, accepted: Accepted, library: Sequence[Candidate]) -> bool:
    """True where as much is found in what is left, its signs drawn at random; frame: that of the fit with the cause.

    A shape is searched for again, with all that the search may find; another cause is one of those of the library that
    have no shapes.
    """
    search, rng = SEARCHES.get(accepted.candidate.effect.kind), np.random.default_rng(SEED)
    if search is not None:
        some = frame.thinned(scans.SCANNED)
        return any(_best_shape(some.shuffled(rng), search) >= accepted.score.gain for _ in range(DRAWS))
    others = [each for each in library if each.effect.kind not in SMOOTH and each.effect.kind not in SEARCHES]
    projected = [(frame.projected(frame.columns(each.effect)), each.shapes) for each in [accepted.candidate, *others]]
    for _ in range(DRAWS):
        shuffled = frame.shuffled(rng)
        if max(shuffled.score(each, shapes).gain for each, shapes in projected) >= accepted.score.gain:
            return True
    return False


def _best_shape(frame: Frame, search: Callable[[Frame], Iterable[Candidate]]) -> float:
    scores = (frame.score(frame.projected(frame.columns(each.effect)), each.shapes) for each in search(frame))
    return max((score.gain for score in scores), default=0.0)
