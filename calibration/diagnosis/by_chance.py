"""Whether as much would have been found where there is nothing: in what is left, its signs at random.

Where much is left that no cause explains, residuals are neither even nor white, and a search over thousands of shapes
finds more in them than noise of their size allows; so may a cause that acts on a few rows. Signs drawn anew for every
row keep their sizes and whatever makes some rows larger than others, and destroy what a cause could follow (the wild
bootstrap of Wu 1986 and Liu 1988).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field

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


@dataclass
class Chance:
    """What is found in what a fit leaves, the signs of its rows drawn at random."""

    frame: Frame
    """Of the fit with all causes."""
    library: Sequence[Candidate]
    _most: dict[str, float] = field(init=False, default_factory=dict)
    """The largest gains, by kind of search."""

    def finds(self, accepted: Accepted) -> bool:
        """True where one of the draws holds as much as an accepted cause is worth.

        A shape is searched for again, with all that the search may find; another cause is one of those of the library
        that have no shapes.
        """
        if accepted.score.gain > self.frame.squares:
            return False  # there is not as much
        kind = accepted.candidate.effect.kind
        if kind not in self._most:
            self._most[kind] = self._of_shapes(SEARCHES[kind]) if kind in SEARCHES else self._of_library(accepted)
        return self._most[kind] >= accepted.score.gain

    def _of_shapes(self, search: Callable[[Frame], Iterable[Candidate]]) -> float:
        rng, some = np.random.default_rng(SEED), self.frame.thinned(scans.SCANNED)
        gains = [
            shuffled.score(shuffled.projected(shuffled.columns(found.effect)), found.shapes).gain
            for shuffled in (some.shuffled(rng) for _ in range(DRAWS))
            for found in search(shuffled)
        ]
        return max(gains, default=0.0)

    def _of_library(self, accepted: Accepted) -> float:
        rng, frame = np.random.default_rng(SEED), self.frame
        others = [each for each in self.library if each.effect.kind not in SMOOTH and each.effect.kind not in SEARCHES]
        tried = [(frame.projected(frame.columns(one.effect)), one.shapes) for one in [accepted.candidate, *others]]
        draws = [frame.shuffled(rng) for _ in range(DRAWS)]
        return max(shuffled.score(projected, shapes).gain for shuffled in draws for projected, shapes in tried)
