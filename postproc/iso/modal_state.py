"""The modal state of ISO / Fanuc / LinuxCNC programs: modes, offsets, lengths, and the frame that results."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from postproc.control.codes import DISTANCES, INCH, LARGEST, PLANES
from postproc.control.interpreter import Interpreter
from postproc.control.tilted_planes import lean, normal_of
from postproc.control.words import no_number
from postproc.iso.codes import (
    CENTRE_DISTANCES,
    FEED_MODES,
    MIRROR,
    RETURN_TO_LEVEL,
    RETURN_TO_R,
    SCALE,
    TILT,
    UNITS,
)
from postproc.iso.datum_transformations import MAKERS, Programmed
from postproc.iso.offsets import TCP_CODES, Lengths, Offsets, Shifts
from postproc.iso.variables import IsoVariables
from postproc.motion.frames import Frame, Placement, renamed, rotated, shifted
from postproc.motion.moves import Kind, Known
from postproc.motion.recorder import Recorder
from postproc.text.block import Block

UPRIGHT = 1e-6
"""rad: a tool that leans no more is perpendicular to the tilted plane."""
INTEGERS = "coordinates without decimal point are taken in mm, inches or degrees, not in increments"
DEFAULTS = {
    "unit": "no G20 or G21 before it: coordinates are taken in mm",
    "distance": "no G90 or G91 before it: coordinates are taken as absolute",
    "plane": "no G17, G18 or G19 before it: arcs are taken in X Y",
}
"""Notes on modes that the program has not set, by their names."""


@dataclass
class ModalState(Interpreter):
    """The state that holds until a block changes it; every change goes to the recorder, with the axes concerned."""

    scope: IsoVariables = field(init=False)

    units: ClassVar[Mapping[float, float]] = UNITS
    feed_modes: ClassVar[frozenset[float]] = FEED_MODES

    def __post_init__(self) -> None:
        super().__post_init__()
        control = self.machine.control
        self.family = control.family
        """The family of controls that decides where controls differ."""
        self.arc_absolute = control.arc_centres == "absolute"
        self.to_retract: bool | None = False if self.family == "fanuc" else None
        """Canned cycles end at R (G99) and not at the level before (G98)."""
        self.not_programmed = dict(DEFAULTS)
        if control.unit:
            del self.not_programmed["unit"]
        self.mode_assumed: set[str] = set()
        """Modes that moves have assumed, as the program had not set them."""
        self.offsets = Offsets(self.control_state)
        self.lengths = Lengths(self.control_state)
        self.placement, self.placement_code = Placement(), 0.0
        """The rotation, mirror or scale of the coordinates, and its G code; 0 for none."""
        self.mirrors: dict[str, float] = {}
        """Positions of the mirrors of G51.1, by axis."""
        self.upright = False
        """The tool is perpendicular to the tilted plane."""
        self.recorder = Recorder(self.machine, self.frame())

    # ---- modes and numbers

    def take_mode(self, block: Block, code: float) -> bool:
        """Take over a modal code; False for any other code."""
        if code in CENTRE_DISTANCES:
            self.arc_absolute = code == 90.1
        elif code in (RETURN_TO_LEVEL, RETURN_TO_R):
            self.to_retract = code == RETURN_TO_R
        elif not super().take_mode(block, code):
            return False
        mode = "plane" if code in PLANES else "unit" if code in UNITS else "distance" if code in DISTANCES else ""
        self.not_programmed.pop(mode, None)
        if mode in self.mode_assumed and code in (21.0, 90.0):
            self.recorder.mark_uncertain()
        self.mode_assumed.discard(mode)
        return True

    def note_not_programmed(self, line: int, kind: Kind) -> None:
        """Note the assumptions of a move: modes that the program has not given."""
        for mode in ("unit", "distance", "plane") if kind is Kind.ARC else ("unit", "distance"):
            if mode in self.not_programmed:
                self.notes.add(self.not_programmed.pop(mode), line)
                self.mode_assumed.add(mode)

    def number(self, block: Block, index: int, unit: float) -> float:
        """The number of a word in mm or degrees; without a decimal point it may be a number of increments."""
        word = block.words[index]
        value = word.value
        if value is None or not abs(value) < LARGEST:
            raise no_number(block, word)
        if value and word.formula is None and "." not in block.text[word.start : word.end]:
            if self.machine.control.integer_words == "increments":
                if unit == INCH:
                    raise block.refuse(
                        f"{word.address} is an inch coordinate without decimal point, and its increment is not known: "
                        "write the decimal point"
                    )
                return value * self.machine.control.increment
            self.notes.add(INTEGERS, block.line)
        return value * unit

    # ---- frames

    @property
    def tilted(self) -> bool:
        """True while a tilted plane is on."""
        return self.placement_code == TILT

    @property
    def shifted(self) -> bool:
        """True while a turn, a scale, G52 or G92 is on."""
        return bool(self.placement_code) or self.offsets.moved

    def frame(self) -> Frame:
        """The frame of programmed coordinates in force."""
        added, lengths = self.offsets.added(), self.lengths
        shift = shifted(*(added.pop(axis, 0.0) for axis in self.x_y_z))
        return self.control_state.frame(
            self.offsets.name,
            rotated(self.offsets.turn).then(shift).then(self.placement),
            added,
            tool=lengths.tool_name,
            length=lengths.tool(),
            length_offset=lengths.offset() or 0.0,
            tcp=self.tcp or self.tilted,
        )

    # ---- work offsets and lengths

    def change_tool(self, block: Block) -> None:
        """M6."""
        self.hold_tool(self.lengths.selected_tool)
        self.move_for_tool_change(block)

    def hold_tool(self, number: int) -> None:
        """Another tool is in the spindle; the axes do not move."""
        self.lengths.spindle_tool = number
        by_spindle_tool = (self.tcp or self.tilted) and self.lengths.offset() is None
        self.change_frame(self.x_y_z if by_spindle_tool else ())

    def select_offset(self, block: Block, code: float, extended: int | None) -> None:
        """G54 and its kin, G54.1 P. LinuxCNC keeps G52 and G92, which are one store there, in every offset."""
        if self.placement_code or (self.offsets.moved and self.family != "linuxcnc"):
            raise block.refuse(
                "the effect of a new work offset on an active G52, G92, rotation, mirror or scale depends on the "
                "control: end these before it"
            )
        self.offsets.select(code, extended)

    def select_length(self, block: Block, code: float, number: int | None) -> None:
        """G43, G43.4, G43.5, G49."""
        if code in TCP_CODES and (self.placement_code or self.offsets.turn):
            raise block.refuse(
                f"G{code:g} while the coordinates are rotated, mirrored or scaled is not corrected: end this before it"
            )
        assumed = number is None and code != 49.0
        if assumed and self.lengths.select_spindle(block, self.family == "linuxcnc"):
            self.notes.add("G43 without H is taken to select the length of the tool in the spindle", block.line)
        self.lengths.select(code, number)
        self.tcp = code in TCP_CODES or self.machine.control.tcp_at_start
        if code in TCP_CODES:
            self.note_tcp(f"G{code:g}", block)

    def give_length(self, length: float) -> None:
        """G43.1: a length given in the program, mm."""
        before = self.state()
        self.lengths.give(length)
        self.tcp = self.machine.control.tcp_at_start
        self.changed_since(before)

    def state(self) -> tuple[str | None, tuple[int, float | None] | None, bool]:
        """Work offset and length in force, None where the program has not set it yet, and TCP."""
        return self.offsets.name if self.offsets.selected else None, self.lengths.key, self.tcp

    def changed_since(self, before: tuple[str | None, tuple[int, float | None] | None, bool]) -> None:
        """Set the frame of the recorder, with the axes whose coordinates differ from those of the state before."""
        x_y_z, (offset, length, tcp) = self.x_y_z, self.state()
        changed: set[int] = set()
        if offset != before[0]:
            changed.update(range(len(self.machine.axes)))
        if tcp != before[2] or (tcp and length != before[1]):
            changed.update(x_y_z)
        elif length != before[1]:
            changed.add(x_y_z[2])
        self.change_frame(changed)

    # ---- G52, G92, G10

    def shift_origin(self, block: Block, values: Shifts) -> None:
        """G52."""
        if self.offsets.preset and any(self.offsets.preset.values()):
            raise block.refuse("G52 and G92 share one offset on some controls, not on others: cancel G92 before G52")
        self.offsets.local.update(values)
        self.change_frame(values)

    def preset_here(self, block: Block, values: Shifts) -> None:
        """G92 with axes: new coordinates for the present positions."""
        self._refuse_turned(block)
        self.offsets.preset_at(block, self._present_positions(block, values), values)
        self.change_frame(())

    def enter_offset(self, block: Block, name: str, values: Shifts, turn: float | None) -> None:
        """G10 L2: a work offset of the table, and by how many degrees it turns X and Y."""
        if self.placement_code and name == self.offsets.name:
            raise block.refuse(
                "G10 changes the active work offset while the coordinates are rotated: write it before the rotation"
            )
        if turn is not None and name == self.offsets.name and turn != self.offsets.turn and self.offsets.moved:
            raise block.refuse(
                "LinuxCNC loses the positions of X and Y when G10 rotates the active work offset under G52 or G92: end "
                "G52 or G92 before it"
            )
        self.offsets.enter(name, values)
        self.notes.add(f"{name} has the values that G10 sets", block.line)
        changed = set(values)
        if turn is not None:
            self.offsets.turned[name] = turn
            changed.update(self.x_y_z[:2])
        if name == self.offsets.name:
            self.change_frame(changed)

    def enter_here(self, block: Block, values: Shifts) -> None:
        """G10 L20 of LinuxCNC: the active work offset that gives the present positions these coordinates."""
        self._refuse_turned(block)
        here = self._present_positions(block, values)
        work = self.offsets.work()
        entered = {axis: work[axis] + here[axis] - value for axis, value in values.items()}
        self.offsets.enter(self.offsets.name, entered)
        self.change_frame(())

    def cancel_preset(self, block: Block, axes: Iterable[int]) -> None:
        """G92.1."""
        if self.placement_code and self.offsets.moved:
            raise block.refuse(
                "G92.1 while the coordinates are rotated, mirrored or scaled is not corrected: write it before that"
            )
        axes = list(axes)
        self.offsets.cancel_preset(axes)
        self._change_shifted(axes)

    def suspend(self, block: Block, suspended: bool) -> None:
        """G92.2, G92.3."""
        self.offsets.suspend(block, suspended)
        self._change_shifted(self.offsets.preset or {})

    def _change_shifted(self, axes: Iterable[int]) -> None:
        if self.frame() != self.recorder.frame:
            self.change_frame(axes)

    def _refuse_turned(self, block: Block) -> None:
        if self.placement_code or self.tcp or self.offsets.turn:
            raise block.refuse(
                "a preset of the present position (G92, G10 L20) is not corrected while the coordinates "
                "or the table are rotated: write it before the rotation"
            )

    def _present_positions(self, block: Block, axes: Iterable[int]) -> Shifts:
        """The present positions of axes; Refusal where the program has not given them in this frame."""
        for axis in axes:
            if self.recorder.known[axis] != Known.PROGRAM:
                name = self.machine.names[axis]
                raise block.refuse(
                    f"the preset of {name} needs a programmed position: write a move of {name} in this frame before it"
                )
        return {axis: self.recorder.position[axis] for axis in axes}

    # ---- turns

    def turn(self, code: float, programmed: Programmed) -> None:
        """G68, G51, G51.1, G68.2."""
        if self.placement_code and not (code == MIRROR == self.placement_code):
            raise programmed.block.refuse(
                f"G{code:g} while G{self.placement_code:g} is active is not corrected: end the latter first"
            )
        if self.offsets.turn:
            raise programmed.block.refuse(
                f"G{code:g} within a work offset that rotates the coordinates is not corrected: select another first"
            )
        if code == TILT and (self.offsets.moved or self.tcp):
            raise programmed.block.refuse(
                "a tilted plane while G52, G92 or TCP is active is not corrected: end these before it"
            )
        if code == MIRROR:
            self.mirrors.update(programmed.axes)
            programmed = Programmed(programmed.block, programmed.plane, self.mirrors, programmed.others)
        self._put(MAKERS[code](programmed), code)
        self.upright = False

    def scaled_along(self, axis: int) -> bool:
        """True where G51 or G51.1 changes lengths along an axis."""
        i = self.x_y_z.index(axis)
        return self.placement_code == SCALE or (self.placement_code == MIRROR and self.placement.turn[4 * i] < 0.0)

    def end_turn(self, code: float) -> None:
        """G69, G50: of the code that it ends."""
        if self.placement_code == code:
            self._put(Placement(), 0.0)

    def end_mirror(self, block: Block, axes: Iterable[str]) -> None:
        """G50.1: of these axes, all for none."""
        if self.placement_code != MIRROR:
            return
        named = set(axes)
        self.mirrors = {axis: at for axis, at in self.mirrors.items() if named and axis not in named}
        remaining = MAKERS[MIRROR](Programmed(block, "", self.mirrors, {})) if self.mirrors else Placement()
        self._put(remaining, MIRROR if self.mirrors else 0.0)

    def _put(self, placement: Placement, code: float) -> None:
        was_tilted, before = self.tilted, self.placement
        self.placement, self.placement_code = placement, code
        if was_tilted != self.tilted:
            self.change_frame(self.x_y_z)
        elif self.frame() != self.recorder.frame:
            self.change_frame([self.x_y_z[i] for i in renamed(before, placement)])

    def check_perpendicular(self, block: Block) -> None:
        """G53.1: the tool along the normal of the tilted plane; otherwise the control chooses how to turn it."""
        if not self.tilted:
            raise block.refuse("G53.1 needs a tilted plane: write G68.2 before it")
        degrees = np.add(self.recorder.position, self.recorder.frame.offset)
        known = all(self.recorder.known[i] != Known.ASSUMED for i in self.rotary_axes)
        if (
            not known
            or lean(self.machine, np.where(self.machine.rotary, degrees, 0.0), normal_of(self.placement)) > UPRIGHT
        ):
            raise block.refuse(
                "the tool is not perpendicular to the tilted plane, and the control chooses how G53.1 turns "
                "the rotary axes: turn them in a block before it"
            )
        self.upright = True
