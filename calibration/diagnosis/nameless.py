"""Functions without a name as terms: smooth functions, errors of readings, swings, random walks, errors of positions.

A function of the tool's displacement has an `Unnamed` effect. No table corrects a swing and a walk: elsewhere, and at
another time, only their size is known (`second_moment`).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import combinations

import numpy as np

from calibration.diagnosis.forms import made_of
from calibration.diagnosis.smooth import (
    TYPICAL_FUNCTION_UM,
    Products,
    Variable,
    along_tool,
    axes_of,
    of_readings,
    products,
    share_of_time,
    smooth,
    time_of,
    timed,
    tool_directions,
    unnamed,
    variable,
)
from calibration.gaussian_terms.geometry import ERROR_DEGREE
from calibration.gaussian_terms.observations import Observations
from calibration.gaussian_terms.structure import Structure
from calibration.gaussian_terms.term import Term
from calibration.observation.full_model import is_log
from kinematics.basis import Legendre
from kinematics.effects import ErrorMotion
from kinematics.effects.base import UM, own_component, unit_of
from kinematics.state import TIME
from kinematics.transforms import Array

TYPICAL_FINE = 3.0
"""Typical size of errors of single positions, um or urad: what curves of several degrees leave."""
TURNS_BETWEEN_SWINGS = 0.5
"""Turns over the duration of a measurement by which swings that are tried differ: they are orthogonal."""
SWING_TURNS = tuple(np.arange(1.0, 40.0, TURNS_BETWEEN_SWINGS).tolist())
"""Turns over the duration of the swings that are tried."""
FINER_TURNS = 4
"""Finer steps between two neighbouring swings."""
SWING_DEGREE = 6
"""Degree of the two axes with whose positions a swing changes, beside a swing that is present."""
WALK, ROWS_OF_A_STEP = 80, 4
"""Most Karhunen-Loeve functions of a random walk, and rows for each of them."""
MOST_OWN_ERRORS = 400
"""Most positions of an axis that have errors of their own; more of them are a curve."""
FINEST_DEGREE = 160
"""Largest degree of the curve of an axis that was logged at many positions: 80 waves over its travel."""
VISITS = 2.0
"""Least mean number of rows of a position."""
VISITED_DECIMALS = 2
"""Decimals of a position, mm or degrees, that is visited again."""


def nameless(observations: Observations) -> list[Term]:
    """All functions without a name that a measurement can show."""
    return [
        *smooth(observations),
        *of_readings(observations),
        *swings(observations),
        *walks(observations),
        *fine(observations),
    ]


def swings(observations: Observations) -> Iterator[Term]:
    """Periodic courses of the tool with time, of any phase, which change in proportion to the position of each axis.

    The effect of a term is the function of position that multiplies either phase. It is an uncertainty only, of the
    size that `second_moment` gives. Finer members have turns between its neighbours, and change with the position of
    two axes as a function of a higher degree.
    """
    if timed(observations):
        for letter in tool_directions(observations):
            yield from _in_proportion(observations, letter, SWING_TURNS, TURNS_BETWEEN_SWINGS)


def _in_proportion(observations: Observations, letter: str, turns: Sequence[float], step: float) -> Iterator[Term]:
    """Swings of some turns that change in proportion to the position of each axis; their neighbours are a step away."""
    axes = list(axes_of(observations).values())
    if not axes:
        return
    shares = ((0,) * len(axes), *map(tuple, np.eye(len(axes), dtype=int).tolist()))
    form = Products(shares, np.full(len(shares), len(shares) ** -0.5))
    for each in turns:
        yield replace(
            _swing(observations, letter, each, axes, form),
            finer=partial(_finer_swings, observations, letter, each, step),
        )


def _finer_swings(observations: Observations, letter: str, turns: float, step: float) -> list[Term]:
    """Members between the neighbours of a swing: other turns, and functions of two axes."""
    near = turns + step * np.arange(1 - FINER_TURNS, FINER_TURNS) / FINER_TURNS
    found = list(_in_proportion(observations, letter, near[near != turns].tolist(), step / FINER_TURNS))
    for pair in combinations(axes_of(observations).values(), 2):
        curved = products((SWING_DEGREE, SWING_DEGREE))
        form = Products(((0, 0), *curved.degrees), np.append(1.0, curved.falls) / 2.0**0.5)
        found += [_swing(observations, letter, each, pair, form) for each in near[::2].tolist()]
    return found


def _swing(
    observations: Observations, letter: str, turns: float, variables: Sequence[Variable], form: Products
) -> Term:
    """A swing of so many turns over the duration, times functions of some axes."""
    names = tuple(each.name for each in variables)
    columns = [each.columns for each in variables]
    size = TYPICAL_FUNCTION_UM * np.diag(form.heights)
    period = float(np.ptp(time_of(observations))) / turns
    return Term(
        f"error along {letter}, periodic in time ({period:.4g} s), which changes with {', '.join(names)}",
        "swing",
        ("swing", letter),
        along_tool(observations, letter, partial(_swing_functions, form, columns, share_of_time(observations), turns)),
        2 * len(form.degrees),
        (unnamed(letter, variables, form),),
        np.concatenate([size, size], axis=1),
        letter,
        (TIME, *names),
    )


def _swing_functions(form: Products, columns: Sequence[Array], share: Array, turns: float) -> Array:
    functions, phase = form.of(columns), (2.0 * np.pi * turns) * share[:, None]
    return TYPICAL_FUNCTION_UM * UM * np.concatenate([functions * np.sin(phase), functions * np.cos(phase)], axis=1)


def walks(observations: Observations) -> Iterator[Term]:
    """Random walks of the tool with time from where it was first, by their Karhunen-Loeve functions.

    The effect of a term is a constant displacement. It is an uncertainty only, of the size that `second_moment` gives:
    the RMS of the walk over the measurement.
    """
    if not timed(observations):
        return
    count, share = max(min(WALK, len(observations) // ROWS_OF_A_STEP), 1), share_of_time(observations)
    functions = _steps(count, share)
    whole, constant = variable(TIME, time_of(observations)), Products(((0,),), np.ones(1))
    parameters = TYPICAL_FUNCTION_UM * np.sqrt(np.mean(functions**2, axis=0))[None]
    for letter in tool_directions(observations):
        yield Term(
            f"random walk along {letter}",
            "walk",
            ("walk", letter),
            along_tool(observations, letter, partial(_walk_functions, count, share)),
            count,
            (unnamed(letter, [whole], constant),),
            parameters,
            letter,
            (TIME,),
        )


def _steps(count: int, share: Array) -> Array:
    """Functions `(n, count)` of a walk whose mean square over its duration is 1: variance 2 at its end."""
    rates = np.pi * (np.arange(count) + 0.5)
    return np.asarray(2.0 * np.sin(rates * share[:, None]) / rates)


def _walk_functions(count: int, share: Array) -> Array:
    return TYPICAL_FUNCTION_UM * UM * _steps(count, share)


def fine(observations: Observations) -> Iterator[Term]:
    """Errors of an axis finer than its error motions: at each of its positions, shared by all visits, or a curve."""
    measurement = observations.measurement
    for axis in measurement.moving:
        if is_log(measurement, axis):
            yield _fine_curve(observations, axis)
            continue
        position = np.round(measurement.state.position(measurement.machine, axis), VISITED_DECIMALS)
        _, number, counts = np.unique(position, return_inverse=True, return_counts=True)
        again = np.flatnonzero(counts > 1)
        if counts[number].mean() < VISITS or not ERROR_DEGREE < len(again) <= MOST_OWN_ERRORS:
            continue
        size = TYPICAL_FINE * unit_of(axis)[1]
        yield Term(
            f"fine errors of {axis}",
            "fine",
            ("fine", axis),
            observations.along(observations.own_arm(axis), partial(_visits, number, again, size)),
            len(again),
            where=axis,
            variables=(axis,),
        )


def _fine_curve(observations: Observations, axis: str) -> Term:
    """The positioning error of a logged axis, finer than its error motion: Legendre polynomials of higher degrees."""
    basis = Legendre(observations.measurement.moving[axis], FINEST_DEGREE)
    effect = ErrorMotion(own_component(axis), axis, basis, (0.0,) * basis.size)
    degrees = np.arange(basis.size)
    finer = degrees > ERROR_DEGREE
    sizes = TYPICAL_FINE * (ERROR_DEGREE / np.maximum(degrees, 1)) ** observations.priors.smoothness
    parameters = np.diag(sizes)[:, finer]
    return Term(
        f"fine errors of {axis}",
        "fine",
        ("fine", axis),
        made_of(observations, (effect,), parameters),
        parameters.shape[1],
        (effect,),
        parameters,
        axis,
        (axis,),
    )


def _visits(number: np.ndarray, again: np.ndarray, size: float) -> Array:
    return np.asarray(size * (number[:, None] == again))


def second_moment(term: Term, mean: Array, covariance: Array) -> Array:
    """Second moment `(P, P)` of the parameters of the effects of a function, um2, from that of its coefficients.

    mean `(width,)`, covariance `(width, width)`: of the coefficients. The columns are width / P groups of as many as
    there are parameters, which at another time have any sign: the phases of a swing, the functions of a walk. The size
    is that of all groups together, the largest of a swing.
    """
    parameters = term.parameters
    if parameters is None:
        return np.zeros((0, 0))
    whole = covariance + np.outer(mean, mean)
    count, found = len(parameters), np.zeros((len(parameters),) * 2)
    for start in range(0, term.width, count):
        group = slice(start, start + count)
        found += parameters[:, group] @ whole[group, group] @ parameters[:, group].T
    return found


def of_next_stop(structure: Structure, repeats: Mapping[str, float]) -> dict[str, float]:
    """Standard uncertainty of each axis at its next stop, um or urad, that no error motion holds.

    repeats: standard deviation of each axis from stop to stop, where the data show it.
    """
    squares = {axis: size**2 for axis, size in repeats.items()}
    for term, size in zip(structure.terms, structure.term_sizes, strict=True):
        if term.kind == "fine" and not term.effects and term.where is not None:
            squares[term.where] = squares.get(term.where, 0.0) + (size * TYPICAL_FINE) ** 2
    return {axis: math.sqrt(square) for axis, square in squares.items()}
