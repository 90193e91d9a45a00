"""State: everything an error may depend on, one row per instant."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np

from kinematics.basis import Basis
from kinematics.machine import Axis, Machine
from kinematics.transforms import Array, read_only
from kinematics.turn import columns_of
from kinematics.user_error import UserError

REFERENCE_DEGC = 20.0
"""degC that temperatures count from."""
TIME, TEMPERATURE = "time", "temperature "
"""The variable of time, and the prefix of those of sensors; all others are axes."""


def general_state(machine: Machine) -> State:
    """One row at positions without any symmetry: no component of a direction that turns with axes is 0 by chance.

    Axes stand at 1, 2, 3 ... mm and rad: sums of these angles are no quarters of a turn.
    """
    return State(np.arange(1.0, len(machine.axes) + 1.0)[None])


def variable_unit(machine: Machine, name: str) -> str:
    """Unit of `State.variable`: of an axis mm or deg, of `time` s, of a temperature K."""
    if name == TIME:
        return "s"
    return "K" if name.startswith(TEMPERATURE) else machine.axes[machine.index(name)].unit


@dataclass(frozen=True)
class State:
    """Columns over `n` instants, in the order of time; None if a column is not known."""

    positions: Array
    """Axis positions `(n, axes)` in chain order, mm and rad."""
    approach: Array | None = None
    """Sign of the last move of each axis `(n, axes)`: -1, 0 (not moved yet), 1; between these, the side of the play on
    which an axis lies that its drive has not yet pushed."""
    last_move: Array | None = None
    """Last move of each axis `(n, axes)`, mm and rad, signed."""
    velocity: Array | None = None
    """Velocity of each axis `(n, axes)`, mm/s and rad/s."""
    acceleration: Array | None = None
    """Acceleration of each axis `(n, axes)`, mm/s2 and rad/s2."""
    time: Array | None = None
    """`(n,)`, s."""
    temperatures: Mapping[str, Array] = field(default_factory=dict)
    """By sensor `(n,)`, K from 20 degC."""
    spindle_speed: Array | None = None
    """Mean speed of the spindle since the row before `(n,)`, rpm."""
    cycle: Array | None = None
    """Number of the measuring cycle `(n,)`, from 0."""
    station: np.ndarray | None = None
    """Name of the instrument's set-up `(n,)`."""
    target: np.ndarray | None = None
    """Name of the target or tool vector `(n,)`."""
    observed: Array | None = None
    """Point `(n, 3)` in the instrument's frame, mm."""
    past: State | None = None
    """Time and temperatures before the first row, for effects with a memory; None where they had settled by then."""
    _known: dict[tuple[int, Axis, Basis], Array] = field(default_factory=dict, init=False, repr=False, compare=False)
    _left_behind: dict[Hashable, Any] = field(default_factory=dict, init=False, repr=False, compare=False)

    def __len__(self) -> int:
        return len(self.positions)

    def rows(self, index: slice | np.ndarray) -> State:
        """The state at some of its rows; itself, with all that it has worked out, where these are all of them."""
        if _is_all(index, len(self)):
            return self
        columns: dict[str, Any] = {f.name: getattr(self, f.name) for f in fields(self) if f.init}
        for name, column in columns.items():
            if isinstance(column, np.ndarray):
                columns[name] = column[index]
        columns["temperatures"] = {sensor: column[index] for sensor, column in self.temperatures.items()}
        return State(**columns)

    def position(self, machine: Machine, axis: str) -> Array:
        """Positions `(n,)` of one axis in the units of files, mm or degrees."""
        i = machine.index(axis)
        return np.asarray(self.positions[:, i] / machine.scale[i])

    def variable(self, machine: Machine, name: str, by: str) -> Array:
        """Column `(n,)` of an axis, mm or degrees, of `time`, s, or of `temperature NAME`, K from 20 degC.

        UserError, naming the effect, when it is not known.
        """
        if name == TIME:
            return np.asarray(self.need("time", by))
        if name.startswith(TEMPERATURE):
            return self.temperature(name.removeprefix(TEMPERATURE), by)
        return self.position(machine, name)

    def basis_columns(self, machine: Machine, axis: str, basis: Basis) -> Array:
        """Basis functions `(n, size)` at the positions of one axis; kept, since its error motions share their basis."""
        column = machine.index(axis)
        key = column, machine.axes[column], basis
        if key not in self._known:
            self._known[key] = read_only(columns_of(machine.axes[column], basis, self.position(machine, axis)))
        return self._known[key]

    def left_behind(self, key: Hashable, work: Callable[[State], Any]) -> Any:
        """The result of `work` on the past, calculated once per key; None without a past."""
        if self.past is None:
            return None
        known = self.past._left_behind
        if key not in known:
            known[key] = work(self.past)
        return known[key]

    def need(self, column: str, by: str) -> Any:
        """A column that an effect cannot do without; UserError, naming the effect, when it is not known."""
        value = getattr(self, column)
        if value is None:
            raise UserError(f"{by} needs {column.replace('_', ' ')}, which these data do not give")
        return value

    def temperature(self, sensor: str, by: str) -> Array:
        """K from 20 degC `(n,)` of one sensor; UserError when there is none of that name."""
        if sensor not in self.temperatures:
            raise UserError(f"{by} needs the temperature {sensor!r}, which these data do not give")
        return self.temperatures[sensor]


def with_moves(state: State, approach: Array | None = None) -> State:
    """The state with the last move of each axis, from the order of its rows, and the approach unless given.

    A row that does not move an axis keeps its last move and its approach; both are 0 before the first move.
    """
    moves = np.diff(state.positions, axis=0, prepend=state.positions[:1])
    moves[np.abs(moves) < 1e-9] = 0.0
    moved = np.where(moves != 0.0, np.arange(len(state))[:, None], 0)
    last = np.take_along_axis(moves, np.maximum.accumulate(moved, axis=0), axis=0)
    return replace(state, last_move=last, approach=np.sign(last) if approach is None else approach)


def _is_all(index: slice | np.ndarray, n: int) -> bool:
    """True for an index of all of n rows, in their order."""
    if isinstance(index, slice):
        return range(n)[index] == range(n)
    return len(index) == n and index.dtype.kind in "iu" and np.array_equal(index, np.arange(n))
