"""States of the machine as arrays, as a file of points has them in its columns."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from calibration.measurement.in_motion import velocities
from calibration.measurement.measurement import with_moves
from kinematics.machine import Machine
from kinematics.state import REFERENCE_DEGC, State
from kinematics.transforms import Array
from kinematics.user_error import UserError


def states_of(
    machine: Machine,
    points: Array,
    *,
    approach: Array | None = None,
    time: Array | None = None,
    temperatures: Mapping[str, Any] | None = None,
    feed: Array | None = None,
) -> State:
    """The states at axis positions `(n, axes)`, mm and degrees, in the order in which the machine reaches them.

    approach `(n, axes)` or `(axes,)`: -1, 0 or 1, from the order of rows unless given; time `(n,)`, s; temperatures by
    sensor and feed, mm/min: `(n,)` or one number. UserError, with the name of the array, for one of another shape, for
    numbers that are not finite, and for a direction that is none.
    """
    axes = len(machine.axes)
    if points.ndim != 2 or points.shape[1] != axes or not len(points):
        raise UserError(
            f"points: expected an array (n, {axes}) of {', '.join(machine.names)}, mm and degrees, in the order of "
            f"{machine.chain}, not one of shape {points.shape}"
        )
    _refuse_not_finite("points", points)
    state = with_moves(
        State(
            points * machine.scale,
            time=None if time is None else column(time, len(points), "time"),
            temperatures={
                name: column(values, len(points), f"temperatures[{name!r}]") - REFERENCE_DEGC
                for name, values in (temperatures or {}).items()
            },
        )
    )
    if approach is not None:
        signs = column(approach, len(points), "approach", axes)
        if not np.isin(signs, (-1.0, 0.0, 1.0)).all():
            raise UserError("approach: expected -1, 0 or 1, the direction of each axis before the point")
        state = replace(state, approach=signs)
    return state if feed is None else _fed(machine, state, column(feed, len(points), "feed"))


def _fed(machine: Machine, state: State, speeds: Array) -> State:
    """The states, reached one from the other by feeds `(n,)`, mm/min."""
    if np.any(speeds < 0.0):
        raise UserError("feed: a feed is below 0; a machine at standstill has 0")
    first, still = np.arange(len(state)) == 0, np.zeros(state.positions.shape)
    return replace(state, velocity=velocities(machine, state.positions, speeds, first, still)[0])


def column(values: Any, rows: int, name: str, width: int | None = None) -> Array:
    """An array `(rows,)`, or `(rows, width)`, of values that are given for each row, or once for all rows."""
    try:
        found = np.asarray(values, float)
    except (TypeError, ValueError):
        raise UserError(f"{name}: expected numbers, one for each of {rows} rows, or one for all") from None
    shape = (rows,) if width is None else (rows, width)
    if found.shape not in (shape, shape[1:]):
        raise UserError(f"{name}: expected an array of shape {shape}, or {shape[1:]} for all rows, not {found.shape}")
    _refuse_not_finite(name, found)
    return np.broadcast_to(found, shape)


def _refuse_not_finite(name: str, values: Array) -> None:
    wrong = np.argwhere(~np.isfinite(values))
    if len(wrong):
        raise UserError(f"{name}: row {int(wrong[0][0]) if values.ndim else 0} has a number that is not finite")
