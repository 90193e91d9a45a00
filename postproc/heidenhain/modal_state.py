"""The modal state of a HEIDENHAIN control, and the operations on it that the parts of the dialect share."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from kinematics.machine import Machine
from kinematics.transforms import Array
from postproc.control.codes import AXES
from postproc.control.functions import mark_named_unknown
from postproc.control.state import ControlState
from postproc.control.tilted_planes import lean
from postproc.heidenhain.datum_transformations import DatumTransformations
from postproc.heidenhain.variables import QParameters
from postproc.motion.frames import Frame, Placement, cartesian, spatial
from postproc.motion.moves import AxisWord
from postproc.motion.recorder import Recorder
from postproc.text.block import Block, Word
from postproc.text.notes import Notes

UPRIGHT = 1e-4
"""rad: a tool that leans no more is perpendicular, as angles are written with three decimals."""


@dataclass
class Content:
    """The words of one block, sorted."""

    axes: list[int] = field(default_factory=list)
    """Indices of the axis words with a value."""
    bare_axes: list[int] = field(default_factory=list)
    """Indices of those without."""
    m: list[float] = field(default_factory=list)
    other: set[str] = field(default_factory=set)
    """Addresses of all other words."""


def sort(block: Block) -> Content:
    """The words of a block; Refusal for an axis that is named twice."""
    content = Content()
    for i, word in enumerate(block.words):
        address = word.address
        if address[-1] in AXES and address[:-1] in ("", "I"):
            if any(block.words[j].address[-1] == address[-1] for j in content.axes):
                raise block.refuse(f"two {address[-1]} words")
            (content.bare_axes if word.start == word.end else content.axes).append(i)
        elif address == "M":
            if word.value is not None:
                content.m.append(word.value)
        else:
            content.other.add(address)
    return content


def value_of(block: Block, word: Word) -> float:
    """The number of a word; Refusal where the program does not give it."""
    if word.value is None:
        raise block.refuse(
            f"{block.text[word.at : word.end]}: its value is known only while the program runs: assign "
            "the parameter in the program or write a number"
        )
    return word.value


@dataclass
class Control:
    """The state that holds until a block changes it; positions in programmed coordinates, mm and degrees."""

    machine: Machine
    state: ControlState
    notes: Notes
    scope: QParameters = field(default_factory=QParameters)

    def __post_init__(self) -> None:
        self.begun = self.ended = False
        self.unit = 1.0
        self.preset = "0"
        self.without_rotation: set[str] = set()
        """Presets whose basic rotation M143 has deleted."""
        self.tool_length = self.oversize = 0.0
        self.tool_name = ""
        """Number or name of the tool in the spindle; empty for none."""
        self.tcp = self.machine.control.tcp_at_start
        self.transformations = DatumTransformations()
        self.tilt: Placement | None = None
        """Of a tilted working plane: how its axes lie in the workpiece frame."""
        self.normal = (0.0, 0.0, 1.0)
        """Z of the tilted plane in the workpiece frame."""
        self.tilted_transformations = DatumTransformations()
        """Datum transformations within it."""
        self.levelled = False
        """Cycle 19 tilts the working plane by zero angles."""
        self.compensated = self.cornered = False
        """The control shifts the path by the radius of the tool; the block before is a rounding or a chamfer."""
        self.frames = 0
        """Counts changes of the frame: a pole belongs to one."""
        self._upright: Array | None = None
        """Rotary positions, degrees, at which the tool was found upright."""
        self.recorder = Recorder(self.machine, self.frame())

    # ---- words

    def axis_words(self, block: Block, indices: Iterable[int]) -> list[tuple[AxisWord, float]]:
        """Axis words with their values, mm or degrees, in the order of the block."""
        result = []
        for i in indices:
            address = block.words[i].address
            axis = self.recorder.axis(block, address[-1])
            unit = 1.0 if self.machine.axes[axis].rotary else self.unit
            result.append((AxisWord(axis, i, len(address) > 1), value_of(block, block.words[i]) * unit))
        return result

    def target(self, block: Block, words: list[tuple[AxisWord, float]]) -> list[float]:
        """Where a move with these words ends, in programmed coordinates."""
        if not self.begun:
            self.notes.add("no BEGIN PGM: coordinates taken in mm", block.line)
        target = self.recorder.target(block, words)
        self.transformations.check(block)
        self.tilted_transformations.check(block)
        if self.levelled and any(target[i] for i, axis in enumerate(self.machine.axes) if axis.rotary):
            raise block.refuse("rotary axes away from 0 while cycle 19 is on: the control may turn the coordinates")
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
        """The frame of programmed coordinates now."""
        placed = self.placed(self.tilt).then(self.tilted_transformations.placement)
        length, tcp = self.tool_length + self.oversize, self.tcp or self.tilt is not None
        return self.state.frame(self.preset, placed, tool=self.tool_name, length=length, tcp=tcp)

    @property
    def basic_rotation(self) -> tuple[float, float, float]:
        """Basic rotation of the active preset, degrees about X, Y, Z."""
        deleted = self.preset in self.without_rotation
        return (0.0, 0.0, 0.0) if deleted else self.state.setup.turned.get(self.preset, (0.0, 0.0, 0.0))

    def delete_basic_rotation(self, block: Block) -> None:
        """M143: the basic rotation of the preset in force ends, its shift stays."""
        if self.tilt is not None:
            raise block.refuse("M143 deletes the basic rotation in a tilted plane")
        if any(self.basic_rotation):
            self.notes.add(f"M143: the basic rotation of preset {self.preset} ends", block.line)
        self.without_rotation.add(self.preset)
        if self.frame() != self.recorder.frame:
            self.change_frame(cartesian(self.machine))

    def set_preset(self, block: Block, preset: str) -> None:
        """Cycle 247: another preset, which ends datum shift, mirror, rotation and scaling."""
        if self.tilt is not None:
            raise block.refuse("another preset while the working plane is tilted")
        if preset in self.without_rotation and any(self.state.setup.turned.get(preset, ())):
            raise block.refuse(f"preset {preset} after an M143: its rotation then depends on the control")
        if preset not in self.state.setup.turned:
            self.notes.add("presets taken without rotation", block.line)
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
        self.recorder.set_frame(self.frame(), axes)

    def switch_tcp(self, on: bool) -> None:
        """M128 and its like."""
        if on != self.tcp:
            self.tcp = on
            self.change_frame(cartesian(self.machine))

    def mark_unknown(self, names: Sequence[str]) -> None:
        """The positions of these axes are not known from the program from here on."""
        mark_named_unknown(self.recorder, names)

    def q(self, number: int) -> float:
        """The value of a Q parameter that holds a number; NotKnown where it is not known."""
        value = self.scope.get("Q", (float(number),))
        assert isinstance(value, float)
        return value
