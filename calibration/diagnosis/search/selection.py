"""Selection of the causes that the data support, one by one, each fitted jointly with everything else.

Forward: the candidate with the lowest delta-BIC that also predicts held-out blocks better, passes false-discovery
control over all that was tried, is visible in these data and has a physical size. After each accepted candidate the
whole model is fitted again (periods and time constants too), and causes whose delta-BIC has become too high are
dropped. At the end each cause is compared with its siblings, and replaced by one that explains more.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import combinations, takewhile
from typing import NamedTuple

import msgspec
import numpy as np

from calibration.diagnosis.search.candidates import RARE, Candidate, at_zero
from calibration.diagnosis.search.evaluation import (
    EVEN,
    WORTH,
    Evaluated,
    Sibling,
    complexity,
    evaluate,
    passing,
    score_of,
    siblings,
)
from calibration.diagnosis.search.linearised_fit import LinearisedFit
from calibration.diagnosis.search.recent_fits import RecentFits
from calibration.diagnosis.search.shapes import proposed_shapes as scans
from calibration.diagnosis.search.shapes.change_points import about_another_point
from calibration.diagnosis.search.stage import Accepted, Stage, chosen_of
from calibration.diagnosis.search.start_model import Base
from calibration.fit.fit import Fit
from calibration.measurement.measurement import Measurement
from calibration.observation.outliers import Variance
from kinematics.effects import Cyclic, LocationJump
from kinematics.running.progress import Progress
from kinematics.transforms import Array

DROPPED = -6.0
"""delta-BIC from which an accepted cause is dropped again."""
MOST = 12
"""Most causes that are named."""
SAME = 0.95
"""Cosine of two signals from which odds are compared by fits."""
BETTER = -4.0
"""Difference of delta-BIC from which a sibling replaces a cause."""
NEARLY = 0.05
"""Share of the delta-BIC by which a simpler cause may be less likely: a further cause is found after it."""
MANY = 8
"""Blocks from which the fit of the others has nearly all data, so that it evaluates bases as the whole does."""
FEW = 4.0
"""Observations per effective parameter up to which they leave the choice of bases open."""
GROWN = 5.0
"""Factor by which the gain of a cause grows at most if the noise of an axis that hides it is estimated with it."""
PASSES = 2
"""Most rounds in which a sibling replaces a cause."""


@dataclass(frozen=True)
class Selection:
    """Stages of a selection, and the candidates of its last round."""

    stages: tuple[Stage, ...]
    """The base alone or with the causes known, then stages with more causes; the last one is the result."""
    last_round: tuple[Evaluated, ...]
    """All candidates on the linearised fit of the result, the best first."""


class _Tried(NamedTuple):
    """Candidates that were tried on a linearised fit, the best first."""

    linearised: LinearisedFit
    evaluated: list[Evaluated]


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
    recent: RecentFits = field(default_factory=RecentFits, compare=False, repr=False)

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
        tried: list[_Tried] = []
        turn = 0
        while True:
            now, turn = stages[-1], turn + 1
            tried = tried or self._tried(now, f"trying causes, round {turn}; found: {_listed(now.accepted)}")
            found = self._found(tried, now.accepted, refused)
            if not found:
                last_round = (each._replace(projected=each.projected.summary) for each in tried[0].evaluated)
                return Selection(tuple(stages), tuple(last_round))
            refused.update(each.candidate.form for each in found)
            trials = []
            for each in found:
                self.progress(f"fitting {each.candidate.effect.name} along; found: {_listed(now.accepted)}")
                trials.append(self.stage([*chosen_of(now.accepted), (each.candidate, each.score.size)]))
            trial = min(trials, key=lambda trial: trial.cost + 2.0 * trial.rarity)
            other = self.refined(now)
            if other is not now and other.cost < trial.cost:
                refused.difference_update(each.candidate.form for each in found)
                stages[-1], tried = other, []
                continue
            if trial.accepted[-1].score.delta_bic < WORTH and not trial.predicts_worse_than(now):
                stages[1:] = [stage.at_rest for stage in stages[1:]]
                stages.append(self.joined(self.pruned(trial)))
                tried = []

    def stage(self, chosen: Sequence[tuple[Candidate, Array]]) -> Stage:
        """The full fit with these causes, each evaluated on the linearised fit without it."""
        return self._stage_of(chosen, self.recent.fit(self.base, self.measurement, chosen, self.variance))

    def cautious(self, stage: Stage) -> Stage:
        """The stage with an uncertainty that contains errors which the model lacks."""
        noise = stage.fit.measurement.noise
        if noise is None or not noise.misfit:
            return stage
        chosen = chosen_of(stage.accepted)
        again = self.recent.fit(self.base, self.measurement, chosen, self.variance, cautious=True)
        return self._stage_of(chosen, again).with_siblings_of(stage)

    def with_finer_turns(self, stage: Stage) -> Fit | None:
        """The fit of the causes of a stage with finer bases of rotary axes; None without these, and for many rows."""
        few = stage.fit.observations < FEW * stage.fit.effective_parameters
        base = stage.base.with_finer_turns(self.measurement) if few else None
        return None if base is None else base.cautious_fit(self.measurement, chosen_of(stage.accepted), self.variance)

    def _stage_of(self, chosen: Sequence[tuple[Candidate, Array]], fit: Fit) -> Stage:
        linearised = LinearisedFit.of(fit)
        accepted = []
        for (candidate, _), number in zip(chosen, self.base.numbers(chosen), strict=True):
            effect = fit.model.effects[number]
            found = replace(candidate, effect=at_zero(effect))
            without = self.base.lacking(linearised, (candidate, number))
            projected = without.candidate(found.effect, found.unit)
            score = score_of(without, found, projected)
            gains = partial(self._held_out_gains, replace(linearised), found, number)
            accepted.append(Accepted(found, score.size * found.unit, score, projected.visible, gains))
        return Stage(self.base, fit, linearised, tuple(accepted))

    def _held_out_gains(self, linearised: LinearisedFit, candidate: Candidate, number: int) -> Array:
        """Reduction of the squares of each held-out block by an accepted cause, the effect `number` of the fit."""
        without = self.base.lacking(linearised, (candidate, number))
        return without.held_out_gains(without.candidate(candidate.effect, candidate.unit))

    def against_siblings(self, stage: Stage) -> Stage:
        """Every cause compared with its siblings, and replaced by one that explains more."""
        swaps_left = PASSES
        while (other := self.plainer(self.leaner(self.pruned(stage)))) is not stage:
            stage = other
        first = stage
        accepted: list[Accepted] = []
        while len(accepted) < len(stage.accepted):
            i = len(accepted)
            own, besides = stage.accepted[i], [*stage.accepted[:i], *stage.accepted[i + 1 :]]
            without = stage.without(i)
            others = self.evaluated(without, besides, f"siblings of {own.candidate.effect.name}")
            compared = self._compared(stage, i, siblings(without, own.candidate, others))
            accepted.append(replace(own, siblings=compared))
            likelier = self._likelier(without, own, others, compared) if swaps_left else None
            if likelier is None:
                continue
            chosen = chosen_of(stage.accepted)
            chosen[i] = (likelier.candidate, likelier.score.size)
            trial = self.pruned(self.stage(chosen))
            if trial.cost + 2.0 * trial.rarity >= stage.cost + 2.0 * stage.rarity:
                swaps_left = 0
                continue
            swaps_left -= 1
            stage, accepted = trial, []
        kept = stage if stage is first else self.plainer(self.leaner(self.pruned(stage)))
        return stage._replace(accepted=tuple(accepted)) if kept is stage else self.against_siblings(kept)

    def _likelier(
        self, without: LinearisedFit, own: Accepted, others: Sequence[Evaluated], compared: Sequence[Sibling]
    ) -> Evaluated | None:
        """The candidate in place of a cause that explains more, on the linearised fit without it; None without any.

        others: all candidates there; compared: the siblings among them, the likeliest first.
        """
        ahead = [each for each in others if each.score.delta_bic < own.score.delta_bic + BETTER]
        first, likeliest = self._best(without, ahead), next(iter(compared), None)
        if first is None and likeliest and likeliest.log_odds < 0.0:
            return None if self.search.by_chance(without, likeliest.evaluated) else likeliest.evaluated
        return first

    def _compared(self, stage: Stage, index: int, found: Sequence[Sibling]) -> tuple[Sibling, ...]:
        """Siblings of an accepted cause, the likeliest first; their odds by fits where linear terms may decide on them.

        Of two causes with the same signal the odds would be those of the second order of large errors.
        """
        large = NEARLY * stage.accepted[index].score.gain
        compared = [
            self._by_fit(stage, index, each)
            if each.cosine >= SAME and EVEN < each.log_odds < large
            else each._replace(log_odds=each.log_odds + self._of_drift(stage, index, each))
            for each in found
        ]
        return tuple(sorted(compared, key=lambda each: each.log_odds))

    def with_odds_of_ties(self, stage: Stage) -> Stage:
        """The stage of a result, the odds of siblings that would be tied by fits: linear odds do not decide there."""
        accepted = []
        for i, own in enumerate(stage.accepted):
            odds = [self._by_fit(stage, i, each) if each.log_odds < EVEN else each for each in own.siblings]
            accepted.append(replace(own, siblings=tuple(sorted(odds, key=lambda each: each.log_odds))))
        return stage._replace(accepted=tuple(accepted))

    def _of_drift(self, stage: Stage, index: int, sibling: Sibling) -> float:
        """Log odds of an accepted cause before any data: another direction of a present drift is likelier."""
        own = stage.accepted[index]
        drifting = any(each.candidate.shifts_tool for each in stage.accepted if each is not own)
        return RARE * (own.candidate.shifts_tool - sibling.evaluated.candidate.shifts_tool) if drifting else 0.0

    def _by_fit(self, stage: Stage, index: int, sibling: Sibling) -> Sibling:
        """The sibling of an accepted cause, its odds by a fit with it in place of the cause."""
        own, other = stage.accepted[index], sibling.evaluated.candidate
        chosen = chosen_of(stage.accepted)
        chosen[index] = (other, sibling.evaluated.score.size)
        trial = self.stage(chosen)
        # an error of the machine lies along an axis, but a knock may turn the instrument, or not: a tie by linear odds,
        # which take the direction of the instrument as one choice, is judged like a knock
        knocked = own.candidate.effect.ACTS_ON == other.effect.ACTS_ON == "instrument"
        by_choices = knocked or sibling.log_odds < EVEN
        dearer = trial.cost_of_choices - stage.cost_of_choices if by_choices else trial.cost - stage.cost
        before = other.rarity - own.candidate.rarity + self._of_drift(stage, index, sibling)
        return sibling._replace(log_odds=dearer / 2 + before)

    def refined(self, stage: Stage) -> Stage:
        """The stage with another form of a cause (time constants, course, fixed point) that explains more."""
        for i, own in enumerate(stage.accepted):
            without = stage.without(i)
            others = [c for c in self.library if c.cause == own.candidate.cause and c.form != own.candidate.form]
            others += about_another_point(without, own.candidate)
            if not others:
                continue
            best = evaluate(without, others)[0]
            if best.score.delta_bic < own.score.delta_bic + BETTER:
                chosen = chosen_of(stage.accepted)
                chosen[i] = (best.candidate, best.score.size)
                trial = self.stage(chosen)
                if trial.cost < stage.cost + BETTER:
                    return self.refined(trial)
        return stage

    def plainer(self, stage: Stage) -> Stage:
        """The stage with a form of a cause of fewer parameters, where a full fit with it is likelier.

        Of large causes linearised fits prefer forms with more parameters.
        """
        for i, own in enumerate(stage.accepted):
            most = own.score.delta_bic + max(-WORTH, NEARLY * abs(own.score.delta_bic))
            forms = [c for c in self.library if c.cause == own.candidate.cause]
            forms = [c for c in forms if complexity(c) < complexity(own.candidate)]
            for each in evaluate(stage.without(i), forms) if forms else ():
                chosen = chosen_of(stage.accepted)
                chosen[i] = (each.candidate, each.score.size)
                if each.score.delta_bic < most and (trial := self.stage(chosen)).cost < stage.cost:
                    return self.plainer(trial)
        return stage

    def leaner(self, stage: Stage) -> Stage:
        """The stage without causes that a full fit of the others replaces: their shapes were refined beside them.

        The fit is made where the linearised fit, in which shapes move as well, misses the cause little enough.
        """
        shaped = any(each.candidate.shapes for each in stage.accepted)
        for own in sorted(stage.accepted, key=lambda each: -each.score.delta_bic) if shaped else ():
            others = [each for each in stage.accepted if each is not own]
            if not others or stage.needs(own):
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
        best, axes = stage, set(self.measurement.machine.names)
        while True:
            bases = best.base.with_bases_of(base, self.measurement)
            tried = {axis: self.on(bases[axis]).stage(chosen) for axis in bases if axis in axes}
            finer = {axis: each for axis, each in tried.items() if each.held_out_um < best.held_out_um}
            if not finer:
                return best.base
            # an axis whose finer basis does not help alone does not help beside others
            best, axes = min(finer.values(), key=lambda each: each.held_out_um), set(finer)

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

    def _tried(self, stage: Stage, step: str) -> list[_Tried]:
        """All candidates beside a stage, with its noise and with even noise, if that is another one."""
        noises = {id(each): each for each in (stage.linearised, stage.linearised.evenly_noisy)}.values()
        found = []
        for number, noisy in enumerate(noises):
            absorbing = self.search.absorbed(noisy)
            evaluated = self.evaluated(absorbing, stage.accepted, f"{step}, even noise" if number else step)
            found.append(_Tried(absorbing, evaluated))
        return found

    def _found(
        self, tried: Sequence[_Tried], accepted: Sequence[Accepted], refused: set[tuple[str, ...]]
    ) -> list[Evaluated]:
        """The likeliest cause among the candidates tried, without those refused; empty without one.

        Two where another one is likelier if noise is even: the noise of an axis hides a cause that acts along it. It is
        refused where it would remain unlikely if this noise were far smaller with the cause.
        """
        found: list[Evaluated] = []
        own = {each.candidate.cause: each.score for each in reversed(tried[0].evaluated)}
        for absorbing, evaluated in tried if len(accepted) < MOST else ():
            while best := self._best(absorbing, [each for each in evaluated if each.candidate.form not in refused]):
                score = own.get(best.candidate.cause, best.score)
                if score.delta_bic <= WORTH + (GROWN - 1.0) * score.gain:
                    break
                refused.add(best.candidate.form)
            if best and all(best.candidate.cause != each.candidate.cause for each in found):
                found.append(best)
        return found

    def evaluated(self, linearised: LinearisedFit, accepted: Sequence[Accepted], step: str = "") -> list[Evaluated]:
        """Candidates for causes besides those accepted, the best first; step: shown with the share of those tried."""
        if step:
            self.progress(step)
        causes = {each.candidate.cause for each in accepted}
        left = [candidate for candidate in self.library if candidate.cause not in causes]
        proposed = [_at_once(each, accepted) for each in self.search.proposals(linearised, left)]
        once = [each for each in proposed if each.cause not in causes or not isinstance(each.effect, LocationJump)]
        return evaluate(linearised, [*left, *once], lambda share: self.progress(step, share) if step else None)

    def _best(self, linearised: LinearisedFit, evaluated: Sequence[Evaluated]) -> Evaluated | None:
        """The likeliest candidate that may be named; of several nearly as likely the commonest and simplest."""
        possible = passing(linearised, evaluated)
        first = next((each for each in possible if not self.search.by_chance(linearised, each)), None)
        if first is None:
            return None
        limit = first.score.delta_bic + max(-WORTH, NEARLY * abs(first.score.delta_bic))
        nearly = takewhile(lambda each: each.score.delta_bic < limit, possible)
        close = [first, *(each for each in nearly if not self.search.by_chance(linearised, each))]
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


def _at_once(candidate: Candidate, accepted: Sequence[Accepted]) -> Candidate:
    """A candidate, a jump of the machine at the moment of an accepted one: what jumps again and again wanders."""
    moments = [each.candidate.effect.since_s for each in accepted if isinstance(each.candidate.effect, LocationJump)]
    if not moments or not isinstance(candidate.effect, LocationJump):
        return candidate
    return replace(candidate, effect=msgspec.structs.replace(candidate.effect, since_s=moments[0]), trials=1.0)


def _listed(accepted: Sequence[Accepted]) -> str:
    return ", ".join(each.candidate.effect.name for each in accepted) or "none yet"
