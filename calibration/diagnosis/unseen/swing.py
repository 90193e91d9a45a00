"""A swing of the tool with time, of one period, such as the control of a hall makes.

A smooth function of time leaves open whatever was measured once, at one time. A swing comes back while the axes are
elsewhere: it takes little from the error motions.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from calibration.diagnosis.residual.absorber import Absorbing, absorbing
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
from kinematics.effects import Unnamed
from kinematics.machine import Machine
from kinematics.state import TIME, State
from kinematics.transforms import Array

MOST_TURNS, ROWS_PER_TURN, STEP = 100, 8, 0.25
"""Most turns within the measurement, least rows in each, and the steps in which their number is tried."""
SCANNED_ROWS, SCANNED_TERMS, TERMS = 1000, 20, 60
"""Most rows and terms with which periods are tried, and most terms of the result."""
PASSES = 2
"""Times that each length and the period are searched for."""
NEAR = 0.01
"""Share of a turn in the measurement over which the evidence shows the uncertainty of the period."""
EXACT = 1e-3
"""Turns within the measurement to which the period is searched for."""
OTHER = 0.45
"""Length with which a further axis is tried."""


class Swing(Unnamed, frozen=True, tag="swing"):
    """The tool point swings with time: in `time` the degrees 1 and 2 are cosine and sine of one period."""

    period: float
    """s"""

    def _functions(self, machine: Machine, state: State, number: int) -> Array:
        """See `Unnamed`."""
        if self.variables[number] != TIME:
            return super()._functions(machine, state, number)
        phase = 2.0 * np.pi * state.need("time", self.name) / self.period
        return np.stack([np.ones_like(phase), np.cos(phase), np.sin(phase)], axis=1)


class FoundSwing(NamedTuple):
    """A swing as it is reported."""

    component: Direction
    """Direction of the tool in which it is clearest."""
    variables: tuple[str, ...]
    """On which its size depends."""
    period: float
    u: float
    """Standard uncertainty of the period; both s."""


class Swinging(NamedTuple):
    """A swing of the tool: its period, and the smooth functions of axes and temperatures by which it is large."""

    period: float
    """s"""
    function: Function
    """Of the amplitudes of cosine and sine, without time."""
    component: Direction
    """Direction of the tool in which it is clearest."""

    def in_direction(self, linearised: LinearisedFit, component: Direction, most: int = TERMS) -> tuple[Swing, Array]:
        """The swing in one direction of the tool at zero, with `most` terms each, and their standard deviations."""
        degrees, spread = terms_of(self.function.lengths, most)
        terms = tuple((*term, wave) for wave in (1, 2) for term in degrees.tolist())
        variables = (*self.function.variables, TIME)
        ranges = (*ranges_of(linearised, self.function.variables), (0.0, self.period))
        return Swing(component, variables, ranges, terms, (0.0,) * len(terms), self.period), np.tile(spread, 2)

    def evidence(self, linearised: LinearisedFit, component: Direction, most: int = TERMS) -> tuple[float, float]:
        """Log odds of the swing in one direction against none, and its most likely size, as of `unnamed.evidence`."""
        effect, spread = self.in_direction(linearised, component, most)
        columns = linearised.columns(effect) * spread
        return evidence(linearised.projected(columns).schur, columns.T @ linearised.residual)

    def beside(self, linearised: LinearisedFit) -> Absorbing:
        """The linearised fit with the swing in the directions of the tool that need it, the clearest first."""
        found, missing = Absorbing(linearised, 0.0), COMPONENTS
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

    def with_rest(self, linearised: LinearisedFit, dependence: Unexplained) -> Absorbing:
        """The same, and a smooth function of the variables of the dependence where the swing leaves one."""
        swung = self.beside(linearised)
        rest = absorbing(swung.linearised, dependence, whole=True, walk=False)
        effects, prior = (*swung.effects, *rest.effects), np.concatenate([swung.prior, rest.prior])
        return Absorbing(rest.linearised, swung.log_odds + rest.log_odds, effects, prior)

    def found(self, linearised: LinearisedFit) -> FoundSwing:
        """The swing as it is reported, with the uncertainty of its period by the curvature of the evidence."""
        duration = _duration(linearised)
        turns = duration / self.period + NEAR * np.array([-1.0, 0.0, 1.0])
        odds = [self._replace(period=duration / n).evidence(linearised, self.component)[0] for n in turns.tolist()]
        curvature = -float(np.diff(odds, 2)[0]) / NEAR**2
        u = self.period**2 / duration / math.sqrt(curvature) if curvature > 0.0 else math.inf
        return FoundSwing(self.component, self.function.variables, self.period, u)

    def tuned(self, linearised: LinearisedFit) -> Swinging:
        """The same with the likeliest lengths and period near its own, and with further axes where these are clear."""
        best = self
        for _ in range(PASSES):
            for i in range(len(best.function.lengths)):
                best = best._likelier(linearised, [best._of_length(i, length) for length in LENGTHS])
            best = best._likelier(linearised, [best._of_near_period(linearised)])
        for axis in linearised.measurement.machine.names:
            if axis not in best.function.variables and np.ptp(linearised.positions(axis)) > 0.0:
                best = best._likelier(linearised, [best._also_of(axis)], EVIDENCE)
        return best

    def _likelier(self, linearised: LinearisedFit, others: Sequence[Swinging], least: float = 0.0) -> Swinging:
        """The likeliest of others, if its log odds are larger by more than `least`."""
        odds = [each.evidence(linearised, self.component)[0] for each in (self, *others)]
        best = int(np.argmax(odds))
        return (self, *others)[best] if odds[best] > odds[0] + least else self

    def _of_length(self, number: int, length: float) -> Swinging:
        lengths = self.function.lengths
        return self._replace(
            function=self.function._replace(lengths=(*lengths[:number], length, *lengths[number + 1 :]))
        )

    def _also_of(self, axis: str) -> Swinging:
        return self._replace(function=Function((*self.function.variables, axis), (*self.function.lengths, OTHER)))

    def _of_near_period(self, linearised: LinearisedFit) -> Swinging:
        """The same with the likeliest of the periods within a step of its own."""
        from scipy.optimize import minimize_scalar

        duration = _duration(linearised)

        def against(turns: float) -> float:
            return -self._replace(period=duration / turns).evidence(linearised, self.component)[0]

        turns = duration / self.period
        around = (max(turns - STEP, STEP), turns + STEP)
        found = minimize_scalar(against, bounds=around, method="bounded", options={"xatol": EXACT})
        return self._replace(period=duration / float(found.x))


def searched_swing(linearised: LinearisedFit, dependence: Unexplained) -> Swinging | None:
    """The likeliest swing; None where a smooth function of the variables is nearly as likely."""
    lengths = dict(zip(dependence.variables, dependence.lengths, strict=True))
    del lengths[TIME]
    function = Function(tuple(lengths), tuple(lengths.values()))
    component = max(COMPONENTS, key=lambda component: odds_of(linearised, component, dependence))
    few, duration = linearised.thinned(SCANNED_ROWS), _duration(linearised)
    turns = np.arange(1.0, min(MOST_TURNS, len(linearised.rows) // ROWS_PER_TURN), STEP)
    if not len(turns):
        return None
    swings = [Swinging(duration / float(n), function, component) for n in turns]
    likeliest = int(np.argmax([swing.evidence(few, component, SCANNED_TERMS)[0] for swing in swings]))
    found = swings[likeliest].tuned(linearised)
    smooth = absorbing(linearised, dependence, whole=True).log_odds
    return found if found.beside(linearised).log_odds - math.log(len(turns)) > smooth + EVIDENCE else None


def _duration(linearised: LinearisedFit) -> float:
    return float(np.ptp(linearised.state.need("time", "a swing")))
