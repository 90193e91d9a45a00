"""Selection: which causes the data ask for, found one by one, each fitted jointly with everything else.

Forward: the candidate with the lowest delta-BIC that also predicts held-out blocks better, survives false-discovery
control over all that was tried, is visible in these data and of a physical size. After each one that is taken in, the
whole is fitted anew (periods and time constants too), those that no longer pay are dropped, and each is held against
its siblings, one of which takes its place where it explains more.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations
from typing import NamedTuple

import numpy as np

from calibration.diagnosis.search import proposed_shapes as scans
from calibration.diagnosis.search.candidates import Candidate, at_zero
from calibration.diagnosis.search.linearised_fit import LinearisedFit, Projected, Score
from calibration.diagnosis.search.start_model import Base
from calibration.fit.fit import Fit
from calibration.measurement.measurement import Measurement
from calibration.observation.outliers import Variance
from kinematics.effects import Cyclic
from kinematics.transforms import Array

WORTH = -10.0
"""delta-BIC that a cause has to bring: odds of 150 to 1 (Kass and Raftery)."""
DROPPED = -6.0
"""A cause whose removal costs less goes again."""
SURE = 1.0
"""Standard errors that the gain on held-out blocks has to be above zero."""
MOSTLY = 0.75
"""Or the share of blocks that gain, where what else is missing makes one of them lose."""
FALSE = 0.01
"""Share of false causes among those named (Benjamini and Hochberg)."""
SEEN = 0.05
"""Share of a cause's signal that has to survive model and registration for it to be named."""
LARGEST = 100.0
"""Physical limit of its size, as a multiple of the typical one."""
MOST = 12
"""Causes that are named."""
LOOKED_AT = 8
"""Best candidates of a round whose held-out gain is worked out."""
RELATED = 0.7
"""Cosine of what two causes do, from which they are siblings."""
BETTER = -4.0
"""By so much lower a sibling's delta-BIC makes it take the place."""
PASSES = 2
"""Times that all causes are held against their siblings."""
Progress = Callable[[str], None]


class Evaluated(NamedTuple):
    """A candidate, its columns and its score on one linearised fit."""

    candidate: Candidate
    projected: Projected
    score: Score


class Sibling(NamedTuple):
    """Another cause that does much the same to these data."""

    evaluated: Evaluated
    cosine: float
    """Between what the two do, once the model and the registration have taken their part."""
    log_odds: float
    """Of the accepted cause against this one, by what they explain and by how much of each is free to be chosen."""


@dataclass(frozen=True)
class Accepted:
    """An accepted cause, evaluated on the linearised fit without it."""

    candidate: Candidate
    """With the shapes that the fit found."""
    size: Array
    """Linear parameters in terms of their typical sizes."""
    score: Score
    visible: float
    held_out_gains: Array
    """Fall of the squares of each held-out block."""
    siblings: tuple[Sibling, ...] = ()

    @property
    def sureness(self) -> float:
        """Gain on held-out blocks in terms of its standard error."""
        return float(self.held_out_gains.mean()) / max(_error(self.held_out_gains), 1e-300)


class Stage(NamedTuple):
    """The fit with some causes."""

    base: Base
    fit: Fit
    linearised: LinearisedFit
    accepted: tuple[Accepted, ...]

    @property
    def numbers(self) -> list[int]:
        """Where the accepted causes stand among the effects of the fit."""
        return self.base.numbers(chosen_of(self.accepted))

    def without(self, index: int) -> LinearisedFit:
        """The linearised fit without one accepted cause."""
        return self.base.lacking(self.linearised, self.accepted[index].candidate, self.numbers[index])

    @property
    def cost(self) -> float:
        """Sum of squares, and what the causes' parameters are charged (BIC)."""
        parameters = sum(each.score.effective_parameters for each in self.accepted)
        return self.linearised.squares + parameters * float(np.log(self.linearised.scalars))

    @property
    def heldout_um(self) -> float:
        """RMS of held-out residuals."""
        return self.linearised.cross_validation.rms_um


@dataclass(frozen=True)
class Selection:
    """How the causes were found."""

    stages: tuple[Stage, ...]
    """The base alone, then with one cause more each; the last one is the result."""
    last_round: tuple[Evaluated, ...]
    """All candidates on the linearised fit of the result, the best first."""


