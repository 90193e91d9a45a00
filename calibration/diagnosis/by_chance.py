"""Whether a search for a shape would have found as much where there is nothing: what is left, its signs at random.

Where much is left that no cause explains, residuals are neither even nor white, and a search over thousands of shapes
finds more in them than noise of their size allows. Signs drawn anew for every row keep their sizes and whatever makes
some rows larger than others, and destroy what a shape could follow (the wild bootstrap of Wu 1986 and Liu 1988).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping

import numpy as np

from calibration.diagnosis import scans
from calibration.diagnosis.frame import Frame
from calibration.diagnosis.library import Candidate
from calibration.diagnosis.selection import Accepted

DRAWS = 19
"""A shape that none of them matches is found by chance in at most one of twenty searches."""
SEED = 1
SEARCHES: Mapping[str, Callable[[Frame], Iterable[Candidate]]] = {
    "cyclic": scans.waves,
    "quantised-compensation": scans.steps,
    "station-shift": scans.breaks,
}
"""By kind of effect."""


def searched(accepted: Accepted) -> bool:
    """True for a cause whose shape was found by a search."""
    return accepted.candidate.effect.kind in SEARCHES


def by_chance(frame: Frame, accepted: Accepted) -> bool:
    """True where the same search finds as much in what is left, its signs drawn at random; frame: with the cause."""
    rng, some = np.random.default_rng(SEED), frame.thinned(scans.SCANNED)
    return any(_best(some.shuffled(rng), accepted.candidate.effect.kind) >= accepted.score.gain for _ in range(DRAWS))


def _best(frame: Frame, kind: str) -> float:
    scores = (
        frame.score(frame.projected(frame.columns(found.effect)), found.shapes) for found in SEARCHES[kind](frame)
    )
    return max((score.gain for score in scores), default=0.0)
