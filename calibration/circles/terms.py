"""What may be in the deviations of circles, as terms: the causes of the table that a circle shows, and smooth waves.

The waves are all other error motions in a plane: alike in both directions and at all feeds, in bands of their number
on a turn. Two waves and less are those of centre, length, squareness and scale.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import combinations, permutations
from typing import Any, cast

import numpy as np

from calibration.circles.circles import Circle, ballbar_of
from calibration.diagnosis.forms import made_of, plain
from calibration.diagnosis.prior_odds import with_log_prior
from calibration.gaussian_terms.geometry import prior_sizes
from calibration.gaussian_terms.observations import Observations
from calibration.gaussian_terms.term import Term
from calibration.measurement.measurement import Measurement
from kinematics.basis import Interval, Legendre
from kinematics.effects import (
    Backlash,
    Component,
    Effect,
    ErrorMotion,
    LateralPlay,
    LocationError,
    ReversalSpike,
    Scale,
    ServoMismatch,
)
from kinematics.effects.base import own_component
from kinematics.error_model.priors import BANDS
from kinematics.transforms import Array

OTHER = "other-error-motions"
"""Kind of the smooth errors of position that no cause of the list has."""
MOST_WAVES = 20
"""Most of their waves on a turn, as the degree of an error motion."""
SPIKE_MM = (0.03, 0.06, 0.12, 0.25, 0.5, 1.0, 2.0)
"""Distances over which a reversal spike decays; the search refines them."""
NEIGHBOUR_DISTANCES = 8
"""Distances, or times, between two neighbours at a time."""
CURVED_POSITIONING = 0.5
"""Prior odds of a curved positioning error: controls compensate it more often than a bow, which looks alike."""
BOW = 1.5
"""Range of a Legendre polynomial of degree 2 over its interval."""


@dataclass(frozen=True, eq=False)
class CircleTerm(Term):
    """A term whose sizes have names."""

    names: tuple[str, ...] = ()
    """Names of its sizes with their units; empty where it has none."""
    unit_sizes: Array = field(default_factory=lambda: np.zeros((0, 0)))
    """Sizes by the coefficients of the columns `(names, width)`."""
    shape: Mapping[str, float] = field(default_factory=dict)
    """Values that shape the columns, with units."""


def terms_of(observations: Observations, circles: Sequence[Circle]) -> list[Term]:
    """All terms that are tried, with their prior odds; cyclic errors are proposed by the search.

    Error motions are in every machine: each is there as likely as not, but for curved positioning. Circles are run
    because of the drives: each kind of their causes is common, and shared by its places and shapes.
    """
    found = []
    for term in (*_error_motions(observations), *_waves(observations, circles)):
        odds = CURVED_POSITIONING if term.kind == "positioning-curve" else 1.0
        found.append(with_log_prior(term, float(np.log(odds))))
    common, of_drives = observations.priors.common, list(_of_drives(observations))
    kinds = Counter(term.kind for term in of_drives)
    odds_of = {kind: common / (1.0 - common) / count for kind, count in kinds.items()}
    return [*(with_log_prior(term, float(np.log(odds_of[term.kind]))) for term in of_drives), *found]


def named_sizes(term: Term) -> tuple[tuple[str, ...], Array]:
    """Names of the sizes of a term with their units, and the sizes by the coefficients of its columns `(k, width)`."""
    if isinstance(term, CircleTerm):
        return term.names, term.unit_sizes
    assert term.parameters is not None
    table = [parameter for effect in term.effects for parameter in effect.parameter_table if parameter.linear]
    single = sum(parameter.name.startswith("sine") for parameter in table) == 1
    names = [each.name.removesuffix("[0]") if single else each.name for each in table]
    return tuple(f"{name}_{each.unit}" for name, each in zip(names, table, strict=True)), term.parameters


def shape_of(term: Term) -> dict[str, float]:
    """Values that shape the columns of a term, with their units in the names."""
    if isinstance(term, CircleTerm):
        return dict(term.shape)
    shapes = {}
    for effect in term.effects:
        for parameter in effect.parameter_table:
            if not parameter.linear:
                shapes[f"{parameter.name}_{parameter.unit}"] = float(getattr(effect, parameter.name))
    return shapes


def _term(
    observations: Observations, kind: str, where: str, effects: Sequence[Effect], parameters: Array, **more: Any
) -> CircleTerm:
    """A term of effects, of coefficients that give their linear parameters by `parameters @`."""
    make = made_of(observations, tuple(effects), parameters)
    return CircleTerm(
        f"{kind} {where}", kind, (kind, where), make, parameters.shape[1], tuple(effects), parameters, where, **more
    )


def _linear_axes(observations: Observations) -> dict[str, Interval]:
    return {axis: span for axis, span in observations.measurement.moving.items() if axis[0] not in "ABC"}


def _of_drives(observations: Observations) -> Iterator[Term]:
    """Causes that differ by the direction of motion, or by the feed."""
    axes = _linear_axes(observations)
    for axis, (low, high) in axes.items():
        # width and wind-up, um per m, by the widths at both ends
        at_zero = np.array([[-low, high], [1e3, -1e3]]) / (high - low)
        names = "width_plus_um", "width_minus_um"
        effect = Backlash(axis, 0.0, 0.0)
        size = effect.typical[0]
        yield _term(observations, "backlash", axis, [effect], size * at_zero, names=names, unit_sizes=size * np.eye(2))
        yield from _spikes(observations, axis)
    for axis, other in permutations(axes, 2):
        play = plain(observations, LateralPlay(own_component(other), axis, 0.0))
        yield _renamed(play, "lateral-play", f"E_{own_component(other)}{axis}", "play_um")
    for one, other in combinations(axes, 2):
        yield _renamed(
            plain(observations, ServoMismatch(one, other, 0.0)), "servo-mismatch", f"{one} {other}", "lag_ms"
        )


def _renamed(term: Term, kind: str, where: str, name: str) -> Term:
    """A term of one parameter with the names of circular tests."""
    assert term.parameters is not None
    return CircleTerm(
        f"{kind} {where}", kind, (kind, where), term.make, 1, term.effects, term.parameters, where,
        names=(name,), unit_sizes=term.parameters,
    )  # fmt: skip


def _error_motions(observations: Observations) -> Iterator[Term]:
    """Squareness, scales, and bows of the axes."""
    axes = _linear_axes(observations)
    for axis, other in permutations(axes, 2):
        yield _bow(observations, "straightness", own_component(other), axis)
    for axis in axes:
        yield _bow(observations, "positioning-curve", own_component(axis), axis)
    for one, other in combinations(axes, 2):
        apart = [Scale(one, 0.0), Scale(other, 0.0)]
        parameters = apart[0].typical[0] * np.array([[0.5], [-0.5]])
        yield _term(
            observations, "scale-mismatch", f"{one} {other}", apart, parameters, names=("difference_um_per_m",),
            unit_sizes=np.array([apart[0].typical]),
        )  # fmt: skip
        first, second = sorted((one, other), key=own_component)
        normal = cast(Component, "ABC"[3 - sum("XYZ".index(own_component(axis)) for axis in (one, other))])
        angle = plain(observations, LocationError(normal, second, 0.0))
        yield _renamed(angle, "squareness", f"{first} {second}", "angle_urad")


def _bow(observations: Observations, kind: str, component: Component, axis: str) -> Term:
    motion = ErrorMotion(component, axis, Legendre(_linear_axes(observations)[axis], 2), (0.0,) * 3)
    parameters = np.zeros((3, 1))
    parameters[2] = prior_sizes(np.array([2]), observations.priors)
    where, sizes = f"E_{component}{axis}", BOW * parameters[2:]
    return _term(observations, kind, where, [motion], parameters, names=("bow_um",), unit_sizes=sizes)


def _waves(observations: Observations, circles: Sequence[Circle]) -> Iterator[Term]:
    """All other error motions of each plane, band by band."""
    angles = np.zeros(len(observations))
    planes = np.full(len(observations), "", dtype=object)
    for circle in circles:
        angles[circle.rows], planes[circle.rows] = circle.angles, circle.plane
    for plane in dict.fromkeys(circle.plane for circle in circles):
        for low, high in BANDS:
            numbers = np.arange(max(low, 3), min(high, MOST_WAVES) + 1)
            if len(numbers):
                make = partial(_wave_columns, observations, angles, planes == plane, numbers)
                name, width, most = f"{OTHER} {plane} up to {numbers[-1]}", 2 * len(numbers), float(numbers[-1])
                no_sizes, shape = np.zeros((0, width)), {"waves": most}
                yield CircleTerm(name, OTHER, (name,), make, width, where=plane, unit_sizes=no_sizes, shape=shape)


def _wave_columns(observations: Observations, angles: Array, own: np.ndarray, numbers: np.ndarray) -> Array:
    turns, size = np.outer(angles, numbers), 1e-3 * prior_sizes(numbers, observations.priors)
    columns = np.concatenate([np.cos(turns) * size, np.sin(turns) * size], axis=1)
    return np.where(own[:, None], columns, 0.0)[:, None, :]


# ---- reversal spikes


def _spikes(observations: Observations, axis: str) -> Iterator[Term]:
    """Spikes that keep their distance, and at several feeds spikes that keep their time."""
    measurement = observations.measurement
    feeds = feeds_of(measurement)
    ways = [SPIKE_MM[0] / 2.0, *SPIKE_MM, SPIKE_MM[-1] * 2.0]
    for i in range(len(SPIKE_MM)):
        near = ways[i : i + 3]
        yield _spike(observations, axis, "length_mm", near)
        if len(feeds) > 1:
            yield _spike(observations, axis, "time_ms", [time_of(measurement, feeds[-1], way) for way in near])


def _spike(observations: Observations, axis: str, shape: str, near: Sequence[float]) -> Term:
    """A spike at both ends of an axis with a shape, between those of its neighbours."""
    low, own, high = near
    values = np.geomspace(low, high, NEIGHBOUR_DISTANCES + 2).tolist()
    return replace(
        spike_by_feed(observations, axis, _ways(observations.measurement, {shape: own})),
        name=f"reversal-spike {axis} {shape} {own:.9g}",
        shape={shape: own},
        finer=lambda: [_spike(observations, axis, shape, values[i : i + 3]) for i in range(NEIGHBOUR_DISTANCES)],
    )


def _ways(measurement: Measurement, shape: Mapping[str, float]) -> dict[float, float]:
    """Distances over which a spike with a length or a time decays, mm, by feed."""
    if "length_mm" in shape:
        return dict.fromkeys(feeds_of(measurement), shape["length_mm"])
    return {feed: way_in(measurement, feed, shape["time_ms"]) for feed in feeds_of(measurement)}


def ways_of(measurement: Measurement, term: Term) -> dict[float, float]:
    """Distances over which a spike decays, mm, by feed."""
    return _ways(measurement, shape_of(term))


def spike_by_feed(observations: Observations, axis: str, ways: Mapping[float, float]) -> CircleTerm:
    """A spike at the positive and at the negative end of an axis; ways: distances of its decay, mm, by feed."""
    names = "height_plus_um", "height_minus_um"
    effect = ReversalSpike(axis, 0.0, next(iter(ways.values())))
    size = effect.typical[0]
    make = partial(_spike_columns, observations, axis, ways, size)
    return CircleTerm(
        f"reversal-spike {axis} {sorted(ways.items())}", "reversal-spike", ("reversal-spike", axis), make, 2, (effect,),
        where=axis, names=names, unit_sizes=size * np.eye(2),
    )  # fmt: skip


def _spike_columns(observations: Observations, axis: str, ways: Mapping[float, float], size: float) -> Array:
    measurement = observations.measurement
    assert measurement.feed is not None
    own = np.zeros((len(observations), 1, 1))
    for way in set(ways.values()):
        feeds = [feed for feed, value in ways.items() if value == way]
        signal = made_of(observations, [ReversalSpike(axis, 0.0, way)], np.array([[size]]))()
        own = np.where(np.isin(measurement.feed, feeds)[:, None, None], signal, own)
    x = measurement.state.position(measurement.machine, axis)
    plus = (x > 0.5 * sum(measurement.moving[axis]))[:, None, None]
    return np.concatenate([np.where(plus, own, 0.0), np.where(plus, 0.0, own)], axis=2)


def feeds_of(measurement: Measurement) -> list[float]:
    """The feeds of the rows, ascending, mm/min."""
    assert measurement.feed is not None
    return [float(feed) for feed in np.unique(measurement.feed)]


def radius_mm(measurement: Measurement) -> float:
    """Radius of the circles, mm: the length of the bar."""
    return ballbar_of(measurement).length_mm


def time_of(measurement: Measurement, feed: float, way: float) -> float:
    """Time, ms, in which an axis on a circle moves a distance, mm, after its reversal: sqrt(2 r s) / v."""
    return float(6e4 * (2.0 * radius_mm(measurement) * way) ** 0.5 / feed)


def way_in(measurement: Measurement, feed: float, time_ms: float) -> float:
    """Way, mm, of an axis on a circle in a time, ms, after its reversal."""
    return (feed * time_ms / 6e4) ** 2 / (2.0 * radius_mm(measurement))
