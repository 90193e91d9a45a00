"""The modal state of a Siemens 840D control."""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, field
from typing import NamedTuple

from postproc.control import modal_state
from postproc.motion.frames import Frame
from postproc.siemens.frames import DatumTransformations
from postproc.siemens.polar import Polar
from postproc.text.block import Block


class Cycle(NamedTuple):
    """A call of a cycle."""

    name: str
    retraction: float | None
    """Position of the tool along its axis after the cycle, in units of the program; None where it is not given."""


@dataclass
class ModalState(modal_state.ModalState):
    """The modes of Siemens programs: work offset, frames, tool and cutting edge, pole, corners and the modal cycle."""

    work_offset: str = "G500"
    """Name of the work offset in force."""
    offset_programmed: bool = False
    """The program has named it: a named G500 that is not given is machine zero."""
    transformations: DatumTransformations = field(default_factory=DatumTransformations)
    """The programmable frame and the tilted plane."""
    polar: Polar = field(default_factory=Polar)
    """The pole, and the last polar coordinates."""
    cycle: Cycle | None = None
    """The cycle that runs after every move (MCALL); None for none."""
    selected_tool: int | str = 0
    """Number or name of the tool that the next tool change puts into the spindle."""
    spindle_tool: int | str | None = None
    """Number or name of the tool in the spindle; None before the first tool change."""
    edge: int = 1
    """Number of the cutting edge in force."""
    length: float = 0.0
    """Length of the edge, mm."""
    length_key: str = ""
    """Name of the length in the set-up; empty for none."""
    machine_vectors: bool = False
    """ORIMKS: vectors are those of the machine."""
    rounded: bool = False
    """The control rounds every corner."""
    spline: str = ""
    """The spline in force: ASPLINE, BSPLINE or CSPLINE; empty for another motion."""
    spline_points: tuple[tuple[float, ...], ...] = ()
    """Its last points, programmed coordinates, mm and degrees."""
    spline_frame: Frame | None = None
    """Their frame."""
    cornered: bool = False
    """The control breaks the corner after the block."""

    @property
    def tilted(self) -> bool:
        """True while CYCLE800 tilts the coordinates."""
        return self.transformations.tilted is not None

    @property
    def plain(self) -> bool:
        """True while lines of axis words are moves without corners and cycles."""
        blocked = self.ended or self.compensated or self.cornered or self.rounded or self.polar.radius is not None
        special = self.tilted or self.cycle is not None or bool(self.spline)
        noted = bool(self.length) and self.plane != "XYZ"
        passive = not set(self.machine.control.passive_axes).isdisjoint(self.machine.names)
        return not (blocked or special or noted or passive)

    def frame(self) -> Frame:
        """The frame of programmed coordinates in force."""
        shifts = {self.machine.index(axis): shift for axis, shift in self.transformations.rotary_shifts.items()}
        return self.control_state.frame(
            self._offset_name(),
            self.transformations.placement,
            shifts,
            tool=self.length_key,
            length=self.length,
            tcp=self.tcp or self.tilted,
        )

    def _offset_name(self) -> str:
        """Name of the work offset in force, empty for machine zero: a G500 that the program names and nobody gave."""
        if self.work_offset == "G500" and self.offset_programmed and not self.control_state.names_offset("G500"):
            return ""
        return self.work_offset


class SavedModes(NamedTuple):
    """The modal G codes that a subprogram with SAVE found, which hold again behind it."""

    depth: int
    """Subprograms in one another, with this one."""
    modes: dict[str, object]
    compensated: bool
    transformations: DatumTransformations
    work_offset: str
    offset_programmed: bool

    @classmethod
    def of(cls, modal: ModalState, depth: int) -> SavedModes:
        """The modes of the caller."""
        modes = {name: getattr(modal, name) for name in SAVED}
        frames = copy(modal.transformations)
        return cls(depth, modes, modal.compensated, frames, modal.work_offset, modal.offset_programmed)

    def put_back(self, block: Block, modal: ModalState) -> bool:
        """Restore them before a block; True where the work offset is another one, which the caller restores.

        Refusal where the subprogram has left radius compensation or a frame: for frames, machine data decide.
        """
        if modal.compensated != self.compensated or modal.transformations != self.transformations:
            raise block.refuse(
                "the subprogram with SAVE before this block ends with another frame (TRANS, ROT, CYCLE800) or radius "
                "compensation than it began with, and machine data decide whether these are restored: end them in it"
            )
        for name, value in self.modes.items():
            setattr(modal, name, value)
        return modal.work_offset != self.work_offset


SAVED = ("motion", "spline", "plane", "unit", "absolute", "timed", "rounded", "machine_vectors")
"""Modes of G codes."""
