"""The table of effects: physical causes of error, one class each.

An effect turns its parameters into error motions at the axes, a displacement of the tool, or a displacement of
the observations. Everything that fits, predicts, corrects or reports errors goes through this table.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Union

from kinematics.effects.base import COMPONENTS, INSTRUMENT, TOOL, UM, URAD, Component, EffectBase, Remedy, unit_of
from kinematics.effects.combined.thermal import (
    DistortionWithSensor,
    DistortionWithTime,
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
from kinematics.effects.control import ControlTable, WorkpieceSurface
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
from kinematics.effects.geometric import CentredMotion, ErrorMotion, Racking, Wobble
from kinematics.effects.instrument import (
    LateReadBack,
    MeasuringMachineScale,
    MeasuringMachineSquareness,
    Outliers,
    StationShift,
    TargetOffset,
    TrackerDrift,
    UnknownApproach,
)
from kinematics.effects.load import CrossAxis, JointCompliance, RamSag
from kinematics.effects.location import LocationError, LocationJump, Scale, ToolShift, after_touch_off
from kinematics.effects.probe import ProbeLobing
from kinematics.effects.records import Columns, Parameter, Workshop
from kinematics.effects.tracker import (
    AirDrift,
    AirScale,
    AngleHarmonic,
    AngleStep,
    RangeDrift,
    RangeJump,
    RangeOffset,
)
from kinematics.effects.unnamed import Unnamed
from kinematics.running import plugins
from kinematics.running.plugins import Plugin
from kinematics.user_error import UserError

_ORDER = """
error-motion location location-jump tool-shift scale cross-axis racking wobble joint-compliance ram-sag backlash
reversal lateral-play hysteresis reversal-spike cyclic quantised-compensation control-table surface following-error
servo-mismatch settling first-cycle thermal-drift thermal-drift-sensor thermal-drift-duty
thermal-drift-workpiece thermal-drift-workpiece-sensor thermal-scale thermal-scale-sensor
thermal-scale-quadratic thermal-scale-duty thermal-distortion thermal-distortion-sensor unnamed station-shift
tracker-drift tracker-range tracker-range-drift range-jump air-scale air-scale-drift tracker-angle
tracker-angle-step target-offset late-read-back probe-lobing cmm-scale cmm-squareness unknown-approach outliers
"""
"""Kinds in the order of the table; one that is not named here follows at its end."""


def _all() -> list[type[EffectBase]]:
    """The classes that are effects of the table: those with a title of their own."""
    classes: list[type[EffectBase]] = [EffectBase]  # type: ignore[type-abstract]
    for each in classes:
        classes += [below for below in each.__subclasses__() if below not in classes]
    return [each for each in classes if "TITLE" in vars(each)]


def _place(effect: type[EffectBase]) -> int:
    kind, order = str(effect.__struct_config__.tag), _ORDER.split()
    return order.index(kind) if kind in order else len(order)


def _of_plugins() -> Iterator[tuple[str, Plugin]]:
    """The kinds of a user's own plug-ins; UserError for a class that lacks a fact, or has the kind of another one."""
    known = set(_all())
    for plugin in plugins.run():
        every = _all()
        for effect in (each for each in every if each not in known):
            kind, where = str(effect.__struct_config__.tag), f"--plugin {plugin.name}: {effect.__name__}"
            lacking = [name for name in ("WORKSHOP", "SHOWN_OVER", "columns") if not _stated(effect, name)]
            if lacking:
                raise UserError(f"{where} has no {lacking[0]}: state it, as an effect in docs/develop/recipes.md does")
            if any(kind == other.__struct_config__.tag for other in every if other is not effect):
                raise UserError(f"{where}: its kind {kind!r} is that of another effect: give it another tag")
            yield kind, plugin
        known.update(every)


def _stated(effect: type[EffectBase], name: str) -> bool:
    """True for a fact that a class states, or takes from a class of its own kind."""
    return getattr(effect, name, None) is not getattr(EffectBase, name, None)


PLUGINS: Mapping[str, Plugin] = dict(_of_plugins())
"""The plug-ins by the kinds of their effects."""
EFFECTS: tuple[type[EffectBase], ...] = tuple(sorted(_all(), key=_place))
"""The table of all effects. A class of a module that is imported here is known to all of ncomp."""
if TYPE_CHECKING:
    Effect = EffectBase
else:
    Effect = Union[EFFECTS]  # noqa: UP007  the union by which files are decoded
KINDS: Mapping[str, type[EffectBase]] = {str(effect.__struct_config__.tag): effect for effect in EFFECTS}
"""The classes by their kinds, the names in files."""

__all__ = [
    "COMPONENTS",
    "EFFECTS",
    "INSTRUMENT",
    "KINDS",
    "TOOL",
    "UM",
    "URAD",
    "AirDrift",
    "AirScale",
    "AngleHarmonic",
    "AngleStep",
    "Backlash",
    "CentredMotion",
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
    "ProbeLobing",
    "QuadraticGrowth",
    "QuantisedCompensation",
    "Racking",
    "RamSag",
    "RangeDrift",
    "RangeJump",
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
    "ToolShift",
    "TrackerDrift",
    "UnknownApproach",
    "Unnamed",
    "Wobble",
    "WorkpieceDrift",
    "WorkpieceDriftWithSensor",
    "WorkpieceSurface",
    "Workshop",
    "after_touch_off",
    "unit_of",
]