@dataclass(frozen=True)
class Selector:
    """What stays the same while causes are looked for."""

    measurement: Measurement
    base: Base
    library: Sequence[Candidate]
    variance: Variance
    progress: Progress

    @cached_property
    def bare(self) -> Stage:
        """The fit of the base alone."""
        return self.stage(())

    def on(self, base: Base) -> Selector:
        """The same with another base."""
        return self if base is self.base else replace(self, base=base)

    def select(self, known: Sequence[Accepted] = ()) -> Selection:
        """The causes that the data ask for, from those known already."""
        stages = [self.bare]
        if known:
            stages.append(self.pruned(self.stage(chosen_of(known))))
        refused: set[tuple[str, ...]] = set()
        while True:
            now = stages[-1]
            self.progress(f"trying causes; found: {_listed(now.accepted)}")
            evaluated = evaluate(now.linearised, proposals(now.linearised, self._left(now.accepted)))
            allowed = [each for each in evaluated if _key(each.candidate) not in refused]
            best = next(passing(now.linearised, allowed), None) if len(now.accepted) < MOST else None
            if best is None:
                return Selection(tuple(stages), tuple(evaluated))
            refused.add(_key(best.candidate))
            self.progress(f"fitting {best.candidate.effect.name} along; found: {_listed(now.accepted)}")
            trial = self.stage([*chosen_of(now.accepted), (best.candidate, best.score.size)])
            if trial.accepted[-1].score.delta_bic < WORTH:
                stages.append(self.joined(self.pruned(trial)))

    def stage(self, chosen: Sequence[tuple[Candidate, Array]]) -> Stage:
        """The full fit with these causes, and each seen from the fit without it."""
        fit = self.base.fit(self.measurement, chosen, self.variance)
        linearised = LinearisedFit.of(fit)
        accepted = []
        for (candidate, _), number in zip(chosen, self.base.numbers(chosen), strict=True):
            effect = fit.model.effects[number]
            found = replace(candidate, effect=at_zero(effect))
            without = self.base.lacking(linearised, candidate, number)
            projected = without.candidate(found.effect, found.unit)
            score = without.score(projected, candidate.shapes, candidate.trials)
            size, gains = score.size * found.unit, without.held_out_gains(projected)
            accepted.append(Accepted(found, size, score, projected.visible, gains))
        return Stage(self.base, fit, linearised, tuple(accepted))

    def against_siblings(self, stage: Stage) -> Stage:
        """Every cause compared with its siblings, and replaced by one that explains more."""
        for swaps_left in reversed(range(PASSES + 1)):
            accepted: list[Accepted] = []
            better: list[tuple[Candidate, Array]] | None = None
            for i, own in enumerate(stage.accepted):
                self.progress(f"siblings of {own.candidate.effect.name}")
                without = stage.without(i)
                others = evaluate(
                    without, proposals(without, self._left([*stage.accepted[:i], *stage.accepted[i + 1 :]]))
                )
                accepted.append(replace(own, siblings=tuple(siblings(without, own, others))))
                first = next(passing(without, others), None)
                if better is None and first and first.score.delta_bic < own.score.delta_bic + BETTER:
                    better = chosen_of(stage.accepted)
                    better[i] = (first.candidate, first.score.size)
            if better is None or not swaps_left:
                break
            trial = self.pruned(self.stage(better))
            if trial.cost > stage.cost + BETTER:
                break
            stage = trial
        kept = self.pruned(stage)
        return stage._replace(accepted=tuple(accepted)) if kept is stage else self.against_siblings(kept)

    def chosen_again(self, stage: Stage) -> Base:
        """The base whose bases are chosen by the evidence once more, with what a stage has found besides."""
        besides = [stage.fit.model.effects[i] for i in stage.numbers if i >= len(self.base.model.effects)]
        return self.base.chosen_again(self.measurement, besides, self.progress)

    def joined(self, stage: Stage) -> Stage:
        """With one cyclic error for two where one of them is a harmonic of the other, and no less is explained."""
        for one, other in combinations(stage.accepted, 2):
            first, second = one.candidate.effect, other.candidate.effect
            whole = scans.joined(first, second) if isinstance(first, Cyclic) and isinstance(second, Cyclic) else None
            if whole is None:
                continue
            others = chosen_of([each for each in stage.accepted if each is not one and each is not other])
            together = replace(one.candidate, effect=whole), np.concatenate([one.size, other.size])
            trial = self.stage([*others, together])
            if trial.linearised.squares < stage.linearised.squares + float(
                np.log(stage.linearised.scalars)
            ):  # a period less
                return self.joined(trial)
        return stage

    def _left(self, accepted: Sequence[Accepted]) -> list[Candidate]:
        causes = {each.candidate.cause for each in accepted}
        return [candidate for candidate in self.library if candidate.cause not in causes]

    def pruned(self, stage: Stage) -> Stage:
        """Without the causes that no longer pay now that others are known."""
        while stage.accepted:
            worst = max(stage.accepted, key=lambda each: each.score.delta_bic)
            if worst.score.delta_bic < DROPPED:
                break
            stage = self.stage(chosen_of([each for each in stage.accepted if each is not worst]))
        return stage


