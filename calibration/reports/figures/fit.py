"""Figures of a fit: error motions with their uncertainties, and the unexplained residual."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from calibration.fit.fit import Fit
from kinematics.effects import ErrorMotion
from kinematics.error_model.model import ErrorModel
from kinematics.transforms import Array
from rendering.figures import (
    COLOURS,
    Figure,
    Panel,
    against_normal,
    band,
    bars,
    clock,
    dots,
    grid,
    level,
    some,
)

ERROR_MOTIONS_ACROSS = 3
"""Error motions side by side."""
PRACTICALLY_ZERO_UM = 0.05
"""Range of the error, um and urad, of an error motion that is practically zero."""


def error_motions_figure(model: ErrorModel) -> Figure:
    """The error motions with their uncertainties."""
    whole = np.array(model.covariance)
    panels = [_motion(effect, whole[part, part]) for effect, part in model.error_motions]
    return grid(panels, ERROR_MOTIONS_ACROSS, height=220)


def _motion(effect: ErrorMotion, own: Array) -> Panel:
    unit = "deg" if effect.axis[0] in "ABC" else "mm"
    panel = Panel(f"{effect.axis}, {unit}", f"{effect.name}, {'urad' if effect.angular else 'um'}", effect.name)
    x = np.linspace(*effect.basis.interval, 120)
    columns = effect.basis.columns(x)
    u = np.sqrt(np.maximum(np.einsum("np,pq,nq->n", columns, own, columns), 0.0))
    y = columns @ effect.parameters
    band(panel, x, y, 2 * u)
    if np.max(np.abs(y) + 2 * u) < PRACTICALLY_ZERO_UM:
        panel.axes["yaxis"] = {"range": [-PRACTICALLY_ZERO_UM, PRACTICALLY_ZERO_UM]}
    return panel


def in_uncertainties(fitted: Fit) -> Array:
    """Residuals of the rows that are kept, in standard uncertainties."""
    return np.asarray(fitted.white[fitted.kept])


def distribution(fitted: Fit) -> Figure:
    """Distribution of the residuals in standard uncertainties, and the residuals in the order of acquisition."""
    white = in_uncertainties(fitted)
    left, right = Panel(), Panel("row, in the order of acquisition", "residual / standard uncertainty")
    against_normal(left, white, 5.0)
    rows = some(np.arange(len(white)))
    for k in range(white.shape[1]):
        name = "xyz"[k] if white.shape[1] > 1 else ""
        dots(right, np.flatnonzero(fitted.kept)[rows], white[rows, k], COLOURS[k], name)
    return grid([left, right], 2, height=300)


def along_axes(fitted: Fit) -> Figure:
    """Residuals over the time and over the position of each axis that moves, on one scale."""
    measurement, kept = fitted.measurement, fitted.kept
    residual = (fitted.residual * measurement.per_micro)[kept]
    noise = np.sqrt(np.diagonal(measurement.covariances, axis1=1, axis2=2)) * measurement.per_micro
    typical = noise[kept].mean(axis=0)
    rows = some(np.arange(len(residual)))
    panels = []
    for label, x in _variables(fitted):
        panel = Panel(label, f"residual, {measurement.unit}")
        for k in range(residual.shape[1]):
            dots(panel, x[rows], residual[rows, k], COLOURS[k], "xyz"[k] if residual.shape[1] > 1 else "")
        for sign in (-2.0, 2.0):
            level(panel, sign * float(typical.max()))
        panels.append(panel)
    return grid(panels, 3, same_y=True)


def _variables(fitted: Fit) -> Iterator[tuple[str, Array]]:
    """Time, and the position of each axis that moves, of the rows that are kept, with the labels of their axes."""
    state, machine = fitted.measurement.state, fitted.measurement.machine
    if state.time is not None and np.ptp(state.time[fitted.kept]) > 0:
        unit, label = clock(state.time)
        yield label, state.time[fitted.kept] / unit
    positions = state.positions[fitted.kept] / machine.scale
    for i, axis in enumerate(machine.axes):
        if np.ptp(positions[:, i]) > 0:
            yield f"{axis.name}, {axis.unit}", positions[:, i]


def by_direction(fitted: Fit) -> Figure:
    """RMS of the residuals of the rows with each direction of approach of each axis that moves."""
    measurement, rows = fitted.measurement, np.flatnonzero(fitted.kept)
    approach = measurement.state.approach
    assert approach is not None
    squares = np.mean((fitted.residual * measurement.per_micro)[rows] ** 2, axis=1)
    panel = Panel("axis and direction of approach", f"residual RMS, {measurement.unit}")
    for sign, name, colour in ((1, "forward", COLOURS[0]), (-1, "backward", COLOURS[1])):
        sides = {axis.name: approach[rows, i] == sign for i, axis in enumerate(measurement.machine.axes)}
        known = {axis: side for axis, side in sides.items() if side.any()}
        bars(panel, list(known), [float(np.sqrt(squares[side].mean())) for side in known.values()], colour, name)
    return Figure([panel])
