"""The correction: the command whose actual pose, under the error model, is the nominal one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kinematics.errors import UserError
from kinematics.forward import tool_point
from kinematics.inverse import linear_positions
from kinematics.machine import Machine, NDArrayBool
from kinematics.model import ErrorModel
from kinematics.state import State
from kinematics.transforms import Array
from postproc.circles import point_at, sweep
from postproc.motions import Kind, Known, Motions

CONVERGED_MM = 1e-8
MAX_ROUNDS = 12


@dataclass(frozen=True)
class Correction:
    """Corrected positions of a chunk of moves; positions `(n, axes)` in programmed coordinates, mm and degrees."""

    nominal: Array
    """Nominal axis positions `(n, axes)`, mm and rad."""
    corrected: Array
    """Corrected axis positions `(n, axes)`, mm and rad."""
    target: Array
    """Corrected programmed positions."""
    middle_shift: dict[int, Array]
    """By row of an arc: corrected minus nominal programmed position `(axes,)` half-way along it."""


def correct(motions: Motions, model: ErrorModel) -> Correction:
    """Correct all moves of a chunk: end points, and the middles of arcs.

    Translator axes whose position the program has said in its own frame take the correction; rotary axes and axes
    that stand at an assumed or machine position keep the nominal one.
    """
    machine = motions.machine
    nominal = motions.machine_target
    movable = (motions.known == Known.PROGRAM) & (motions.kind != Kind.MACHINE)[:, None]
    corrected = correct_positions(machine, model, nominal, motions.tool, movable)
    return Correction(nominal, corrected, motions.in_program(corrected), _arc_middles(motions, model, movable))


def correct_positions(machine: Machine, model: ErrorModel, nominal: Array, tool: Array, movable: NDArrayBool) -> Array:
    """Axis positions `(n, axes)`, mm and rad, at which the actual tool point is where the nominal one is at `nominal`.

    tool `(n, 3)` mm; movable `(n, axes)`: axes that may move, of which only the translators do. The nominal machine
    is aimed past the target by what the exact model says it misses, until nothing is missed: each round leaves about
    the slope of the errors (1e-4) of what the round before did. UserError when it does not settle.
    """
    target = tool_point(machine, nominal, tool)
    aim = target.copy()
    moving = np.zeros_like(movable)
    moving[:, machine.translators] = movable[:, machine.translators]
    q = nominal
    for _ in range(MAX_ROUNDS):
        missed = actual_tool_point(machine, model, q, tool) - target
        aim = aim - missed
        following = np.where(moving, linear_positions(machine, q, aim, tool), nominal)
        step = np.abs(following - q).max(initial=0.0)
        q = following
        if step < CONVERGED_MM:
            return q
    raise UserError("the error model changes so steeply with position that no correction settles")


def actual_tool_point(machine: Machine, model: ErrorModel, q: Array, tool: Array) -> Array:
    """Where the machine with errors puts the tool point `(n, 3)`, mm, workpiece frame; exact matrix product."""
    return tool_point(machine, q, tool, model.errors(machine, State(q)))


def missed_um(machine: Machine, model: ErrorModel, q: Array, nominal: Array, tool: Array) -> Array:
    """Distance `(n,)`, um, of the actual tool point at `q` from the nominal one at `nominal`; shapes as above."""
    missed = actual_tool_point(machine, model, q, tool) - tool_point(machine, nominal, tool)
    return np.asarray(np.linalg.norm(missed, axis=1) * 1e3)


def _arc_middles(motions: Motions, model: ErrorModel, movable: NDArrayBool) -> dict[int, Array]:
    rows = sorted(motions.arcs)
    if not rows:
        return {}
    middles = motions.target.copy()
    for row in rows:
        arc = motions.arcs[row]
        first, second, _ = arc.plane
        start, end = motions.start[row], motions.target[row]
        middles[row] = (start + end) / 2
        angle = sweep((start[first], start[second]), (end[first], end[second]), arc.centre, arc.sense, arc.full)
        middles[row, [first, second]] = point_at((start[first], start[second]), arc.centre, angle / 2)
    nominal = motions.in_machine(middles)
    corrected = nominal.copy()
    corrected[rows] = correct_positions(motions.machine, model, nominal[rows], motions.tool[rows], movable[rows])
    shift = motions.in_program(corrected) - middles
    return {row: shift[row] for row in rows}
