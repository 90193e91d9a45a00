"""Library of candidates: every cause in the table of effects that these data could show.

A candidate is an effect with its amplitudes at zero and its shapes (periods, time constants) as proposed. A cause that
needs columns that the data lack is listed with them. `causes` lists the effects that are tried; `proposed_shapes`
proposes the shapes of cyclic errors and of compensation tables, and the moments of jumps, from the residual.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import get_args

import numpy as np

from calibration.diagnosis.search.causes import causes, given
from calibration.diagnosis.search.score import GENEROUS
from calibration.diagnosis.terms.contract import contract_kind, where
from calibration.fit.datum import along_own_line
from calibration.measurement.measurement import Measurement
from kinematics.basis import Interval, Legendre
from kinematics.effects import (
    Component,
    Effect,
    LocationError,
    Racking,
    Reversal,
    Scale,
    Wobble,
)
from kinematics.effects.base import own_component
from kinematics.effects.geometric import Motion
from kinematics.error_model.model import ErrorModel
from kinematics.machine import split_chain
from kinematics.transforms import Array

HIGHER_FREQUENCY, BACKLASH = "higher-frequency", "backlash"
RARE = 3.0
"""Log odds of common causes against rare ones, before any data: 20 to 1."""
FEW = 3
"""Most parameters of a simple cause."""
WOBBLES = (1, 2)
"""Harmonics of wobbles that a calibrated machine may have got."""
SQUARE_BY_DATUM = ("E_C0X", "E_B0X", "E_A0Y")
"""Orientations that are zero by the datum: X is x, and Y lies in the x y plane."""
BRIDGE = 1000.0
"""Least length, mm, of a bridge that is driven on both sides."""


@dataclass(frozen=True)
class Candidate:
    """A cause to be tried."""

    effect: Effect
    shapes: int = 0
    """Number of its parameters that were searched for."""
    trials: float = 1.0
    """Number of independent tries of that search."""
    replaces: str = ""
    """Name of the error motion of the model that it refines."""
    prior: tuple[float, ...] = ()
    """Prior standard deviations of its linear parameters, in typical sizes; empty: the data determine its size."""
    changes: Effect | None = None
    """Effect of the present calibration that it changes; None where it is a cause of its own."""

    @property
    def kind(self) -> str:
        """Kind in the contract of the diagnosis."""
        return HIGHER_FREQUENCY if self.replaces else contract_kind(self.effect)

    @property
    def simple(self) -> bool:
        """True for a common cause with few parameters, none of which was searched for."""
        return not self.shapes and not self.rarity and len(self.effect.parameters) <= FEW

    @property
    def rarity(self) -> float:
        """Log odds of a common cause against this one, before any data; a drift rather shifts than tilts."""
        tilt = contract_kind(self.effect) == "thermal-drift" and str(self.axis) in "ABC"
        return RARE if tilt or self.effect.RARE else 0.0

    @property
    def shifts_tool(self) -> bool:
        """True for a thermal drift of the tool along an axis: one direction of a vector."""
        effect = self.effect
        return contract_kind(effect) == "thermal-drift" and effect.ACTS_ON == "tool" and not effect.angular

    @property
    def unit(self) -> Array:
        """Scale of its parameters in scores, in typical sizes: the prior is `GENEROUS` times this."""
        return np.array(self.prior) / GENEROUS if self.prior else np.ones(1)

    @property
    def axis(self) -> str | None:
        """Axis, or direction of the tool, or circle, station or target of the instrument."""
        return where(self.effect)

    @property
    def cause(self) -> tuple[str, str | None, str | None]:
        """Key that all variants of one cause share: kind, axis, component, and other axis, degree, side or moment.

        A reversal along its own axis is a backlash that changes with the position.
        """
        if isinstance(self.effect, Reversal) and self.effect.component == own_component(self.effect.axis):
            return BACKLASH, self.axis, None
        fields = (
            getattr(self.effect, field, None) for field in ("component", "other", "degree", "motion", "side", "over")
        )
        moment = None if self.effect.moment is None else "since"
        return self.kind, self.axis, "".join(str(field) for field in (*fields, moment) if field is not None) or None

    @property
    def form(self) -> tuple[str, ...]:
        """Key that candidates of one cause and as many parameters share, whatever their periods and time constants."""
        return (*map(str, self.cause), str(len(self.effect.parameters)))


@dataclass(frozen=True)
class Untested:
    """A cause that cannot be tested, and the columns that the data lack for it."""

    name: str
    lacks: str


def at_zero(effect: Effect) -> Effect:
    """The effect with its linear parameters at zero, shapes as they are."""
    table = effect.parameter_table
    values = [0.0 if quantity.linear else value for quantity, value in zip(table, effect.parameters, strict=True)]
    return effect.with_parameters(values, (0.0,) * len(values))


def library(measurement: Measurement, model: ErrorModel) -> tuple[list[Candidate], list[Untested]]:
    """Candidates for effects that a model of these data lacks, and the causes that cannot be tested."""
    found: list[Candidate] = []
    missing: list[Untested] = []
    known = {(type(effect), effect.name) for effect in model.effects}
    for candidate in (Candidate(*cause) for cause in causes(measurement)):
        lacks = [need for need in candidate.effect.needs if not given(measurement.state, need)]
        if lacks:
            missing.append(Untested(candidate.effect.name, ", ".join(lacks).replace("_", " ")))
        elif (type(candidate.effect), candidate.effect.name) not in known:
            found.append(candidate)
    return found, list(dict.fromkeys(missing))


def changes(model: ErrorModel) -> Iterator[Candidate]:
    """Changes of a machine since its calibration, other than of the course of its error motions.

    Scales, location errors, wobble and racking, which a first calibration contains as error motions; and a change of
    each other effect that the calibration has, at zero.
    """
    axes = {motion.axis: motion for motion, _ in model.error_motions}
    for axis in axes:
        rotary = axis[0] in "ABC"
        own = along_own_line(axis) if rotary else "XYZ" + _about(axis)
        lines = (LocationError(component, axis, 0.0) for component in get_args(Component) if component not in own)
        yield from (Candidate(line) for line in lines if line.name not in SQUARE_BY_DATUM)
        yield from _wobbles(axis) if rotary else [Candidate(Scale(axis, 0.0))]
    for effect in model.effects:
        of_its_own = effect.NAMES_CAUSE and not (effect.OF_ISO_230 or effect.OF_SEVERAL_CLASSES)
        if of_its_own and effect.ACTS_ON != "instrument":
            yield Candidate(at_zero(effect), changes=effect)
    yield from _racking(model, {axis: motion.basis.interval for axis, motion in axes.items()})


def _wobbles(axis: str) -> Iterator[Candidate]:
    for motion in get_args(Motion):
        for harmonic in WOBBLES:
            for sense in (1, -1):
                yield Candidate(Wobble(axis, motion, harmonic, sense, 0.0, 0.0))


def _racking(model: ErrorModel, intervals: Mapping[str, Interval]) -> Iterator[Candidate]:
    """Racking of the first axis of the tool's side, if it carries a bridge: a long second axis, across it."""
    bridge = [name for name, side in split_chain(model.machine.chain) if side == "tool" and name[0] not in "ABC"][:2]
    if all(name in intervals and own_component(name) in "XY" for name in bridge) and len(bridge) == 2:
        axis, cross = bridge
        low, high = intervals[cross]
        if high - low >= BRIDGE and own_component(axis) != own_component(cross):
            yield Candidate(Racking(axis, cross, high - low, Legendre(intervals[axis], 1), (0.0, 0.0), low))


def _about(axis: str) -> str:
    """Component of the rotation about a linear axis' own line."""
    return "ABC"["XYZ".index(own_component(axis))]
