"""The table of effects: physical causes of error, one class each.

An effect turns its parameters into error motions at the axes, linearly: `columns` gives, for each error motion it
touches, the change of that error motion per unit of each parameter. Everything that fits, predicts, corrects or
reports errors goes through this table.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal, NamedTuple

import msgspec
import numpy as np

from kinematics.basis import Basis, Interval
from kinematics.machine import Machine
from kinematics.state import State
from kinematics.transforms import Array

COMPONENTS = "XYZABC"
Component = Literal["X", "Y", "Z", "A", "B", "C"]

UM, URAD = 1e-3, 1e-6
"""Parameters are in um and urad, error motions in mm and rad."""


class Columns(NamedTuple):
    """Change of one error motion (column of an axis, index into COMPONENTS) per parameter: `(n, parameters)`."""

    axis: int
    component: int
    values: Array


def unit_of(component: str) -> tuple[str, float]:
    """Unit of the parameters of an error in that direction, and its size in mm or rad."""
    return ("um", UM) if component in "XYZ" else ("urad", URAD)


class ErrorMotion(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="kind", tag="error-motion"):
    """One of the six error motions of ISO 230-1 of an axis, E_XX ... E_CC, as a function of its own position."""

    component: Component
    axis: str
    basis: Basis
    parameters: tuple[float, ...]
    u: tuple[float, ...]
    """Standard uncertainties (k = 1) of the parameters."""
    note: str = ""

    def __post_init__(self) -> None:
        if len(self.parameters) != self.basis.size or len(self.u) != self.basis.size:
            raise ValueError(
                f"{self.name}: its basis takes {self.basis.size} parameters with as many u, "
                f"got {len(self.parameters)} and {len(self.u)}"
            )

    @property
    def name(self) -> str:
        """E_XX, E_CY, ..."""
        return f"E_{self.component}{self.axis}"

    @property
    def unit(self) -> str:
        """Unit of its parameters."""
        return unit_of(self.component)[0]

    @property
    def uncertainties(self) -> tuple[float, ...]:
        """Standard uncertainties of its parameters."""
        return self.u

    @property
    def interval(self) -> Interval | None:
        """Positions of its axis that it is known for, mm or degrees."""
        return self.basis.interval

    def columns(self, machine: Machine, state: State) -> Iterator[Columns]:
        """See `Columns`."""
        values = self.basis.columns(state.position(machine, self.axis)) * unit_of(self.component)[1]
        yield Columns(machine.index(self.axis), COMPONENTS.index(self.component), values)


class LocationError(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="kind", tag="location"):
    """Position or orientation of an axis line (ISO 230-1), E_C0Y, E_B0Z, E_X0C, E_A0B, ..., tool relative to workpiece.

    An orientation error of a linear axis tilts its line, so its carriage leaves the nominal direction d by
    angle x d per mm and does not turn: E_XY = -E_C0Y y, E_YX = E_C0X x, E_XZ = E_B0Z z. All others are the constants of
    the error motions: the line of a rotary axis in the head lies at the value, that of a table at minus the value.
    """

    component: Component
    axis: str
    value: float
    u: float
    note: str = ""

    @property
    def name(self) -> str:
        """E_C0Y, E_X0C, ..."""
        return f"E_{self.component}0{self.axis}"

    @property
    def unit(self) -> str:
        """Unit of its parameter."""
        return unit_of(self.component)[0]

    @property
    def parameters(self) -> tuple[float, ...]:
        """Its value, as the one parameter."""
        return (self.value,)

    @property
    def uncertainties(self) -> tuple[float, ...]:
        """Standard uncertainty of its one parameter."""
        return (self.u,)

    @property
    def interval(self) -> Interval | None:
        """None: it holds for every position."""
        return None

    def columns(self, machine: Machine, state: State) -> Iterator[Columns]:
        """See `Columns`."""
        i, j, size = machine.index(self.axis), COMPONENTS.index(self.component), unit_of(self.component)[1]
        axis = machine.axes[i]
        if axis.rotary or j < 3:
            yield Columns(i, j, np.full((len(state.positions), 1), size))
            return
        turn = axis.error_frame[:, j - 3]
        sideways = axis.error_frame.T @ np.cross(turn, axis.unit_direction) * size
        for k in np.flatnonzero(sideways):
            yield Columns(i, int(k), sideways[k] * state.positions[:, [i]])


EFFECTS = (ErrorMotion, LocationError)
Effect = ErrorMotion | LocationError
