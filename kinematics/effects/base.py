"""The base of all effects: parameters with units and typical sizes, and columns over a State."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from itertools import islice
from typing import Any, ClassVar, Literal, NamedTuple, Self, cast

import msgspec
import numpy as np

from kinematics.basis import Basis, Interval
from kinematics.machine import Machine
from kinematics.state import State
from kinematics.transforms import Array

COMPONENTS = "XYZABC"
Component = Literal["X", "Y", "Z", "A", "B", "C"]
Remedy = Literal["program", "table", "bidirectional table", "none"]

UM, URAD = 1e-3, 1e-6
"""Parameters are in um and urad, error motions in mm and rad."""
HOUR = 3600.0

TOOL = -2
"""Index of a displacement of the tool in its own frame, behind the last axis."""
INSTRUMENT = -1
"""Index of a displacement of an observation in the instrument's frame, behind the tool."""

BY_DIRECTION = "um or urad"
"""Unit of a parameter that counts the error itself: of a translation, or of a rotation."""
BY_AXIS = "mm or deg"
"""Unit of a position: of a linear, or of a rotary axis."""


class Columns(NamedTuple):
    """Change of one error component at an axis, the tool or the instrument, per unit of each parameter."""

    column: int
    """Column of an axis, TOOL or INSTRUMENT."""
    component: int
    """Index into COMPONENTS."""
    values: Array
    """`(n, parameters)`; mm or rad per unit of the parameter."""


class Parameter(NamedTuple):
    """One number of an effect."""

    name: str
    unit: str
    """In the table of a class `a or b` where the direction or the axis decides, as in BY_DIRECTION and BY_AXIS."""
    typical: float
    """Typical size, the standard deviation of its prior; infinite where nothing limits it."""
    linear: bool = True
    """False for a parameter that shapes the columns (a period, a time constant) and has no effect without an amplitude.
    """
    share_of: str = ""
    """In the table of a class: the field that `typical` is a share of."""
    lower: float = -math.inf
    """It lies above this; linear parameters have no bounds."""
    closed: bool = False
    """True when it may also lie on the bound."""

    @property
    def bounded(self) -> bool:
        """True when it has a bound."""
        return not math.isinf(self.lower)

    @property
    def bound(self) -> str:
        """`> 0` or `>= 0`; empty when there is none."""
        return "" if not self.bounded else f"{'>=' if self.closed else '>'} {self.lower:g}"

    @property
    def key(self) -> str:
        """Name and unit of an object's parameter, the unit once: `width_um`, `rate_um_per_h`, `lag_ms`."""
        name, bracket, index = self.name.partition("[")
        unit = self.unit.replace("/", "_per_").lower()
        return f"{name if name.endswith(f'_{unit}') else f'{name}_{unit}'}{bracket}{index}"

    def allows(self, value: float) -> bool:
        """True within its bound; not a number is not."""
        return not self.bounded or value > self.lower or (self.closed and value == self.lower)


def unit_of(direction: str) -> tuple[str, float]:
    """Unit of the parameters of an error in that direction, a component or an axis, and its size in mm or rad."""
    return ("urad", URAD) if direction[0] in "ABC" else ("um", UM)


def own_component(axis: str) -> Component:
    """Direction of an axis' positioning error: X of X2 and U, B of B."""
    return cast(Component, {"U": "X", "V": "Y", "W": "Z"}.get(axis[0], axis[0]))


def own_motion(machine: Machine, axis: str) -> tuple[int, int, float]:
    """Column of the axis, index of its positioning error, and the sign in it of an error forward.

    Forward is where a positive command goes; the sign is -1 for an axis that runs against its letter, since its E_ii is
    counted along the letter.
    """
    i, k = machine.index(axis), COMPONENTS.index(own_component(axis))
    return i, k, float(np.sign(machine.axes[i].error_frame[:, k % 3] @ machine.axes[i].unit_direction))


