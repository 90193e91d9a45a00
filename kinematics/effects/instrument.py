"""The instrument: errors of the measurement, which leave the data and never enter the machine.

Observations are points in the instrument's frame. Errors are observed minus true; they are subtracted from the
observations.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, ClassVar, Literal

import msgspec
import numpy as np

from kinematics.effects.base import (
    BY_DIRECTION,
    INSTRUMENT,
    TOOL,
    UM,
    URAD,
    own_motion,
    unit_of,
)
from kinematics.effects.combined.when import AtRate, FromMoment
from kinematics.effects.combined.where import AtStation, OfInstrument, in_station, observed
from kinematics.effects.records import Columns, Parameter, Workshop
from kinematics.machine import Machine
from kinematics.state import State
from kinematics.transforms import Array
from kinematics.user_error import UserError

Vector = tuple[float, float, float]
ZERO: Vector = (0.0, 0.0, 0.0)
WARM_UP = "Let the instrument warm up, fix its stand, and measure again."


class StationShift(AtStation, FromMoment, frozen=True, tag="station-shift"):
    """The pose of the instrument in one set-up differs from its registration: shifted, and turned about its origin.

    With `since_s` it holds from this time on: the instrument was knocked. In the instrument's own frame; its
    observations move in the opposite direction.
    """

    TITLE: ClassVar[str] = "shift of an instrument station"
    NEEDS: ClassVar[tuple[str, ...]] = ("observed", "station", "time")
    LABEL: ClassVar[tuple[str, ...]] = ("station",)
    SHOWN_OVER = "time"
    SHOWN_BY = "fixed references, measured again and again"
    WORKSHOP = Workshop("The instrument or its stand has moved between two set-ups.", WARM_UP)
    QUANTITIES: ClassVar[tuple[Parameter, ...]] = (
        Parameter("shift_um", "um", 20.0),
        Parameter("turn_urad", "urad", 20.0),
    )

    station: str
    shift_um: Vector = ZERO
    turn_urad: Vector = ZERO
    since_s: float | None = None

    def at_place(self, machine: Machine, state: State, course: Array) -> Iterator[Columns]:
        """See `Course.at_place`: in one station."""
        return super().at_place(machine, state, course * in_station(state, self.station, self.name))


class TrackerDrift(AtStation, AtRate, frozen=True, tag="tracker-drift"):
    """The instrument moves on its base with time, from time 0: shifts, and turns about its origin, at constant rates.

    In the instrument's own frame; its observations move in the opposite direction.
    """

    TITLE: ClassVar[str] = "drift of the instrument on its base"
    NEEDS: ClassVar[tuple[str, ...]] = ("observed", "time")
    RARE = True
    ON_PART = (
        "the part, or the measuring machine, drifted while it measured; the machine tool has no part in it: let "
        "the part reach the temperature of the room, and measure some features once more at the end"
    )
    SHOWN_OVER = "time"
    SHOWN_BY = "positions measured once more backwards, and fixed references on the bed"
    WORKSHOP = Workshop("The instrument or its stand moves slowly: warm-up, floor, tripod.", WARM_UP)
    QUANTITIES: ClassVar[tuple[Parameter, ...]] = (
        Parameter("shift_um_per_h", "um/h", 10.0),
        Parameter("turn_urad_per_h", "urad/h", 10.0),
    )

    shift_um_per_h: Vector = ZERO
    turn_urad_per_h: Vector = ZERO


class MeasuringMachineScale(OfInstrument, frozen=True, tag="cmm-scale"):
    """The measuring machine that measures a part reads one of its coordinates too long in proportion.

    Also the temperature of the part, if the measuring machine does not correct it. ISO 10360-2; Schwenke et al., CIRP
    Annals 57/2 (2008).
    """

    TITLE: ClassVar[str] = "scale of the coordinate measuring machine, or temperature of the part on it"
    LABEL: ClassVar[tuple[str, ...]] = ("direction",)
    SHOWN_OVER = "coordinate"
    SHOWN_BY = "the part measured once more, turned by 90 degrees on the measuring machine, and a length standard"
    WORKSHOP = Workshop(
        "Scale of the coordinate measuring machine, or a part that is not at 20 °C on it.",
        "Let the part take the temperature of the room; check the machine with a gauge.",
    )
    QUANTITIES: ClassVar[tuple[Parameter, ...]] = (Parameter("scale_um_per_m", "um/m", 5.0),)

    direction: Literal["x", "y", "z"]
    scale_um_per_m: float

    def columns(self, machine: Machine, state: State) -> Iterator[Columns]:  # noqa: ARG002
        """See `EffectBase.columns`."""
        k = "xyz".index(self.direction)
        yield Columns(INSTRUMENT, k, state.need("observed", self.name)[:, [k]] * 1e-3 * UM)


class MeasuringMachineSquareness(OfInstrument, frozen=True, tag="cmm-squareness"):
    """Two axes of the measuring machine that measures a part are not square to each other.

    The first coordinate of the plane is read too long by angle x the second: the angle between the two axes, as the
    measuring machine takes them for square, exceeds 90 degrees by it. ISO 10360-2; ISO 230-1:2012.
    """

    TITLE: ClassVar[str] = "squareness of the coordinate measuring machine"
    LABEL: ClassVar[tuple[str, ...]] = ("plane",)
    SHOWN_OVER = "coordinate"
    SHOWN_BY = "the part measured once more, turned by 90 degrees on the measuring machine"
    WORKSHOP = Workshop(
        "Axes of the coordinate measuring machine that are not square.", "Measure the part in turned positions too."
    )
    QUANTITIES: ClassVar[tuple[Parameter, ...]] = (Parameter("angle_urad", "urad", 5.0),)

    plane: Literal["xy", "xz", "yz"]
    angle_urad: float

    def columns(self, machine: Machine, state: State) -> Iterator[Columns]:  # noqa: ARG002
        """See `EffectBase.columns`."""
        first, second = ("xyz".index(letter) for letter in self.plane)
        yield Columns(INSTRUMENT, first, state.need("observed", self.name)[:, [second]] * URAD)


class TargetOffset(OfInstrument, FromMoment, frozen=True, tag="target-offset"):
    """The position of a target on the tool differs from its stated vector, in the tool's own directions.

    With `since_s` it holds from this time on: the target was taken out and seated again, or the tool has slipped.
    """

    TITLE: ClassVar[str] = "offset of a target in its nest"
    NEEDS: ClassVar[tuple[str, ...]] = ("target", "time")
    LABEL: ClassVar[tuple[str, ...]] = ("target",)
    SHOWN_OVER = "target"
    SHOWN_BY = "targets exchanged, or the tool turned, between two runs"
    WORKSHOP = Workshop(
        "A reflector is not seated in its nest, or its position is stated wrong.", "Clean the nest; measure the target."
    )
    QUANTITIES: ClassVar[tuple[Parameter, ...]] = (Parameter("offset_um", "um", 50.0),)

    target: str
    offset_um: Vector
    since_s: float | None = None

    @property
    def remarks(self) -> tuple[str, ...]:
        """What the header of the data should say, where the offset holds for all of them."""
        if self.since_s is not None:
            return ()
        size = ", ".join(f"{1e-3 * value:.3f}" for value in self.offset_um)
        u = 2e-3 * max(self.uncertainties)
        return (
            f"target {self.target}: its position on the tool differs by ({size}) mm +- {u:.2g} mm (k=2) from the "
            "stated one: measure it, and correct the header",
        )

    def at_place(self, machine: Machine, state: State, course: Array) -> Iterator[Columns]:  # noqa: ARG002
        """See `Course.at_place`: at one target."""
        here = state.need("target", self.name) == self.target
        for k in range(3):
            yield Columns(TOOL, k, course * here[:, None] * UM * np.eye(3)[k])


class LateReadBack(OfInstrument, frozen=True, tag="late-read-back"):
    """The axis positions of an observation are late, or the two clocks differ: the machine had moved on.

    Every axis is lag x velocity ahead of the recorded position: a following error with the opposite sign that is no
    error of the machine.
    """

    TITLE: ClassVar[str] = "late read-back of the axis positions (clock offset)"
    NEEDS: ClassVar[tuple[str, ...]] = ("velocity",)
    RARE = True
    SHOWN_OVER = "velocity"
    SHOWN_BY = "the same path at two feeds"
    WORKSHOP = Workshop("The clocks of control and instrument differ.", "Synchronise the clocks, or use a trigger.")
    QUANTITIES: ClassVar[tuple[Parameter, ...]] = (Parameter("lag_ms", "ms", 1.0),)

    lag_ms: float

    def columns(self, machine: Machine, state: State) -> Iterator[Columns]:
        """See `EffectBase.columns`."""
        velocity = state.need("velocity", self.name)
        for axis in machine.names:
            i, component, forward = own_motion(machine, axis)
            yield Columns(i, component, 1e-3 * forward * velocity[:, [i]])


class UnknownApproach(OfInstrument, frozen=True, tag="unknown-approach"):
    """Error of an axis in the rows before its first move, where the direction of its approach is unknown.

    The direction decides on which side of its lost motion the axis was: half the reversal value of ISO 230-2, with
    either sign.
    """

    TITLE: ClassVar[str] = "error of an axis before its first move, approached from an unknown side"
    NEEDS: ClassVar[tuple[str, ...]] = ("approach",)
    SHOWN_OVER = "rows"
    WORKSHOP = Workshop(
        "The axis had not moved before the first rows, so that its side of the backlash is unknown.",
        "Move every axis once in the same direction before the measurement.",
    )
    QUANTITIES: ClassVar[tuple[Parameter, ...]] = (Parameter("offset", BY_DIRECTION, 10.0),)

    axis: str
    offset: float

    def columns(self, machine: Machine, state: State) -> Iterator[Columns]:
        """See `EffectBase.columns`."""
        i, component, forward = own_motion(machine, self.axis)
        unknown = state.need("approach", self.name)[:, [i]] == 0.0
        yield Columns(i, component, forward * unit_of(self.axis)[1] * unknown)


class Outliers(OfInstrument, frozen=True, tag="outliers"):
    """Rows of the data, counted from 0, that are wrong: the deviation x y z of each in the instrument's frame."""

    TITLE: ClassVar[str] = "outliers"
    NEEDS: ClassVar[tuple[str, ...]] = ()
    HAS_MEMORY: ClassVar[bool] = True
    SHOWN_OVER = "size of the residual"
    WORKSHOP = Workshop(
        "Single rows: a broken beam, a bump, a wrong point.", "Look at the listed rows; measure them again."
    )
    QUANTITIES: ClassVar[tuple[Parameter, ...]] = (Parameter("shift_um", "um", float("inf")),)

    rows: tuple[Annotated[int, msgspec.Meta(ge=0)], ...]
    shift_um: tuple[float, ...]

    def __post_init__(self) -> None:
        if len(self.shift_um) != 3 * len(self.rows):
            raise ValueError(f"{self.name}: three numbers for each of its {len(self.rows)} rows")
        super().__post_init__()

    @property
    def size_summary(self) -> tuple[str, ...]:
        """The number of its rows."""
        return (f"{len(self.rows)} row{'s' * (len(self.rows) > 1)}",)

    def columns(self, machine: Machine, state: State) -> Iterator[Columns]:  # noqa: ARG002
        """See `EffectBase.columns`."""
        if max(self.rows, default=-1) >= len(state):
            raise UserError(f"{self.name}: there is no row {max(self.rows)} in {len(state)} rows")
        values = np.zeros((len(state), 3, len(self.shift_um)))
        for i, row in enumerate(self.rows):
            values[row, :, 3 * i : 3 * i + 3] = np.eye(3) * UM
        yield from observed(values)
