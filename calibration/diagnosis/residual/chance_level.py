"""Chance level of causes: the gain that the same search finds in the residuals with random signs.

Where no cause explains a large part of them, residuals are neither homogeneous nor white. A search over thousands of
shapes then finds more in them than in noise of their size; so may a cause that acts on a few rows. A random sign for
every line (else stop) keeps the sizes of the residuals, whatever makes some rows larger than others, and the course
along a line, but destroys every course that recurs from line to line, as that of a cause does (the wild bootstrap of Wu
1986 and Liu 1988, by clusters of rows).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from calibration.diagnosis.search import proposed_shapes as scans
from calibration.diagnosis.search.candidates import HIGHER_FREQUENCY, Candidate
from calibration.diagnosis.search.linearised_fit import LinearisedFit

SMOOTH = (
    *("error-motion", "location", "cross-axis", "thermal-drift", "thermal-scale", "thermal-drift-sensor"),
    *("thermal-drift-workpiece", "thermal-drift-workpiece-sensor"),
    *("thermal-scale-sensor", "station-shift", "tracker-drift", "tracker-range", "air-scale", "tracker-angle"),
)
"""Kinds that another smooth function of their variables could imitate."""
DRAWS = 19
"""Random draws: a cause that exceeds all of them is found by chance at most once in twenty times."""
SEED = 1
SEARCHES: Mapping[str, Callable[[LinearisedFit], Iterable[Candidate]]] = {
    "cyclic": scans.waves,
    "quantised-compensation": scans.steps,
    "station-shift": scans.breaks,
    HIGHER_FREQUENCY: scans.finer,
}
"""Search for shapes, by kind of cause."""


@dataclass
class Chance:
    """Gains found in the residuals of a fit, the signs of its rows drawn at random."""

    linearised: LinearisedFit
    """The fit with all causes."""
    library: Sequence[Candidate]
    _draws: dict[str, Iterator[float]] = field(init=False, default_factory=dict)
    _known: dict[str, list[float]] = field(init=False, default_factory=dict)
    """Largest gain of each draw so far, by kind of cause."""

    def finds(self, candidate: Candidate, gain: float) -> bool:
        """True where one of the draws reaches the gain of a candidate.

        A kind with a search is searched for again, over all its shapes. Any other cause is itself tried, together with
        the causes of the library that are neither smooth nor searched for.
        """
        if gain > self.linearised.squares:
            return False  # no draw has as many squares
        kind = candidate.kind
        if kind not in self._draws:
            self._draws[kind] = self._shapes(SEARCHES[kind]) if kind in SEARCHES else self._of_library(candidate)
        known = self._known.setdefault(kind, [])
        while max(known, default=0.0) < gain:
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
            responses = shuffled.responses([each.effect for each in found])
            scores = (shuffled.score(one, each.shapes) for one, each in zip(responses, found, strict=True))
            yield max((score.gain for score in scores), default=0.0)

    def _of_library(self, candidate: Candidate) -> Iterator[float]:
        rng, linearised = np.random.default_rng(SEED), self.linearised
        others = [each for each in self.library if each.effect.kind not in SMOOTH and each.kind not in SEARCHES]
        tried = [candidate, *others]
        responses = linearised.responses([each.effect for each in tried])
        for _ in range(DRAWS):
            shuffled = linearised.shuffled(rng)
            yield max(shuffled.score(one, each.shapes).gain for one, each in zip(responses, tried, strict=True))
