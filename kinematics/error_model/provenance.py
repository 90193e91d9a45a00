"""Where a calibration comes from, and the machine that it belongs to: entries of a calibration file."""

from __future__ import annotations

import datetime
import warnings
from collections.abc import Iterable
from typing import Annotated

import msgspec

from kinematics.effects import PLUGINS, Effect
from kinematics.machine import Machine
from kinematics.running.plugins import OtherPlugin

SIMULATED = "simulated data"
"""Words in the source of a calibration that was fitted to such data."""
VALID_DAYS = 365.0
"""Validity of a calibration without `valid_days`, days."""


NOBODY = "ncomp"
"""The maker of a machine without errors."""


class MachineReference(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The machine that a calibration belongs to."""

    name: str
    """Name of the machine."""
    chain: str
    """Its chain, `w C B b X Y Z t`."""
    chain_hash: str
    """Fingerprint of its geometry: a machine with another one is refused."""


class Provenance(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Where a calibration comes from: tool and version, time, sources and the fingerprints of its inputs.

    Fields that are UNSET stay out of the file and out of the id, so that older files keep theirs.
    """

    made_by: str
    """Program and its version."""
    made_at: Annotated[datetime.datetime, msgspec.Meta(tz=True)]
    """Time at which it was made."""
    source: str = ""
    """Origin in words."""
    inputs: dict[str, str] = {}
    """Fingerprints of the input files by their names; `plug-in NAME` has the fingerprint of a plug-in with effects of
    the calibration, or its package and version."""
    valid_days: Annotated[float, msgspec.Meta(gt=0.0)] | msgspec.UnsetType = msgspec.UNSET
    """Days for which the calibration is valid from the measurement on; without it VALID_DAYS."""
    measured_on: datetime.date | msgspec.UnsetType = msgspec.UNSET
    """Date of the measurement, of several the earliest; without it the date of `made_at` counts."""
    temperatures_degC: dict[str, tuple[float, float]] | msgspec.UnsetType = msgspec.UNSET  # noqa: N815  its unit
    """Lowest and highest temperature of each sensor while the machine was measured, degC."""

    @classmethod
    def of_today(cls) -> Provenance:
        """That of a machine without errors."""
        now = datetime.datetime.now(datetime.UTC)
        return cls(NOBODY, now.replace(hour=0, minute=0, second=0, microsecond=0))

    @property
    def lasting(self) -> Provenance:
        """Without the date of a machine without errors, which is the day of the run."""
        unix = datetime.datetime.fromtimestamp(0, datetime.UTC)
        return msgspec.structs.replace(self, made_at=unix) if self.made_by == NOBODY else self

    def warn_of_other_plugins(self, effects: Iterable[Effect], name: str) -> None:
        """Warn where the plug-ins of some effects are not those with which the calibration of this name was made."""
        for plugin, version in plugin_inputs(effects).items():
            before = self.inputs.get(plugin, version)
            if version != before:
                text = f"calibration {name} was made with {plugin}, {before}, and this run uses {version}"
                warnings.warn(f"{text}: fit it again if the effect has changed", OtherPlugin, stacklevel=3)


def reference(machine: Machine) -> MachineReference:
    """The machine entry of a calibration."""
    return MachineReference(machine.name, machine.chain, machine.chain_hash)


def plugin_inputs(effects: Iterable[Effect]) -> dict[str, str]:
    """The plug-ins that gave some effects, as inputs of a calibration with these effects."""
    return {
        f"plug-in {plugin.name}": plugin.version for plugin in (PLUGINS[e.kind] for e in effects if e.kind in PLUGINS)
    }
