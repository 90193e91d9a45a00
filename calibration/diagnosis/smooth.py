"""Smooth functions without a name: displacements of the tool, and errors of a beam's readings.

They are sums of products of Legendre polynomials of some variables, whose coefficients share one size.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import cache, partial
from itertools import combinations
from typing import NamedTuple

import numpy as np

from calibration.diagnosis.library.causes import WARMER
from calibration.gaussian_terms.observations import Observations
from calibration.gaussian_terms.posterior import ROUNDING
from calibration.gaussian_terms.term import Along, Term
from kinematics.basis import Interval, Legendre
from kinematics.effects import Unnamed
from kinematics.effects.base import UM
from kinematics.effects.combined.where import beam
from kinematics.state import TEMPERATURE, TIME
from kinematics.transforms import Array

(TYPICAL_FUNCTION_UM,) = (quantity.typical for quantity in Unnamed.QUANTITIES)
"""Typical size of a function without a name, um, as that of `Unnamed`."""
DEGREES = (14, 8, 6)
"""Degrees in each variable of a function of one, two and three of them: up to about 80 products."""
DEGREES_BESIDE_TIME = 4
"""Degrees in the others of a function that changes with time as one of time alone, and less along the axes."""
OF_READINGS = (8, 6)
"""Degrees in each reading of an error of one and two of them."""
TREND, OWN_COURSE = 4, 0.1
"""Degree in time that imitates most temperatures, and the least share of a temperature that is no such trend."""


class Variable(NamedTuple):
    """A variable of smooth functions, with Legendre polynomials of unit mean square over its range."""

    name: str
    range: Interval
    columns: Array
    """`(n, degrees)`"""


class Products(NamedTuple):
    """Products of Legendre polynomials of some variables that share one size."""

    degrees: tuple[tuple[int, ...], ...]
    """One row for each product."""
    falls: Array
    """Prior sizes `(m,)` of products of unit mean square: of a function of mean square 1 in all."""

    @property
    def heights(self) -> Array:
        """Prior sizes `(m,)` of products of polynomials that are 1 at the end, as those of `Unnamed`."""
        return np.asarray(self.falls * np.sqrt(np.prod(2.0 * np.array(self.degrees) + 1.0, axis=1)))

    def of(self, columns: Sequence[Array]) -> Array:
        """The functions `(n, m)` in prior sizes, from the columns of their variables."""
        index = np.array(self.degrees).T
        found = self.falls * columns[0][:, index[0]]
        for own, degrees in zip(columns[1:], index[1:], strict=True):
            found *= own[:, degrees]
        return np.asarray(found)


def smooth(observations: Observations) -> Iterator[Term]:
    """Smooth functions of one to three variables, as displacements of the tool in each of its directions."""
    axes = axes_of(observations)
    variables = {**axes, **_conditions(observations)}
    turning = [name for name in axes if name[0] in "ABC"]
    for count, degree in enumerate(DEGREES, start=1):
        for chosen in combinations(variables, count):
            if chosen[0] in axes and count == 1:  # an error motion
                continue
            if count == len(DEGREES) and len(set(chosen) & set(turning)) > 1:  # rotary axes alone set few poses
                continue
            shapes = [(degree,) * count]
            if TIME in chosen and count > 1:
                shapes.append(tuple(DEGREES[0] if name == TIME else DEGREES_BESIDE_TIME for name in chosen))
            for shape in shapes:
                form = products(shape, tuple(name not in axes for name in chosen))
                yield from _of_tool(observations, [variables[name] for name in chosen], form)


@cache
def products(shape: tuple[int, ...], alone: tuple[bool, ...] = ()) -> Products:
    """Products of degrees k with sum k / largest degree from 0, exclusive, to 1; their sizes fall with each degree.

    alone: false for each variable of which no product is a function alone: that is an error motion, a scale or a
    location error. By default all may be.
    """
    alone = alone or (True,) * len(shape)
    degrees = [
        each
        for each in np.ndindex(*(most + 1 for most in shape))
        if 0 < sum(map(_share, each, shape)) <= 1.0 + ROUNDING
        and (np.count_nonzero(each) > 1 or alone[int(np.flatnonzero(each)[0])])
    ]
    falls = 1.0 / np.prod(np.maximum(degrees, 1), axis=1)
    return Products(tuple(degrees), falls / np.sqrt(np.sum(falls**2)))


def _share(degree: int, most: int) -> float:
    return degree / most


def axes_of(observations: Observations) -> dict[str, Variable]:
    """The axes that move, as variables."""
    machine, state = observations.measurement.machine, observations.measurement.state
    found = {}
    for axis, ends in observations.measurement.moving.items():
        columns = state.basis_columns(machine, axis, Legendre(ends, max(DEGREES[1], DEGREES_BESIDE_TIME)))
        found[axis] = Variable(axis, ends, _of_unit_mean_square(columns))
    return found


def _conditions(observations: Observations) -> dict[str, Variable]:
    """Time, and the temperatures that are no trend with time, as variables."""
    measurement, found = observations.measurement, {}
    trend = np.ones((len(observations), 1))
    if timed(observations):
        found[TIME] = variable(TIME, time_of(observations))
        trend = found[TIME].columns[:, : TREND + 1]
    for sensor, kelvin in measurement.state.temperatures.items():
        left = kelvin - trend @ np.linalg.lstsq(trend, kelvin, rcond=None)[0]
        if np.ptp(kelvin) > WARMER and np.std(left) > OWN_COURSE * np.std(kelvin):
            found[TEMPERATURE + sensor] = variable(TEMPERATURE + sensor, kelvin)
    return found


def variable(name: str, values: Array) -> Variable:
    """A variable of values `(n,)`, over their range."""
    ends = float(values.min()), float(values.max())
    return Variable(name, ends, _of_unit_mean_square(Legendre(ends, DEGREES[0]).columns(values)))


def _of_unit_mean_square(columns: Array) -> Array:
    return np.asarray(columns * np.sqrt(2.0 * np.arange(columns.shape[1]) + 1.0))


def timed(observations: Observations) -> bool:
    """True where the rows have times, of the machine, that differ."""
    measurement = observations.measurement
    time = measurement.state.time
    return time is not None and measurement.instrument.CLOCK_OF_MACHINE and bool(np.ptp(time))


def time_of(observations: Observations) -> Array:
    """The times `(n,)`, s; they are known."""
    time = observations.measurement.state.time
    assert time is not None
    return time


def share_of_time(observations: Observations) -> Array:
    """The time `(n,)` as a share of the duration."""
    time = time_of(observations)
    return np.asarray((time - time.min()) / np.ptp(time))


def along_tool(observations: Observations, letter: str, functions: Callable[[], Array]) -> Along:
    """Columns of functions that displace the tool in one of its directions."""
    return observations.along(6 * len(observations.measurement.machine.axes) + "XYZ".index(letter), functions)


def tool_directions(observations: Observations) -> list[str]:
    """Directions of the tool that the observations show."""
    first = 6 * len(observations.measurement.machine.axes)
    return [letter for k, letter in enumerate("XYZ") if observations.transform[:, :, first + k].any()]


def _of_tool(observations: Observations, variables: Sequence[Variable], products: Products) -> Iterator[Term]:
    names = tuple(each.name for each in variables)
    parameters = np.diag(TYPICAL_FUNCTION_UM * products.heights)
    columns = [each.columns for each in variables]
    for letter in tool_directions(observations):
        yield Term(
            f"function of {', '.join(names)} along {letter}",
            "smooth",
            ("smooth", names, letter),
            along_tool(observations, letter, partial(_sized, products, columns)),
            len(products.degrees),
            (unnamed(letter, variables, products),),
            parameters,
            letter,
            names,
        )


def unnamed(letter: str, variables: Sequence[Variable], products: Products) -> Unnamed:
    """The effect of a function of variables, with coefficients of zero."""
    return Unnamed(
        component=letter,  # type: ignore[arg-type]
        variables=tuple(each.name for each in variables),
        ranges=tuple(each.range for each in variables),
        terms=products.degrees,
        coefficients=(0.0,) * len(products.degrees),
    )


def _sized(products: Products, columns: Sequence[Array]) -> Array:
    return TYPICAL_FUNCTION_UM * UM * products.of(columns)


def of_readings(observations: Observations) -> Iterator[Term]:
    """Errors of the readings of a beam, smooth functions of one or two of them; they leave the data with it."""
    measurement = observations.measurement
    points = measurement.state.observed
    if not measurement.instrument.BY_BEAM or points is None:
        return
    own = beam(points)
    distance = np.linalg.norm(points, axis=1)
    turned = np.exp(1j * own.angles)
    azimuth, elevation = np.angle(turned / np.mean(turned, axis=0)).T
    readings = {"azimuth": azimuth, "elevation": elevation, "distance": distance}
    variables = {name: variable(name, values) for name, values in readings.items() if np.ptp(values)}
    errors = {
        "azimuth": own.sideways / distance.mean(),
        "elevation": own.upwards / distance.mean(),
        "distance": own.direction,
    }
    first = 6 * (len(measurement.machine.axes) + 1)
    arms = {name: np.einsum("ndk,nk->nd", observations.transform[:, :, first:], way) for name, way in errors.items()}
    for count, degree in enumerate(OF_READINGS, start=1):
        for chosen in combinations(variables, count):
            columns = [variables[name].columns for name in chosen]
            for name, arm in arms.items():
                yield Term(
                    f"error of {name} by {', '.join(chosen)}",
                    "smooth",
                    ("reading", chosen, name),
                    Along(name, arm, partial(_sized, products((degree,) * count), columns)),
                    len(products((degree,) * count).degrees),
                    where=name,
                    variables=chosen,
                )
