"""Klartext arcs whose correction moves an axis across their plane: whether and how their blocks can name it."""

from __future__ import annotations

from collections.abc import Iterable

import msgspec
import numpy as np

from postproc.compensation.correction import Correction
from postproc.motion.frames import SAME_FRAME_MM
from postproc.motion.motions import Motions
from postproc.text.block import Block
from postproc.text.line_numbers import ranges, shortened

BY_ANGLE = frozenset(("circle", "circle_radius", "tangent", "polar_circle", "polar_tangent"))
"""Kinds of blocks that become a helix by an angle instead of their end: C, CR, CT, CP, CTP."""


def axes_across(motions: Motions, row: int, moved: Iterable[int]) -> list[int]:
    """Axes of `moved` that a Klartext arc nominally does not move and does not name."""
    arc = motions.arcs.get(row)
    if arc is None or motions.blocks[motions.block[row]].kind == "words":
        return []
    named = {word.axis for word in motions.words[row]}.union(arc.plane[:2])
    unmoved = abs(motions.target[row] - motions.start[row]) < SAME_FRAME_MM
    return [axis for axis in moved if axis not in named and unmoved[axis]]


def replaced_by_angle(motions: Motions, row: int, across: list[int], block: Block | None) -> list[int] | None:
    """Indices of the words that an angle must replace so that the block can name the axes `across`.

    None if the block cannot name them, because of the control (`klartext_arcs`) or the words of the block.
    block: that of the program; None for an added one.
    """
    how, arc = motions.machine.control.klartext_arcs, motions.arcs[row]
    if how == "axes":
        return []
    if how == "plane" or across != [arc.plane[2]]:
        return None
    if block is None:
        return []
    if block.kind == "polar_circle" and any(word.address == "IPA" for word in block.words):
        return []
    replaced = [word.word for word in motions.words[row] if word.axis in arc.plane[:2] and word.word >= 0]
    replaced += [index for index in arc.words[:1] if arc.form == "radius" and index is not None]
    replaced += [i for i, word in enumerate(block.words) if word.address.removeprefix("I") in ("PR", "PA")]
    movable = block.kind in BY_ANGLE and not block.no_insertion
    return replaced if movable and not any(block.words[i].formula for i in replaced) else None


def stays_in_plane(motions: Motions, row: int) -> bool:
    """True for a Klartext arc whose block cannot name the axis across its plane."""
    block = motions.blocks[motions.block[row]]
    across = axes_across(motions, row, (motions.arcs[row].plane[2],))
    if not across or (motions.added[row] and motions.machine.control.klartext_arcs != "plane"):
        return False
    return replaced_by_angle(motions, row, across, block) is None


class FlatArcs(msgspec.Struct):
    """Klartext arcs that leave the correction of an axis across their plane to the next line."""

    lines: list[int] = msgspec.field(default_factory=list)
    largest_um: float = 0.0

    def take(self, motions: Motions, correction: Correction, ends: np.ndarray) -> None:
        """Add the arcs of a chunk; `ends` `(n, axes)`: written ends of the moves, mm and degrees."""
        if not motions.arcs:
            return
        machine, circles = motions.machine, motions.circles
        across = np.zeros((len(circles.rows), len(machine.axes)), bool)
        across[:, machine.translators] = True
        for plane in (circles.first, circles.second):
            across[np.arange(len(plane)), plane] = False
        left = np.where(across, np.abs(ends - correction.target)[circles.rows], 0.0).max(axis=1)
        resolutions = np.array([axis.resolution for axis in machine.axes])
        flat = np.flatnonzero(left >= resolutions[across.argmax(axis=1)])
        for row, size in zip(circles.rows[flat].tolist(), left[flat].tolist(), strict=True):
            block = motions.blocks[motions.block[row]]
            if block.kind != "words":
                self.lines.append(block.line)
                self.largest_um = max(self.largest_um, size * 1e3)

    def notes(self) -> list[str]:
        """Notes on these arcs for the user."""
        if not self.lines:
            return []
        return [
            f"arcs stay in their plane: up to {self.largest_um:.3g} um of the correction across it is left to the next "
            f"line (lines {shortened(ranges(self.lines))}; see klartext_arcs of the machine file)"
        ]
