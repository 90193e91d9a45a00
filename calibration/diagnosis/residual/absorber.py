"""Absorber: a smooth function of the variables of the unexplained residual, beside which a cause must prove itself.

Where an unknown cause is at work, known causes and searched shapes imitate parts of it. A cause is kept only if the
data with the cause and the function are far likelier than with the function alone.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import NamedTuple, Protocol

import numpy as np

from calibration.diagnosis.residual.dependence import EVIDENCE, Function, Unexplained
from calibration.diagnosis.residual.readings import with_function_of_readings
from calibration.diagnosis.residual.unnamed import COMPONENTS, Direction, evidence, may_depend_on, propose
from calibration.diagnosis.search.candidates import Candidate
from calibration.diagnosis.search.evaluation import evaluate
from calibration.diagnosis.search.linearised_fit import LinearisedFit
from calibration.diagnosis.search.row_sensitivity import RowSensitivity
from calibration.diagnosis.search.stage import Accepted, Stage
from kinematics.effects import UM, CrossAxis, Cyclic, Effect, QuantisedCompensation, Unnamed
from kinematics.state import TIME
from kinematics.transforms import Array

MOST = 0.5
"""Share of the log odds of the function that is most of them."""
CLEARLY = 0.75
"""Least share of the excess over the noise that a cause explains beside an unexplained function of its variables."""
STEPS, ROWS_PER_STEP = 150, 3
"""Most steps of a random walk, and least number of rows between them."""
ROUNDS = 3
"""Times that a function is fitted beside the noise that it leaves."""
STEP_UM = 10.0
"""Size of a step in whose units its standard deviation is chosen, um."""


class Beside(Protocol):
    """A linearised fit with a function beside the model, and the log odds of this function against none."""

    @property
    def linearised(self) -> LinearisedFit:
        """The linearised fit with the function."""

    @property
    def log_odds(self) -> float:
        """Log odds of the function against none."""


class Absorbing(NamedTuple):
    """A linearised fit with a smooth function of the variables of a dependence."""

    linearised: LinearisedFit
    log_odds: float
    """Log odds of the function against none."""
    effects: tuple[Unnamed, ...] = ()
    """The function in the directions of the tool that it needs, at zero."""
    prior: Array = np.zeros(0)
    """Prior standard deviations `(k,)` of its coefficients, um."""
    walks: tuple[tuple[Direction, float], ...] = ()
    """Directions of the tool with a random walk, and the standard deviation of its steps, um; in turn as columns."""

    def along(self, effect: Unnamed, in_typical: Array, log_odds: float) -> Absorbing:
        """The same with a function in one direction more, with priors `(k,)` of its coefficients in typical sizes."""
        prior = in_typical * [quantity.typical for quantity in effect.parameter_table]
        linearised, effects = self.linearised.along(effect, prior), (*self.effects, effect)
        return Absorbing(linearised, self.log_odds + log_odds, effects, np.concatenate([self.prior, prior]), self.walks)


def absorbed(linearised: LinearisedFit, dependence: Unexplained | None) -> LinearisedFit:
    """The linearised fit with a smooth function of the variables of a dependence, in the directions that it needs."""
    return absorbing(linearised, dependence).linearised


def log_odds_of_function(linearised: LinearisedFit, dependence: Unexplained | None, *, whole: bool = False) -> float:
    """Log odds of the smooth function against none; whole: also with the terms that the model can imitate."""
    return absorbing(linearised, dependence, whole=whole, walk=False).log_odds


def without_support(stage: Stage, fair: Stage, dependence: Unexplained) -> list[Accepted]:
    """Accepted causes without which the function explains the data nearly as well as with them; fair: by `fair_to`.

    A cause is kept that alone explains most of the squares of the function: the function then imitates the cause. Also
    a cause that depends on one of the variables, and is less clear than the function beside it or leaves much beyond
    the noise: it is a mean of the function, or a part of it. A finer error motion of an axis falls where the rest
    depends on this axis and time: it is the mean of an error that changes.

    The function is without the terms that the model can imitate, unless none of the others explains anything.
    """
    together = log_odds_of_function(fair.linearised, dependence)
    whole = not together
    if whole:
        together = log_odds_of_function(fair.linearised, dependence, whole=True)
    found = []
    for i, each in enumerate(stage.accepted):
        without = fair.without(i)
        score = each.score if fair.linearised is stage.linearised else evaluate(without, [each.candidate])[0].score
        own, alone = -0.5 * score.delta_bic, log_odds_of_function(without, dependence, whole=whole)
        named = each.candidate.effect.NAMES_CAUSE
        imitated = own + together - alone < EVIDENCE and own < MOST * alone
        part = own < together or share_of_excess(without, fair.linearised) < CLEARLY
        depends = not _variables(each.candidate).isdisjoint(dependence.variables)
        if (named and (imitated or (part and depends))) or _changes(each.candidate, dependence):
            found.append(each)
    return found


def fair_to(stage: Stage, dependence: Unexplained) -> Stage:
    """The stage with the noise beside which the whole function counts, by `with_fair_noise`."""
    function = partial(absorbing, dependence=dependence, whole=True, walk=False)
    return stage._replace(linearised=with_fair_noise(stage.linearised, function))


def _changes(candidate: Candidate, dependence: Unexplained) -> bool:
    """True for a finer error motion of an axis that the unexplained residual depends on, together with time."""
    return bool(candidate.replaces) and {TIME, getattr(candidate.effect, "axis", "")} <= set(dependence.variables)


def share_of_excess(without: LinearisedFit, with_cause: LinearisedFit) -> float:
    """Share of the squares beyond the specified noise, without a cause, that the cause explains."""
    explained = without.squares - with_cause.squares
    left = with_cause.squares - with_cause.degrees_of_freedom / with_cause.fit.variance_factor
    return explained / max(explained + left, explained, 1.0)


def _variables(candidate: Candidate) -> set[str]:
    """Variables of a course in time, or in temperatures, which are functions of time; of a sag, a wave or a sawtooth,
    and of a finer error motion.

    None for an effect that depends on anything but time and the positions of axes.
    """
    effect, timed = candidate.effect, in_time(candidate.effect)
    if not timed and not candidate.replaces and not isinstance(effect, (CrossAxis, Cyclic, QuantisedCompensation)):
        return set()
    axes = {getattr(effect, name) for name in ("axis", "other") if hasattr(effect, name)}
    return {TIME, *axes} if timed else axes


def in_time(effect: Effect) -> bool:
    """True for an effect with a course in time, or in temperatures, which are functions of time."""
    return TIME in effect.needs or "temperatures" in effect.needs


def absorbing(
    linearised: LinearisedFit, dependence: Unexplained | None, *, whole: bool = False, walk: bool = True
) -> Absorbing:
    """The linearised fit with the function, as far as an error of the tool can depend on its variables.

    A function of a tracker's readings acts on these. whole: also with the terms of the function that the model and the
    registration can imitate. walk: where it depends on time, also with a random walk.
    """
    found = Absorbing(linearised, 0.0)
    if dependence is not None and dependence.of_readings:
        misreading = with_function_of_readings(linearised)
        return Absorbing(misreading.linearised, misreading.log_odds)
    function = None if dependence is None else function_of_tool(linearised, dependence)
    if function is None:
        return found
    if walk and TIME in function.variables:
        found = with_walk(linearised)
    missing = COMPONENTS
    while proposed := propose(found.linearised, function, missing, whole=whole):
        best = proposed[0]
        found = found.along(best.effect, np.array(best.candidate.prior), best.log_odds)
        missing = tuple(component for component in missing if component != best.effect.component)
    return found


def function_of_tool(linearised: LinearisedFit, dependence: Unexplained) -> Function | None:
    """The function of those variables of a dependence that an error of the tool can depend on; None without any."""
    lengths = zip(dependence.variables, dependence.lengths, strict=True)
    possible = {name: length for name, length in lengths if may_depend_on(linearised, name)}
    return Function(tuple(possible), tuple(possible.values())) if possible else None


def with_walk(linearised: LinearisedFit) -> Absorbing:
    """The linearised fit with a random walk of the tool in time, in the directions that need it, the clearest first.

    Independent steps at moments that are evenly spread over the rows, with one standard deviation. None without times.
    """
    found, missing = Absorbing(linearised, 0.0), COMPONENTS
    if linearised.state.time is None:
        return found
    steps = UM * STEP_UM * steps_of_walk(linearised)
    while missing:
        walks = [RowSensitivity.of_tool(found.linearised, component) for component in missing]
        proposed = [evidence(*each.parts(steps)) for each in walks]
        best = int(np.argmax([log_odds for log_odds, _ in proposed]))
        log_odds, size = proposed[best]
        if log_odds <= EVIDENCE:
            break
        beside = found.linearised.beside(walks[best].columns(size * steps))
        own = (*found.walks, (missing[best], size * STEP_UM))
        found = Absorbing(beside, found.log_odds + log_odds, walks=own)
        missing = tuple(component for component in missing if component != missing[best])
    return found


def with_fair_noise(linearised: LinearisedFit, function: Callable[[LinearisedFit], Beside]) -> LinearisedFit:
    """The linearised fit with the noise beside which a function counts; `function` adds it to a linearised fit.

    Even noise, since estimated non-repeatability of an axis would hold a part of the function. But the estimated noise
    where it alone is likelier than the function and even noise of the size that the function leaves: the stops shift
    independently, which looks like a part of the function, and even noise as large as these shifts hides the causes.
    """
    even = quieter = linearised.evenly_noisy
    noise = linearised.measurement.noise
    if noise is None or not noise.of_stops:
        return even
    of_stops = 0.5 * (even.squares + even.spread - linearised.squares - linearised.spread)
    for _ in range(ROUNDS):
        beside = function(quieter)
        quiet = 0.5 * (even.squares + even.spread - quieter.squares - quieter.spread)
        if of_stops <= beside.log_odds + quiet:
            return even
        factor = quieter.fit.variance_factor * beside.linearised.squares / beside.linearised.degrees_of_freedom
        quieter = LinearisedFit.of(replace(quieter.fit, variance_factor=max(factor, 1.0)))
    return linearised


def steps_of_walk(linearised: LinearisedFit) -> Array:
    """Which steps of a random walk each row has behind it, `(n, k)`: 1 or 0."""
    time, count = linearised.state.need("time", "a random walk"), min(STEPS, len(linearised.rows) // ROWS_PER_STEP)
    moments = np.unique(np.quantile(time, np.arange(1, count + 1) / (count + 1), method="nearest"))
    return np.asarray(time[:, None] >= moments[moments > time.min()], float)
