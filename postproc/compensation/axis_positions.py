"""Positions of the axes on the control: an axis keeps its corrected position until a block programs another one.

An axis that a block leaves out keeps the correction of an earlier block; a move in machine coordinates removes the
correction of the axes that it names.
"""

from __future__ import annotations

import numpy as np

from kinematics.machine import NDArrayBool
from kinematics.transforms import Array
from postproc.compensation.correction import Correction
from postproc.motion.frames import cartesian, to_machine, to_program
from postproc.motion.motions import Motions
from postproc.motion.moves import Kind, Known


def held_shifts(motions: Motions, correction: Correction, before: Array) -> Array:
    """Shifts of the machine axes from their nominal positions at the ends of all rows `(n, axes)`, mm and rad.

    before `(axes,)`: the shifts before the first row.
    """
    held = np.empty_like(correction.nominal)
    anew = moved_anew(motions)
    shifts = np.where(motions.movable, correction.corrected - correction.nominal, 0.0)
    first, last = 0, before
    for row in [*_partly_programmed(motions).tolist(), len(motions)]:
        held[first:row] = _carried(anew[first:row], shifts[first:row], last)
        last = held[row - 1] if row > first else last
        if row < len(motions):
            held[row] = last = _partly(motions, correction, row, last)
        first = row + 1
    return held


def moved_anew(motions: Motions) -> NDArrayBool:
    """True `(n, axes)` where a row moves an axis to a new position; all other axes keep their shift."""
    anew = motions.movable | (motions.known_start == Known.ASSUMED)
    anew[np.ix_(motions.rotary_only & ~motions.tcp, np.array(motions.machine.translators))] = False
    for row in np.flatnonzero(motions.kind == Kind.MACHINE).tolist():
        anew[row, [word.axis for word in motions.words[row]]] = True
    return np.asarray(anew)


def _carried(anew: NDArrayBool, shifts: Array, before: Array) -> Array:
    """The shifts `(n, axes)`; where not `anew`, those of the row before; before the first row, `before` `(axes,)`."""
    last = np.maximum.accumulate(np.where(anew, np.arange(len(anew))[:, None], -1), axis=0)
    return np.where(last >= 0, np.take_along_axis(shifts, np.maximum(last, 0), axis=0), before)


def _partly_programmed(motions: Motions) -> np.ndarray:
    """Rows in rotated coordinates with some, but not all, of X Y Z given by the program."""
    programmed = motions.correctable[:, list(cartesian(motions.machine))]
    turned = np.array([frame.couples for frame in motions.frames], bool)[motions.frame]
    return np.flatnonzero(turned & motions.programmed & programmed.any(axis=1) & ~programmed.all(axis=1))


def _partly(motions: Motions, correction: Correction, row: int, before: Array) -> Array:
    """The shifts `(axes,)` after a row of `_partly_programmed`: coordinates that are not given keep their position."""
    machine, frame = motions.machine, motions.frames[motions.frame[row]]
    nominal = correction.nominal[row]
    program = to_program(machine, frame, (nominal + before)[None])[0]
    programmed = motions.correctable[row]
    program[programmed] = correction.target[row, programmed]
    return np.asarray(to_machine(machine, frame, program[None])[0] - nominal)
