"""Library of candidates: every cause in the table of effects that these data could show.

A candidate is an effect with its amplitudes at zero and its shapes (periods, time constants) as proposed. A cause that
needs columns that the data lack is listed with them. `proposed_shapes` proposes the shapes of cyclic errors and of
compensation tables from the residual.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, cast, get_args

import numpy as np

from calibration.diagnosis.search.linearised_fit import GENEROUS
from calibration.fit.datum import along_own_line
from calibration.measurement.instruments import LaserTracker
from calibration.measurement.measurement import Measurement
from calibration.observation.full_model import moving_axes
from kinematics.basis import Interval
from kinematics.effects import (
    AirScale,
    AngleHarmonic,
    Backlash,
    Component,
    CrossAxis,
    DriftWithSensor,
    Effect,
    ErrorMotion,
    FirstCycle,
    FollowingError,
    GrowthWithSensor,
    GrowthWithTime,
    LateReadBack,
    LocationError,
    RangeOffset,
    Settling,
    TargetOffset,
    ThermalDrift,
    TrackerDrift,
)
from kinematics.effects.base import own_component
from kinematics.error_model.model import ErrorModel
from kinematics.state import State
from kinematics.transforms import Array

TIME_CONSTANTS = (0.1, 0.2, 0.4, 0.8)
"""Time constants of exponentials, as shares of the duration of the data; refined in the fit."""
WARMER = 0.2
"""Range of a temperature, K, above which candidates depend on it."""
HARMONICS = (1, 2)
OWN_DEGREE, OTHER_DEGREE = 1, 2
"""Degrees of error motions that depend on another axis."""
KINDS = {"thermal-drift-sensor": "thermal-drift", "thermal-scale-sensor": "thermal-scale"}
"""Kinds in the contract of the diagnosis where the table of effects has other names."""
HIGHER_FREQUENCY = "higher-frequency"
RARE = 3.0
"""Log odds of common causes against rare ones, before any data: 20 to 1."""
RARE_KINDS = ("settling", "first-cycle", "late-read-back", "tracker-drift")
"""Kinds that also imitate a common cause: backlash, a thermal drift."""


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

    @property
    def kind(self) -> str:
        """Kind in the contract of the diagnosis."""
        return HIGHER_FREQUENCY if self.replaces else contract_kind(self.effect)

    @property
    def rarity(self) -> float:
        """Log odds of a common cause against this one, before any data."""
        return RARE if self.effect.kind in RARE_KINDS else 0.0

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
        """Key that all variants of one cause share: kind, axis, component and other axis."""
        other = getattr(self.effect, "other", "")
        return self.kind, self.axis, f"{getattr(self.effect, 'component', '')}{other}" or None


@dataclass(frozen=True)
class Untested:
    """A cause that cannot be tested, and the columns that the data lack for it."""

    name: str
    lacks: str


def contract_kind(effect: Effect) -> str:
    """The kind of an effect in a diagnosis (contract 4.3)."""
    return KINDS.get(effect.kind, effect.kind)


def where(effect: Effect) -> str | None:
    """Axis of an effect; else the direction of the tool, or the circle, station or target of the instrument."""
    for field in ("axis", "component", "circle", "station", "target"):
        if getattr(effect, field, None):
            return str(getattr(effect, field))
    return None


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
    for candidate in _all(measurement):
        lacks = [need for need in candidate.effect.needs if not _given(measurement.state, need)]
        if lacks:
            missing.append(Untested(candidate.effect.name, ", ".join(lacks).replace("_", " ")))
        elif (type(candidate.effect), candidate.effect.name) not in known:
            found.append(candidate)
    return found, list(dict.fromkeys(missing))


def changes(model: ErrorModel) -> Iterator[Candidate]:
    """Changes of a machine since its calibration: its error motions, and location errors of their axes."""
    axes = {effect.axis: effect for effect in model.effects if isinstance(effect, ErrorMotion)}
    for effect in model.effects:
        if isinstance(effect, ErrorMotion):
            zero = (0.0,) * effect.basis.size
            yield Candidate(ErrorMotion(effect.component, effect.axis, effect.basis, zero, u=zero))
    for axis in axes:
        own = along_own_line(axis) if axis[0] in "ABC" else None
        for component in get_args(Component):
            if (component not in own) if own else (component in "ABC" and component != _about(axis)):
                yield Candidate(LocationError(component, axis, 0.0))


def _about(axis: str) -> str:
    """Component of the rotation about a linear axis' own line."""
    return "ABC"["XYZ".index(own_component(axis))]


