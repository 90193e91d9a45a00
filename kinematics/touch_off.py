"""How a work offset was obtained: touched off on the machine, or true."""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Mapping
from typing import TYPE_CHECKING

import msgspec

from kinematics.user_error import UserError

if TYPE_CHECKING:
    from kinematics.machine import Machine

PROBED, TRUE = "probed", "true"
_ENTRY = re.compile(r"(?:(probe|[A-Za-z]\d?)\s*=|([A-Za-z]))\s*([-+]?[\d.].*)")
EXPECTED = "expected probed, true, or probed@X..,Y..,Z..,B..,C..,probe=mm"


class Datum(msgspec.Struct, frozen=True):
    """How one work offset was obtained.

    Probed: the commanded position at which the tip of a probe or tool touched the datum, so that the offset holds the
    machine's error there. True: the position of the datum itself, free of the machine's error.
    """

    probed: bool = True
    at: Mapping[str, float] = msgspec.field(default_factory=dict)
    """Machine position of the touch-off by axis, mm and degrees; X Y Z are those of the tip. Without an axis: that of
    the work offset, and home for a rotary axis that the work offset does not shift."""
    probe: float | None = None
    """Length of the probe, mm, from the tool reference point to the tip; None for the length of the first tool."""


class TouchOff(msgspec.Struct, frozen=True):
    """The touch-off of one work offset, as far as the control knows it; positions `(axes,)`, mm and degrees."""

    name: str
    """Name of the work offset."""
    offset: tuple[float, ...]
    """The work offset that was stored."""
    position: tuple[float, ...]
    """Machine position; X Y Z are those of the tip."""
    probe: float | None = None
    """Length of the probe, mm; None for the length of the tool with which the offset is first used."""

    @property
    def length(self) -> float:
        """Length of the probe, mm; 0 as long as no tool has been in the spindle."""
        return self.probe or 0.0


def touch_off(name: str, datum: Datum, offset: tuple[float, ...], machine: Machine) -> TouchOff:
    """The touch-off of the work offset `name`, with values `offset` `(axes,)`, mm and degrees."""
    position = [
        datum.at.get(axis.name, value if axis.name in "XYZ" or (axis.rotary and value) else axis.home)
        for axis, value in zip(machine.axes, offset, strict=True)
    ]
    return TouchOff(name, offset, tuple(position), datum.probe)


def read_datum(text: str, axes: Collection[str], where: str) -> Datum:
    """`probed@C90,probe=120` or `true` as a Datum, on a machine with these axes.

    UserError, beginning with `where`, for anything else.
    """
    kind, at, entries = text.strip().partition("@")
    kind = kind.strip().lower()
    if kind not in (PROBED, TRUE) or (at and (kind == TRUE or not entries.strip())):
        raise UserError(f"{where}: {EXPECTED}")
    positions: dict[str, float] = {}
    for entry in entries.split(",") if at else ():
        name, value = _entry(entry, where)
        if name in positions:
            raise UserError(f"{where}: {name} is given twice: give it once")
        if name != "probe" and name not in axes:
            raise UserError(f"{where}: no axis {name}; the machine has {', '.join(axes)}")
        positions[name] = value
    probe = positions.pop("probe", None)
    if probe is not None and probe < 0.0:
        raise UserError(f"{where}: a probe of {probe:g} mm")
    return Datum(kind == PROBED, positions, probe)


def _entry(text: str, where: str) -> tuple[str, float]:
    """`C90`, `C=90` or `probe=120` as the name, in capitals but for `probe`, and the value."""
    match = _ENTRY.fullmatch(text.strip())
    try:
        value = float(match[3]) if match else math.nan
    except ValueError:
        value = math.nan
    if match is None or not math.isfinite(value):
        raise UserError(f"{where}: {text.strip()!r} is neither an axis with its position nor probe=mm; {EXPECTED}")
    name: str = match[1] or match[2]
    return name if name == "probe" else name.upper(), value
