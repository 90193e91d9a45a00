"""Where the origin of ISO coordinates is: work offsets, G10, G52 and G92."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

from kinematics.touch_off import TouchOff
from postproc.control.state import ControlState
from postproc.iso.codes import WORK_OFFSETS
from postproc.text.block import Block

Shifts = dict[int, float]
"""By axis, mm or degrees."""
NUMBERED = dict(enumerate([*(f"G{g}" for g in range(54, 60)), "G59.1", "G59.2", "G59.3"], start=1))
"""Work offsets by the P of G10 L2."""


@dataclass
class Offsets:
    """The work offset in force, and what the program adds to it."""

    state: ControlState
    name: str = "G54"
    said: bool = False
    """The program has said which one is in force."""
    local: Shifts = field(default_factory=dict)
    """G52."""
    preset: Shifts | None = None
    """G92; None before the first one."""
    suspended: bool = False
    """G92.2."""
    turned: dict[str, float] = field(default_factory=dict)
    """Degrees by which G10 has turned X and Y of work offsets (LinuxCNC)."""

    def work(self) -> list[float]:
        """The work offset of every axis, mm or degrees."""
        return list(self.state.work_offset(self.name))

    def touch_off(self) -> TouchOff | None:
        """Touch-off of the active work offset; None if the offset is true."""
        return self.state.touch_off(self.name)

    def added(self) -> Shifts:
        """What G52 and G92 add, inside the work offset and its turn."""
        found = dict(self.local)
        for axis, value in ({} if self.suspended else self.preset or {}).items():
            found[axis] = found.get(axis, 0.0) + value
        return found

    @property
    def turn(self) -> float:
        """Degrees by which the work offset in force turns X and Y."""
        return self.turned.get(self.name, 0.0)

    @property
    def moved(self) -> bool:
        """True while G52 or G92 shifts an axis."""
        return any(self.local.values()) or any((self.preset or {}).values())

    def select(self, code: float, extended: int | None) -> None:
        """Take a work offset: by its code, or by the P of G54.1."""
        self.name = WORK_OFFSETS[code] if extended is None else f"G54.1P{extended}"
        self.said = True

    def enter(self, name: str, values: Shifts) -> None:
        """Set a work offset, of axes that the block says."""
        names = self.state.setup.machine.names
        self.state.enter_offset(name, {names[axis]: value for axis, value in values.items()})

    def call(self, block: Block, here: Shifts, said: Shifts) -> None:
        """G92: the places `here` are called `said` from now on."""
        if any(self.local.values()):
            raise block.refuse("G92 while G52 is on: one store on some controls, two on others")
        preset = {} if self.suspended or self.preset is None else self.preset
        for axis, value in said.items():
            preset[axis] = preset.get(axis, 0.0) + here[axis] - value
        self.preset, self.suspended = preset, False

    def uncall(self, axes: Iterable[int]) -> None:
        """G92.1: as if G92 and G52 had not been, for these axes."""
        for axis in axes:
            self.local.pop(axis, None)
            (self.preset or {}).pop(axis, None)

    def suspend(self, block: Block, suspended: bool) -> None:
        """G92.2: no G92 for a while; G92.3: again."""
        if any(self.local.values()):
            code = "G92.2" if suspended else "G92.3"
            raise block.refuse(f"{code} while G52 is on: one store on some controls, two on others")
        if not suspended and self.preset is None:
            raise block.refuse("brings back what a G92 of another program has left")
        self.suspended = suspended
