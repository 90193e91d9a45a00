"""The channel of a HEIDENHAIN control: the operations on its modal state that the parts of the dialect share."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from kinematics.transforms import Array
from postproc.control import channel
from postproc.control.channel import AxisWords
from postproc.control.tilted_planes import lean
from postproc.heidenhain.codes import HARMLESS_M, MEANT_M, REFUSED_M, SET_BY_CONTROL
from postproc.heidenhain.datum_transformations import DatumTransformations
from postproc.heidenhain.modal_state import ModalState
from postproc.heidenhain.variables import QParameters
from postproc.text.block import Block

PERPENDICULAR_TOOL_RAD = 1e-4
"""rad: a tool that leans no more is perpendicular, as angles are written with three decimals."""


@dataclass
class Channel(channel.Channel):
    """The operations that moves, cycles, planes and tools of Klartext share."""

    modal: ModalState
    scope: QParameters
    frames: int = 0
    """Counts changes of the frame: a pole belongs to one."""
    _upright: Array | None = None
    """Rotary positions, degrees, at which the tool is perpendicular to the tilted plane; None where not yet known."""

    harmless_m: ClassVar[frozenset[float]] = HARMLESS_M | MEANT_M
    refused_m: ClassVar[Mapping[float, str]] = REFUSED_M

    def __post_init__(self) -> None:
        super().__post_init__()
        self.columns |= {f"I{name}": axis for name, axis in self.columns.items()}

    def q(self, number: int) -> float:
        """The value of a Q parameter that holds a number; NotKnown where it is not known."""
        value = self.scope.get("Q", (float(number),))
        assert isinstance(value, float)
        return value

    def set_by_control(self, statement: str) -> None:
        """Forget the parameters that a statement makes the control set."""
        for number in SET_BY_CONTROL.get(statement, ()):
            self.scope.values.pop(("Q", float(number)), None)

    # ---- moves

    def target(self, block: Block, words: AxisWords) -> list[float]:
        """Where a move with these words ends, in programmed coordinates."""
        modal = self.modal
        if not modal.begun:
            self.notes.add("no BEGIN PGM: the coordinates are taken in mm", block.line)
        target = self.recorder.target(block, words)
        modal.transformations.check(block)
        modal.tilted_transformations.check(block)
        if modal.levelled and any(target[axis] for axis in self.rotary_axes):
            raise block.refuse(
                "a rotary axis is not at 0 while cycle 19 is on: the control may rotate the coordinates; write PLANE"
            )
        if modal.tilt is not None and any(word.axis in self.machine.translators for word, _ in words):
            self._check_upright(block, target)
        return target

    def _check_upright(self, block: Block, target: list[float]) -> None:
        """Refusal where the tool is not perpendicular to the tilted plane."""
        angles = np.where(self.machine.rotary, np.array(target) + self.recorder.frame.offset, 0.0)
        if self._upright is None or not np.array_equal(self._upright, angles):
            if lean(self.machine, angles, self.modal.normal) > PERPENDICULAR_TOOL_RAD:
                raise block.refuse(
                    "the tool is not perpendicular to the tilted plane: turn the rotary axes before this "
                    "move (PLANE ... TURN or L A B C)"
                )
            self._upright = angles

    # ---- frames

    def change_frame(self, axes: Iterable[int]) -> None:
        """Program in the present frame from here, in which coordinates of these axes mean something else."""
        self.frames += 1
        self._upright = None
        super().change_frame(axes)

    def delete_basic_rotation(self, block: Block) -> None:
        """M143: the basic rotation of the preset in force ends, its shift stays."""
        modal = self.modal
        if modal.tilt is not None:
            raise block.refuse("M143 in a tilted plane is not followed: write PLANE RESET before it")
        if any(modal.basic_rotation):
            self.notes.add(f"M143 ends the basic rotation of preset {modal.preset}", block.line)
        modal.without_rotation.add(modal.preset)
        if modal.frame() != self.recorder.frame:
            self.change_frame(self.x_y_z)

    def set_preset(self, block: Block, preset: str) -> None:
        """Cycle 247: another preset, which ends datum shift, mirror, rotation and scaling."""
        modal, turned = self.modal, self.setup.turned
        if modal.tilt is not None:
            raise block.refuse("the preset changes in a tilted plane: write PLANE RESET before it")
        if preset in modal.without_rotation and any(turned.get(preset, ())):
            raise block.refuse(f"the rotation of preset {preset} after its M143 depends on the control: remove M143")
        if preset not in turned:
            self.notes.add("the presets are taken without rotation", block.line)
        if modal.transformations.active:
            self.notes.add("cycle 247 ends datum shift, mirror, rotation and scaling", block.line)
        modal.preset, modal.transformations = preset, DatumTransformations()
        self.change_frame(range(len(self.machine.axes)))
