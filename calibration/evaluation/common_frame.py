"""One frame for the error motions of several calibrations, so that equal machines have equal error motions.

A calibration can be expressed in many equivalent frames: constants shared by two axes, slopes of straightness and first
harmonics of rotary axes change no measurement of the tool against a workpiece (`calibration.fit.datum`). The sampled
error motions of every calibration are transformed along these directions into the datum of `ncomp fit`.
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
    """Sampling positions of one error motion."""

    axis: int
    component: int
    interval: Interval
    """Sampled range, mm or degrees."""
    positions: Array
    """Positions `(n,)`, mm or degrees, evenly over the interval."""
    reference: float
    """Reference position, mm or degrees; its value follows those at the positions."""

    @property
    def everywhere(self) -> Array:
        """Positions and reference `(n + 1,)`."""
        return np.append(self.positions, self.reference)

    def name(self, machine: Machine) -> str:
        """Name by ISO 230-1, such as E_XY."""
        return f"E_{COMPONENTS[self.component]}{machine.names[self.axis]}"


@dataclass(frozen=True)
class CommonFrame:
    """The transformation into the datum, linear in the sampled values."""

    shapes: Array
    """Changes `(rows, m)` of all error motions, one below the other, for one unit of each parameter."""
    by_values: Array
    """Matrix `(m, rows)` from the sampled values to the parameters of the transformation."""

    def moved(self, values: Array) -> Array:
        """Values `(rows,)`, or derivatives of them `(rows, p)`, in the common frame."""
        return np.asarray(values + self.shapes @ (self.by_values @ values))


def common_frame(machine: Machine, motions: Sequence[Sampled]) -> CommonFrame:
    """The frame of these error motions, um and urad, one below the other in the given order.

    The transformation is derived from least-squares lines, or first harmonics, through the values.
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
