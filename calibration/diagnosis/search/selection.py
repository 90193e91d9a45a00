"""Selection of the causes that the data support, one by one, each fitted jointly with everything else.

Forward: the candidate with the lowest delta-BIC that also predicts held-out blocks better, passes false-discovery
control over all that was tried, is visible in these data and has a physical size. After each accepted candidate the
whole model is fitted again (periods and time constants too), and causes whose delta-BIC has become too high are
dropped. At the end each cause is compared with its siblings, and replaced by one that explains more.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence, Set
from dataclasses import dataclass, field, replace
from itertools import combinations
from typing import NamedTuple

import msgspec
import numpy as np

from calibration.diagnosis.search import proposed_shapes as scans
from calibration.diagnosis.search.candidates import Candidate, at_zero
from calibration.diagnosis.search.linearised_fit import LinearisedFit, Projected, Score
from calibration.diagnosis.search.start_model import Base
from calibration.fit.fit import Fit
from calibration.measurement.measurement import Measurement
from calibration.observation.outliers import Variance
from calibration.observation.stops_and_lines import stops
from kinematics.effects import Cyclic, DriftWithSensor, FollowingError, LocationJump, ThermalDrift
from kinematics.transforms import Array

WORTH = -10.0
"""Largest delta-BIC of an accepted cause: odds of 150 to 1 (Kass and Raftery)."""
DROPPED = -6.0
"""delta-BIC from which an accepted cause is dropped again."""
SURE, SURE_OF_RARE, NEARLY_SURE = 1.5, 2.0, 1.0
"""Standard errors by which the gain on held-out blocks must exceed zero, for a cause, a rare cause, and a cause that
keeps others from being named in place of it."""
MOSTLY = 0.75
"""Or the share of blocks with a gain, since another missing cause may make one of them lose."""
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
IRREPLACEABLE = 100.0
"""Growth of the BIC without a cause, but with all others at once, above which none is searched for in its place."""
UNSEEN = 1e-12
"""Least sum of squares that is not zero."""
MOST = 12
"""Most causes that are named."""
LOOKED_AT = 8
"""Best candidates of a round for which the held-out gain is computed."""
RELATED = 0.7
"""Cosine of the signals of two causes from which they are siblings."""
SAME = 0.95
"""Cosine of two signals from which odds are compared by fits."""
EVEN = 5.0
"""Logarithm of the odds below which two causes are tied: 150 to 1."""
BETTER = -4.0
"""Difference of delta-BIC from which a sibling replaces a cause."""
NEARLY = 0.05
"""Share of the delta-BIC by which a simpler cause may be less likely: what it lacks is found after it."""
WORSE = 1.02
"""Ratio by which the held-out RMS may rise by chance with a cause, or with finer bases, that are there."""
MANY = 8
"""Blocks from which the fit of the others has nearly all data, so that it judges bases as the whole does."""
PASSES = 2
"""Most rounds in which a sibling replaces a cause."""
Progress = Callable[[str], None]


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


@dataclass(frozen=True)
class Accepted:
    """An accepted cause, evaluated on the linearised fit without it."""

    candidate: Candidate
    """The candidate with the shapes that the fit found."""
    size: Array
    """Linear parameters in units of their typical sizes."""
    score: Score
    visible: float
    held_out_gains: Array
    """Reduction of the squares of each held-out block."""
    siblings: tuple[Sibling, ...] = ()

    @property
    def sureness(self) -> float:
        """Mean gain on held-out blocks, in units of its standard error."""
        return float(self.held_out_gains.mean()) / max(_error(self.held_out_gains), 1e-300)


class Stage(NamedTuple):
    """The fit with some causes."""

    base: Base
    fit: Fit
    linearised: LinearisedFit
    accepted: tuple[Accepted, ...]

    @property
    def numbers(self) -> list[int]:
        """Indices of the accepted causes among the effects of the fit."""
        return self.base.numbers(chosen_of(self.accepted))

    @property
    def at_rest(self) -> Stage:
        """The stage without the results that can be calculated again."""
        return self._replace(linearised=replace(self.linearised))

    def without(self, index: int) -> LinearisedFit:
        """The linearised fit without one accepted cause."""
        return self.base.lacking(self.linearised, self.accepted[index].candidate, self.numbers[index])

    @property
    def cost(self) -> float:
        """BIC, up to a constant of the data: squares, log determinant of the noise, cost of the causes' parameters."""
        parameters = sum(each.score.effective_parameters for each in self.accepted)
        fitted = self.linearised.squares + self.linearised.spread
        return fitted + parameters * float(np.log(self.linearised.scalars))

    @property
    def rarity(self) -> float:
        """Log odds of as many common causes against its own, before any data."""
        return sum(each.candidate.rarity for each in self.accepted)

    @property
    def held_out_um(self) -> float:
        """RMS of the cross-validation residuals, um per scalar (rotary axes: urad)."""
        return self.linearised.cross_validation.rms_um

    def predicts_worse_than(self, other: Stage) -> bool:
        """True where the residuals of held-out rows, of those that both keep, are larger than by chance."""
        _, own, others = np.intersect1d(self.linearised.rows, other.linearised.rows, return_indices=True)
        held, before = self.linearised.cross_validation, other.linearised.cross_validation
        both = held.counted[own] & before.counted[others]
        squares, before_squares = (
            float(np.sum(each.residual_um[rows[both]] ** 2)) for each, rows in ((held, own), (before, others))
        )
        return squares > WORSE**2 * before_squares


