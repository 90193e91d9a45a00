"""The causes of deviations that are tried on circles: signals along the bar of the table's effects."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations, permutations
from typing import cast

import numpy as np

from calibration.circles.circles import Circle
from calibration.measurement.measurement import Measurement
from kinematics.basis import Legendre
from kinematics.effects import (
    Backlash,
    Component,
    Cyclic,
    EffectBase,
    ErrorMotion,
    LateralPlay,
    LocationError,
    ReversalSpike,
    Scale,
    ServoMismatch,
)
from kinematics.effects.base import own_component
from kinematics.transforms import Array

LENGTHS_MM = (0.03, 0.06, 0.12, 0.25, 0.5, 1.0, 2.0)
"""Ways over which a reversal spike decays that are tried, mm; refined."""
WAVES = 3.0
"""Rows in the shortest period of a cyclic error."""
LARGEST_PERIOD = 0.1
"""Longest period of a cyclic error, as a share of the range of its axis."""
HEIGHTS = "height_plus_um", "height_minus_um"
OTHER = "other-error-motions"
"""Kind of the smooth errors of position that no cause of the list has."""
OTHER_WAVES = (4, 6, 8, 12)
"""Numbers of waves on a turn up to which they are tried."""


@dataclass(frozen=True, eq=False)
class Group:
    """A cause with the columns of its signal."""

    kind: str
    where: str
    names: tuple[str, ...]
    """Names of its parameters with their units."""
    columns: Array
    """Signal along the bar `(n, k)`, um for each unit of the parameters."""
    shape: Mapping[str, float]
    """Values of the parameters that shape the columns, with units."""
    trials: float = 1.0
    """Number of independent shapes that were tried."""

    @cached_property
    def norms(self) -> Array:
        """Norms of the columns `(k,)`, um; 1 of a column of zeros."""
        norms = np.linalg.norm(self.columns, axis=0)
        return np.where(norms > 0.0, norms, 1.0)

    @property
    def name(self) -> str:
        """Name in reports: `backlash X`."""
        return f"{self.kind} {self.where}"

    @property
    def unit(self) -> str:
        """Unit of its first parameter; empty without named parameters."""
        unit = self.names[0].partition("_")[2] if self.names else ""
        return unit.removeprefix("plus_").replace("_per_", "/")


def candidates(measurement: Measurement, transform: Array, rows: np.ndarray) -> Iterator[Group]:
    """The causes that are tried: those of the table that a circle shows."""
    machine, q = measurement.machine, measurement.state.positions[rows]
    moving = [
        axis.name for axis, span in zip(machine.axes, np.ptp(q, axis=0).tolist(), strict=True)
        if not axis.rotary and span > 1.0
    ]  # fmt: skip

    def signal(effect: EffectBase) -> Array:
        return signal_of(measurement, transform, rows, effect)

    for axis in moving:
        backlash = signal(Backlash(axis, 1.0))
        i = machine.index(axis)
        side = (q[:, [i]] - q[:, i].mean()) / (0.5 * np.ptp(q[:, i]))
        yield Group("backlash", axis, ("width_plus_um", "width_minus_um"), _sides(backlash, side), {})
        for length in LENGTHS_MM:
            yield spike(measurement, transform, rows, axis, length)
        feeds = feeds_of(measurement, rows)
        for length in LENGTHS_MM if len(feeds) > 1 else ():
            yield timed_spike(measurement, transform, rows, axis, time_of(measurement, feeds[-1], length))
        yield from _periods(measurement, transform, rows, axis)
    for axis, other in permutations(moving, 2):
        component = own_component(other)
        where = f"E_{component}{axis}"
        yield Group("lateral-play", where, ("play_um",), signal(LateralPlay(component, axis, 1.0)), {})
        low, high = q[:, machine.index(axis)].min(), q[:, machine.index(axis)].max()
        bow = signal(ErrorMotion(component, axis, Legendre((float(low), float(high)), 2), (0.0,) * 3))[:, 2:]
        yield Group("straightness", where, ("bow_um",), bow / 1.5, {})
    for axis in moving:
        low, high = q[:, machine.index(axis)].min(), q[:, machine.index(axis)].max()
        component, basis = own_component(axis), Legendre((float(low), float(high)), 2)
        curve = signal(ErrorMotion(component, axis, basis, (0.0,) * 3))[:, 2:]
        yield Group("positioning-curve", f"E_{component}{axis}", ("bow_um",), curve / 1.5, {})
    for one, other in combinations(moving, 2):
        pair = f"{one} {other}"
        apart = 0.5 * (signal(Scale(one, 1.0)) - signal(Scale(other, 1.0)))
        yield Group("scale-mismatch", pair, ("difference_um_per_m",), apart, {})
        normal = cast(Component, "ABC"[3 - sum("XYZ".index(own_component(axis)) for axis in (one, other))])
        first, second = sorted((one, other), key=own_component)
        angle = signal(LocationError(normal, second, 1.0))
        yield Group("squareness", f"{first} {second}", ("angle_urad",), angle, {})
        yield Group("servo-mismatch", pair, ("lag_ms",), signal(ServoMismatch(one, other, 1.0)), {})


def other_motions(measurement: Measurement, rows: np.ndarray, circles: Sequence[Circle]) -> Iterator[Group]:
    """All other error motions in a plane: waves of the deviation, alike in both directions and at all feeds.

    Two waves and less are those of centre, length, squareness and scale.
    """
    angles, planes = np.zeros(len(measurement.observed)), np.full(len(measurement.observed), "", dtype=object)
    for circle in circles:
        angles[circle.rows], planes[circle.rows] = circle.angles, circle.plane
    for plane in dict.fromkeys(circle.plane for circle in circles):
        own = (planes[rows] == plane)[:, None]
        for most in OTHER_WAVES:
            turns = np.outer(angles[rows], np.arange(3, most + 1))
            columns = np.where(own, np.concatenate([np.cos(turns), np.sin(turns)], axis=1), 0.0)
            yield Group(OTHER, plane, (), columns, {"waves": most})


def spike(measurement: Measurement, transform: Array, rows: np.ndarray, axis: str, length: float) -> Group:
    """A reversal spike at both ends of an axis that decays over a distance, mm, at all feeds."""
    columns = spike_columns(measurement, transform, rows, axis, dict.fromkeys(feeds_of(measurement, rows), length))
    return Group("reversal-spike", axis, HEIGHTS, columns, {"length_mm": length}, 6.0)


def timed_spike(measurement: Measurement, transform: Array, rows: np.ndarray, axis: str, time_ms: float) -> Group:
    """A reversal spike at both ends of an axis that decays over a time, ms: over a longer distance at a higher feed."""
    ways = {feed: way_in(measurement, feed, time_ms) for feed in feeds_of(measurement, rows)}
    columns = spike_columns(measurement, transform, rows, axis, ways)
    return Group("reversal-spike", axis, HEIGHTS, columns, {"time_ms": time_ms}, 6.0)


def spike_columns(
    measurement: Measurement, transform: Array, rows: np.ndarray, axis: str, ways: Mapping[float, float]
) -> Array:
    """Signals `(n, 2)` of unit spikes at the positive and at the negative end; ways: distances, mm, by feed."""
    assert measurement.feed is not None
    own = np.zeros((len(rows), 1))
    for way in set(ways.values()):
        feeds = [feed for feed, value in ways.items() if value == way]
        signal = signal_of(measurement, transform, rows, ReversalSpike(axis, 0.0, way))[:, :1]
        own = np.where(np.isin(measurement.feed[rows], feeds)[:, None], signal, own)
    x = measurement.state.positions[rows, measurement.machine.index(axis)]
    plus = (x > 0.5 * (x.min() + x.max()))[:, None]
    return np.concatenate([np.where(plus, own, 0.0), np.where(plus, 0.0, own)], axis=1)


def feeds_of(measurement: Measurement, rows: np.ndarray) -> list[float]:
    """The feeds of the rows, ascending, mm/min."""
    assert measurement.feed is not None
    return [float(feed) for feed in np.unique(measurement.feed[rows])]


def radius_mm(measurement: Measurement) -> float:
    """Radius of the circles, mm: the length of the bar."""
    assert measurement.instrument.OBSERVES == "distance"
    return measurement.instrument.length_mm


def time_of(measurement: Measurement, feed: float, way: float) -> float:
    """Time, ms, in which an axis on a circle moves a distance, mm, after its reversal: sqrt(2 r s) / v."""
    return float(6e4 * (2.0 * radius_mm(measurement) * way) ** 0.5 / feed)


def way_in(measurement: Measurement, feed: float, time_ms: float) -> float:
    """Way, mm, of an axis on a circle in a time, ms, after its reversal."""
    return (feed * time_ms / 6e4) ** 2 / (2.0 * radius_mm(measurement))


def cyclic(measurement: Measurement, transform: Array, rows: np.ndarray, axis: str, period: float) -> Group:
    """A cyclic error of an axis with one harmonic and this period, mm."""
    component = own_component(axis)
    columns = signal_of(measurement, transform, rows, Cyclic(component, axis, period, (0.0,), (0.0,)))[:, 1:]
    waves = _range(measurement, rows, axis) / period
    return Group("cyclic", axis, ("sine_um", "cosine_um"), columns, {"period_mm": period}, max(waves, 1.0) * 10.0)


def signal_of(measurement: Measurement, transform: Array, rows: np.ndarray, effect: EffectBase) -> Array:
    """Signal along the bar `(n, parameters)` of an effect, um for each unit of its parameters."""
    total: Array | None = None
    for column, component, values in effect.columns(measurement.machine, measurement.state):
        own = transform[rows, 6 * column + component][:, None] * values[rows]
        total = own if total is None else total + own
    assert total is not None
    return total


def _sides(width: Array, side: Array) -> Array:
    """Columns of the widths at the positive and at the negative end, for a width that is linear between."""
    return np.concatenate([width * 0.5 * (1.0 + side), width * 0.5 * (1.0 - side)], axis=1)


def _range(measurement: Measurement, rows: np.ndarray, axis: str) -> float:
    return float(np.ptp(measurement.state.positions[rows, measurement.machine.index(axis)]))


def _periods(measurement: Measurement, transform: Array, rows: np.ndarray, axis: str) -> Iterator[Group]:
    """Cyclic errors on a grid of periods, fine enough that the phase at the ends changes by less than an eighth."""
    steps = np.abs(np.diff(measurement.state.positions[rows, measurement.machine.index(axis)]))
    span, shortest = _range(measurement, rows, axis), WAVES * float(np.quantile(steps, 0.95))
    low, high = 1.0 / (LARGEST_PERIOD * span), 1.0 / max(shortest, 1e-3)
    for frequency in np.arange(low, high, 0.4 / span).tolist():
        yield cyclic(measurement, transform, rows, axis, 1.0 / frequency)
