"""The modal state: what one block sets, and the blocks after it rely on."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field

from kinematics.machine import Machine
from postproc.control.codes import UNIT_NAMES
from postproc.control.plain_arcs import ArcModes
from postproc.control.state import ControlState
from postproc.motion.frames import Frame


@dataclass
class ModalState(ABC):
    """The modes of one run of a program; each holds until a block changes it. A dialect adds its own modes.

    A run begins with a new state, which is that of a control that has just been switched on. The blocks change it in
    the order in which they run, and it carries over from chunk to chunk. A subprogram begins in the state of its
    caller, and the caller goes on in the state that the subprogram leaves. Nothing copies or restores a state: a block
    that requests this is refused.
    """

    control_state: ControlState
    """Offsets and tools of the control."""
    begun: bool = False
    """The program has begun."""
    ended: bool = False
    """The program has ended."""
    motion: float | None = None
    """G code of the motion in force."""
    plane: str = "XYZ"
    """First, second and normal axis of the working plane."""
    unit: float = field(init=False)
    """Unit of lengths, mm."""
    absolute: bool = True
    """Coordinates are positions; otherwise they are increments."""
    timed: bool = False
    """F is the inverse of the time of a move."""
    tcp: bool = field(init=False)
    """Coordinates are those of the tool point in the workpiece frame."""
    compensated: bool = False
    """The control shifts the path by the radius of the tool."""

    def __post_init__(self) -> None:
        control = self.machine.control
        self.unit, self.tcp = UNIT_NAMES[control.unit or "mm"], control.tcp_at_start

    @property
    def machine(self) -> Machine:
        """The machine that runs the program."""
        return self.control_state.setup.machine

    @property
    def plane_columns(self) -> tuple[int, int, int]:
        """Columns of the axes of the working plane."""
        first, second, normal = (self.machine.index(axis) for axis in self.plane)
        return first, second, normal

    @property
    def sense(self) -> int:
        """Sense of the arcs of the motion in force: +1 counter-clockwise seen from the end of the normal, else -1."""
        return 1 if self.motion == 3.0 else -1

    @property
    def angle_axis(self) -> int:
        """Column of the axis whose words are angles of polar coordinates; -1 for none."""
        return -1

    @property
    @abstractmethod
    def plain(self) -> bool:
        """True while lines of axis words, with or without a motion code, are moves to positions or by increments."""

    @property
    def arc_modes(self) -> ArcModes | None:
        """The modes of arcs in plain lines; None if the arcs are read one by one in this state."""
        return ArcModes(self.plane, self.unit, absolute=False)

    @abstractmethod
    def frame(self) -> Frame:
        """The frame of programmed coordinates in force."""
