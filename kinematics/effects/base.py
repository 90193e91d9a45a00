"""What every effect offers: parameters with units and typical sizes, and columns over a State."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator, Sequence
from typing import Any, ClassVar, Literal, NamedTuple, Self

import msgspec
import numpy as np

from kinematics.basis import Interval
from kinematics.machine import Machine
from kinematics.state import State
from kinematics.transforms import Array

COMPONENTS = "XYZABC"
Component = Literal["X", "Y", "Z", "A", "B", "C"]
Remedy = Literal["program", "table", "bidirectional table", "none"]

UM, URAD = 1e-3, 1e-6
"""Parameters are in um and urad, error motions in mm and rad."""
HOUR = 3600.0

TOOL = -1
"""Place of what displaces the tool in its own frame, behind the last axis."""
INSTRUMENT = -2
"""Place of what displaces an observation in the instrument's frame; it never enters the machine."""


class Columns(NamedTuple):
    """Change of one error component at one place, per unit of each parameter."""

    place: int
    """Column of an axis, TOOL or INSTRUMENT."""
    component: int
    """Index into COMPONENTS."""
    values: Array
    """`(n, parameters)`; mm or rad per unit of the parameter."""


class Parameter(NamedTuple):
    """One number of an effect."""

    name: str
    unit: str
    typical: float
    """Its typical size, the standard deviation of its prior; infinite where nothing limits it."""
    linear: bool = True


def unit_of(component: str) -> tuple[str, float]:
    """Unit of the parameters of an error in that direction, and its size in mm or rad."""
    return ("um", UM) if component in "XYZ" else ("urad", URAD)


class Cause(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="kind"):
    """Base of all effects: one physical cause of error.

    A class of effects says once what it is; an object holds its parameters. Parameters stand in fields of their own,
    a number or a row of numbers each, named with their unit; `u` holds their standard uncertainties (k = 1), flat in
    the order of `parameter_table`.
    """

    TITLE: ClassVar[str]
    ACTS_ON: ClassVar[Literal["axis", "tool", "instrument"]] = "axis"
    NEEDS: ClassVar[tuple[str, ...]] = ()
    """Columns of State, besides positions."""
    REMEDY: ClassVar[Remedy] = "program"
    HAS_MEMORY: ClassVar[bool] = False
    """True when a row depends on rows before it."""
    QUANTITIES: ClassVar[tuple[Parameter, ...]] = ()
    """The fields that hold parameters; a row of numbers gives as many parameters `name[i]`."""

    u: tuple[float, ...] = ()
    note: str = ""

    def __post_init__(self) -> None:
        if self.u and len(self.u) != len(self.parameters):
            raise ValueError(f"{self.name}: {len(self.parameters)} parameters with {len(self.u)} u")

    @property
    def name(self) -> str:
        """Short name for tables and reports."""
        axis = getattr(self, "axis", "")
        component = getattr(self, "component", "")
        return " ".join(filter(None, (self.kind, f"E_{component}{axis}" if component and axis else component or axis)))

    @property
    def axes(self) -> tuple[str, ...]:
        """Names of the axes it speaks of."""
        return tuple(getattr(self, field) for field in ("axis", "other", "cross") if hasattr(self, field))

    @property
    def kind(self) -> str:
        """The name of the class in files."""
        return str(self.__struct_config__.tag)

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

    def quantities(self) -> tuple[Parameter, ...]:
        """The fields that hold parameters; effects whose units depend on a direction override this."""
        return self.QUANTITIES

    @property
    def parameters(self) -> tuple[float, ...]:
        """Their values, flat."""
        return tuple(float(v) for q in self.quantities() for v in np.atleast_1d(getattr(self, q.name)))

    @property
    def uncertainties(self) -> tuple[float, ...]:
        """Standard uncertainties of the parameters; zero where none are given."""
        return self.u or (0.0,) * len(self.parameters)

    def with_parameters(self, values: Sequence[float], u: Sequence[float] = ()) -> Self:
        """The same effect with other parameters, flat, and their standard uncertainties."""
        left = list(values)
        changes: dict[str, Any] = {"u": tuple(float(v) for v in u)}
        for quantity in self.quantities():
            value = getattr(self, quantity.name)
            if isinstance(value, tuple):
                changes[quantity.name] = tuple(float(left.pop(0)) for _ in value)
            else:
                changes[quantity.name] = float(left.pop(0))
        return msgspec.structs.replace(self, **changes)

    @property
    def interval(self) -> Interval | None:
        """Positions of its axis that it is known for, mm or degrees; None: all."""
        return None

    @abstractmethod
    def columns(self, machine: Machine, state: State) -> Iterator[Columns]:
        """Derivatives of the error components it touches with respect to its parameters, at their values."""

    def contributions(self, machine: Machine, state: State) -> Iterator[tuple[int, int, Array]]:
        """Place, component and values `(n,)`, mm or rad: what the effect adds; here for effects linear in all."""
        parameters = np.asarray(self.parameters)
        for place, component, values in self.columns(machine, state):
            yield place, component, values @ parameters
