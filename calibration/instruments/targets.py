"""What instruments aim at: targets on their carriers, and calibrated distances."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple

from kinematics.machine import Vector

Carrier = Literal["tool", "table", "bed"]


@dataclass(frozen=True)
class Target:
    """A reflector and its position on its carrier."""

    position: Vector
    """Position, mm: from the tool reference point, in the tool's directions; on the table or the bed, in the workpiece
    frame at zero pose of the machine."""
    carrier: Carrier = "tool"
    """What carries the target: tool, table (workpiece) or bed."""
    free: bool = False
    """True for a target on the tool whose position the registration also estimates."""
    spindle_deg: float = 0.0
    """Angle by which the spindle was turned about +z when a touch probe measured, degrees; `position` is turned too."""

    @property
    def known(self) -> bool:
        """False where the position is a first value for the registration: on the table, on the bed, and where free."""
        return self.carrier == "tool" and not self.free


SPINDLE_NOSE = Target((0.0, 0.0, 0.0))


class Distance(NamedTuple):
    """A calibrated distance between the centres of two spheres, such as the length of a scale bar."""

    one: str
    other: str
    length: float
    """Distance, mm."""
    u: float
    """Standard uncertainty of the distance, mm."""