def _all(measurement: Measurement) -> Iterator[Candidate]:
    axes = moving_axes(measurement)
    for axis in axes:
        yield from _of_drive(measurement, axis)
    yield from _thermal(measurement, axes)
    if measurement.axis is None:
        yield from _crossed(axes)
    if isinstance(measurement.instrument, LaserTracker):
        yield from _of_tracker(measurement)
    if _given(measurement.state, "velocity"):
        yield Candidate(LateReadBack(lag_ms=0.0))


def _of_drive(measurement: Measurement, axis: str) -> Iterator[Candidate]:
    yield Candidate(Backlash(axis=axis, width=0.0))
    yield Candidate(Settling(axis=axis, share_ppm=0.0))
    yield Candidate(FollowingError(axis=axis, lag_ms=0.0))
    if measurement.state.cycle is not None:
        yield Candidate(FirstCycle(component=own_component(axis), axis=axis, offset=0.0))


def _thermal(measurement: Measurement, axes: dict[str, Interval]) -> Iterator[Candidate]:
    state = measurement.state
    span = float(np.ptp(state.time)) if state.time is not None else 0.0
    courses: list[dict[str, Any]] = [{"rate": 0.0}]
    courses += [{"amplitudes": (0.0,), "time_constants_s": (max(share * span, 1.0),)} for share in TIME_CONSTANTS]
    along = {own_component(axis) for axis in axes}
    if measurement.component is not None:
        along |= {cast(Component, str(letter)) for letter in np.unique(measurement.component) if letter}
    components = [c for c in get_args(Component) if measurement.axis is None or c in along]
    sensors = [name for name, kelvin in state.temperatures.items() if np.ptp(kelvin) > WARMER]
    for course in courses:
        shapes = len(course) - 1
        for component in components:
            yield Candidate(ThermalDrift(component=component, **course), shapes, 1.0 + 3 * shapes)
        for axis in axes:
            if axis[0] not in "ABC":
                yield Candidate(GrowthWithTime(axis=axis, **course), shapes, 1.0 + 3 * shapes)
    for sensor in sensors:
        for component in components:
            yield Candidate(DriftWithSensor(component=component, sensor=sensor, coefficient=0.0))
        for axis in axes:
            if axis[0] not in "ABC":
                yield Candidate(GrowthWithSensor(axis=axis, sensor=sensor, coefficient=0.0))


def _crossed(axes: dict[str, Interval]) -> Iterator[Candidate]:
    count = (OWN_DEGREE + 1) * OTHER_DEGREE
    for axis, own in axes.items():
        for other, interval in axes.items():
            if other != axis:
                for component in get_args(Component):
                    yield Candidate(
                        CrossAxis(
                            component=component,
                            axis=axis,
                            other=other,
                            own_interval=own,
                            other_interval=interval,
                            own_degree=OWN_DEGREE,
                            other_degree=OTHER_DEGREE,
                            coefficients=(0.0,) * count,
                        )
                    )


def _of_tracker(measurement: Measurement) -> Iterator[Candidate]:
    yield Candidate(RangeOffset(offset_um=0.0))
    yield Candidate(AirScale(scale_um_per_m=0.0))
    for circle in ("azimuth", "elevation"):
        for harmonic in HARMONICS:
            yield Candidate(AngleHarmonic(circle=circle, harmonic=harmonic, sine_urad=0.0, cosine_urad=0.0))
    yield Candidate(TrackerDrift())
    on_tool = [name for name, target in measurement.targets.items() if target.carrier == "tool"]
    if len(on_tool) > 1:
        for name in on_tool:
            yield Candidate(TargetOffset(target=name, offset_um=(0.0, 0.0, 0.0)))


def _given(state: State, column: str) -> bool:
    """True where the data have a column and its numbers vary; temperatures and names need not vary."""
    value = getattr(state, column)
    if column == "temperatures":
        return bool(value)
    if value is None:
        return False
    return value.dtype.kind not in "fi" or bool(np.any(value != value[:1]))
