"""The modal state of a HEIDENHAIN control."""

from __future__ import annotations

from dataclasses import dataclass, field

from postproc.control import modal_state
from postproc.heidenhain.datum_transformations import DatumTransformations
from postproc.motion.frames import Frame, Placement, spatial

NO_TOOL = "0"


@dataclass
class ModalState(modal_state.ModalState):
    """The modes of Klartext: preset, tool, datum transformations and the tilted working plane."""

    preset: str = "0"
    """Number of the preset in force."""
    without_rotation: set[str] = field(default_factory=set)
    """Presets whose basic rotation M143 has deleted."""
    tool: str = NO_TOOL
    """Number or name of the tool in the spindle."""
    tool_length: float = 0.0
    """Its length without the oversize, mm."""
    oversize: float = 0.0
    """Oversize of its length by TOOL CALL, mm."""
    radius_oversize: float = 0.0
    """Oversize of its radius by TOOL CALL, mm."""
    cycle: int = 0
    """Number of the last cycle that was defined for a call; 0 for none."""
    calls_cycle: bool = False
    """The cycle runs after every move (M89)."""
    transformations: DatumTransformations = field(default_factory=DatumTransformations)
    """Datum transformations outside a tilted plane."""
    tilt: Placement | None = None
    """Placement of the axes of a tilted working plane in the workpiece frame; None without one."""
    normal: tuple[float, float, float] = (0.0, 0.0, 1.0)
    """Z of the tilted plane in the workpiece frame."""
    tilted_transformations: DatumTransformations = field(default_factory=DatumTransformations)
    """Datum transformations within the tilted plane."""
    levelled: bool = False
    """Cycle 19 tilts the working plane by zero angles."""
    cornered: bool = False
    """The block before is a rounding or a chamfer."""

    @property
    def plain(self) -> bool:
        """True while L is a straight move in coordinates that are not tilted, without radius compensation."""
        transformed = self.transformations.active or self.tilted_transformations.active
        blocked = self.ended or self.compensated or self.cornered or self.levelled or self.tilt is not None
        return self.begun and not transformed and not blocked and not self.calls_cycle

    def frame(self) -> Frame:
        """The frame of programmed coordinates in force."""
        placed = self.placed(self.tilt).then(self.tilted_transformations.placement)
        name = self.tool if self.tool != NO_TOOL else ""
        length, tcp = self.tool_length + self.oversize, self.tcp or self.tilt is not None
        return self.control_state.frame(self.preset, placed, tool=name, length=length, tcp=tcp)

    @property
    def basic_rotation(self) -> tuple[float, float, float]:
        """Basic rotation of the active preset, degrees about X, Y, Z."""
        deleted = self.preset in self.without_rotation
        return (0.0, 0.0, 0.0) if deleted else self.control_state.setup.turned.get(self.preset, (0.0, 0.0, 0.0))

    def placed(self, tilt: Placement | None) -> Placement:
        """The placement by preset rotation and datum transformations, and by a tilted plane within them."""
        return spatial(*self.basic_rotation).then(self.transformations.placement).then(tilt or Placement())
