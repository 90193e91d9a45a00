"""What to measure next: moves of a measurement, ranked by what each tells per minute."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

from calibration.diagnosis.selection import Judged, Stage
from calibration.diagnosis.verdict import REMEDIES, Named


class Move(NamedTuple):
    """A measurement to add."""

    name: str
    minutes: float
    gain_per_minute: float
    """By which the squares that tell causes apart, or show them, grow, in terms of the noise's variance."""
    says: str
    """What to do, and what it tells, in workshop words."""


def moves(stage: Stage, causes: Sequence[Named], judged: Sequence[Judged]) -> Iterator[Move]:  # noqa: ARG001
    """Moves that separate ties, the best first."""
    for cause in causes:
        if cause.verdict == "tied":
            other = cause.alternatives[0]
            yield Move(
                "remedy",
                0.0,
                0.0,
                f"{REMEDIES.get(cause.kind, 'other positions')}: separates {cause.effect.name} from {other.name}",
            )