@dataclass(frozen=True)
class Selection:
    """Stages of a selection, and the candidates of its last round."""

    stages: tuple[Stage, ...]
    """The base alone or with the causes known, then stages with more causes; the last one is the result."""
    last_round: tuple[Evaluated, ...]
    """All candidates on the linearised fit of the result, the best first."""


@dataclass(frozen=True)
class Search:
    """Candidates that are tried beside the library, and the doubts about them."""

    proposals: Callable[[LinearisedFit, Sequence[Candidate]], Iterable[Candidate]]
    """Candidates with shapes proposed from the residual; the library is given."""
    absorbed: Callable[[LinearisedFit], LinearisedFit] = lambda linearised: linearised
    """The linearised fit on which candidates are evaluated."""
    by_chance: Callable[[LinearisedFit, Evaluated], bool] = lambda _, __: False
    """True where the search would find as much by chance."""


@dataclass(frozen=True)
class Selector:
    """Data, base and library of a selection."""

    measurement: Measurement
    base: Base
    library: Sequence[Candidate]
    variance: Variance
    progress: Progress
    search: Search
    bare_stages: dict[str, Stage] = field(default_factory=dict, compare=False, repr=False)
    """Fits of bases alone, by their choice: bases come back, and each is fitted once."""

    @property
    def bare(self) -> Stage:
        """The fit of the base alone."""
        key = repr(self.base.bases)
        if key not in self.bare_stages:
            self.bare_stages.update({known: stage.at_rest for known, stage in self.bare_stages.items()})
            self.bare_stages[key] = self.stage(())
        return self.bare_stages[key]

    def without_causes(self, stage: Stage) -> LinearisedFit:
        """The fit of the base alone, with the noise of a stage."""
        noisy = stage.fit.measurement
        return LinearisedFit.of(self.base.fit_as_noisy(noisy, (), self.variance if noisy.noise is None else "sheet"))

    def on(self, base: Base) -> Selector:
        """The selector with another base."""
        return self if base is self.base else replace(self, base=base)

    def select(self, known: Sequence[Accepted] = ()) -> Selection:
        """Selection of the causes that the data support, beginning with those known already."""
        stages = [self.pruned(self.stage(chosen_of(known))) if known else self.bare]
        refused: set[tuple[str, ...]] = set()
        while True:
            now = stages[-1]
            self.progress(f"trying causes; found: {_listed(now.accepted)}")
            evaluated, found = self._found(now.linearised, now.accepted, refused)
            if not found:
                last_round = (each._replace(projected=each.projected.summary) for each in evaluated)
                return Selection(tuple(stages), tuple(last_round))
            refused.update(_key(each.candidate) for each in found)
            trials = []
            for each in found:
                self.progress(f"fitting {each.candidate.effect.name} along; found: {_listed(now.accepted)}")
                trials.append(self.stage([*chosen_of(now.accepted), (each.candidate, each.score.size)]))
            trial = min(trials, key=lambda trial: trial.cost + 2.0 * trial.rarity)
            other = self.refined(now)
            if other is not now and other.cost < trial.cost:
                refused.difference_update(_key(each.candidate) for each in found)
                stages[-1] = other
                continue
            if trial.accepted[-1].score.delta_bic < WORTH and not trial.predicts_worse_than(now):
                stages[1:] = [stage.at_rest for stage in stages[1:]]
                stages.append(self.joined(self.pruned(trial)))

    def stage(self, chosen: Sequence[tuple[Candidate, Array]]) -> Stage:
        """The full fit with these causes, each evaluated on the linearised fit without it."""
        return self._stage_of(chosen, self.base.fit(self.measurement, chosen, self.variance))

    def cautious(self, stage: Stage) -> Stage:
        """The stage with an uncertainty that contains errors which the model lacks."""
        noise = stage.fit.measurement.noise
        if noise is None or not noise.misfit:
            return stage
        chosen = chosen_of(stage.accepted)
        found = self._stage_of(chosen, self.base.cautious_fit(self.measurement, chosen, self.variance))
        kept = [
            replace(each, siblings=other.siblings) for each, other in zip(found.accepted, stage.accepted, strict=True)
        ]
        return found._replace(accepted=tuple(kept))

    def _stage_of(self, chosen: Sequence[tuple[Candidate, Array]], fit: Fit) -> Stage:
        linearised = LinearisedFit.of(fit)
        accepted = []
        for (candidate, _), number in zip(chosen, self.base.numbers(chosen), strict=True):
            effect = fit.model.effects[number]
            found = replace(candidate, effect=at_zero(effect))
            without = self.base.lacking(linearised, candidate, number)
            projected = without.candidate(found.effect, found.unit)
            score = _score(without, found, projected)
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
                others = self._evaluated(without, [*stage.accepted[:i], *stage.accepted[i + 1 :]])
                near = [self._fitted(stage, i, each) for each in siblings(without, own, others)]
                accepted.append(replace(own, siblings=tuple(sorted(near, key=lambda each: each.log_odds))))
                ahead = [each for each in others if each.score.delta_bic < own.score.delta_bic + BETTER]
                first, likelier = self._best(without, ahead), next(iter(accepted[-1].siblings), None)
                if first is None:
                    first = likelier.evaluated if likelier and likelier.log_odds < 0.0 else None
                if better is None and first:
                    better = chosen_of(stage.accepted)
                    better[i] = (first.candidate, first.score.size)
            if better is None or not swaps_left:
                break
            trial = self.pruned(self.stage(better))
            if trial.cost > stage.cost + BETTER:
                break
            stage = trial
        kept = self.leaner(self.pruned(stage))
        return stage._replace(accepted=tuple(accepted)) if kept is stage else self.against_siblings(kept)

    def _fitted(self, stage: Stage, index: int, sibling: Sibling) -> Sibling:
        """The sibling of an accepted cause, its odds by a fit with it where linear terms may decide on them.

        Of two causes with the same signal the odds would be those of the second order of large errors.
        """
        own = stage.accepted[index]
        if sibling.cosine < SAME or not EVEN < sibling.log_odds < NEARLY * own.score.gain:
            return sibling
        chosen = chosen_of(stage.accepted)
        chosen[index] = (sibling.evaluated.candidate, sibling.evaluated.score.size)
        rarer = sibling.evaluated.candidate.rarity - own.candidate.rarity
        return sibling._replace(log_odds=(self.stage(chosen).cost - stage.cost) / 2 + rarer)

    def refined(self, stage: Stage) -> Stage:
        """The stage with another form of a cause (time constants, course along an axis) that explains more."""
        for i, own in enumerate(stage.accepted):
            others = [c for c in self.library if c.cause == own.candidate.cause and _key(c) != _key(own.candidate)]
            if not others:
                continue
            best = evaluate(stage.without(i), others)[0]
            if best.score.delta_bic < own.score.delta_bic + BETTER:
                chosen = chosen_of(stage.accepted)
                chosen[i] = (best.candidate, best.score.size)
                trial = self.stage(chosen)
                if trial.cost < stage.cost + BETTER:
                    return self.refined(trial)
        return stage

    def commoner(self, stage: Stage) -> Stage:
        """The stage with common causes in place of a rare one, where these explain as much."""
        for i, own in enumerate(stage.accepted):
            if not own.candidate.rarity or self._irreplaceable(stage, i):
                continue
            others = [each for each in stage.accepted if each is not own]
            library = [candidate for candidate in self.library if candidate.cause != own.candidate.cause]
            lacking = replace(self, library=library)
            for known in (lacking._drifting(stage.without(i), others), others):
                trial = lacking.select(known).stages[-1] if known is not None else stage
                if trial.rarity < stage.rarity and trial.cost < stage.cost + 2.0 * own.candidate.rarity:
                    return self.commoner(trial)
        return stage

    def _drifting(self, linearised: LinearisedFit, others: Sequence[Accepted]) -> Sequence[Accepted] | None:
        """The causes with a thermal drift along X, Y and Z, in the course that explains most; None without one.

        A drift is a vector: its directions, one by one, leave the others' part and seem to explain little.
        """
        known = {each.candidate.cause for each in others}
        courses: dict[str, list[Candidate]] = {}
        for candidate in self.library:
            effect = candidate.effect
            drift = isinstance(effect, (ThermalDrift, DriftWithSensor)) and effect.component in "XYZ"
            if drift and candidate.cause not in known:
                courses.setdefault(repr(msgspec.structs.replace(effect, component="X")), []).append(candidate)
        tried = [evaluate(linearised, candidates) for candidates in courses.values()]
        if not tried:
            return None
        best = max(tried, key=lambda vector: linearised.squares_of_all([each.projected for each in vector]))
        return self.stage([*chosen_of(others), *((each.candidate, each.score.size) for each in best)]).accepted

    def _irreplaceable(self, stage: Stage, index: int) -> bool:
        """True where all visible candidates together, in place of a cause, explain much less than the cause does."""
        own, without = stage.accepted[index], stage.without(index)
        others = [each for each in self._evaluated(without, stage.accepted) if each.projected.visible >= SEEN]
        explained = without.squares_of_all([each.projected for each in others]) / max(own.score.squares, UNSEEN)
        missing = own.score.gain * max(1.0 - explained, 0.0)
        # noise of one axis from stop to stop may take the place of the cause
        count = len(np.unique(stops(without.measurement)[without.rows]))
        spared = 2.0 * own.candidate.rarity + own.score.effective_parameters * float(np.log(without.scalars))
        return count * float(np.log1p(missing / count)) > spared + IRREPLACEABLE

    def leaner(self, stage: Stage) -> Stage:
        """The stage without causes that a full fit of the others replaces: their shapes were refined beside them."""
        shaped = any(each.candidate.shapes for each in stage.accepted)
        for own in sorted(stage.accepted, key=lambda each: -each.score.delta_bic) if shaped else ():
            others = [each for each in stage.accepted if each is not own]
            if not others:
                break
            self.progress(f"fitting without {own.candidate.effect.name}")
            trial = self.stage(chosen_of(others))
            if trial.cost < stage.cost - DROPPED:
                return self.leaner(trial)
        return stage

    def chosen_again(self, stage: Stage) -> Base:
        """The base with bases selected again by the evidence, with the noise and the added causes of the stage.

        Where they predict many held-out blocks worse, only the bases of single axes that predict them better.
        """
        besides = [stage.fit.model.effects[i] for i in stage.numbers if i >= len(self.base.model.effects)]
        base = self.base.chosen_again(stage.fit.measurement, besides, self.progress)
        if base.bases == self.base.bases:
            return self.base
        chosen = chosen_of(stage.accepted)
        few = len(stage.linearised.blocks) < MANY
        if few or not self.on(base).stage(chosen).predicts_worse_than(stage):
            return base
        best = stage
        while True:
            tried = [self.on(each).stage(chosen) for each in best.base.with_bases_of(base, self.measurement)]
            finer = min(tried, key=lambda each: each.held_out_um, default=best)
            if finer.held_out_um >= best.held_out_um:
                return best.base
            best = finer

    def joined(self, stage: Stage) -> Stage:
        """The stage with one cyclic error for two, where one is a harmonic of the other.

        The squares must grow by less than the BIC's cost of one parameter.
        """
        for one, other in combinations(stage.accepted, 2):
            first, second = one.candidate.effect, other.candidate.effect
            whole = scans.joined(first, second) if isinstance(first, Cyclic) and isinstance(second, Cyclic) else None
            rest = [each for each in stage.accepted if each is not one and each is not other]
            besides = [each.candidate.effect for each in rest if isinstance(each.candidate.effect, Cyclic)]
            if whole is None or any(scans.overlap(whole, third) for third in besides):
                continue
            others = chosen_of(rest)
            together = replace(one.candidate, effect=whole), np.concatenate([one.size, other.size])
            trial = self.stage([*others, together])
            one_period = float(np.log(stage.linearised.scalars))
            if trial.linearised.squares + trial.linearised.spread < (
                stage.linearised.squares + stage.linearised.spread + one_period
            ):
                return self.joined(trial)
        return stage

    def _found(
        self, linearised: LinearisedFit, accepted: Sequence[Accepted], refused: Set[tuple[str, ...]]
    ) -> tuple[list[Evaluated], list[Evaluated]]:
        """All candidates, the best first; and of those not refused the likeliest cause, none without one.

        Two where another one is likelier if noise is even: the noise of an axis hides a cause that acts along it.
        """
        found: list[Evaluated] = []
        first: list[Evaluated] = []
        for noisy in {id(each): each for each in (linearised, linearised.evenly_noisy)}.values():
            absorbing = self.search.absorbed(noisy)
            evaluated = self._evaluated(absorbing, accepted)
            first = first or evaluated
            allowed = [each for each in evaluated if _key(each.candidate) not in refused]
            best = self._best(absorbing, allowed) if len(accepted) < MOST else None
            if best and all(best.candidate.cause != each.candidate.cause for each in found):
                found.append(best)
        return first, found

    def _evaluated(self, linearised: LinearisedFit, accepted: Sequence[Accepted]) -> list[Evaluated]:
        """Candidates for causes besides those accepted, the best first."""
        causes = {each.candidate.cause for each in accepted}
        left = [candidate for candidate in self.library if candidate.cause not in causes]
        proposed = self.search.proposals(linearised, left)
        # a quantity of the machine that jumps again and again wanders: no cause of the library
        once = [each for each in proposed if each.cause not in causes or not isinstance(each.effect, LocationJump)]
        return evaluate(linearised, [*left, *once])

    def _best(self, linearised: LinearisedFit, evaluated: Sequence[Evaluated]) -> Evaluated | None:
        """The likeliest candidate that may be named; of several nearly as likely the commonest and simplest."""
        some = (each for each in passing(linearised, evaluated) if not self.search.by_chance(linearised, each))
        first = next(some, None)
        if first is None:
            return None
        limit = first.score.delta_bic + max(-WORTH, NEARLY * abs(first.score.delta_bic))
        close = [first, *(each for each in some if each.score.delta_bic < limit)]
        return min(close, key=lambda each: (each.candidate.rarity, complexity(each.candidate)))

    def pruned(self, stage: Stage) -> Stage:
        """The stage without the causes whose delta-BIC is `DROPPED` or higher, now that others are known."""
        while stage.accepted:
            worst = max(stage.accepted, key=lambda each: each.score.delta_bic)
            if worst.score.delta_bic < DROPPED:
                break
            rest = chosen_of([each for each in stage.accepted if each is not worst])
            stage = self.stage(rest) if rest else self.bare
        return stage


