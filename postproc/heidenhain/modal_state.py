"""The modal state of a HEIDENHAIN control, and the operations on it that the parts of the dialect share."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from kinematics.transforms import Array
from postproc.control.codes import AXES
from postproc.control.interpreter import AxisWords, Interpreter
from postproc.control.tilted_planes import lean
from postproc.control.words import Content
from postproc.heidenhain.datum_transformations import DatumTransformations
from postproc.heidenhain.variables import QParameters
from postproc.motion.frames import Frame, Placement, spatial
from postproc.motion.moves import Kind
from postproc.motion.recorder import Recorder
from postproc.text.block import Block

UPRIGHT = 1e-4
"""rad: a tool that leans no more is perpendicular, as angles are written with three decimals."""


def sort(block: Block) -> Content:
    """The words of a block, axes without a value by their names; Refusal for an axis that is named twice."""
    content = Content(block)
    for i, word in enumerate(block.words):
        address = word.address
        if address[-1] in AXES and address[:-1] in ("", "I"):
            if any(block.words[j].address[-1] == address[-1] for j in content.axes):
                raise block.refuse(f"the block has two {address[-1]} words: write one")
            if word.start == word.end:
                content.names[address] = i
            else:
                content.axes.append(i)
        elif address == "M":
            if word.value is not None:
                content.m.append(word.value)
        else:
            content.other[address] = i
    return content


def straight(content: Content) -> Kind:
    """The kind of a straight move: rapid with FMAX."""
    return Kind.RAPID if "FMAX" in content.other else Kind.LINE


@dataclass
class ModalState(Interpreter):
    """The state that holds until a block changes it."""

    scope: QParameters = field(default_factory=QParameters)

    def __post_init__(self) -> None:
        super().__post_init__()
        self.columns |= {f"I{name}": axis for name, axis in self.columns.items()}
        self.preset = "0"
        self.without_rotation: set[str] = set()
        """Presets whose basic rotation M143 has deleted."""
        self.tool_length = self.oversize = 0.0
        self.tool_name = ""
        """Number or name of the tool in the spindle; empty for none."""
        self.transformations = DatumTransformations()
        self.tilt: Placement | None = None
        """Placement of the axes of a tilted working plane in the workpiece frame; None without one."""
        self.normal = (0.0, 0.0, 1.0)
        """Z of the tilted plane in the workpiece frame."""
        self.tilted_transformations = DatumTransformations()
        """Datum transformations within it."""
        self.levelled = False
        """Cycle 19 tilts the working plane by zero angles."""
        self.cornered = False
        """The block before is a rounding or a chamfer."""
        self.frames = 0
        """Counts changes of the frame: a pole belongs to one."""
        self._upright: Array | None = None
        """Rotary positions, degrees, at which the tool was found upright."""
        self.recorder = Recorder(self.machine, self.frame())

    # ---- words

    def target(self, block: Block, words: AxisWords) -> list[float]:
        """Where a move with these words ends, in programmed coordinates."""
        if not self.begun:
            self.notes.add("no BEGIN PGM: the coordinates are taken in mm", block.line)
        target = self.recorder.target(block, words)
        self.transformations.check(block)
        self.tilted_transformations.check(block)
        if self.levelled and any(target[i] for i, axis in enumerate(self.machine.axes) if axis.rotary):
            raise block.refuse(
                "a rotary axis is not at 0 while cycle 19 is on: the control may rotate the coordinates; write PLANE"
            )
        if self.tilt is not None and any(word.axis in self.machine.translators for word, _ in words):
            self._check_upright(block, target)
        return target

    def _check_upright(self, block: Block, target: list[float]) -> None:
        """Refusal where the tool is not perpendicular to the tilted plane."""
        rotary = self.machine.rotary
        angles = np.where(rotary, np.array(target) + self.recorder.frame.offset, 0.0)
        if self._upright is None or not np.array_equal(self._upright, angles):
            if lean(self.machine, angles, self.normal) > UPRIGHT:
                raise block.refuse(
                    "the tool is not perpendicular to the tilted plane: turn the rotary axes before this "
                    "move (PLANE ... TURN or L A B C)"
                )
            self._upright = angles

    # ---- frames

    def frame(self) -> Frame:
        """The frame of programmed coordinates in force."""
        placed = self.placed(self.tilt).then(self.tilted_transformations.placement)
        length, tcp = self.tool_length + self.oversize, self.tcp or self.tilt is not None
        return self.control_state.frame(self.preset, placed, tool=self.tool_name, length=length, tcp=tcp)

    @property
    def basic_rotation(self) -> tuple[float, float, float]:
        """Basic rotation of the active preset, degrees about X, Y, Z."""
        deleted = self.preset in self.without_rotation
        return (0.0, 0.0, 0.0) if deleted else self.control_state.setup.turned.get(self.preset, (0.0, 0.0, 0.0))

    def delete_basic_rotation(self, block: Block) -> None:
        """M143: the basic rotation of the preset in force ends, its shift stays."""
        if self.tilt is not None:
            raise block.refuse("M143 in a tilted plane is not followed: write PLANE RESET before it")
        if any(self.basic_rotation):
            self.notes.add(f"M143 ends the basic rotation of preset {self.preset}", block.line)
        self.without_rotation.add(self.preset)
        if self.frame() != self.recorder.frame:
            self.change_frame(self.x_y_z)

    def set_preset(self, block: Block, preset: str) -> None:
        """Cycle 247: another preset, which ends datum shift, mirror, rotation and scaling."""
        if self.tilt is not None:
            raise block.refuse("the preset changes in a tilted plane: write PLANE RESET before it")
        if preset in self.without_rotation and any(self.control_state.setup.turned.get(preset, ())):
            raise block.refuse(f"the rotation of preset {preset} after its M143 depends on the control: remove M143")
        if preset not in self.control_state.setup.turned:
            self.notes.add("the presets are taken without rotation", block.line)
        if self.transformations.active:
            self.notes.add("cycle 247 ends datum shift, mirror, rotation and scaling", block.line)
        self.preset, self.transformations = preset, DatumTransformations()
        self.change_frame(range(len(self.machine.axes)))

    def placed(self, tilt: Placement | None) -> Placement:
        """Preset rotation, datum shift and the like, and a tilted plane within them."""
        return spatial(*self.basic_rotation).then(self.transformations.placement).then(tilt or Placement())

    def change_frame(self, axes: Iterable[int]) -> None:
        """Program in the present frame from here, in which coordinates of these axes mean something else."""
        self.frames += 1
        self._upright = None
        super().change_frame(axes)

    def q(self, number: int) -> float:
        """The value of a Q parameter that holds a number; NotKnown where it is not known."""
        value = self.scope.get("Q", (float(number),))
        assert isinstance(value, float)
        return value
