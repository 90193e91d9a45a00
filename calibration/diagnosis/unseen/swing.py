"""A swing of the tool with time, of one period, such as the control of a hall makes.

A smooth function of time imitates each error that was measured once, at one time. A swing comes back while the axes are
elsewhere: it takes little from the error motions.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from calibration.diagnosis.residual.absorber import Absorbing, absorbing, with_fair_noise
from calibration.diagnosis.residual.dependence import EVIDENCE, LENGTHS, Function, Unexplained
from calibration.diagnosis.residual.unnamed import (
    COMPONENTS,
    Direction,
    evidence,
    odds_of,
    ranges_of,
    terms_of,
)
from calibration.diagnosis.search.linearised_fit import LinearisedFit
from calibration.diagnosis.search.row_sensitivity import RowSensitivity
from kinematics.effects import Unnamed
from kinematics.machine import Machine
from kinematics.state import TIME, State
from kinematics.transforms import Array

LEAST_TURNS, MOST_TURNS, ROWS_PER_TURN, STEP = 1.25, 100, 8, 0.25
"""Least and most turns within the measurement, least rows in each, and the steps in which their number is tried.

Of fewer turns nothing comes back: any course in time is a part of a wave that is long enough.
"""
ROWS, SCANNED_TERMS, TERMS = 1000, 20, 60
"""Most rows with which swings are compared, most terms with which periods are tried, and most terms of the result."""
WAVES = 4
"""Most waves of a swing."""
PASSES = 2
"""Times that each length and the period are searched for."""
PARTS = 10
"""Parts of the time of which each is left out in turn, for the uncertainty of the period."""
EXACT = 1e-3
"""Turns within the measurement to which the period is searched for."""
OTHER = 0.45
"""Length with which a further axis is tried."""


class Swing(Unnamed, frozen=True, tag="swing"):
    """The tool point swings with time: the degrees of `time` are 1, then cosine and sine of a period, its half ..."""

    period: float
    """s"""

    def _functions(self, machine: Machine, state: State, number: int) -> Array:
        """See `Unnamed`."""
        if self.variables[number] != TIME:
            return super()._functions(machine, state, number)
        phase = 2.0 * np.pi * state.need("time", self.name) / self.period
        waves = range(1, (max(term[number] for term in self.terms) + 1) // 2 + 1)
        each = [function(wave * phase) for wave in waves for function in (np.cos, np.sin)]
        return np.stack([np.ones_like(phase), *each], axis=1)


class FoundSwing(NamedTuple):
    """A swing as it is reported."""

    component: Direction
    """Direction of the tool in which it is clearest."""
    variables: tuple[str, ...]
    """Variables that change its size."""
    period: float
    u: float
    """Standard uncertainty of the period; both s."""


class Swinging(NamedTuple):
    """A swing of the tool: its period, and the smooth functions of axes and temperatures by which it is large."""

    period: float
    """s"""
    function: Function
    """Variables of the amplitudes of cosine and sine, and their lengths; without time."""
    component: Direction
    """Direction of the tool in which it is clearest."""
    waves: int = 1
    """Number of its waves: of the period, of half of it, and so on."""

    def in_direction(self, linearised: LinearisedFit, component: Direction, most: int = TERMS) -> tuple[Swing, Array]:
        """The swing in one direction of the tool at zero, and the standard deviations of its terms; `most` by wave.

        The shorter waves are smaller, as those of a sawtooth are.
        """
        degrees, spread = terms_of(self.function.lengths, most)
        numbers = range(1, 2 * self.waves + 1)
        terms = tuple((*term, number) for number in numbers for term in degrees.tolist())
        variables = (*self.function.variables, TIME)
        ranges = (*ranges_of(linearised, self.function.variables), (0.0, self.period))
        spread = np.concatenate([spread / ((number + 1) // 2) for number in numbers])
        return Swing(component, variables, ranges, terms, (0.0,) * len(terms), self.period), spread

    def evidence(self, linearised: LinearisedFit, component: Direction) -> tuple[float, float]:
        """Log odds of the swing in one direction against none, and its most likely size, as of `unnamed.evidence`."""
        tool = RowSensitivity.of_tool(linearised, component)
        effect, spread = self.in_direction(linearised, component)
        return evidence(*tool.parts(tool.values(effect) * spread))

    def log_odds(self, tool: RowSensitivity, most: int = TERMS) -> float:
        """Log odds of the swing in its clearest direction against none; tool: sensitivity to that; `most` by wave."""
        effect, spread = self.in_direction(tool.linearised, self.component, most)
        return evidence(*tool.parts(tool.values(effect) * spread))[0]

    def beside(self, linearised: LinearisedFit, directions: tuple[Direction, ...] = COMPONENTS) -> Absorbing:
        """The linearised fit with the swing in those directions of the tool that need it, the clearest first."""
        found, missing = Absorbing(linearised, 0.0), directions
        while missing:
            by_direction = [self.evidence(found.linearised, component) for component in missing]
            best = int(np.argmax([log_odds for log_odds, _ in by_direction]))
            log_odds, size = by_direction[best]
            if log_odds <= EVIDENCE:
                break
            effect, spread = self.in_direction(found.linearised, missing[best])
            found = found.along(effect, size * spread, log_odds)
            missing = (*missing[:best], *missing[best + 1 :])
        return found

    def with_rest(
        self, linearised: LinearisedFit, dependence: Unexplained, directions: tuple[Direction, ...] = COMPONENTS
    ) -> Absorbing:
        """The same, and a smooth function of the variables of the dependence where the swing leaves one."""
        swung = self.beside(linearised, directions)
        rest = absorbing(swung.linearised, dependence, whole=True, walk=False)
        effects, prior = (*swung.effects, *rest.effects), np.concatenate([swung.prior, rest.prior])
        return Absorbing(rest.linearised, swung.log_odds + rest.log_odds, effects, prior)

    def found(self, linearised: LinearisedFit) -> FoundSwing:
        """The swing as it is reported, with the uncertainty of its period by a jackknife of parts of the time.

        Beside a swing that grows, or of another form, the errors of neighbouring rows are alike: the curvature of the
        evidence would be too large.
        """
        linearised = linearised.thinned(ROWS)
        parts = np.array_split(np.argsort(linearised.state.need("time", "a swing"), kind="stable"), PARTS)
        rows = np.arange(len(linearised.rows))
        fits = (linearised.of_rows(np.setdiff1d(rows, part)) for part in parts)
        others = (RowSensitivity.of_tool(each, self.component) for each in fits)
        periods = [self._of_near_period(each, least=STEP).period for each in others]
        u = math.sqrt((PARTS - 1) * float(np.var(periods)))
        return FoundSwing(self.component, self.function.variables, self.period, u)

    def tuned(self, linearised: LinearisedFit) -> Swinging:
        """The same with the likeliest lengths and period near its own, with further waves and axes that are clear."""
        best, tool = self, RowSensitivity.of_tool(linearised.thinned(ROWS), self.component)
        for _ in range(PASSES):
            for i in range(len(best.function.lengths)):
                best = best._likelier(tool, [best._of_length(i, length) for length in LENGTHS])
            best = best._likelier(tool, [best._of_near_period(tool)])
            if best.waves < WAVES:
                further = best._replace(waves=best.waves + 1)
                best = best._likelier(tool, [further._of_near_period(tool)], EVIDENCE)
        return best._with_axes(tool, OTHER)

    def with_axes(self, linearised: LinearisedFit) -> Swinging:
        """The same with the likeliest period near its own, and axes along which its size clearly changes evenly."""
        tool = RowSensitivity.of_tool(linearised, self.component)
        return self._likelier(tool, [self._of_near_period(tool)])._with_axes(tool, max(LENGTHS))

    def _with_axes(self, tool: RowSensitivity, length: float) -> Swinging:
        best, fit = self, tool.linearised
        for axis in fit.measurement.machine.names:
            if axis not in best.function.variables and np.ptp(fit.positions(axis)) > 0.0:
                best = best._likelier(tool, [best._also_of(axis, length)], EVIDENCE)
        return best

    def _likelier(self, tool: RowSensitivity, others: Sequence[Swinging], least: float = 0.0) -> Swinging:
        """The likeliest of others, if its log odds are larger by more than `least`."""
        odds = [each.log_odds(tool) for each in (self, *others)]
        best = int(np.argmax(odds))
        return (self, *others)[best] if odds[best] > odds[0] + least else self

    def _of_length(self, number: int, length: float) -> Swinging:
        lengths = self.function.lengths
        return self._replace(
            function=self.function._replace(lengths=(*lengths[:number], length, *lengths[number + 1 :]))
        )

    def _also_of(self, axis: str, length: float) -> Swinging:
        return self._replace(function=Function((*self.function.variables, axis), (*self.function.lengths, length)))

    def _of_near_period(self, tool: RowSensitivity, least: float = LEAST_TURNS) -> Swinging:
        """The same with the likeliest of the periods within a step of its own, of so many turns at least."""
        from scipy.optimize import minimize_scalar

        duration = duration_of(tool.linearised)

        def against(turns: float) -> float:
            return -self._replace(period=duration / turns).log_odds(tool, SCANNED_TERMS)

        turns = duration / self.period
        around = (max(turns - STEP, least), turns + STEP)
        found = minimize_scalar(against, bounds=around, method="bounded", options={"xatol": EXACT})
        return self._replace(period=duration / float(found.x))

    def too_long(self, linearised: LinearisedFit) -> bool:
        """True where its period is the longest that is tried: a longer one may be likelier."""
        return duration_of(linearised) / self.period < LEAST_TURNS + 2.0 * EXACT


def searched_swing(linearised: LinearisedFit, dependence: Unexplained) -> Swinging | None:
    """The likeliest swing; None where a smooth function of the variables is nearly as likely.

    Also beside even noise: estimated non-repeatability of an axis may hold the swing.
    """
    found, even = _searched(linearised, dependence), linearised.evenly_noisy
    if found is not None or even is linearised:
        return found
    found = _searched(even, dependence)
    return found if found and with_fair_noise(linearised, found.beside) is not linearised else None


def _searched(linearised: LinearisedFit, dependence: Unexplained) -> Swinging | None:
    """As `searched_swing`, beside the noise of the linearised fit."""
    lengths = dict(zip(dependence.variables, dependence.lengths, strict=True))
    del lengths[TIME]
    function = Function(tuple(lengths), tuple(lengths.values()))
    smooth, component = max((odds_of(linearised, component, dependence), component) for component in COMPONENTS)
    few, duration = linearised.thinned(ROWS), duration_of(linearised)
    turns = np.arange(LEAST_TURNS, min(MOST_TURNS, len(linearised.rows) // ROWS_PER_TURN), STEP).tolist()
    if not turns:
        return None
    tool, swings = RowSensitivity.of_tool(few, component), [Swinging(duration / n, function, component) for n in turns]
    likeliest = int(np.argmax([swing.log_odds(tool, SCANNED_TERMS) for swing in swings]))
    found = swings[likeliest].tuned(linearised)
    least, swung = math.log(len(turns)) + EVIDENCE, found.beside(linearised)
    if found.too_long(linearised) or swung.log_odds - least <= smooth:
        return None
    # causes beside the swing are for the smooth function in either case; a wave may be a part of a random walk
    rest = absorbing(swung.linearised, dependence, whole=True).log_odds if lengths else 0.0
    alone = absorbing(linearised, dependence, whole=True).log_odds
    return found if swung.log_odds + rest - least > alone else None


def duration_of(linearised: LinearisedFit) -> float:
    """Duration of the measurement, s."""
    return float(np.ptp(linearised.state.need("time", "a swing")))