def evaluate(linearised: LinearisedFit, candidates: Sequence[Candidate]) -> list[Evaluated]:
    """Candidates with their scores, the best first."""
    tried = linearised.candidates([candidate.effect for candidate in candidates])
    found = [
        Evaluated(candidate, projected, _score(linearised, candidate, projected))
        for candidate, projected in zip(candidates, tried, strict=True)
    ]
    return sorted(found, key=lambda evaluated: evaluated.score.delta_bic)


def _score(linearised: LinearisedFit, candidate: Candidate, projected: Projected) -> Score:
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
        if predicts(gains, SURE_OF_RARE if each.candidate.rarity else SURE):
            yield each
        elif predicts(gains, NEARLY_SURE):
            hidden = min(hidden, each.score.delta_bic)


def _of_any_size(linearised: LinearisedFit, each: Evaluated) -> bool:
    """True for lag and waves that an interferometer, or another reference of one axis, shows clearly."""
    clear = linearised.measurement.axis is not None and each.projected.visible > CLEAR
    return clear and isinstance(each.candidate.effect, (Cyclic, FollowingError))


def predicts(gains: Array, sure: float = SURE_OF_RARE) -> bool:
    """True where held-out blocks are predicted better: on average by so many standard errors, or most of them."""
    return bool(gains.mean() > sure * _error(gains) or (gains.sum() > 0 and np.mean(gains > 0) >= MOSTLY))


