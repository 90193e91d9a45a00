"""ISO 230-6: positioning along the body diagonals of the volume, from points of a laser tracker.

Along each diagonal the deviation is the distance of the measured points along their common straight line, less that of
the positions: to first order the displacement along the diagonal, whatever the pose of the tracker. At each target and
direction the values are those of ISO 230-2 (`iso230.py`); of the machine:

    E_d = max of E of the diagonals, the bidirectional systematic deviations
    B_d = max of B of the diagonals, the reversal values

A reading counts if the row before it is on the same diagonal, so that its direction is along the diagonal.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from calibration.measurement.measurement import Measurement
from calibration.single_axis.iso230 import TARGET_DECIMALS, AxisTest, Readings, Value, tested
from kinematics.deviation import UM_PER_MM
from kinematics.transforms import Array
from kinematics.user_error import UserError

ON_DIAGONAL_MM = 0.01
"""Largest distance of a position from a diagonal, mm: positions are stated to 0.001 mm."""
TOO_SMALL = " (it may be too small: targets with one direction only do not count)"


def diagonal_tests(measurement: Measurement) -> tuple[AxisTest, ...]:
    """The test of each body diagonal in a tracker's data, the signs of its axes in its name: X+Y-Z.

    UserError for positions beside the body diagonals, and for several targets or stations.
    """
    if any(len(set(each.tolist())) > 1 for each in (measurement.groups, measurement.state.target) if each is not None):
        raise UserError(f"{measurement.source}: ISO 230-6 needs one target and one station: give their rows alone")
    machine = measurement.machine
    linear = [axis.name for axis in machine.axes if not axis.rotary]
    if np.ptp(measurement.state.positions[:, machine.rotary], axis=0).max(initial=0.0) > 0.0 or len(linear) != 3:
        raise UserError(f"{measurement.source}: ISO 230-6 needs moves of three linear axes, the others at rest")
    position = np.stack([measurement.state.position(machine, name) for name in linear], axis=1)
    signs, along = _diagonals(measurement, position)
    found = [_test(measurement, linear, one, signs, along) for one in np.unique(signs, axis=0)[::-1]]
    return tuple(test for test in found if test is not None)


def _diagonals(measurement: Measurement, position: Array) -> tuple[Array, Array]:
    """Signs of the axes `(n, 3)` along the diagonal of each row, first axis positive, and the distance along it, mm."""
    half = np.ptp(position, axis=0) / 2.0
    if half.min() < ON_DIAGONAL_MM:
        raise UserError(f"{measurement.source}: ISO 230-6 needs moves of all linear axes, and one of them rests")
    share = (position - position.min(axis=0)) / half - 1.0
    beside = np.ptp(np.abs(share), axis=1) * half.max() > ON_DIAGONAL_MM
    if beside.any():
        row = int(np.argmax(beside))
        raise UserError(
            f"{measurement.where(row)}: the position is on no body diagonal of the volume. ISO 230-2 needs data of an "
            "interferometer, and ISO 230-6 points of a tracker on these diagonals alone: plan them with "
            "'ncomp plan --strategy space-diagonals --order retraced'"
        )
    signs = np.where(share * np.where(share[:, :1] < 0.0, -1.0, 1.0) < 0.0, -1.0, 1.0)
    length = float(np.linalg.norm(half))
    middle = np.abs(share).max(axis=1) * length < ON_DIAGONAL_MM
    for row in np.flatnonzero(middle).tolist():  # the diagonals meet there: it belongs to that of the row before
        signs[row] = signs[max(row - 1, 0)]
    return signs, (share[:, 0] + 1.0) * length


def _test(measurement: Measurement, linear: Sequence[str], one: Array, signs: Array, along: Array) -> AxisTest | None:
    """The test of a diagonal; None where no reading has a direction along it."""
    on = (signs == one).all(axis=1)
    step = np.diff(along, prepend=along[0])
    rows = np.flatnonzero(on & np.roll(on, 1) & (np.abs(step) > ON_DIAGONAL_MM))
    if not len(rows):
        return None
    points = measurement.observed - measurement.observed[on].mean(axis=0)
    line = np.linalg.svd(points[on], full_matrices=False)[2][0]
    line = line * (1.0 if points[on] @ line @ (along[on] - along[on].mean()) > 0.0 else -1.0)
    deviation = (points @ line - along + along[on].mean()) * UM_PER_MM
    variance = np.einsum("i,nij,j->n", line, measurement.instrument.row_covariances(measurement)[rows], line)
    name = linear[0] + "".join(
        f"{'+' if sign > 0 else '-'}{axis}" for sign, axis in zip(one[1:], linear[1:], strict=True)
    )
    read = Readings(np.round(along[rows], TARGET_DECIMALS) + 0.0, (step[rows] < 0.0).astype(int), deviation[rows])
    return tested(measurement, name, rows, read, (float(np.sqrt(variance.mean())) * UM_PER_MM, 0.0), rotary=False)


def largest_of_diagonals(tests: Sequence[AxisTest]) -> Iterator[Value]:
    """E_d and B_d, each with the diagonal that has it in its title."""
    for symbol, of, title in (("E_d", "E", "systematic deviation"), ("B_d", "B", "reversal value")):
        own = [(value, test.axis) for test in tests for value in test.values if value.symbol == of]
        if own:
            value, axis = max(own, key=lambda each: each[0].value)
            one_way = [each.value for test in tests for each in test.values if each.symbol.startswith(f"{of} ")]
            left_out = TOO_SMALL if max(one_way, default=0.0) > value.value else ""
            yield Value(symbol, f"{title} of the diagonals, {axis}{left_out}", value.value, value.U)
