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
from kinematics.effects.distortion import DistortionWithSensor, DistortionWithTime
from kinematics.effects.drive import (
    Backlash,
    Cyclic,
    FirstCycle,
    FollowingError,
    QuantisedCompensation,
    Reversal,
    Settling,
)
from kinematics.effects.friction import Hysteresis, LateralPlay, ReversalSpike, ServoMismatch
from kinematics.effects.geometric import CrossAxis, ErrorMotion, LocationError, LocationJump, Racking, Scale, Wobble
from kinematics.effects.instrument import (
    AirDrift,
    AirScale,
    AngleHarmonic,
    AngleStep,
    LateReadBack,
    MeasuringMachineScale,
    MeasuringMachineSquareness,
    Outliers,
    RangeDrift,
    RangeOffset,
    StationShift,
    TargetOffset,
    TrackerDrift,
    UnknownApproach,
)
from kinematics.effects.load import JointCompliance, RamSag
from kinematics.effects.thermal import (
    DriftWithDuty,
    DriftWithSensor,
    GrowthWithDuty,
    GrowthWithSensor,
    GrowthWithTime,
    QuadraticGrowth,
    ThermalDrift,
    WorkpieceDrift,
    WorkpieceDriftWithSensor,
)
from kinematics.effects.unnamed import Unnamed

Effect = (
    ErrorMotion
    | LocationError
    | LocationJump
    | Scale
    | CrossAxis
    | Racking
    | Wobble
    | JointCompliance
    | RamSag
    | Backlash
    | Reversal
    | LateralPlay
    | Hysteresis
    | ReversalSpike
    | Cyclic
    | QuantisedCompensation
    | ControlTable
    | FollowingError
    | ServoMismatch
    | Settling
    | FirstCycle
    | ThermalDrift
    | DriftWithSensor
    | DriftWithDuty
    | WorkpieceDrift
    | WorkpieceDriftWithSensor
    | GrowthWithTime
    | GrowthWithSensor
    | QuadraticGrowth
    | GrowthWithDuty
    | DistortionWithTime
    | DistortionWithSensor
    | Unnamed
    | StationShift
    | TrackerDrift
    | RangeOffset
    | RangeDrift
    | AirScale
    | AirDrift
    | AngleHarmonic
    | AngleStep
    | TargetOffset
    | LateReadBack
    | MeasuringMachineScale
    | MeasuringMachineSquareness
    | UnknownApproach
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
    "AirDrift",
    "AirScale",
    "AngleHarmonic",
    "AngleStep",
    "Backlash",
    "Columns",
    "Component",
    "ControlTable",
    "CrossAxis",
    "Cyclic",
    "DistortionWithSensor",
    "DistortionWithTime",
    "DriftWithDuty",
    "DriftWithSensor",
    "Effect",
    "EffectBase",
    "ErrorMotion",
    "FirstCycle",
    "FollowingError",
    "GrowthWithDuty",
    "GrowthWithSensor",
    "GrowthWithTime",
    "Hysteresis",
    "JointCompliance",
    "LateReadBack",
    "LateralPlay",
    "LocationError",
    "LocationJump",
    "MeasuringMachineScale",
    "MeasuringMachineSquareness",
    "Outliers",
    "Parameter",
    "QuadraticGrowth",
    "QuantisedCompensation",
    "Racking",
    "RamSag",
    "RangeDrift",
    "RangeOffset",
    "Remedy",
    "Reversal",
    "ReversalSpike",
    "Scale",
    "ServoMismatch",
    "Settling",
    "StationShift",
    "TargetOffset",
    "ThermalDrift",
    "TrackerDrift",
    "UnknownApproach",
    "Unnamed",
    "Wobble",
    "WorkpieceDrift",
    "WorkpieceDriftWithSensor",
    "unit_of",
]
