"""The last fits of a selection: the same causes come back after other steps, and each fit is made once."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TypeVar

import numpy as np

from calibration.diagnosis.search.candidates import Candidate
from calibration.diagnosis.search.start_model import Base, prior_of
from calibration.fit.fit import Fit
from calibration.fit.noise import WithNoise
from calibration.measurement.measurement import Measurement
from calibration.observation.outliers import Variance

RECENT = 24
"""Number of fits of each kind that are kept."""
Key = tuple[object, ...]
Kept = TypeVar("Kept")


@dataclass(frozen=True)
class RecentFits:
    """The last fits to one measurement, by the bases, the causes and their priors."""

    first: dict[Key, WithNoise] = field(default_factory=dict)
    """With the noise of the measurement."""
    fits: dict[Key, Fit] = field(default_factory=dict)
    """With the noise that these show."""
    cautious: dict[Key, Fit] = field(default_factory=dict)
    """The same with errors that the model lacks."""

    def fit(
        self,
        base: Base,
        measurement: Measurement,
        chosen: Sequence[tuple[Candidate, np.ndarray]],
        variance: Variance,
        *,
        cautious: bool = False,
    ) -> Fit:
        """The fit of causes beside a base, as `Base.fit` or `Base.cautious_fit`."""
        key = repr(base.bases), *((candidate, prior_of(candidate, size).tobytes()) for candidate, size in chosen)
        made = base.cautious_fit if cautious else base.fit

        def first() -> WithNoise:
            last = next(reversed(self.first.values()), None)
            return _kept(self.first, key, lambda: base.first_fit(measurement, chosen, variance, last))

        known = self.cautious if cautious else self.fits
        return _kept(known, key, lambda: made(measurement, chosen, variance, first()))


def _kept(known: dict[Key, Kept], key: Key, made: Callable[[], Kept]) -> Kept:
    """A known result, or the one `made` now, in place of the oldest of as many as are kept."""
    if key not in known:
        while len(known) >= RECENT:
            del known[next(iter(known))]
        known[key] = made()
    return known[key]
