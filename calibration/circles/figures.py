"""The figures of a circular test by ISO 230-4:2005, for each plane and feed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from calibration.circles.circles import Circle, ballbar_of
from calibration.instruments import Ballbar
from calibration.instruments.ballbar import LENGTH_ERROR
from calibration.measurement.measurement import Measurement
from calibration.plausibility.misfit import misfit
from kinematics.transforms import Array

SECTORS = 720
"""Angles per turn at which both directions are compared."""


@dataclass(frozen=True)
class CircularFigure:
    """One value of ISO 230-4, um."""

    symbol: str
    title: str
    value: float
    U: float
    """Expanded uncertainty, k = 2, from the uncertainties of the instrument."""


@dataclass(frozen=True)
class CircularTest:
    """The circles of one plane at one feed."""

    plane: str
    feed: float
    """mm/min."""
    figures: tuple[CircularFigure, ...]
    circles: tuple[Circle, ...]
    deviations: tuple[Array, ...]
    """Radial deviations `(n,)` of each circle from the least-squares circle of both directions, um."""

    def json(self) -> dict[str, Any]:
        """The test for programs."""
        values = {each.symbol: {"value_um": each.value, "U_um": each.U} for each in self.figures}
        return {"plane": self.plane, "feed_mm_min": self.feed, "figures": values}


def circular_tests(measurement: Measurement, circles: Sequence[Circle]) -> list[CircularTest]:
    """The figures of each plane and feed."""
    tests = []
    for plane, feed in dict.fromkeys((each.plane, each.feed) for each in circles):
        mine = tuple(each for each in circles if (each.plane, each.feed) == (plane, feed))
        tests.append(_test(measurement, plane, feed, mine))
    return tests


def _test(measurement: Measurement, plane: str, feed: float, circles: tuple[Circle, ...]) -> CircularTest:
    instrument = ballbar_of(measurement)
    residual, registration = misfit(measurement)
    # deviations from the nominal radius about the common centre; the error of the bar's length is in them
    off = [1e3 * (residual[each.rows, 0] + registration.zeros[LENGTH_ERROR]) for each in circles]
    together = np.concatenate([each.angles for each in circles])
    radius, about = _least_squares(together, np.concatenate(off))
    own = [values - radius - _shift(each.angles, about) for each, values in zip(circles, off, strict=True)]
    return CircularTest(plane, feed, tuple(_figures(instrument, circles, off, own, radius)), circles, tuple(own))


def _figures(
    instrument: Ballbar, circles: Sequence[Circle], off: Sequence[Array], own: Sequence[Array], radius: float
) -> Iterator[CircularFigure]:
    u = instrument.u_um
    of_range = 2.0 * 2.0**0.5 * u
    for name, forward in (("ccw", True), ("cw", False)):
        parts = [k for k, each in enumerate(circles) if each.counter_clockwise == forward]
        if parts:
            angles = np.concatenate([circles[k].angles for k in parts])
            values = np.concatenate([off[k] for k in parts])
            mean, about = _least_squares(angles, values)
            deviation = values - mean - _shift(angles, about)
            yield CircularFigure(f"G({name})", f"circular deviation {name}", float(np.ptp(deviation)), of_range)
    both = {each.counter_clockwise for each in circles} == {True, False}
    every = np.concatenate(own)
    if both:
        yield CircularFigure("G(b)", "bi-directional circular deviation", float(np.ptp(every)), of_range)
        yield CircularFigure("H", "circular hysteresis", _hysteresis(circles, own), of_range)
    if instrument.length_u_um is not None:
        of_radius = 2.0 * float(np.hypot(u, instrument.length_u_um))
        yield CircularFigure("Fmax", "largest radial deviation", float(every.max()) + radius, of_radius)
        yield CircularFigure("Fmin", "smallest radial deviation", float(every.min()) + radius, of_radius)
        if both:
            of_mean = 2.0 * float(np.hypot(u / len(every) ** 0.5, instrument.length_u_um))
            yield CircularFigure("D", "mean bi-directional radial deviation", radius, of_mean)


def _least_squares(angles: Array, values: Array) -> tuple[float, Array]:
    """Mean, and shift `(2,)` in the plane, of the least-squares circle of deviations `(n,)` at angles `(n,)`."""
    columns = np.column_stack([np.ones(len(angles)), np.cos(angles), np.sin(angles)])
    mean, x, y = np.linalg.lstsq(columns, values)[0].tolist()
    return mean, np.array([x, y])


def _shift(angles: Array, about: Array) -> Array:
    return np.asarray(about[0] * np.cos(angles) + about[1] * np.sin(angles))


def _hysteresis(circles: Sequence[Circle], own: Sequence[Array]) -> float:
    """Largest difference, um, between the two directions at one angle."""
    means = []
    for forward in (True, False):
        parts = [k for k, each in enumerate(circles) if each.counter_clockwise == forward]
        angles = np.concatenate([circles[k].angles for k in parts]) % (2.0 * np.pi)
        order = np.argsort(angles)
        values = np.concatenate([own[k] for k in parts])[order]
        grid = np.linspace(angles.min(), angles.max(), SECTORS)
        means.append(np.interp(grid, angles[order], values))
    return float(np.abs(means[0] - means[1]).max())
