"""Chance level of causes: the gain that the same search finds in the residuals with random signs.

Where no cause explains a large part of them, residuals are neither homogeneous nor white. A search over thousands of
shapes then finds more in them than in noise of their size; so may a cause that acts on a few rows. A random sign for
every line (else stop) keeps the sizes of the residuals, whatever makes some rows larger than others, and the course
along a line, but destroys every course that recurs from line to line, as that of a cause does (the wild bootstrap of Wu
1986 and Liu 1988, by clusters of rows).
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from calibration.diagnosis.residual.found_again import found_again
from calibration.diagnosis.search.candidates import HIGHER_FREQUENCY, Candidate
from calibration.diagnosis.search.evaluation import Evaluated
from calibration.diagnosis.search.linearised_fit import LinearisedFit
from calibration.diagnosis.search.shapes import proposed_shapes as scans
from calibration.diagnosis.search.shapes.change_points import breaks, turning_points

SMOOTH = (
    *("error-motion", "location", "cross-axis", "thermal-drift", "thermal-scale", "thermal-drift-sensor"),
    *("thermal-drift-workpiece", "thermal-drift-workpiece-sensor"),
    *("thermal-scale-sensor", "station-shift", "tracker-drift", "tracker-range", "air-scale", "tracker-angle"),
)
"""Kinds that another smooth function of their variables could imitate."""
DRAWS, FALSE = 19, 0.01
"""Random draws, all of which a cause must exceed, and the chance of its gain by the distribution of theirs."""
ENOUGH, CLEARLY = 7, 1.5
"""Draws that suffice where a gain is so many times as large as the one that has this chance by their distribution."""
SEED = 1
SEARCHES: Mapping[str, Callable[[LinearisedFit], Iterable[Candidate]]] = {
    "cyclic": scans.waves,
    "quantised-compensation": scans.steps,
    "station-shift": breaks,
    "tracker-angle-step": turning_points,
    HIGHER_FREQUENCY: scans.finer,
}
"""Search for shapes, by kind of effect."""
PERIODIC = ("cyclic", "quantised-compensation")
"""Kinds of cause whose periods are searched for."""


def searched(candidate: Candidate) -> str:
    """Kind of the effect of a candidate, the key of its search for shapes; a finer error motion is one of its own."""
    return HIGHER_FREQUENCY if candidate.replaces else candidate.effect.kind


@dataclass
class Chance:
    """Gains found in the residuals of a fit, the signs of its rows drawn at random."""

    linearised: LinearisedFit
    """The fit with all causes."""
    library: Sequence[Candidate]
    _draws: dict[str, Iterator[float]] = field(init=False, default_factory=dict)
    _known: dict[str, list[float]] = field(init=False, default_factory=dict)
    """Largest gain of each draw, by kind of cause."""

    def finds(self, candidate: Candidate, gain: float) -> bool:
        """True where one of the draws reaches the gain of a candidate.

        A kind with a search is searched for again, over all its shapes. Any other cause is itself tried, together with
        the causes of the library that are neither smooth nor searched for.
        """
        if gain > self.linearised.squares:
            return False  # no draw has as many squares
        kind = searched(candidate)
        if kind not in self._draws:
            self._draws[kind] = self._shapes(SEARCHES[kind]) if kind in SEARCHES else self._of_library(candidate)
        known = self._known.setdefault(kind, [])
        while max(known, default=0.0) < gain:
            if len(known) >= ENOUGH and gain > CLEARLY * _largest(known):
                return False
            more = next(self._draws[kind], None)
            if more is None:
                return gain < _largest(known)
            known.append(more)
        return True

    def _shapes(self, search: Callable[[LinearisedFit], Iterable[Candidate]]) -> Iterator[float]:
        rng, some = np.random.default_rng(SEED), self.linearised.thinned(scans.SCANNED)
        for shuffled in some.draws(rng, DRAWS):
            found = list(search(shuffled))
            responses = shuffled.responses([each.effect for each in found])
            scores = (shuffled.score(one, each.shapes) for one, each in zip(responses, found, strict=True))
            yield max((score.gain for score in scores), default=0.0)

    def _of_library(self, candidate: Candidate) -> Iterator[float]:
        rng, linearised = np.random.default_rng(SEED), self.linearised
        others = [each for each in self.library if each.effect.kind not in SMOOTH and searched(each) not in SEARCHES]
        tried = [candidate, *others]
        responses = linearised.responses([each.effect for each in tried])
        for shuffled in linearised.draws(rng, DRAWS):
            yield max(shuffled.score(one, each.shapes).gain for one, each in zip(responses, tried, strict=True))


def _largest(gains: Sequence[float]) -> float:
    """Gain that random signs exceed in `FALSE` of all draws: largest gains of a search have a Gumbel distribution."""
    scale = float(np.std(gains)) * np.sqrt(6.0) / np.pi
    return float(np.mean(gains) - scale * (np.euler_gamma + np.log(-np.log1p(-FALSE))))


@dataclass
class ByChance:
    """Doubt about searched shapes.

    True where the same search does not find a shape again without each held-out block, or finds as much in residuals
    with random signs.
    """

    library: Sequence[Candidate]
    kinds: Collection[str] = tuple(SEARCHES)
    """Kinds of effect that are doubted."""
    _latest: Chance | None = field(init=False, default=None)

    def __call__(self, linearised: LinearisedFit, evaluated: Evaluated) -> bool:
        """True for a candidate of these kinds whose gain on a linearised fit chance reaches."""
        if searched(evaluated.candidate) not in self.kinds:
            return False
        if not found_again(linearised, evaluated.candidate.effect):
            return True
        if self._latest is None or self._latest.linearised is not linearised:
            self._latest = Chance(linearised, self.library)
        return self._latest.finds(evaluated.candidate, evaluated.score.gain)