def siblings(linearised: LinearisedFit, accepted: Accepted, evaluated: Sequence[Evaluated]) -> list[Sibling]:
    """Other causes with nearly the same signal, on a linearised fit without any of them; the likeliest first."""
    own = linearised.projected(linearised.columns(accepted.candidate.effect))
    score = linearised.score(own, accepted.candidate.shapes)
    energy = float(score.size @ own.schur @ score.size)
    found: dict[tuple[str | None, ...], Sibling] = {}
    for each in evaluated:
        other, cause = each.projected, each.candidate.cause
        if other.visible < GLIMPSED or not energy or cause == accepted.candidate.cause:
            continue
        shared = (other.columns.T @ own.columns - other.through.T @ own.through) @ score.size
        ridge = 1e-9 * np.trace(other.schur) * np.eye(len(other.schur))
        cosine = float(
            np.sqrt(min(max(float(shared @ np.linalg.solve(other.schur + ridge, shared)), 0.0) / energy, 1.0))
        )
        if cosine > RELATED:
            free = complexity(each.candidate) - complexity(accepted.candidate)
            log_odds = (score.gain - each.score.gain + free * float(np.log(linearised.scalars))) / 2
            log_odds += each.candidate.rarity - accepted.candidate.rarity
            if cause not in found or log_odds < found[cause].log_odds:
                found[cause] = Sibling(each._replace(projected=other.summary), cosine, log_odds)
    return sorted(found.values(), key=lambda sibling: sibling.log_odds)


