"""Candidates on a linearised fit: their scores, those that may be named, and the siblings of a cause."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
from scipy import special

from calibration.diagnosis.search.candidates import Candidate
from calibration.diagnosis.search.linearised_fit import LinearisedFit
from calibration.diagnosis.search.score import Projected, Score
from kinematics.effects import Cyclic, FollowingError
from kinematics.transforms import Array

WORTH = -10.0
"""Largest delta-BIC of an accepted cause: odds of 150 to 1 (Kass and Raftery)."""
SURE, SURE_OF_RARE, NEARLY_SURE = 1.5, 2.0, 1.0
"""Standard errors by which the gain on held-out blocks must exceed zero, for a cause, a rare cause, and a cause that
keeps others from being named in place of it."""
MOSTLY = 0.75
"""Or the share of blocks with a gain, since another missing cause may make one of them lose."""
SIGNS = 0.1
"""Largest chance of so many blocks with a gain for a rare cause: of few blocks most gain by chance."""
FALSE = 0.01
"""Share of false causes among those named (Benjamini and Hochberg)."""
SEEN = 0.05
"""Least share of its signal that model and registration cannot imitate, for a cause to be named."""
GLIMPSED = 0.01
"""The same for a cause to be a sibling of a named one."""
LARGEST = 100.0
"""Physical limit of a cause's size, as a multiple of the typical one, unless the cause is CLEAR."""
CLEAR = 0.1
"""Least visible share of the signal of a lag or a wave that an interferometer shows with any size."""
LOOKED_AT = 8
"""Best candidates of a round for which the held-out gain is computed."""
RELATED = 0.7
"""Cosine of the signals of two causes from which they are siblings."""
EVEN = 5.0
"""Logarithm of the odds below which two causes are tied: 150 to 1."""


class Evaluated(NamedTuple):
    """A candidate, its columns and its score on one linearised fit."""

    candidate: Candidate
    projected: Projected
    score: Score


class Sibling(NamedTuple):
    """Another cause with nearly the same signal in these data."""

    evaluated: Evaluated
    cosine: float
    """Cosine between the parts of both signals that the model and the registration cannot imitate."""
    log_odds: float
    """Log odds of the accepted cause against this one, by their gains and their numbers of free choices."""


def evaluate(
    linearised: LinearisedFit, candidates: Sequence[Candidate], done: Callable[[float], None] = lambda _: None
) -> list[Evaluated]:
    """Candidates with their scores, the best first; done: called with the share of those tried."""
    tried = linearised.candidates([candidate.effect for candidate in candidates], done)
    found = [
        Evaluated(candidate, projected, score_of(linearised, candidate, projected))
        for candidate, projected in zip(candidates, tried, strict=True)
    ]
    return sorted(found, key=lambda evaluated: evaluated.score.delta_bic)


def score_of(linearised: LinearisedFit, candidate: Candidate, projected: Projected) -> Score:
    """Score of a candidate; a rare cause needs more evidence than a common one."""
    score = linearised.score(projected, candidate.shapes, candidate.trials)
    return score._replace(delta_bic=score.delta_bic + 2.0 * candidate.rarity)


def passing(linearised: LinearisedFit, evaluated: Sequence[Evaluated]) -> Iterator[Evaluated]:
    """Candidates that may be named, the best first."""
    limit = _discovered([each.score.p_value for each in evaluated])
    hidden = min((each.score.delta_bic for each in evaluated if each.projected.visible < SEEN), default=np.inf)
    for each in evaluated[:LOOKED_AT]:
        # no cause is named for a gain that a hardly visible, or nearly sure, cause explains far better
        if each.score.delta_bic > min(WORTH, hidden - WORTH):
            return
        if each.projected.visible < SEEN or each.score.p_value > limit:
            continue
        if np.abs(each.score.size).max() > LARGEST and not _of_any_size(linearised, each):
            continue
        gains = linearised.held_out_gains(each.projected)
        if predicts(gains, SURE_OF_RARE, SIGNS) if each.candidate.rarity else predicts(gains, SURE):
            yield each
        elif predicts(gains, NEARLY_SURE):
            hidden = min(hidden, each.score.delta_bic)


def _of_any_size(linearised: LinearisedFit, each: Evaluated) -> bool:
    """True for lag and waves that an interferometer, or another reference of one axis, shows clearly."""
    clear = linearised.measurement.axis is not None and each.projected.visible > CLEAR
    return clear and isinstance(each.candidate.effect, (Cyclic, FollowingError))


def predicts(gains: Array, sure: float = SURE_OF_RARE, chance: float = 1.0) -> bool:
    """True where held-out blocks are predicted better: on average by so many standard errors, or most of them.

    chance: largest chance that so many blocks gain, unless all of them do.
    """
    if gains.mean() > sure * standard_error(gains):
        return True
    positive = int(np.count_nonzero(gains > 0))
    most = gains.sum() > 0 and positive >= MOSTLY * len(gains)
    return bool(most and (positive == len(gains) or special.bdtrc(positive - 1, len(gains), 0.5) <= chance))


def siblings(linearised: LinearisedFit, own_cause: Candidate, evaluated: Sequence[Evaluated]) -> list[Sibling]:
    """Other causes with nearly the same signal, on a linearised fit without any of them; the likeliest first."""
    own = linearised.projected(linearised.columns(own_cause.effect))
    score = linearised.score(own, own_cause.shapes)
    energy = float(score.size @ own.schur @ score.size)
    found: dict[tuple[str | None, ...], Sibling] = {}
    for each in evaluated:
        other, cause = each.projected, each.candidate.cause
        if other.visible < GLIMPSED or not energy or cause == own_cause.cause:
            continue
        shared = (other.columns.T @ own.columns - other.through.T @ own.through) @ score.size
        ridge = 1e-9 * np.trace(other.schur) * np.eye(len(other.schur))
        cosine = float(
            np.sqrt(min(max(float(shared @ np.linalg.solve(other.schur + ridge, shared)), 0.0) / energy, 1.0))
        )
        if cosine > RELATED:
            free = complexity(each.candidate) - complexity(own_cause)
            log_odds = (score.gain - each.score.gain + free * float(np.log(linearised.scalars))) / 2
            log_odds += each.candidate.rarity - own_cause.rarity
            if cause not in found or log_odds < found[cause].log_odds:
                found[cause] = Sibling(each._replace(projected=other.summary), cosine, log_odds)
    return sorted(found.values(), key=lambda sibling: sibling.log_odds)


def complexity(candidate: Candidate) -> int:
    """Number of free choices of a candidate; a vector of the instrument is one, since its direction is arbitrary."""
    if candidate.effect.ACTS_ON == "instrument":
        return len(candidate.effect.quantities()) + candidate.shapes
    return len(candidate.effect.parameters)


def _discovered(p_values: Sequence[float]) -> float:
    """Largest significant p-value by Benjamini and Hochberg; 0 without any."""
    ordered = np.sort(p_values)
    below = np.flatnonzero(ordered <= FALSE * np.arange(1, len(ordered) + 1) / max(len(ordered), 1))
    return float(ordered[below[-1]]) if len(below) else 0.0


def standard_error(gains: Array) -> float:
    """Standard error of the mean gain of blocks; infinite for one block."""
    return float(gains.std(ddof=1) / np.sqrt(len(gains))) if len(gains) > 1 else float("inf")
