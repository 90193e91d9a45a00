"""The table of effects: physical causes of error, one class each.

An effect turns its parameters into error motions at the axes, a displacement of the tool, or a displacement of
the observations. Everything that fits, predicts, corrects or reports errors goes through this table.
"""

from __future__ import annotations

from kinematics.effects.base import (
    COMPONENTS,
    INSTRUMENT,
    TOOL,
    UM,
    URAD,
    Columns,
    Component,
    EffectBase,
    Parameter,
    Remedy,
    unit_of,
)
from kinematics.effects.control import ControlTable
from kinematics.effects.drive import (
    Backlash,
    Cyclic,
    FirstCycle,
    FollowingError,
    QuantisedCompensation,
    Reversal,
    Settling,
)
from kinematics.effects.geometric import CrossAxis, ErrorMotion, LocationError, Racking, Wobble
from kinematics.effects.instrument import (
    AirScale,
    AngleHarmonic,
    LateReadBack,
    Outliers,
    RangeOffset,
    StationShift,
    TargetOffset,
    TrackerDrift,
)
from kinematics.effects.thermal import DriftWithSensor, GrowthWithSensor, GrowthWithTime, ThermalDrift
from kinematics.effects.unnamed import Unnamed

Effect = (
    ErrorMotion
    | LocationError
    | CrossAxis
    | Racking
    | Wobble
    | Backlash
    | Reversal
    | Cyclic
    | QuantisedCompensation
    | ControlTable
    | FollowingError
    | Settling
    | FirstCycle
    | ThermalDrift
    | DriftWithSensor
    | GrowthWithTime
    | GrowthWithSensor
    | Unnamed
    | StationShift
    | TrackerDrift
    | RangeOffset
    | AirScale
    | AngleHarmonic
    | TargetOffset
    | LateReadBack
    | Outliers
)
EFFECTS: tuple[type[EffectBase], ...] = Effect.__args__
"""The table; a class added to `Effect` is known to all of ncomp."""

__all__ = [
    "COMPONENTS",
    "EFFECTS",
    "INSTRUMENT",
    "TOOL",
    "UM",
    "URAD",
    "AirScale",
    "AngleHarmonic",
    "Backlash",
    "Columns",
    "Component",
    "ControlTable",
    "CrossAxis",
    "Cyclic",
    "DriftWithSensor",
    "Effect",
    "EffectBase",
    "ErrorMotion",
    "FirstCycle",
    "FollowingError",
    "GrowthWithSensor",
    "GrowthWithTime",
    "LateReadBack",
    "LocationError",
    "Outliers",
    "Parameter",
    "QuantisedCompensation",
    "Racking",
    "RangeOffset",
    "Remedy",
    "Reversal",
    "Settling",
    "StationShift",
    "TargetOffset",
    "ThermalDrift",
    "TrackerDrift",
    "Unnamed",
    "Wobble",
    "unit_of",
]
