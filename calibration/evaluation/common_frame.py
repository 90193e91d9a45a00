"""One frame for error motions of several calibrations, so that equal machines have equal error motions.

A calibration may be written in any of many frames: constants that two axes can share, slopes of straightness and first
harmonics of rotary axes change no measurement of the tool against a workpiece (`calibration.fit.datum`). Sampled error
motions of every calibration are moved alike along these directions into the datum of `ncomp fit`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, get_args

import msgspec
import numpy as np
from scipy.linalg import block_diag

from calibration.fit.datum import to_datum
from calibration.observation.full_model import priors
from kinematics.basis import Harmonics, Interval, Legendre
from kinematics.effects import COMPONENTS, Component, ErrorMotion
from kinematics.error_model.model import no_errors
from kinematics.machine import Machine
from kinematics.transforms import Array


class Sampled(NamedTuple):
    """Where one error motion is sampled."""

    axis: int
    component: int
    interval: Interval
    """mm or degrees."""
    positions: Array
    """`(n,)`, mm or degrees; evenly over the interval."""
    reference: float
    """mm or degrees; its value comes behind those at the positions."""

    @property
    def everywhere(self) -> Array:
        """`(n + 1,)`: the positions and the reference."""
        return np.append(self.positions, self.reference)

    def name(self, machine: Machine) -> str:
        """By ISO 230-1: E_XY."""
        return f"E_{COMPONENTS[self.component]}{machine.names[self.axis]}"


@dataclass(frozen=True)
class CommonFrame:
    """The move into the datum, linear in the sampled values."""

    shapes: Array
    """`(rows, m)`: the moves of all error motions, one below the other, for one unit of their parameters."""
    by_values: Array
    """`(m, rows)`: the parameters of the move, by the sampled values."""

    def moved(self, values: Array) -> Array:
        """Values `(rows,)`, or derivatives of them `(rows, p)`, in the common frame."""
        return np.asarray(values + self.shapes @ (self.by_values @ values))


def common_frame(machine: Machine, motions: Sequence[Sampled]) -> CommonFrame:
    """The frame of these error motions, um and urad, which lie one below the other in the order given.

    The move is worked out from the lines, or first harmonics, through the values by least squares.
    """
    effects = []
    for motion in motions:
        basis = (Harmonics if machine.axes[motion.axis].rotary else Legendre)(motion.interval, 1)
        component, axis = get_args(Component)[motion.component], machine.names[motion.axis]
        effects.append(ErrorMotion(component, axis, basis, (0.0,) * basis.size, u=(0.0,) * basis.size))
    model = msgspec.structs.replace(no_errors(machine), effects=tuple(effects))
    move = to_datum(machine, model, priors(model)) - np.eye(len(model.parameters))
    shapes, lines = [], []
    for effect, motion in zip(effects, motions, strict=True):
        columns = effect.basis.columns(motion.everywhere)
        shapes.append(columns)
        lines.append(np.pad(np.linalg.pinv(columns[:-1]), ((0, 0), (0, 1))))
    return CommonFrame(block_diag(*shapes), move @ block_diag(*lines))
