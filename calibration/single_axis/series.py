"""Series of a three-point measurement: the rows in which one axis moves alone, with its three points or more."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from calibration.measurement.measurement import Measurement
from kinematics.machine import Machine
from kinematics.transforms import Array
from kinematics.user_error import UserError

LEAST_SERIES_POSITIONS = 3
"""Least number of positions of a series."""
SAME_COMMAND = 1e-7
"""Difference of commanded positions, mm and rad, below which they are the same."""
PointNumbers = dict[tuple[str, tuple[int, ...]], int]
"""Numbers of points by target and positions in steps of `SAME_COMMAND`; 0 for axes that do not move the target."""


@dataclass(frozen=True)
class Series:
    """Positions of one axis that moves alone."""

    column: int
    positions: Array
    """Positions `(n,)`, mm or rad, ascending."""
    standing: Array
    """Positions of all axes at the first position `(axes,)`, mm and rad."""
    targets: tuple[str, ...]
    numbers: np.ndarray
    """Numbers `(n, k)` of the points."""


def _side(machine: Machine, carrier: str) -> np.ndarray:
    """Mask `(axes,)` of the axes that move a target."""
    side = {"tool": "tool", "table": "workpiece"}.get(carrier)
    return np.array([axis.side == side for axis in machine.axes])


def physical_points(measurement: Measurement) -> tuple[PointNumbers, np.ndarray]:
    """Points by target and position of the axes that move it, and the number `(rows,)` of the point of each row."""
    assert measurement.state.target is not None
    names = measurement.state.target.astype(str).tolist()
    rounded = np.round(measurement.state.positions / SAME_COMMAND).astype(int)
    sides = {name: _side(measurement.machine, target.carrier) for name, target in measurement.targets.items()}
    point_numbers: PointNumbers = {}
    number = [
        point_numbers.setdefault((name, tuple(np.where(sides[name], row, 0).tolist())), len(point_numbers))
        for name, row in zip(names, rounded, strict=True)
    ]
    return point_numbers, np.array(number)


def all_series(measurement: Measurement, point_numbers: PointNumbers, number: np.ndarray) -> list[Series]:
    """The series of all axes: of the tool side, then of the table side, from the bed outward; UserError if none."""
    machine = measurement.machine
    columns = range(len(machine.axes))
    outward_order = [
        *(i for i in columns if machine.axes[i].side == "tool"),
        *(i for i in reversed(columns) if machine.axes[i].side != "tool"),
    ]
    first = np.unique(number, return_index=True)[1]
    positions = measurement.state.positions[first]
    series = [one for i in outward_order if (one := _series(measurement, i, point_numbers, positions)) is not None]
    if not series:
        raise UserError(
            f"{measurement.source}: no axis moves alone through {LEAST_SERIES_POSITIONS} positions or more "
            "with targets on the part that it moves"
        )
    return series


def _series(measurement: Measurement, column: int, point_numbers: PointNumbers, positions: Array) -> Series | None:
    """The positions of one axis with the others on its side at standstill; None if there are none."""
    machine = measurement.machine
    carrier = "tool" if machine.axes[column].side == "tool" else "table"
    lines: dict[tuple[int, ...], dict[int, dict[str, int]]] = {}
    for (target, key), number in point_numbers.items():
        if measurement.targets[target].carrier == carrier:
            standing = (*key[:column], 0, *key[column + 1 :])
            lines.setdefault(standing, {}).setdefault(key[column], {})[target] = number
    long = {key: line for key, line in lines.items() if len(line) >= LEAST_SERIES_POSITIONS}
    if not long:
        return None
    name = machine.axes[column].name
    if len(long) > 1:
        raise UserError(
            f"{measurement.source}: {name} moves along {len(long)} lines; three-point identification needs one ('ncomp "
            "fit' uses all)"
        )
    ((_, line),) = long.items()
    targets = sorted({target for observed in line.values() for target in observed})
    _refuse_missing(measurement, column, line, targets)
    numbers = np.array([[line[q][target] for target in targets] for q in sorted(line)])
    at = positions[numbers[:, 0]]
    return Series(column, at[:, column], at[0], tuple(targets), numbers)


def _refuse_missing(
    measurement: Measurement, column: int, line: Mapping[int, Mapping[str, int]], targets: Sequence[str]
) -> None:
    axis, scale = measurement.machine.axes[column], measurement.machine.scale[column]
    if len(targets) < 3:
        raise UserError(
            f"{measurement.source}: {axis.name} was measured with {len(targets)} target(s) ({', '.join(targets)}); "
            "its six error motions need three that are not in one line"
        )
    for q, observed in sorted(line.items()):
        missing = [target for target in targets if target not in observed]
        if missing:
            raise UserError(
                f"{measurement.source}: {axis.name} at {q * SAME_COMMAND / scale:.4f} {axis.unit} lacks target "
                f"{', '.join(missing)}"
            )