class EffectBase(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="kind"):
    """Base of all effects: one physical cause of error.

    The class describes the effect; an object holds its parameters. Each parameter is a field, a number or a row of
    numbers, in um and urad unless the name contains another unit; a field that is None is no parameter of the object.
    `u` holds their standard uncertainties (k = 1), flat in the order of `parameter_table`.
    """

    TITLE: ClassVar[str]
    ACTS_ON: ClassVar[Literal["axis", "tool", "workpiece", "instrument"]] = "axis"
    """An effect of the instrument is in the data only; it never enters a correction."""
    NEEDS: ClassVar[tuple[str, ...]] = ()
    """Columns of State, besides positions."""
    REMEDY: ClassVar[Remedy] = "program"
    """The simplest remedy: a controller's table, one with both directions, the corrected program."""
    HAS_MEMORY: ClassVar[bool] = False
    """True when a row depends on other rows, or on its number."""
    QUANTITIES: ClassVar[tuple[Parameter, ...]] = ()
    """The fields that hold parameters; a row of numbers gives as many parameters `name[i]`."""
    LABEL: ClassVar[tuple[str, ...]] = ()
    """Fields that distinguish two effects of the class, besides component and axis."""

    u: tuple[float, ...] = ()
    note: str = ""

    def __post_init__(self) -> None:
        if self.u and len(self.u) != len(self.parameters):
            raise ValueError(f"{self.name}: {len(self.parameters)} parameters with {len(self.u)} u")
        for quantity in self.QUANTITIES:
            if not quantity.bounded:
                continue
            value = getattr(self, quantity.name)
            for number in value if isinstance(value, tuple) else () if value is None else (value,):
                if not quantity.allows(number):
                    raise ValueError(f"{self.name}: {quantity.name} must be {quantity.bound}, got {number:g}")

    @property
    def kind(self) -> str:
        """The name of the class in files."""
        return str(self.__struct_config__.tag)

    @property
    def name(self) -> str:
        """Short name for tables and reports."""
        axis, component = getattr(self, "axis", ""), getattr(self, "component", "")
        where = f"E_{component}{axis}" if component and axis else component or axis
        return " ".join(filter(None, (self.kind, where, *(str(getattr(self, field)) for field in self.LABEL))))

    @property
    def axes(self) -> tuple[str, ...]:
        """Names of the axes of the effect."""
        return tuple(getattr(self, field) for field in ("axis", "other", "cross") if hasattr(self, field))

    @property
    def sensors(self) -> tuple[str, ...]:
        """Names of the temperatures that it follows."""
        return (self.sensor,) if hasattr(self, "sensor") else ()

    @property
    def needs(self) -> tuple[str, ...]:
        """The columns of State, besides positions, that this effect requires."""
        return self.NEEDS

    @property
    def angular(self) -> bool:
        """True when its errors are rotations."""
        return (getattr(self, "component", "") or getattr(self, "axis", " ")[0]) in "ABC"

    @property
    def intervals(self) -> Mapping[str, Interval]:
        """Known interval of each axis or other variable; outside it the effect keeps the value at the nearer end.

        Units are those of `State.variable`.
        """
        return {}

    @property
    def feature_lengths(self) -> Mapping[str, float]:
        """Shortest feature length of its errors by axis, mm or degrees; without axes on which they are straight."""
        return {}

    @property
    def position_bases(self) -> Mapping[str, Basis | None] | None:
        """The axis on whose position alone its errors depend, at constant conditions and directions of approach.

        They are error motions of this axis, smooth between the nodes of the basis, or everywhere without a basis. Empty
        for a constant displacement of the tool. None for all other effects: of several axes, with jumps, or with a
        memory of the moves.
        """
        return None

    def quantities(self) -> tuple[Parameter, ...]:
        """The fields that hold its parameters, with their units and typical sizes."""
        found = []
        for q in self.QUANTITIES:
            if getattr(self, q.name) is not None:
                turns = self.axes[0][0] in "ABC" if q.unit == BY_AXIS else self.angular
                unit = q.unit.split(" or ")[turns] if " or " in q.unit else q.unit
                size = getattr(self, q.share_of) if q.share_of else 1.0
                same = unit == q.unit and not q.share_of
                found.append(q if same else q._replace(unit=unit, typical=q.typical * size, share_of=""))
        return tuple(found)

    @property
    def parameter_table(self) -> tuple[Parameter, ...]:
        """All parameters, in order."""
        table: list[Parameter] = []
        for quantity in self.quantities():
            value = getattr(self, quantity.name)
            if isinstance(value, tuple):
                table += [quantity._replace(name=f"{quantity.name}[{i}]") for i in range(len(value))]
            else:
                table.append(quantity)
        return tuple(table)

    @property
    def linear(self) -> tuple[bool, ...]:
        """True for each parameter in which the errors are linear."""
        flags: list[bool] = []
        for quantity in self.QUANTITIES:
            value = getattr(self, quantity.name)
            if value is not None:
                flags += [quantity.linear] * (len(value) if isinstance(value, tuple) else 1)
        return tuple(flags)

    @property
    def typical(self) -> tuple[float, ...]:
        """Typical size of each parameter."""
        sizes: list[float] = []
        for quantity in self.QUANTITIES:
            value = getattr(self, quantity.name)
            if value is not None:
                size = quantity.typical * (getattr(self, quantity.share_of) if quantity.share_of else 1.0)
                sizes += [size] * (len(value) if isinstance(value, tuple) else 1)
        return tuple(sizes)

    @property
    def parameters(self) -> tuple[float, ...]:
        """Their values, flat."""
        values: list[float] = []
        for quantity in self.QUANTITIES:
            value = getattr(self, quantity.name)
            if value is not None:
                values += value if isinstance(value, tuple) else (value,)
        return tuple(map(float, values))

    @property
    def uncertainties(self) -> tuple[float, ...]:
        """Standard uncertainties of the parameters; zero where none are given."""
        return self.u or (0.0,) * len(self.parameters)

    def with_parameters(self, values: Sequence[float], u: Sequence[float] = ()) -> Self:
        """The same effect with other parameters, flat, and their standard uncertainties."""
        changes: dict[str, Any] = dict(self._by_field(values))
        return msgspec.structs.replace(self, **changes, u=tuple(map(float, u)))

    def by_key(self, values: Sequence[float]) -> dict[str, float | tuple[float, ...]]:
        """Values, flat, of its parameters or their uncertainties under keys with units, as a diagnosis has them.

        `{"width_um": 31.2}`; a row of numbers stays one, unless it is empty.
        """
        fields = dict(self._by_field(values))
        return {quantity.key: fields[quantity.name] for quantity in self.quantities() if fields[quantity.name] != ()}

    def _by_field(self, values: Sequence[float]) -> Iterator[tuple[str, float | tuple[float, ...]]]:
        """Names of the fields that hold parameters, with their part of values, flat."""
        if len(values) != len(self.parameters):
            raise ValueError(f"{self.name}: {len(self.parameters)} parameters, got {len(values)}")
        left = iter(map(float, values))
        for quantity in self.QUANTITIES:
            value = getattr(self, quantity.name)
            if value is not None:
                yield quantity.name, tuple(islice(left, len(value))) if isinstance(value, tuple) else next(left)

    @abstractmethod
    def columns(self, machine: Machine, state: State) -> Iterator[Columns]:
        """Derivatives of the error components it touches with respect to its parameters, at their values."""

    def contributions(self, machine: Machine, state: State) -> Iterator[tuple[int, int, Array]]:
        """Index, component and values `(n,)`, mm or rad, of the errors of the effect.

        Its columns times its linear parameters; an effect that is not of that form overrides this.
        """
        amplitudes = np.array(self.parameters)
        if not all(quantity.linear for quantity in self.QUANTITIES):
            amplitudes = amplitudes * self.linear
        for column, component, values in self.columns(machine, state):
            yield column, component, values @ amplitudes
