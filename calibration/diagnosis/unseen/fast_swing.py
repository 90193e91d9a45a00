"""A swing of the tool that is too fast for a smooth function of time, such as the cooler of a spindle makes.

Its periods are tried one after the other, with amplitudes that are the same everywhere or change linearly along an
axis. It stands if it is likelier than whatever else the residuals may be: noise, stops that shift independently, a
random walk, or a smooth function of recorded variables.
"""

from __future__ import annotations

import math

import numpy as np

from calibration.diagnosis.residual.absorber import absorbing, with_fair_noise, with_walk
from calibration.diagnosis.residual.dependence import EVIDENCE, LENGTHS, PERMUTATIONS, Function, Unexplained
from calibration.diagnosis.residual.unexplained import SEED, of_machine
from calibration.diagnosis.residual.unnamed import COMPONENTS, Direction
from calibration.diagnosis.search.linearised_fit import LinearisedFit
from calibration.diagnosis.unseen.beside_function import BesideFunction
from calibration.diagnosis.unseen.swing import MOST_TURNS, ROWS, ROWS_PER_TURN, STEP, Swinging, duration_of
from calibration.observation.normal_equations import whitened
from kinematics.effects import UM
from kinematics.state import TIME
from kinematics.transforms import Array

LEAST_TURNS = 4.0
"""Least turns within the measurement: a smooth function of time shows fewer."""
RIDGE, LEAST = 1e-9, 1e-30
"""Added to the squares of columns, as a share of them and at least: readings may not show a direction at all."""
PATH, APART = 0.3, 0.6
"""Share of the squares of an axis' positions from which a wave is its path, and turns from its multiples that part an
error of the time from one of positions."""
MOVES = 0.25
"""Share of the rows before which an axis has moved, from which it follows its path without rests."""


def fast_swing(linearised: LinearisedFit, smooth: Unexplained | None) -> Unexplained | None:
    """A fast swing in the residuals of a linearised fit, as a dependence on time and axes; None without one.

    None for readings along one axis, which moves with time: they may show a wave of its positions.

    smooth: the smooth function that explains the residuals, if there is one.
    """
    if linearised.state.time is None or linearised.measurement.axis is not None:
        return None
    few = linearised.evenly_noisy.thinned(ROWS)
    turns = np.arange(LEAST_TURNS, min(MOST_TURNS, len(few.rows) // ROWS_PER_TURN), STEP)
    if not len(turns):
        return None
    (component, count), p_value = _likeliest(few, turns)
    if p_value > 1.0 / (1.0 + PERMUTATIONS) or _of_path(few, turns, count):
        return None
    swing = Swinging(duration_of(few) / count, Function((), ()), component).with_axes(few).with_axes(few)
    least = math.log(len(COMPONENTS) * len(turns)) + EVIDENCE
    fair = with_fair_noise(linearised, swing.beside)
    others = [with_walk(fair).log_odds]
    if smooth is not None:
        others.append(absorbing(fair, smooth, whole=True).log_odds)
    found = swing.beside(fair)
    if found.log_odds - least <= max(others):
        return None
    values = BesideFunction(fair, found).values[fair.rows]
    shape = of_machine(linearised, whitened(linearised.white, values).reshape(-1))
    function = swing.function
    return Unexplained(
        (*function.variables, TIME),
        (*function.lengths, min(LENGTHS)),
        p_value,
        float(np.sqrt(np.mean(shape**2))),
        shape,
    )


def _likeliest(linearised: LinearisedFit, turns: Array) -> tuple[tuple[Direction, float], float]:
    """Direction and number of turns of the swing that explains most, and the chance of one where stops are permuted."""
    rng, n = np.random.default_rng(SEED), len(linearised.rows)
    rows, stop = linearised.residual.reshape(n, -1), linearised.measurement.stops[linearised.rows]
    by_stop = np.split(np.arange(n), np.flatnonzero(np.diff(stop)) + 1)
    orders = (np.concatenate([by_stop[k] for k in rng.permutation(len(by_stop))]) for _ in range(PERMUTATIONS))
    tables = np.stack([rows, *(rows[order] for order in orders)], axis=2).reshape(rows.size, -1)
    phase = 2.0 * np.pi * linearised.state.need("time", "a swing") / duration_of(linearised)
    powers = np.array(
        [[_explained(columns, phase * count, tables) for count in turns] for columns in _amplitudes(linearised)]
    )
    which, number = np.unravel_index(int(np.argmax(powers[:, :, 0])), powers.shape[:2])
    best = powers.max(axis=(0, 1))
    return (COMPONENTS[which], float(turns[number])), float(np.mean(best >= best[0]))


def _of_path(linearised: LinearisedFit, turns: Array, count: float) -> bool:
    """True where an axis repeats its path in time: so many turns may be waves along it as well."""
    time = linearised.state.need("time", "a swing")
    phase, one = 2.0 * np.pi * (time - time.min()) / duration_of(linearised), np.ones((len(time), 1, 1))
    for axis in linearised.measurement.moving:
        x = linearised.positions(axis)
        # an axis that rests at most stops is no wave of the time, however slowly it goes on
        tried = np.arange(1.0, turns[-1] + STEP, STEP) if np.mean(np.diff(x) != 0.0) > MOVES else turns
        table = (x - x.mean())[:, None]
        shares = np.array([_explained(one, phase * each, table)[0] for each in tried]) / max(np.sum(table**2), LEAST)
        path = float(tried[int(np.argmax(shares))])
        if shares.max() > PATH and abs(count - max(round(count / path), 1) * path) < APART:
            return True
    return False


def _amplitudes(linearised: LinearisedFit) -> list[Array]:
    """White columns `(n, d, k)` of the tool in each direction: everywhere the same, and linear along each axis."""
    measurement = linearised.measurement
    linear = [np.ones(len(linearised.rows))]
    for axis in measurement.moving:
        x = linearised.positions(axis)
        linear.append((x - x.mean()) / max(float(np.ptp(x)), 1e-12))
    first = 6 * len(measurement.machine.axes)
    arms = (linearised.transform[:, :, first + k] for k in range(len(COMPONENTS)))
    return [whitened(linearised.white, UM * arm)[:, :, None] * np.stack(linear, axis=1)[:, None, :] for arm in arms]


def _explained(columns: Array, phase: Array, tables: Array) -> Array:
    """Squares `(m,)` of residuals `(N, m)` that amplitudes of cosine and sine of a phase `(n,)` explain."""
    both = np.concatenate([columns * wave(phase)[:, None, None] for wave in (np.cos, np.sin)], axis=2)
    design = both.reshape(len(tables), -1)
    along, square = design.T @ tables, design.T @ design
    square[np.diag_indices(len(square))] += RIDGE * np.trace(square) + LEAST
    return np.asarray(np.sum(along * np.linalg.solve(square, along), axis=0))