def complexity(candidate: Candidate) -> int:
    """Number of free choices of a candidate; a vector of the instrument is one, since its direction is arbitrary."""
    if candidate.effect.ACTS_ON == "instrument":
        return len(candidate.effect.quantities()) + candidate.shapes
    return len(candidate.effect.parameters)


def chosen_of(accepted: Sequence[Accepted]) -> list[tuple[Candidate, Array]]:
    """Candidates of accepted causes with their sizes, the input of a fit."""
    return [(each.candidate, each.size) for each in accepted]


def _listed(accepted: Sequence[Accepted]) -> str:
    return ", ".join(each.candidate.effect.name for each in accepted) or "none yet"


def _key(candidate: Candidate) -> tuple[str, ...]:
    return (*map(str, candidate.cause), str(len(candidate.effect.parameters)))


def _discovered(p_values: Sequence[float]) -> float:
    """Largest significant p-value by Benjamini and Hochberg; 0 without any."""
    ordered = np.sort(p_values)
    below = np.flatnonzero(ordered <= FALSE * np.arange(1, len(ordered) + 1) / max(len(ordered), 1))
    return float(ordered[below[-1]]) if len(below) else 0.0


def _error(gains: Array) -> float:
    return float(gains.std(ddof=1) / np.sqrt(len(gains))) if len(gains) > 1 else float("inf")
