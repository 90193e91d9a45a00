"""Figures of a diagnosis: residuals before and after, by direction, against noise, and functions without a name."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from calibration.diagnosis.conclusion.fitted_rows import FittedRows, in_micro
from calibration.diagnosis.conclusion.guard import in_units
from calibration.diagnosis.conclusion.result import Diagnosis
from calibration.diagnosis.conclusion.verdict import Judged
from calibration.gaussian_terms.structure import Structure
from kinematics.state import REFERENCE_DEGC, TEMPERATURE, TIME
from kinematics.transforms import Array
from rendering.figures import (
    AFTER,
    BEFORE,
    COLOURS,
    Figure,
    Panel,
    against_normal,
    bars,
    clock,
    colour_axis,
    coloured_dots,
    dots,
    grid,
    line,
    some,
)

APPROACHES = ((1, "forward"), (-1, "backward"), (0, "not known"))
MOST_MEANS, ROWS_OF_MEAN = 16, 8
"""Most means along a variable, and least number of rows of a mean."""
OUTSIDE_PERCENT = 0.5
"""Share of the points, per cent, that may lie outside of a panel on each side."""


def before_and_after(answer: Diagnosis) -> Figure:
    """Residuals without and with the causes, against time and the position of each axis."""
    kept = _kept(answer)
    rows = some(kept)
    values = [_residual(structure) for structure in (answer.bare, answer.structure)]
    names = "xyz" if values[0].shape[1] > 1 else [""]
    low, high = np.percentile(values[0][rows], (OUTSIDE_PERCENT, 100 - OUTSIDE_PERCENT))
    limits = [1.2 * min(low, -1e-3), 1.2 * max(high, 1e-3)]
    panels = []
    for label, x in _along(answer):
        for name, stage in zip(("before", "after"), values, strict=True):
            panel = Panel(label, f"residual, {answer.measurement.unit}", name, axes={"yaxis": {"range": limits}})
            for k in range(stage.shape[1]):
                dots(panel, x[rows], stage[rows, k], COLOURS[k], opacity=0.35)
                line(panel, *_means(x[kept], stage[kept, k]), COLOURS[k], names[k], width=2)
            panels.append(panel)
    return grid(panels, 2, same_y=True)


def by_approach(answer: Diagnosis) -> Figure:
    """RMS of the residuals of the rows with each direction of approach of each axis, before and after."""
    measurement, rows = answer.measurement, _kept(answer)
    stages = ((answer.bare, "before", BEFORE), (answer.structure, "after", AFTER))
    squares = [np.mean(_residual(structure)[rows] ** 2, axis=1) for structure, _, _ in stages]
    panels = []
    for axis in measurement.moving:
        side = np.asarray(measurement.state.need("approach", axis))[rows, measurement.machine.index(axis)]
        panel = Panel(f"direction of approach of {axis}", f"residual RMS, {measurement.unit}", f"Axis {axis}")
        signs = [(sign, name) for sign, name in APPROACHES if (side == sign).any()]
        for own, (_, name, colour) in zip(squares, stages, strict=True):
            values = [float(np.sqrt(np.mean(own[side == sign]))) for sign, _ in signs]
            bars(panel, [label for _, label in signs], values, colour, name)
        panels.append(panel)
    return grid(panels, 3, height=220, same_y=True)


def against_noise(answer: Diagnosis) -> Figure:
    """Distribution of the residuals in standard uncertainties, before and after, with that of noise alone."""
    panels = []
    for name, structure in (("before", answer.bare), ("after", answer.structure)):
        rows = FittedRows.of(structure)
        panels.append(Panel(title=name))
        against_normal(panels[-1], rows.residual[rows.good], 6.0)
    return grid(panels, 2, same_y=True)


def function_figure(answer: Diagnosis, each: Judged) -> Figure:
    """What a function without a name contributes to the rows, over its variables."""
    measurement = answer.measurement
    micro = in_micro(answer.structure, answer.contribution(each))
    names = "xyz" if micro.shape[1] > 1 else [""]
    found = [shown for name in each.variables if (shown := _variable(answer, name)) is not None]
    panels = []
    for label, x in found:
        panels.append(Panel(label, f"unexplained, {measurement.unit}"))
        rows = some(np.arange(len(x)))
        for k in np.flatnonzero(micro.any(axis=0)).tolist():
            dots(panels[-1], x[rows], micro[rows, k], COLOURS[k], names[k])
    if len(found) < 2:
        return grid(panels, 2)
    k = int(np.argmax(np.sum(micro**2, axis=0)))
    (first, x), (second, y) = found[:2]
    most = float(np.abs(micro[:, k]).max()) or 1.0
    label = f"unexplained{' in ' + names[k] if names[k] else ''}, {measurement.unit}"
    panels.append(Panel(first, second))
    coloured_dots(panels[-1], x, y, micro[:, k])
    return grid(panels, 3, colours=colour_axis(-most, most, label, signed=True))


def _kept(answer: Diagnosis) -> np.ndarray:
    """Numbers of the rows that are not left out."""
    return np.flatnonzero(~answer.structure.noise.left_out)


def _residual(structure: Structure) -> Array:
    """Residuals `(n, d)`, um or urad."""
    return in_micro(structure, in_units(structure, structure.left))


def _along(answer: Diagnosis) -> Iterator[tuple[str, Array]]:
    """Time and the positions of the axes that move, with labels."""
    for name in (TIME, *answer.measurement.moving):
        shown = _variable(answer, name)
        if shown is not None and np.ptp(shown[1]) > 0:
            yield shown


def _variable(answer: Diagnosis, name: str) -> tuple[str, Array] | None:
    """Label and values `(n,)` of a variable in the unit shown; None where the rows do not have it."""
    measurement = answer.measurement
    state, machine = measurement.state, measurement.machine
    if name == TIME:
        if state.time is None:
            return None
        unit, label = clock(state.time)
        return label, np.asarray(state.time / unit)
    if name in machine.names:
        return f"{name}, {machine.axes[machine.index(name)].unit}", state.position(machine, name)
    if name.startswith(TEMPERATURE):
        return f"{name}, degC", np.asarray(state.variable(machine, name, name) + REFERENCE_DEGC)
    return _reading(state.observed, name)


def _reading(observed: Array | None, name: str) -> tuple[str, Array] | None:
    """Label and values of a reading of a beam: azimuth, elevation, deg, distance, mm."""
    if observed is None:
        return None
    x, y, z = observed.T
    if name == "azimuth":
        return "azimuth, deg", np.degrees(np.arctan2(y, x))
    if name == "elevation":
        return "elevation, deg", np.degrees(np.arctan2(z, np.hypot(x, y)))
    return ("distance, mm", np.linalg.norm(observed, axis=1)) if name == "distance" else None


def _means(x: Array, y: Array) -> tuple[Array, Array]:
    """Means of adjacent rows along x."""
    parts = np.array_split(np.argsort(x, kind="stable"), max(min(MOST_MEANS, len(x) // ROWS_OF_MEAN), 1))
    return np.array([x[part].mean() for part in parts]), np.array([y[part].mean() for part in parts])
