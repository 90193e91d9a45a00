"""Which axes have backlash in a program, what counts as their reversal, and where their position is known."""

from __future__ import annotations

import numpy as np

from kinematics.effects import Effect
from kinematics.error_model.model import ErrorModel
from kinematics.error_model.play import PlayLimits
from kinematics.machine import Machine, NDArrayBool
from kinematics.transforms import Array
from postproc.motion.motions import Motions
from postproc.motion.moves import Kind, Known


def needs_direction(effect: Effect) -> bool:
    """True for correctable effects that depend on the approach direction of an axis."""
    return effect.ACTS_ON != "instrument" and effect.REMEDY != "none" and "approach" in effect.needs


def axes_with_backlash(model: ErrorModel, machine: Machine) -> tuple[int, ...]:
    """Columns of the axes whose direction the model depends on."""
    return tuple(sorted({machine.index(name) for e in model.effects if needs_direction(e) for name in e.axes}))


def dead_band(machine: Machine, tolerance_um: float) -> Array:
    """Travel `(axes,)`, mm and rad, that an axis must go back before it counts as a reversal: half the tolerance.

    The other half is for the path between the evaluated positions. A tolerance in um is taken in urad for rotary axes.
    The dead band is never smaller than the resolution of the axis.
    """
    resolution = np.array([axis.resolution for axis in machine.axes]) * machine.scale
    return np.maximum(0.5e-3 * tolerance_um * np.where(machine.rotary, 1e-3, 1.0), resolution)


def play_limits(machine: Machine, tolerance_um: float) -> PlayLimits:
    """What counts as play, and as a reversal of an axis without play, in a program with this tolerance."""
    return PlayLimits(dead_band(machine, 0.0) / 2.0, dead_band(machine, tolerance_um))


def after_cycles(motions: Motions, behind_cycle: bool) -> tuple[NDArrayBool, bool]:
    """True `(n,)` for moves before which a canned cycle returns to their start, and whether the next chunk has one.

    The row of a canned cycle ends at the bottom of its hole. behind_cycle: the row before the chunk was one.
    """
    cycles = np.append(behind_cycle, motions.kind == Kind.CYCLE)
    return cycles[:-1], bool(cycles[-1])


def known_before(motions: Motions) -> NDArrayBool:
    """True `(n, axes)` where the position of an axis before a move is known; with TCP a linear axis needs all axes."""
    known = motions.known_start != Known.ASSUMED
    tcp = np.array([frame.tcp for frame in motions.frames], bool)[motions.frame]
    linear = ~motions.machine.rotary
    known[np.ix_(tcp, linear)] &= known[tcp].all(axis=1, keepdims=True)
    return np.asarray(known)


def feeds(motions: Motions) -> NDArrayBool:
    """True `(n,)` for feed moves, whose path matters and not only their end."""
    return np.isin(motions.kind, (Kind.LINE, Kind.ARC))
