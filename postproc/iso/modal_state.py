"""The modal state of ISO / Fanuc / LinuxCNC programs."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TypeAlias

import msgspec

from postproc.control import modal_state
from postproc.control.channel import AxisWords
from postproc.control.plain_arcs import ArcModes
from postproc.iso.codes import MIRROR, SCALE, TILT
from postproc.iso.cycles import CannedCycle
from postproc.iso.offsets import Lengths, Offsets
from postproc.motion.frames import Frame, Placement, cartesian, rotated, shifted
from postproc.motion.moves import Polar
from postproc.text.block import Block

InForce: TypeAlias = tuple[str | None, tuple[int, float | None] | None, bool]
"""Work offset and length in force, None where the program has not set it yet, and TCP."""
DEFAULTS = {
    "unit": "no G20 or G21 before it: coordinates are taken in mm",
    "distance": "no G90 or G91 before it: coordinates are taken as absolute",
    "plane": "no G17, G18 or G19 before it: arcs are taken in X Y",
}
"""Notes on modes that the program has not set, by their names."""


class PolarCoordinates(msgspec.Struct):
    """Radius and angle of polar coordinates in force, from G16 to G15."""

    radius: float | None = None
    """mm."""
    angle: float | None = None
    """Degrees, from the first axis of the plane towards the second."""

    def take(self, block: Block, axes: tuple[int, int], words: AxisWords) -> tuple[AxisWords, Polar | None]:
        """The words of other axes, and the polar position of the words in the plane; None while there is none yet.

        words: with their values, the angle in degrees.
        """
        programmed = {word.axis: (word.word, value) for word, value in words if word.axis in axes}
        self.radius = programmed.get(axes[0], (None, self.radius))[1]
        self.angle = programmed.get(axes[1], (None, self.angle))[1]
        others = [(word, value) for word, value in words if word.axis not in axes]
        if self.radius is None or self.angle is None:
            if programmed:
                raise block.refuse(
                    "polar coordinates (G16) need a radius and an angle before the first move: write both"
                )
            return others, None
        indices = [programmed[axis][0] if axis in programmed else None for axis in axes]
        return others, Polar(axes, self.radius, self.angle, (indices[0], indices[1]))


@dataclass
class ModalState(modal_state.ModalState):
    """The modes of ISO programs: offsets, lengths, placement of the coordinates, polar coordinates and canned cycle."""

    arc_absolute: bool = field(init=False)
    """Centres of arcs are positions (G90.1); otherwise they count from the start."""
    to_retract: bool | None = field(init=False)
    """Canned cycles end at R (G99) and not at the level before (G98); None where the program has not set it yet."""
    not_programmed: dict[str, str] = field(default_factory=DEFAULTS.copy)
    """Notes on modes that the program has not set yet, by their names."""
    mode_assumed: set[str] = field(default_factory=set)
    """Modes that moves have assumed, as the program had not set them."""
    offsets: Offsets = field(init=False)
    """The work offset, G52 and G92."""
    lengths: Lengths = field(init=False)
    """The tool and the length offset."""
    kinematics_tcp: bool = field(init=False)
    """The kinematics in force position the tool point, whatever the length offset (LinuxCNC)."""
    placement: Placement = field(default_factory=Placement)
    """The rotation, mirror or scale of the coordinates."""
    placement_code: float = 0.0
    """Its G code; 0 for none."""
    mirrors: dict[str, float] = field(default_factory=dict)
    """Positions of the mirrors of G51.1, by axis."""
    upright: bool = False
    """The tool is perpendicular to the tilted plane."""
    cycle: CannedCycle | None = None
    """The canned cycle in force."""
    motion_before_cycle: float | None = None
    """G code of the motion that was in force where the canned cycle began."""
    cornered: bool = False
    """The control breaks the corner after the block."""
    polar: PolarCoordinates | None = None
    """Radius and angle of polar coordinates; None without G16."""

    def __post_init__(self) -> None:
        super().__post_init__()
        control = self.machine.control
        self.arc_absolute = control.arc_centres == "absolute"
        self.kinematics_tcp = control.tcp_at_start
        self.to_retract = False if control.family == "fanuc" else None
        if control.unit:
            del self.not_programmed["unit"]
        self.offsets = Offsets(self.control_state)
        self.lengths = Lengths(self.control_state, with_tool_0=control.random_toolchanger)

    @property
    def angle_axis(self) -> int:
        """Column of the axis whose words are angles of polar coordinates; -1 for none."""
        return -1 if self.polar is None else self.plane_columns[1]

    @property
    def plain(self) -> bool:
        """True while lines of axis words are moves of X Y Z and rotary axes, to positions or by increments."""
        return (
            not (self.ended or self.compensated or self.cornered or self.tilted or self.lengths.vectors)
            and self.cycle is None
            and self.polar is None
            and self.not_programmed.keys() <= {"plane"}
        )

    @property
    def arc_modes(self) -> ArcModes | None:
        """The modes of arcs in plain lines; None as long as the program has not given the plane."""
        return None if self.not_programmed else ArcModes(self.plane, self.unit, self.arc_absolute)

    # ---- frames

    @property
    def tilted(self) -> bool:
        """True while a tilted plane is on."""
        return self.placement_code == TILT

    @property
    def shifted(self) -> bool:
        """True while a turn, a scale, G52 or G92 is on."""
        return bool(self.placement_code) or self.offsets.moved

    @property
    def in_force(self) -> InForce:
        """Work offset, length and TCP, to see what a block changes."""
        return self.offsets.name if self.offsets.selected else None, self.lengths.key, self.tcp

    def scaled_along(self, axis: int) -> bool:
        """True where G51 or G51.1 changes lengths along a linear axis."""
        i = cartesian(self.machine).index(axis)
        return self.placement_code == SCALE or (self.placement_code == MIRROR and self.placement.turn[4 * i] < 0.0)

    def frame(self) -> Frame:
        """The frame of programmed coordinates in force."""
        added, lengths = self.offsets.added(), self.lengths
        shift = shifted(*(added.pop(axis, 0.0) for axis in cartesian(self.machine)))
        tcp = self.tcp or self.tilted
        return self.control_state.frame(
            self.offsets.name,
            rotated(self.offsets.turn).then(shift).then(self.placement),
            added,
            tool=lengths.name_in_frame(tcp=tcp),
            length=lengths.tool(),
            length_offset=lengths.offset() or 0.0,
            tcp=tcp,
        )
