"""Canned cycles and polar coordinates of ISO programs: their state, and the moves to the holes."""

from __future__ import annotations

from dataclasses import dataclass

from postproc.control.interpreter import AxisWords
from postproc.control.words import whole_of
from postproc.iso.arcs import PolarCoordinates
from postproc.iso.cycles import CannedCycle, check_cycle_words
from postproc.iso.modal_state import ModalState
from postproc.iso.words import Content
from postproc.motion.circles import point_around
from postproc.motion.moves import Kind, Polar
from postproc.text.block import Block

MOST_HOLES = 9999


@dataclass
class Drilling(ModalState):
    """The modal state with the canned cycle and the polar coordinates in force."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self.cycle: CannedCycle | None = None
        self._before_cycle: float | None = None
        """The motion in force where it began."""
        self.polar: PolarCoordinates | None = None

    # ---- polar coordinates

    def select_polar(self, block: Block, on: bool) -> None:
        """G16 and G15."""
        if on and not self.absolute:
            raise block.refuse("polar coordinates with G91 are not corrected: write G90 before them")
        self.polar = (self.polar or PolarCoordinates()) if on else None
        self.angle_axis = self.plane_columns[1] if on else -1

    def end_words(self, content: Content) -> tuple[AxisWords, Polar | None]:
        """The axis words of a move; for polar coordinates those outside the plane, and the polar end."""
        words = self.axis_words(content.block, content.axes)
        if self.polar is None:
            return words, None
        if not self.absolute:
            raise content.refuse("polar coordinates with G91 are not corrected: write G90 before them")
        axes = self.plane_columns[:2]
        others, polar = self.polar.take(content.block, axes, words)
        if polar is None:
            self.recorder.lock_axes(axes)
        self.no_insertion = True
        return others, polar

    def go_polar(self, target: list[float], polar: Polar) -> None:
        """Set the polar end of a move in its target."""
        target[polar.axes[0]], target[polar.axes[1]] = point_around((0.0, 0.0), polar.radius, polar.angle)
        self.recorder.record_polar(polar)

    # ---- canned cycles

    def begin_cycle(self, block: Block, code: float) -> None:
        """G81 and the other cycles; a cycle within another one takes its level."""
        if self.compensated:
            raise block.refuse("a canned cycle under radius compensation is not corrected: write G40 before it")
        axis = self.plane_columns[2]
        begun = self.cycle
        if begun is None:
            self._before_cycle = self.motion
        if begun is not None and begun.axis != axis:
            raise block.refuse("a change of the plane within a canned cycle is not corrected: write G80 before it")
        # the level before the first of several cycles is that of all
        level = self.recorder.position[axis] if begun is None else begun.level
        known = self.recorder.known[axis] if begun is None else begun.known
        counted, unit = not self.absolute, self.unit
        frame = self.recorder.frame if begun is None else begun.frame
        drilled = begun is not None and begun.begun
        self.cycle = CannedCycle(axis, counted, level, known, unit, frame, begun=drilled)
        alike = begun is not None and (begun.incremental, begun.unit) == (counted, unit)
        if begun is not None and alike and (code == self.motion or self._keeps_depth):
            self.cycle.retract, self.cycle.depth = begun.retract, begun.depth
        self.motion = code
        if axis != self.x_y_z[2]:
            name = self.plane[2]
            self.notes.add(f"a canned cycle outside of G17 is taken to drill along {name}", block.line)

    @property
    def _keeps_depth(self) -> bool:
        """Another cycle without depth or R takes those of the one before; LinuxCNC refuses it."""
        return self.family != "linuxcnc"

    def end_cycle(self) -> None:
        """G80. The motion from before holds again, or the next one needs a code: LinuxCNC refuses it without."""
        if self.cycle is not None:
            holds = self._before_cycle in (0.0, 1.0) and self.family != "linuxcnc"
            self.motion, self.cycle = self._before_cycle if holds else None, None

    def drill(self, index: int, content: Content, cycle: CannedCycle) -> None:
        """Record the holes of a block with coordinates in the cycle in force."""
        block = content.block
        rotary = any(self.rotary[self.recorder.axis(block, block.words[i].address)] for i in content.axes)
        check_cycle_words(content, rotary)
        self._check_cycle_frame(content, cycle)
        times = [whole_of(block, block.words[content.other[letter]]) for letter in "KL" if letter in content.other]
        if len(times) > 1 or any(not 0 <= n <= MOST_HOLES for n in times):
            raise content.refuse(f"a canned cycle takes one of K and L, from 0 to {MOST_HOLES}: write one of them")
        words, polar = self.end_words(content)
        i = content.other.get("R")
        retract = None if i is None else (i, self.number(block, i, self.unit))
        if self.not_programmed:
            self.note_not_programmed(block.line, Kind.CYCLE)
        if times == [0]:
            self._check_stored(content, cycle, words)
            cycle.store(words, retract)
            return
        switched = cycle.incremental == self.absolute
        # of several holes at one position only the first changes anything
        for _ in range(times[0] if times and not self.absolute else 1):
            hole = cycle.hole(block, self.recorder, words, retract, self._returns(cycle), switched=switched)
            if polar is not None:
                self.go_polar(hole.target, polar)
            self.recorder.drill(index, hole.target, hole.level, self.unit, hole.positions, hole.cycle)

    def _returns(self, cycle: CannedCycle) -> bool | None:
        """End position of a hole, as `to_retract`; None if the level before the cycle belongs to another frame.

        There LinuxCNC returns to its number, and others to its position.
        """
        moved = self.recorder.frame != cycle.frame and self.family != "linuxcnc"
        return None if moved and not self.to_retract else self.to_retract

    def _check_stored(self, content: Content, cycle: CannedCycle, words: AxisWords) -> None:
        """K0 and L0 set the depth and R of the holes that come; LinuxCNC refuses them."""
        elsewhere = any(word.axis != cycle.axis for word, _ in words)
        if self.family == "linuxcnc" or cycle.incremental or elsewhere:
            raise content.refuse(
                "the effect of K0 or L0 in this canned cycle depends on the control: write the cycle in the block of "
                "its first hole"
            )

    def _check_cycle_frame(self, content: Content, cycle: CannedCycle) -> None:
        if cycle.unit != self.unit:
            raise content.refuse(
                "G20 or G21 within a canned cycle: some controls read its depth in the new unit. Write G80 before it"
            )
        if cycle.incremental == self.absolute:
            self._check_switched(content, cycle)
        if cycle.axis != self.plane_columns[2]:
            raise content.refuse("a change of the plane within a canned cycle is not corrected: write G80 before it")
        if self.recorder.frame.tcp and not self.tilted:
            raise content.refuse("a canned cycle under TCP is not corrected: switch TCP off before it")
        if self.scaled_along(cycle.axis):
            raise content.refuse(
                "controls differ in canned cycles with a scaled or mirrored depth: end the scale or mirror before it"
            )

    def _check_switched(self, content: Content, cycle: CannedCycle) -> None:
        """FANUC keeps the programmed positions of depth and R; LinuxCNC interprets their numbers again."""
        if self.family != "fanuc":
            raise content.refuse(
                "G90 or G91 within a canned cycle: controls differ in the meaning of its depth; "
                'write family = "fanuc" in the machine file if the depth stays'
            )
        depth = any(content.block.words[i].address == self.plane[2] for i in content.axes)
        if depth and "R" in content.other:
            cycle.incremental = not self.absolute
        elif depth or "R" in content.other:
            raise content.refuse(
                "G90 or G91 changed within the cycle, and the block has only one of depth and R: write both"
            )
        if self.polar is not None:
            raise content.refuse(
                "G90 or G91 within a canned cycle in polar coordinates is not corrected: write G15 before it"
            )
