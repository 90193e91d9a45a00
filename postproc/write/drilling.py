"""Holes of canned cycles at their corrected depth; R gets the same correction, so the number of pecks stays.

R stays at the level before the cycle or below it, or above it, as in the program: controls differ in the return from
above it. Behind a hole with a return to R, R stays at the tool or above it too: LinuxCNC goes to the hole at the level
before the cycle then, and otherwise where the tool is.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence
from typing import NamedTuple

import msgspec
import numpy as np

from kinematics.machine import Machine, NDArrayBool
from kinematics.transforms import Array
from postproc.compensation.correction import Correction
from postproc.motion.motions import Motions
from postproc.motion.moves import Cycle, Kind
from postproc.text.editing import WordEditor
from postproc.write.decimals import decimals_of_axis


class Depth(NamedTuple):
    """Bottom of a hole along the drilling axis, corrected and nominal; mm, programmed coordinates."""

    corrected: float
    nominal: float
    programmed: bool
    """True if the program has given the position of the axis, so that it is corrected."""


class WordScale(NamedTuple):
    """How numbers are written."""

    unit: float
    """mm per unit."""
    decimals: int
    """Number of decimals."""


class Scale(NamedTuple):
    """Unit, decimals and extent of the written words of a block."""

    unit: float
    """Unit of the numbers, mm."""
    decimals: int
    corrected: bool
    """True if depth and R are corrected."""
    both: bool
    """True if both R and the depth are written, even if only one of them has changed."""


class PlainHoles(NamedTuple):
    """Holes of one cycle in plain lines, which give nothing but their positions."""

    cycle: Cycle
    bottoms: Array
    """Written bottoms `(lines,)`, mm."""
    levels: Array
    """Levels `(lines,)` to which the axis returns, mm."""
    words: dict[str, dict[int, float]]
    """Numbers of the added words by name and line."""


class HoleWriter:
    """Writes depth and R of holes; both remain in force in blocks that omit them.

    With increments R is never written without the depth: if only R changes, some controls keep the bottom and others
    its distance from R.
    """

    def __init__(self, machine: Machine) -> None:
        self._machine = machine
        self.bottom = 0.0
        """Written bottom of the last hole, mm."""
        self._level = 0.0
        """Position of the axis before the first cycle, mm."""
        self._nominal_level = 0.0
        """Position of the axis before the first cycle in the program, mm."""
        self._held: dict[str, float] = {}
        """Last written positions of R and the depth, mm."""

    def write_row(
        self, motions: Motions, correction: Correction, row: int, held: list[float], editor: WordEditor
    ) -> None:
        """Write depth and R of a hole if they differ from those in force; `held` becomes the level after the cycle."""
        cycle = motions.cycles[row]
        z = cycle.axis
        corrected, nominal = float(correction.target[row, z]), float(motions.target[row, z])
        depth = Depth(corrected, nominal, bool(motions.correctable[row, z]))
        before, scale = (held[z], float(motions.start[row, z])), self._scale(motions, row, z)
        self.bottom, held[z] = self._write(editor, cycle, self._machine.names[z], depth, before, scale)

    def write_rows(self, motions: Motions, correction: Correction, rows: slice, held: list[float]) -> PlainHoles:
        """The depths of plain lines, which are holes of one cycle."""
        cycle = motions.cycles[rows.start]
        z = cycle.axis
        depths, before = (correction.target[rows, z], motions.target[rows, z]), (held[z], motions.start[rows, z])
        return self._write_lines(cycle, self._machine.names[z], depths, before, self._scale(motions, rows.start, z))

    def _scale(self, motions: Motions, row: int, axis: int) -> WordScale:
        unit = float(motions.unit[row])
        return WordScale(unit, decimals_of_axis(self._machine, axis, unit))

    def _write(
        self, editor: WordEditor, cycle: Cycle, name: str, depth: Depth, before: tuple[float, float], scale: WordScale
    ) -> tuple[float, float]:
        """Edit the block of a hole; returns its written bottom and the level to which the axis returns, mm.

        name: name of the drilling axis. before: its positions before the hole, as written and as programmed, mm.
        """
        if cycle.first:
            self._level, self._nominal_level = before
            self._held.clear()
        unit, decimals = scale
        corrected = {"R": self._clear(cycle, depth, before), "depth": depth.corrected}
        incremental = cycle.incremental != cycle.switched
        above = self._level if incremental else 0.0
        both = (incremental or cycle.switched) and any(
            self._differs(quantity, value, unit, decimals) for quantity, value in corrected.items()
        )
        words = Scale(unit, decimals, depth.programmed, both)
        clear = self._write_word(editor, cycle.retract_word, ("R", "R"), corrected["R"], above, words)
        bottom = self._write_word(
            editor, cycle.word, (name, "depth"), corrected["depth"], clear if incremental else 0.0, words
        )
        return bottom, clear if cycle.to_retract else self._level

    def _write_lines(
        self, cycle: Cycle, name: str, depths: tuple[Array, Array], before: tuple[float, Array], scale: WordScale
    ) -> PlainHoles:
        """As `_write` line by line, of lines without words for R and depth, which are corrected, in G90.

        depths: corrected and nominal ones `(lines,)`. before: the position of the axis before the first hole, as
        written, and those before all of them `(lines,)`, as programmed. All in mm.
        """
        unit, decimals = scale
        words: dict[str, dict[int, float]] = {"R": {}, name: {}}
        ends: list[tuple[float, float]] = []
        held = before[0]
        columns = zip(*(of.tolist() for of in (*depths, before[1])), strict=True)
        for line, (corrected, nominal, start) in enumerate(columns):
            clear = self._clear(cycle, Depth(corrected, nominal, programmed=True), (held, start))
            for address, quantity, value in (("R", "R", clear), (name, "depth", corrected)):
                if self._differs(quantity, value, unit, decimals):
                    words[address][line] = round(value / unit, decimals)
                    self._held[quantity] = unit * words[address][line]
            held = self._held["R"] if cycle.to_retract else self._level
            ends.append((self._held["depth"], held))
        bottoms, levels = np.array(ends).T
        return PlainHoles(cycle, bottoms, levels, words)

    def _clear(self, cycle: Cycle, depth: Depth, before: tuple[float, float]) -> float:
        """Corrected R of a hole, mm; before: as of `_write`."""
        clear = cycle.clear + depth.corrected - depth.nominal
        if cycle.clear <= self._nominal_level:
            clear = min(clear, self._level)
        elif cycle.to_retract:
            clear = max(clear, self._level)
        if not cycle.to_retract and before[1] < self._nominal_level and before[1] <= cycle.clear:
            clear = max(clear, before[0])
        return clear

    def _differs(self, quantity: str, corrected: float, unit: float, decimals: int) -> bool:
        """True if a position, mm, differs from the value on the control."""
        return quantity not in self._held or round((corrected - self._held[quantity]) / unit, decimals) != 0

    def _write_word(
        self, editor: WordEditor, index: int | None, name: tuple[str, str], corrected: float, base: float, scale: Scale
    ) -> float:
        """Write one word; returns its position, mm, unchanged if the axis is not corrected.

        `name`: its address and its quantity; `base`: origin of its value, mm.
        """
        (address, quantity), number = name, (corrected - base) / scale.unit
        if index is not None:
            present = editor.block.words[index].value or 0.0
            programmed = editor.set(index, number, scale.decimals) if scale.corrected else present
        elif scale.corrected and (scale.both or self._differs(quantity, corrected, scale.unit, scale.decimals)):
            programmed = editor.agreed(address, round(number, scale.decimals), scale.decimals)
            editor.insert(address, programmed, scale.decimals)
        else:
            return self._held.get(quantity, corrected)
        self._held[quantity] = base + scale.unit * programmed
        return self._held[quantity]


def corrected_holes(motions: Motions) -> list[int]:
    """Rows of the holes with a corrected depth."""
    return [row for row, cycle in motions.cycles.items() if motions.correctable[row, cycle.axis]]


# ---- patterns of holes, Klartext cycles 220 and 221: one block, which has one position


def apart(motions: Motions, correction: Correction, row: int, programmed: NDArrayBool) -> float:
    """Largest difference, mm, between the corrections of a pattern and of its holes; row: of one of them."""
    rows = np.flatnonzero(motions.block == motions.block[row])
    shifts = (correction.target - motions.target)[rows][:, programmed & ~motions.machine.rotary]
    return float(np.abs(shifts - shifts[:1]).max(initial=0.0))


def write_hole(
    motions: Motions,
    correction: Correction,
    row: int,
    editor: WordEditor,
    held: list[float],
    plane: Sequence[tuple[int, int]],
) -> None:
    """Write a hole of a pattern as a pattern of its own; `held` becomes its position.

    The block of the pattern keeps its first hole. plane: axes of the pattern, and decimals of their words.
    """
    block, unit = editor.block, float(motions.unit[row])
    style = msgspec.structs.replace(editor.layout.numbers, plus=True)
    words = {word.address: word for word in block.words}
    numbers = [style.write(float(correction.target[row, axis]) / unit, decimals) for axis, decimals in plane]
    circle = "Q241" in words
    if motions.kind[row - 1] != Kind.PATTERN:
        for name in {"Q241", "Q242", "Q243"} & words.keys():
            editor.put(words[name].start, words[name].end, "+1")
        if circle:
            _put_on_circle(correction.target[row], editor, held, plane, unit)
            return
    texts = {name: block.text[word.start : word.end] for name, word in words.items()}
    texts |= {**ONE_HOLE, "Q225": numbers[0], "Q226": numbers[1]}
    head = "CYCL DEF 221 CARTESIAN PATTERN" if circle else block.text.lstrip(" \t0123456789").split("~")[0].strip()
    lines = [head, *(f"    {name}={texts[name]}" for name in OF_HOLE if name in texts)]
    editor.lines_after([f"{line} ~" for line in lines[:-1]] + lines[-1:])
    for axis, decimals in plane:
        held[axis] = round(float(correction.target[row, axis]) / unit, decimals) * unit


def _put_on_circle(
    target: Array, editor: WordEditor, held: list[float], plane: Sequence[tuple[int, int]], unit: float
) -> None:
    """Write diameter and first angle of a circle, whose centre is `held`, for a hole at a target; `held` gets there."""
    (x, decimals), (y, _) = plane
    along = complex(float(target[x]) - held[x], float(target[y]) - held[y]) / unit
    diameter, angle = (
        round(2.0 * abs(along), decimals),
        round(math.degrees(cmath.phase(along)), KLARTEXT_ANGLE_DECIMALS),
    )
    style = msgspec.structs.replace(editor.layout.numbers, plus=True)
    for word in editor.block.words:
        if word.address == "Q244":
            editor.put(word.start, word.end, style.write(diameter, decimals))
        elif word.address == "Q245":
            editor.put(word.start, word.end, style.write(angle, KLARTEXT_ANGLE_DECIMALS))
    hole = cmath.rect(diameter / 2.0 * unit, math.radians(angle))
    held[x], held[y] = held[x] + hole.real, held[y] + hole.imag


KLARTEXT_ANGLE_DECIMALS = 4
"""Decimals of an angle in degrees that Klartext controls read."""
ONE_HOLE = {"Q237": "+0", "Q238": "+0", "Q242": "+1", "Q243": "+1", "Q224": "+0"}
"""Spacings, numbers of columns and lines, and rotation of a pattern of one hole."""
OF_HOLE = ("Q225", "Q226", "Q237", "Q238", "Q242", "Q243", "Q224", "Q200", "Q203", "Q204", "Q301")
"""Parameters of cycle 221."""
