"""Records of the effects: their columns, their parameters, their values in a control, their origin and repair."""

from __future__ import annotations

import math
from typing import NamedTuple

from kinematics.transforms import Array


class Columns(NamedTuple):
    """Change of one error component at an axis, the tool or the instrument, per unit of each parameter."""

    column: int
    """Column of an axis, TOOL or INSTRUMENT."""
    component: int
    """Index into COMPONENTS."""
    values: Array
    """`(n, parameters)`; mm or rad per unit of the parameter."""


class Workshop(NamedTuple):
    """Two sentences on a kind of error."""

    origin: str
    repair: str


class InControl(NamedTuple):
    """The value of an effect for a parameter of a control instead of a table."""

    subject: str
    value: str
    """With its unit."""


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
    held: bool = False
    """True for one that stays at its value in a fit, because another effect has its error."""

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
