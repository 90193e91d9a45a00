"""A blind mode: an error that deviations across a path cannot show, whatever their noise and number.

Let each linear axis i have the positioning error L_i g(u_i), with u_i its position scaled to -1 ... 1 over a travel of
2 L_i, and one odd function g for all axes that is zero at the ends. This error shifts a line along itself if the line
is an edge, or a diagonal through the centre of the volume or of one of its faces. Such lines alone cannot show it.
"""

from __future__ import annotations

from dataclasses import replace

import msgspec
import numpy as np

from calibration.measurement.measurement import Measurement
from calibration.registration.registration import Registration
from kinematics.basis import Interval, Polynomial
from kinematics.effects import ErrorMotion
from kinematics.effects.base import own_component
from kinematics.error_model.model import no_errors
from kinematics.transforms import blocks

UNIDENTIFIABLE_DISPLACEMENT = 0.01
"""Share of the displacement across the path below which the mode is unidentifiable."""
MODE_SHAPES = ((0.0, 1.0, 0.0, -1.0), (0.0, 0.0, 0.0, 1.0, 0.0, -1.0))
"""u (1 - u2) and u3 (1 - u2), as coefficients of powers of u."""


def common_odd_mode(measurement: Measurement, registration: Registration) -> str | None:
    """A description of the blind mode if a measurement on the fly cannot identify it; otherwise None."""
    assert measurement.across is not None
    machine = measurement.machine
    ends = (measurement.across.ends / machine.scale).T.tolist()
    moving = {
        axis.name: (low, high) for axis, (low, high) in zip(machine.axes, ends, strict=True)
        if not axis.rotary and high > low
    }  # fmt: skip
    if len(moving) < 2:
        return None
    shares = [_share_across(measurement, registration, moving, shape) for shape in MODE_SHAPES]
    if max(shares) > UNIDENTIFIABLE_DISPLACEMENT:
        return None
    names = [f"E_{own_component(axis)}{axis}" for axis in sorted(moving)]
    return (
        f"{', '.join(names[:-1])} and {names[-1]} in proportion to their travels, with one common shape that is odd "
        f"about the middle and zero at the ends: {100 * max(shares):.2g} % of it lies across this path. Edges, face "
        "and space diagonals do not show it; 'ncomp plan path' makes a path that does"
    )


def _share_across(
    measurement: Measurement, registration: Registration, axes: dict[str, Interval], shape: tuple[float, ...]
) -> float:
    """Ratio of the RMS displacement across the path to that of the whole displacement, for a mode of this shape."""
    machine, effects = measurement.machine, []
    # from powers of u in -1..1 to powers of the basis variable in 0..1
    powers = np.asarray(np.polynomial.Polynomial(shape)(np.polynomial.Polynomial([-1.0, 2.0])).coef, float)
    for axis, (low, high) in axes.items():
        basis = Polynomial((low, high), len(powers) - 1)
        effects.append(ErrorMotion(own_component(axis), axis, basis, tuple((powers * (high - low)).tolist())))
    errors = msgspec.structs.replace(no_errors(machine), effects=tuple(effects)).errors(machine, measurement.state)
    across = whole = 0.0
    for rows in blocks(len(measurement)):
        part, own = measurement.rows(rows), errors[rows].reshape(-1, errors[rows].shape[1] * 6, 1)
        width = own.shape[1]
        across += float(np.sum((part.instrument.transform(part, registration)[:, :, :width] @ own) ** 2))
        part = replace(part, across=None)
        whole += float(np.sum((part.instrument.transform(part, registration)[:, :, :width] @ own) ** 2))
    return float(np.sqrt(across / whole)) if whole else 0.0
