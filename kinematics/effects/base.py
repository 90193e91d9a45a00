"""The base of all effects: parameters with units and typical sizes, and columns over a State."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import islice
from typing import Any, ClassVar, Literal, Self, cast

import msgspec
import numpy as np

from kinematics.basis import Basis, Interval
from kinematics.effects.records import Columns, InControl, Parameter, Workshop
from kinematics.machine import Machine
from kinematics.state import State
from kinematics.transforms import Array

COMPONENTS = "XYZABC"
Component = Literal["X", "Y", "Z", "A", "B", "C"]
Part = Literal["own", "across", "line", "turn"]
Remedy = Literal["program", "table", "bidirectional table", "none"]
Acting = Literal["axis", "tool", "workpiece", "instrument"]
Positions = Literal["of its axis", "none", "any"]

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
    ACTS_ON: ClassVar[Acting] = "axis"
    """An effect of the instrument is in the data only; it never enters a correction."""
    NEEDS: ClassVar[tuple[str, ...]] = ()
    """Columns of State, besides positions."""
    REMEDY: ClassVar[Remedy] = "program"
    """The simplest remedy: a controller's table, one with both directions, the corrected program."""
    HAS_MEMORY: ClassVar[bool] = False
    """True when a row depends on other rows, or on its number."""
    COEFFICIENTS: ClassVar[bool] = False
    """True where the parameters are coefficients of functions of position: reports show the errors at positions."""
    QUANTITIES: ClassVar[tuple[Parameter, ...]] = ()
    """The fields that hold parameters; a row of numbers gives as many parameters `name[i]`."""
    LABEL: ClassVar[tuple[str, ...]] = ()
    """Fields that distinguish two effects of the class, besides component and axis."""
    POSITIONS: ClassVar[Positions] = "any"
    """Positions on which its errors depend, at constant conditions and directions of approach.

    Those of its axis alone, smooth between the nodes of its basis, if it has one; none, as a constant displacement of
    the tool; or any: those of several axes, with jumps, or with a memory of the moves.
    """
    WORKSHOP: ClassVar[Workshop]
    """Usual origin in the workshop, and repair."""
    WORKSHOP_OF_ROTARY: ClassVar[Workshop | None] = None
    """The same for a rotary axis or the joint of an arm, which have no screw, nut or guide; None where it is equal."""
    DIAGNOSED_AS: ClassVar[str] = ""
    """Its kind in a diagnosis; empty where it is the kind in other files."""
    ALONG_OWN_AXIS: ClassVar[str] = ""
    """Kind of the cause of which it is a form where it acts along its own axis; empty for none."""
    RARE: ClassVar[bool] = False
    """True for a rare cause that imitates a common one.

    The common one is a backlash, a thermal drift, a knock at the tracker, or a change of geometry.
    """
    PERIODIC: ClassVar[bool] = False
    """True for an error that repeats along its axis with a period of its own, which a diagnosis searches for."""
    NAMES_CAUSE: ClassVar[bool] = True
    """False for a measured dependence whose physical cause is unknown."""
    OF_AXIS_LINE: ClassVar[bool] = False
    """True for the position, the orientation or the scale of an axis line.

    Every calibration has these: found as a cause it is a change since then.
    """
    OF_SEVERAL_CLASSES: ClassVar[bool] = False
    """True for a sum of errors of several classes of ISO/TR 16907, of which none can be selected alone."""
    OF_ISO_230: ClassVar[bool] = False
    """True for the error motions and location errors of ISO 230-1, which reports show in tables of their own."""
    IN_POSITIONING: ClassVar[Literal["", "mean", "reversal"]] = ""
    """What a test of positioning along its axis (ISO 230-2) contains of it: a part of the mean or of the reversal."""
    ON_PART: ClassVar[str] = ""
    """Note on the effect where a part was measured instead of the machine; empty where it means the same."""
    CONTROL_PARAMETER: ClassVar[Literal["", "backlash", "growth", "rotary"]] = ""
    """The parameter of a control that can take its size instead of a table; empty where there is none."""
    SHOWN_OVER: ClassVar[str]
    """The variable over which a report draws the errors."""
    SHOWN_BY: ClassVar[str] = "other positions"
    """Measurement that makes the effect visible."""

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
    def workshop(self) -> Workshop:
        """Usual origin in the workshop and repair, for a linear or a rotary axis."""
        rotary = any(name[:1] in ("A", "B", "C") for name in self.axes[:1])
        return (self.WORKSHOP_OF_ROTARY if rotary else None) or self.WORKSHOP

    @property
    def part(self) -> Part:
        """The property of its axis of which it is an error (ISO/TR 16907)."""
        own = own_component(self.axes[0]) if self.axes else ""
        component = getattr(self, "component", own)
        return "own" if component == own else "turn" if component in "ABC" else "across"

    @property
    def shortest_wave(self) -> tuple[str, float] | None:
        """Axis, and length along it, mm or degrees, of its shortest wave; None where it does not repeat."""
        return None

    @property
    def kinks(self) -> tuple[float, ...]:
        """Positions of its axis, mm or degrees, that are nodes of a table of this axis; empty where any will do."""
        return ()

    def in_control(self, machine: Machine) -> InControl | None:  # noqa: ARG002  for an axis line, which it contains
        """Its value for the parameter of a control, `CONTROL_PARAMETER`; None where there is none."""
        if not self.CONTROL_PARAMETER:
            return None
        parts = zip(self.parameter_table, self.parameters, strict=True)
        return InControl(self.name, ", ".join(f"{p.name} {v:.4f} {p.unit}" for p, v in parts))

    def beyond_kinematics(self, machine: Machine) -> str:  # noqa: ARG002  for an axis line, which it contains
        """Why the kinematic parameters of a control do not hold it, where they do not."""
        return "it changes with positions: for tables or corrected programs"

    @property
    def meaning(self) -> str:
        """What it is in the words of the workshop; empty where its name says it."""
        return ""

    @property
    def size_summary(self) -> tuple[str, ...]:
        """Texts on its size in place of a list of its parameters; empty where the parameters are listed."""
        return ()

    @property
    def waves(self) -> tuple[str, ...]:
        """Amplitudes and orders of a periodic error as texts; empty for others."""
        return ()

    @property
    def line_name(self) -> str:
        """The property of the axis line of which it is the error; empty where it is none, as `OF_AXIS_LINE`."""
        return ""

    @property
    def remarks(self) -> tuple[str, ...]:
        """Notes on its size as the cause of errors: the meaning of an unusual sign, or what to do."""
        return ()

    @property
    def finding(self) -> str:
        """What is wrong with its size in a calibration, beyond its uncertainty; empty where nothing is."""
        return ""

    def lasting(self) -> Self:
        """The effect as a calibration has it, whenever later data begin: permanent after its moment."""
        return self

    @property
    def conditions(self) -> tuple[str, ...]:
        """What its parameters refer to, as texts: the moment from which it holds, a fixed point, a range."""
        return () if self.moment is None else (f"from {self.moment / HOUR:.4g} h on",)

    @property
    def moment(self) -> float | None:
        """The time, s, at which the error appears suddenly; None where it has no such moment."""
        since_s: float | None = getattr(self, "since_s", None)
        return since_s

    @property
    def has_fixed_point(self) -> bool:
        """True where it leaves one position of its axis where it is, `fixed_point`, which the data have to show."""
        return False

    @property
    def sensors(self) -> tuple[str, ...]:
        """Names of the temperatures that it follows."""
        return (self.sensor,) if hasattr(self, "sensor") else ()

    def shown_by(self, state: State) -> str:  # noqa: ARG002
        """The measurement that shows it, where some states do not."""
        return self.SHOWN_BY

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
        return {self.axis: self.basis.interval} if hasattr(self, "axis") and hasattr(self, "basis") else {}

    @property
    def area(self) -> Mapping[str, Interval]:
        """Interval of each axis, mm, of a surface that is cut, whose heights count from the work zero; else empty."""
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
        if self.POSITIONS == "any":
            return None
        return (
            {self.axis: getattr(self, "basis", None)}
            if self.POSITIONS == "of its axis" and hasattr(self, "axis")
            else {}
        )

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

    @classmethod
    def candidates(cls, axes: Iterable[str]) -> Iterator[Self]:  # noqa: ARG003  for a class that is a candidate
        """Effects of this class without a size that a diagnosis tries on data in which these axes move.

        Those of ncomp's own classes are in `calibration/diagnosis/library/causes.py`, because they depend on the data.
        """
        return iter(())

    @abstractmethod
    def columns(self, machine: Machine, state: State) -> Iterator[Columns]:
        """Derivatives of the error components it touches, the same ones in all rows, by its parameters, as they are."""

    def contributions(self, machine: Machine, state: State) -> Iterator[tuple[int, int, Array]]:
        """Index, component and values `(n,)`, mm or rad, of the errors of the effect.

        Its columns times its linear parameters; an effect that is not of that form overrides this.
        """
        amplitudes = np.array(self.parameters)
        if not all(quantity.linear for quantity in self.QUANTITIES):
            amplitudes = amplitudes * self.linear
        for column, component, values in self.columns(machine, state):
            yield column, component, values @ amplitudes
