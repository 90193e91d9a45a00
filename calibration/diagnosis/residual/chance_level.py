"""Whether as much would have been found where there is nothing: in what is left, its signs at random.

Where much is left that no cause explains, residuals are neither even nor white, and a search over thousands of shapes
finds more in them than noise of their size allows; so may a cause that acts on a few rows. Signs drawn anew for every
row keep their sizes and whatever makes some rows larger than others, and destroy what a cause could follow (the wild
bootstrap of Wu 1986 and Liu 1988).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from calibration.diagnosis.search import proposed_shapes as scans
from calibration.diagnosis.search.candidates import Candidate
from calibration.diagnosis.search.linearised_fit import LinearisedFit
from calibration.diagnosis.search.selection import Accepted

SMOOTH = (
    *("error-motion", "location", "cross-axis", "thermal-drift", "thermal-scale", "thermal-drift-sensor"),
    *("thermal-scale-sensor", "station-shift", "tracker-drift", "tracker-range", "air-scale", "tracker-angle"),
)
"""Kinds that do what another smooth function of their variables could do."""
DRAWS = 19
"""A cause that none of them matches is found by chance in at most one of twenty times."""
SEED = 1
SEARCHES: Mapping[str, Callable[[LinearisedFit], Iterable[Candidate]]] = {
    "cyclic": scans.waves,
    "quantised-compensation": scans.steps,
    "station-shift": scans.breaks,
}
"""How shapes are found, by kind of effect."""


@dataclass
class Chance:
    """What is found in what a fit leaves, the signs of its rows drawn at random."""

    linearised: LinearisedFit
    """Of the fit with all causes."""
    library: Sequence[Candidate]
    _draws: dict[str, Iterator[float]] = field(init=False, default_factory=dict)
    _known: dict[str, list[float]] = field(init=False, default_factory=dict)
    """The largest gain of each draw so far, by kind of effect."""

    def finds(self, accepted: Accepted) -> bool:
        """True where one of the draws holds as much as an accepted cause is worth.

        A shape is searched for again, with all that the search may find; another cause is one of those of the library
        that have no shapes.
        """
        if accepted.score.gain > self.linearised.squares:
            return False  # there is not as much
        kind = accepted.candidate.effect.kind
        if kind not in self._draws:
            self._draws[kind] = self._shapes(SEARCHES[kind]) if kind in SEARCHES else self._of_library(accepted)
        known = self._known.setdefault(kind, [])
        while max(known, default=0.0) < accepted.score.gain:
            more = next(self._draws[kind], None)
            if more is None:
                return False
            known.append(more)
        return True

    def _shapes(self, search: Callable[[LinearisedFit], Iterable[Candidate]]) -> Iterator[float]:
        rng, some = np.random.default_rng(SEED), self.linearised.thinned(scans.SCANNED)
        for _ in range(DRAWS):
            shuffled = some.shuffled(rng)
            found = list(search(shuffled))
            left = shuffled.responses([each.effect for each in found])
            scores = (shuffled.score(one, each.shapes) for one, each in zip(left, found, strict=True))
            yield max((score.gain for score in scores), default=0.0)

    def _of_library(self, accepted: Accepted) -> Iterator[float]:
        rng, linearised = np.random.default_rng(SEED), self.linearised
        others = [each for each in self.library if each.effect.kind not in SMOOTH and each.effect.kind not in SEARCHES]
        tried = [accepted.candidate, *others]
        left = linearised.responses([each.effect for each in tried])
        for _ in range(DRAWS):
            shuffled = linearised.shuffled(rng)
            yield max(shuffled.score(one, each.shapes).gain for one, each in zip(left, tried, strict=True))
