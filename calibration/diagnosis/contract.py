"""Kind, place and distinguishing fields of an effect in a diagnosis (contract 4.3)."""

from __future__ import annotations

from typing import Any

from kinematics.effects import Effect
from kinematics.effects.base import own_component

DISTINGUISHING = (
    *("component", "other", "sensor", "harmonic", "over", "above_deg", "station", "since_s", "target", "direction"),
    *("plane", "degree", "fixed_point", "rows", "variables", "ranges", "terms", "side"),
)
"""Fields that distinguish effects of one kind, besides their axis."""


def contract_kind(effect: Effect) -> str:
    """The kind of an effect in a diagnosis (contract 4.3)."""
    return effect.DIAGNOSED_AS or effect.kind


def where(effect: Effect) -> str | None:
    """Axis of an effect; else the direction of the tool, or the part of the instrument: its circle, station, ..."""
    for field in ("axis", "component", "circle", "station", "target", "direction", "plane"):
        if getattr(effect, field, None):
            return str(getattr(effect, field))
    return None


def fields_of(effect: Effect) -> dict[str, Any]:
    """Fields that distinguish an effect from others of its kind: component, other axis, sensor, side, ..."""
    return {name: getattr(effect, name) for name in DISTINGUISHING if getattr(effect, name, None) is not None}


def is_rare(effect: Effect) -> bool:
    """True for an effect that is rarer than others of its kind: a drift rather shifts than tilts."""
    tilt = contract_kind(effect) == "thermal-drift" and str(where(effect)) in "ABC"
    return tilt or effect.RARE


def family_of(effect: Effect) -> tuple[str, str | None, str | None]:
    """What all variants of one cause share: kind, axis, component, and other axis, degree, side or moment."""
    if effect.ALONG_OWN_AXIS and getattr(effect, "component", None) == own_component(effect.axes[0]):
        return effect.ALONG_OWN_AXIS, where(effect), None
    fields = (getattr(effect, field, None) for field in ("component", "other", "degree", "motion", "side", "over"))
    moment = None if effect.moment is None else "since"
    distinguished = "".join(str(field) for field in (*fields, moment) if field is not None)
    return contract_kind(effect), where(effect), distinguished or None
