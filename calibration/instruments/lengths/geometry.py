"""The geometry of lengths and dial readings: ends that belong together, directions, and the parameters beside them."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from calibration.instruments.lengths.reading import LETTERS, roles
from calibration.registration.derived import derived
from kinematics.transforms import Array

if TYPE_CHECKING:
    from calibration.measurement.measurement import Measurement

RULER, RIGHT_ANGLE, TURN = "scale of the ruler", "angle of the square", "turn of"
"""Names of parameters among the zeros of a registration; the last is followed by the set-up of the square."""


class Pairs(NamedTuple):
    """The lengths both of whose ends are there."""

    first: np.ndarray
    """Rows `(k,)` of the first ends."""
    second: np.ndarray
    """Rows `(k,)` of the second ends."""


@derived
def pairs_of(measurement: Measurement) -> Pairs:
    """The rows of the two ends of each length; a length of which a row is left out says nothing."""
    assert measurement.run is not None
    is_length = np.array([kind == "length" for kind, _ in roles(measurement.run)], bool)
    rows = np.flatnonzero(is_length)
    _, first, group, count = np.unique(measurement.groups[rows], True, True, True)
    whole = count[group] == 2
    ends = rows[whole][np.argsort(first[group[whole]], kind="stable")]
    return Pairs(ends[::2], ends[1::2])


@derived
def lines_of(measurement: Measurement) -> Array:
    """Directions `(n, 3)`, workpiece frame, along which the rows observe; zero for an end whose other end is missing.

    From the first end of a length to the second, and along the dial gauge.
    """
    assert measurement.run is not None
    lines = np.zeros((len(measurement), 3))
    for row, (_, along) in enumerate(roles(measurement.run)):
        if along:
            lines[row, LETTERS.index(along)] = 1.0
    first, second = pairs_of(measurement)
    points = measurement.nominal_points
    chords = points[second] - points[first]
    lines[first] = lines[second] = chords / np.linalg.norm(chords, axis=1, keepdims=True)
    return lines


@derived
def moved_axes(measurement: Measurement) -> np.ndarray:
    """Column `(n,)` of the axis that moved in a dial reading; -1 for lengths."""
    assert measurement.run is not None
    names = measurement.machine.names
    kinds = [kind for kind, _ in roles(measurement.run)]
    axes = [group.rpartition(" ")[2] for group in measurement.groups.tolist()]
    return np.array([-1 if k == "length" else names.index(axis) for k, axis in zip(kinds, axes, strict=True)], int)


@derived
def nominal_offsets(measurement: Measurement) -> Array:
    """Positions `(n,)`, mm, of the nominal machine along the lines of the rows."""
    return np.asarray(np.sum(measurement.nominal_points * lines_of(measurement), axis=1))


@derived
def half_lengths(measurement: Measurement) -> Array:
    """Half of the nominal length at its second end, and minus half at its first `(n,)`, mm; 0 in other rows."""
    first, second = pairs_of(measurement)
    along, half = nominal_offsets(measurement), np.zeros(len(measurement))
    half[second] = (along[second] - along[first]) / 2.0
    half[first] = -half[second]
    return half


@derived
def parameters_beside(measurement: Measurement) -> dict[str, Array]:
    """Derivatives `(n,)` of the observations by the scale of the ruler, and by the angle and the turns of squares.

    A line of the square along the second of two axes turns by the turn of the square and the error of its angle, which
    counts with the opposite sign where the square is turned round.
    """
    assert measurement.run is not None
    found: dict[str, Array] = {}
    halves, axes, groups = half_lengths(measurement), moved_axes(measurement), measurement.groups.tolist()
    for row, (kind, along) in enumerate(roles(measurement.run)):
        if kind == "length":
            found.setdefault(RULER, np.zeros(len(measurement)))[row] = halves[row]
        elif kind != "gauge":
            turn = f"{TURN} {groups[row].rpartition(' ')[0]}"
            own = measurement.machine.names[axes[row]][0]
            position, leads = measurement.state.positions[row, axes[row]], own < along
            found.setdefault(turn, np.zeros(len(measurement)))[row] = -position if leads else position
            angle = found.setdefault(RIGHT_ANGLE, np.zeros(len(measurement)))
            angle[row] = 0.0 if leads else position * (-1.0 if kind == "reversed" else 1.0)
    return found


@derived
def slopes_of(measurement: Measurement) -> dict[str, Array]:
    """Derivatives `(n,)`, mm, by the slope of what the dial touches against the axis, by group of readings across it.

    What a dial gauge touches along the axis that moves is a surface, without a slope.
    """
    assert measurement.run is not None
    lines, axes = lines_of(measurement), moved_axes(measurement)
    found: dict[str, Array] = {}
    for row, ((kind, _), group) in enumerate(zip(roles(measurement.run), measurement.groups.tolist(), strict=True)):
        axis = measurement.machine.axes[axes[row]]
        if kind == "gauge" and abs(float(lines[row] @ axis.unit_direction)) < 0.5:
            own = found.setdefault(group, np.zeros(len(measurement)))
            own[row] = measurement.state.positions[row, axes[row]]
    return found
