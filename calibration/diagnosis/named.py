"""Causes as terms: each with the members of its family, between which the search refines a cause that is present.

Members are time constants, lags and lengths of an effect; moments of a jump; angles of a step of a tracker's circle.
Periodic errors are proposed from a residual (`waves.py`).
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import msgspec
import numpy as np

from calibration.diagnosis.forms import Form, motion_changes, of_others, pivoted, plain, reversals
from calibration.diagnosis.library.causes import angle_steps, causes, given, jumps
from calibration.diagnosis.library.changes import at_zero, changes
from calibration.gaussian_terms.observations import Observations
from calibration.gaussian_terms.term import Term
from calibration.measurement.measurement import Measurement
from calibration.plausibility.times import pauses
from kinematics.basis import Interval
from kinematics.effects import Effect
from kinematics.effects.combined.where import beam
from kinematics.effects.records import Parameter
from kinematics.effects.tracker import CIRCLES
from kinematics.transforms import Array

JUMPS_IN_DICTIONARY = 40
"""Moments, or angles, of a jump in the dictionary, evenly spread over the rows; the search refines them."""
ROWS_BESIDE_JUMP = 8
"""Least number of moments, or angles, on each side of a jump: the rows beyond a later one are single outliers."""
MOST_JUMPS_BETWEEN = 16
"""Most moments, or angles, between two neighbours at a time."""
NEIGHBOUR_SHAPES = 8
"""Time constants, lags or lengths between two neighbours at a time."""
ALONE = 2.5
"""Factor to a time constant, lag or length beyond the last one of a family: about that between neighbours."""
SAME_POSITION_U = 6.0
"""Distance of two angles, in standard uncertainties, up to which they may be readings of one position."""
OPPOSITE = 180.0
"""Range of an angle, deg, from which a step over it has two sides for no row."""
At = Callable[[Effect, float], Effect]
"""The effect of a jump at another moment, s, or angle, deg."""


def named(observations: Observations) -> list[Term]:
    """The causes that a measurement can show, as terms.

    Its times count from its first row, and its rows have a station where the instrument stands at stations.
    """
    measurement = observations.measurement
    effects = _possible(observations)
    between = _neighbours(effects)
    terms = []
    for effect in effects:
        for form in _forms(effect):
            terms.append(_between_shapes(observations, effect, form, between.get(effect)))
    terms += reversals(observations)
    if observations.given is not None:
        terms += motion_changes(observations, observations.given)
    for effect in map(at_zero, jumps(measurement)):
        points, marks = _moments(measurement, effect)
        terms += _at_points(observations, effect, _since, points, marks)
    for step in angle_steps(measurement):
        points = _angles(observations, CIRCLES.index(step.over))
        terms += _at_points(observations, at_zero(step), _above, points, _spread(points))
    return terms


def _possible(observations: Observations) -> list[Effect]:
    """Causes whose columns the measurement has; beside a calibration, changes of it in the place of what it has."""
    measurement, calibration = observations.measurement, observations.given
    effects = list(causes(measurement))
    if calibration is not None:
        known = {(type(effect), effect.name) for effect in calibration.effects}
        effects = [*changes(calibration), *(effect for effect in effects if (type(effect), effect.name) not in known)]
    return [effect for effect in effects if all(given(measurement.state, need) for need in effect.needs)]


def _forms(effect: Effect) -> list[Form]:
    return [plain, pivoted] if effect.has_fixed_point else [plain]


def shape_of(effect: Effect) -> Parameter | None:
    """The quantity that shapes the columns of an effect: a time constant, a lag, a length; None where it has none."""
    return next((each for each in effect.quantities() if not each.linear and getattr(effect, each.name)), None)


def _value(effect: Effect, shape: Parameter) -> float:
    value = getattr(effect, shape.name)
    return float(value[0] if isinstance(value, tuple) else value)


def _with_shape(effect: Effect, shape: Parameter, value: float) -> Effect:
    many = isinstance(getattr(effect, shape.name), tuple)
    changes: dict[str, Any] = {shape.name: (value,) if many else value}
    return msgspec.structs.replace(effect, **changes)


def untested(measurement: Measurement) -> list[tuple[str, str]]:
    """Names of the causes that cannot be tried, and the columns that the measurement lacks for them."""
    found = {}
    for effect in causes(measurement):
        lacks = [need.replace("_", " ") for need in effect.needs if not given(measurement.state, need)]
        if lacks:
            found[effect.name] = ", ".join(lacks)
    return list(found.items())


def _neighbours(effects: Sequence[Effect]) -> dict[Effect, Interval]:
    """Of each effect with a shape: those of its neighbours, effects that are equal but for it, below and above it."""
    families: dict[Hashable, dict[float, Effect]] = {}
    for effect in effects:
        shape = shape_of(effect)
        if shape is not None:
            families.setdefault(_with_shape(effect, shape, 1.0), {})[_value(effect, shape)] = effect
    found = {}
    for members in families.values():
        values = sorted(members)
        ends = [values[0] / ALONE, *values, values[-1] * ALONE]
        found.update({members[own]: (low, high) for low, own, high in zip(ends, values, ends[2:], strict=False)})
    return found


def _between_shapes(observations: Observations, effect: Effect, form: Form, ends: Interval | None) -> Term:
    """The term of an effect, with finer members of shapes between two ends, if it has these."""
    term, shape = form(observations, effect), shape_of(effect)
    if shape is None or ends is None:
        return term

    def finer() -> list[Term]:
        low, high = ends
        values = np.geomspace(low, high, NEIGHBOUR_SHAPES + 2).tolist()
        members = [_with_shape(effect, shape, value) for value in values[1:-1]]
        near = zip(members, values, values[2:], strict=False)
        return [_between_shapes(observations, each, form, (low, high)) for each, low, high in near]

    return replace(term, finer=finer)


def _at_points(observations: Observations, effect: Effect, at: At, points: Array, marks: np.ndarray) -> Iterator[Term]:
    """Terms of a jump at some of the points `(m,)` at which it may be; marks `(k,)`: their indices, ascending.

    Finer members are at the points between those of its neighbours.
    """
    ends = [ROWS_BESIDE_JUMP - 1, *marks.tolist(), len(points) - ROWS_BESIDE_JUMP]
    for form in _forms(effect) if len(marks) else ():
        first = form(observations, at(effect, float(points[marks[0]])))
        yield from _at_marks(observations, first, at, points, ends)


def _at_marks(observations: Observations, jump: Term, at: At, points: Array, marks: Sequence[int]) -> list[Term]:
    """Terms of a jump at the marks but the first and the last one, which are the neighbours of the others."""

    def finer(low: int, own: int, high: int) -> list[Term]:
        inside = [mark for mark in range(low + 1, high) if mark != own]
        some = inside[:: -(-len(inside) // MOST_JUMPS_BETWEEN)] if inside else []
        return _at_marks(observations, jump, at, points, [low, *some, high])

    return [
        of_others(
            observations,
            jump,
            tuple(at(effect, float(points[own])) for effect in jump.effects),
            partial(finer, low, own, high),
        )
        for low, own, high in zip(marks, marks[1:], marks[2:], strict=False)
    ]


def _since(effect: Effect, moment: float) -> Effect:
    return msgspec.structs.replace(effect, since_s=moment)


def _above(effect: Effect, angle: float) -> Effect:
    return msgspec.structs.replace(effect, above_deg=angle)


def _spread(points: Array) -> np.ndarray:
    """Indices `(k,)` of about `JUMPS_IN_DICTIONARY` of some points `(m,)`, evenly spread between the ends."""
    inside = np.arange(ROWS_BESIDE_JUMP, len(points) - ROWS_BESIDE_JUMP)
    return inside[:: max(len(inside) // JUMPS_IN_DICTIONARY, 1)]


def _moments(measurement: Measurement, effect: Effect) -> tuple[Array, np.ndarray]:
    """The moments `(m,)` at which a jump may be, s: those of the rows of its station, or target; and marks of these."""
    time, here = measurement.state.time, np.ones(len(measurement), bool)
    assert time is not None
    for column in ("station", "target"):
        if name := getattr(effect, column, ""):
            here &= getattr(measurement.state, column) == name
    moments, marks = np.unique(time[here]), _spread(np.unique(time[here]))
    after_pause = np.searchsorted(moments, time[pauses(measurement)])
    inside = (after_pause >= ROWS_BESIDE_JUMP) & (after_pause < len(moments) - ROWS_BESIDE_JUMP)
    return moments, np.union1d(marks, after_pause[inside])


def _angles(observations: Observations, circle: int) -> Array:
    """The angles `(m,)`, deg, at which a step over a circle may be: between two positions; empty without two sides.

    Between readings of one position their noise would decide on the side, and be taken for a step.
    """
    observed = observations.measurement.state.observed
    if observed is None:
        return np.zeros(0)
    angles = beam(observed).angles[:, circle]
    centre = np.degrees(np.angle(np.mean(np.exp(1j * angles))))
    apart = np.unique(np.mod(np.degrees(angles) - centre + OPPOSITE, 2.0 * OPPOSITE) - OPPOSITE)
    if np.ptp(apart) >= OPPOSITE:
        return np.zeros(0)
    noise = np.sqrt(np.trace(observations.specified, axis1=1, axis2=2)) / np.linalg.norm(observed, axis=1)
    between = np.diff(apart) > SAME_POSITION_U * np.degrees(noise.max())
    return np.unique(np.round(centre + (apart[1:] + apart[:-1])[between] / 2.0, 5))