def evaluate(linearised: LinearisedFit, candidates: Sequence[Candidate]) -> list[Evaluated]:
    """Candidates with their scores, the best first."""
    left = linearised.candidates([candidate.effect for candidate in candidates])
    found = [
        Evaluated(candidate, projected, linearised.score(projected, candidate.shapes, candidate.trials))
        for candidate, projected in zip(candidates, left, strict=True)
    ]
    return sorted(found, key=lambda evaluated: evaluated.score.delta_bic)


def proposals(linearised: LinearisedFit, library: Sequence[Candidate]) -> list[Candidate]:
    """The library, and shapes proposed from the residual of this linearised fit."""
    return [*library, *scans.proposals(linearised, library)]


def passing(linearised: LinearisedFit, evaluated: Sequence[Evaluated]) -> Iterator[Evaluated]:
    """Those that may be named, the best first."""
    limit = _discovered([each.score.p_value for each in evaluated])
    hidden = min((each.score.delta_bic for each in evaluated if each.projected.visible < SEEN), default=np.inf)
    for each in evaluated[:LOOKED_AT]:
        # what a cause that the data hardly show explains as well is not blamed on another
        if each.score.delta_bic > min(WORTH, hidden + WORTH):
            return
        if each.projected.visible < SEEN or each.score.p_value > limit or np.abs(each.score.size).max() > LARGEST:
            continue
        if predicts(linearised.held_out_gains(each.projected)):
            yield each


def predicts(gains: Array) -> bool:
    """True where held-out blocks are predicted better: on average, or most of them."""
    return bool(gains.mean() > SURE * _error(gains) or (gains.sum() > 0 and np.mean(gains > 0) >= MOSTLY))


def siblings(linearised: LinearisedFit, accepted: Accepted, evaluated: Sequence[Evaluated]) -> list[Sibling]:
    """Other causes of nearly the same signal, on a linearised fit without any of them; the likeliest first."""
    own = linearised.projected(linearised.columns(accepted.candidate.effect))
    score = linearised.score(own, accepted.candidate.shapes)
    energy = float(score.size @ own.left @ score.size)
    found: dict[tuple[str | None, ...], Sibling] = {}
    for each in evaluated:
        other, cause = each.projected, each.candidate.cause
        if other.visible < SEEN or not energy or cause == accepted.candidate.cause:
            continue
        shared = (other.columns.T @ own.columns - other.through.T @ own.through) @ score.size
        ridge = 1e-9 * np.trace(other.left) * np.eye(len(other.left))
        cosine = float(
            np.sqrt(min(max(float(shared @ np.linalg.solve(other.left + ridge, shared)), 0.0) / energy, 1.0))
        )
        if cosine > RELATED:
            free = complexity(each.candidate) - complexity(accepted.candidate)
            log_odds = (score.gain - each.score.gain + free * float(np.log(linearised.scalars))) / 2
            if cause not in found or log_odds < found[cause].log_odds:
                found[cause] = Sibling(each, cosine, log_odds)
    return sorted(found.values(), key=lambda sibling: sibling.log_odds)


def complexity(candidate: Candidate) -> int:
    """Number of things that are free to be chosen: a vector of the instrument is one, its direction being anybody's."""
    if candidate.effect.ACTS_ON == "instrument":
        return len(candidate.effect.quantities()) + candidate.shapes
    return len(candidate.effect.parameters)


def chosen_of(accepted: Sequence[Accepted]) -> list[tuple[Candidate, Array]]:
    """Causes with their sizes, as a fit takes them."""
    return [(each.candidate, each.size) for each in accepted]


def _listed(accepted: Sequence[Accepted]) -> str:
    return ", ".join(each.candidate.effect.name for each in accepted) or "none yet"


def _key(candidate: Candidate) -> tuple[str, ...]:
    return (*map(str, candidate.cause), str(len(candidate.effect.parameters)))


def _discovered(p_values: Sequence[float]) -> float:
    """Largest p-value that counts, by Benjamini and Hochberg."""
    ordered = np.sort(p_values)
    below = np.flatnonzero(ordered <= FALSE * np.arange(1, len(ordered) + 1) / max(len(ordered), 1))
    return float(ordered[below[-1]]) if len(below) else 0.0


def _error(gains: Array) -> float:
    return float(gains.std(ddof=1) / np.sqrt(len(gains))) if len(gains) > 1 else float("inf")
