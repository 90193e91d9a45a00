"""Figures of a diagnosis: shares of the causes, residuals before and after, the unexplained residual."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from calibration.diagnosis.improvement import in_micro
from calibration.diagnosis.residual.readings import readings
from calibration.diagnosis.residual.unexplained import in_lengths, variables
from calibration.diagnosis.result import Diagnosis
from calibration.reports.figures.fit import in_uncertainties
from kinematics.state import REFERENCE
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
MEANS_ALONG, PER_MEAN = 16, 8
OUTER = 0.5
"""Share of the points, per cent, that may lie outside of a panel on each side."""


def before_and_after(found: Diagnosis) -> Figure:
    """Residuals of the present and of the new model, against time and the position of each axis."""
    across = dict(_axes_of_figures(found))
    kept = np.flatnonzero(found.before.fit.kept & found.after.fit.kept)
    rows = some(kept)
    names = "xyz" if found.measurement.axis is None else [""]
    values = [in_micro(stage.fit, stage.fit.residual) for stage in (found.before, found.after)]
    low, high = np.percentile(values[0][rows], (OUTER, 100 - OUTER))
    limits = [1.2 * min(low, -1e-3), 1.2 * max(high, 1e-3)]
    panels = []
    for label, x in across.items():
        for name, stage in zip(("before", "after"), values, strict=True):
            panel = Panel(label, f"residual, {found.measurement.unit}", name, axes={"yaxis": {"range": limits}})
            for k in range(stage.shape[1]):
                dots(panel, x[rows], stage[rows, k], COLOURS[k], opacity=0.35)
                line(panel, *_means(x[kept], stage[kept, k]), COLOURS[k], names[k], width=2)
            panels.append(panel)
    return grid(panels, 2, same_y=True)


def by_direction(found: Diagnosis) -> Figure:
    """RMS of the residuals of the rows with each direction of approach of each axis, before and after."""
    measurement = found.measurement
    rows = np.flatnonzero(found.before.fit.kept & found.after.fit.kept)
    panels = []
    for axis in measurement.moving:
        side = np.asarray(measurement.state.need("approach", axis))[rows, measurement.machine.index(axis)]
        panel = Panel(f"direction of approach of {axis}", f"residual RMS, {measurement.unit}", f"Axis {axis}")
        signs = [(sign, name) for sign, name in APPROACHES if (side == sign).any()]
        for stage, name, colour in ((found.before, "before", BEFORE), (found.after, "after", AFTER)):
            squares = np.mean(in_micro(stage.fit, stage.fit.residual)[rows] ** 2, axis=1)
            values = [float(np.sqrt(np.mean(squares[side == sign]))) for sign, _ in signs]
            bars(panel, [label for _, label in signs], values, colour, name)
        panels.append(panel)
    return grid(panels, 3, height=220, same_y=True)


def against_noise(found: Diagnosis) -> Figure:
    """Distribution of the residuals in standard uncertainties, before and after, with that of noise alone."""
    panels = []
    for name, stage in (("before", found.before), ("after", found.after)):
        panels.append(Panel(title=name))
        against_normal(panels[-1], in_uncertainties(stage.fit), 6.0)
    return grid(panels, 2, same_y=True)


def unexplained_shape(found: Diagnosis) -> Figure:
    """Smooth shape of the unexplained residual over each variable that it depends on, and over two of them."""
    assert found.unexplained is not None
    linearised = found.named.linearised
    values = np.zeros_like(linearised.fit.residual)
    values[linearised.rows] = in_lengths(linearised, found.unexplained)
    micro = in_micro(linearised.fit, values)[linearised.rows]
    known = variables(found.measurement, linearised.rows) | readings(found.measurement, linearised.rows)
    chosen = dict(_shown(found, name, known[name]) for name in found.unexplained.variables)
    panels = []
    for name, x in chosen.items():
        panels.append(Panel(name, f"unexplained, {found.measurement.unit}"))
        for k in range(micro.shape[1]):
            dots(panels[-1], x, micro[:, k], COLOURS[k], "xyz"[k] if micro.shape[1] > 1 else "")
    if len(chosen) < 2:
        return grid(panels, 2)
    k = int(np.argmax(np.sum(micro**2, axis=0)))
    (first, x), (second, y) = list(chosen.items())[:2]
    most = float(np.abs(micro[:, k]).max())
    label = f"unexplained{' in ' + 'xyz'[k] if micro.shape[1] > 1 else ''}, {found.measurement.unit}"
    panels.append(Panel(first, second))
    coloured_dots(panels[-1], x, y, micro[:, k])
    return grid(panels, 3, colours=colour_axis(-most, most, label, signed=True))


def _axes_of_figures(found: Diagnosis) -> Iterator[tuple[str, Array]]:
    measurement = found.measurement
    state, machine = measurement.state, measurement.machine
    if state.time is not None and np.ptp(state.time) > 0:
        unit, label = clock(state.time)
        yield label, state.time / unit
    for axis in measurement.moving:
        yield f"{axis}, {machine.axes[machine.index(axis)].unit}", state.position(machine, axis)


def _means(x: Array, y: Array) -> tuple[Array, Array]:
    """Means of adjacent rows along x."""
    parts = np.array_split(np.argsort(x, kind="stable"), max(min(MEANS_ALONG, len(x) // PER_MEAN), 1))
    return np.array([x[part].mean() for part in parts]), np.array([y[part].mean() for part in parts])


def _shown(found: Diagnosis, name: str, values: Array) -> tuple[str, Array]:
    """Label and values of a variable in the unit shown."""
    machine = found.measurement.machine
    if name == "time":
        unit, label = clock(values)
        return label, np.asarray(values / unit)
    if name.startswith("temperature "):
        return f"{name}, degC", np.asarray(values + REFERENCE)
    if name in machine.names:
        return f"{name}, {machine.axes[machine.index(name)].unit}", values
    if name in ("azimuth", "elevation"):
        return f"{name}, deg", np.degrees(values)
    units = {"feed": ", mm/min", "distance": ", mm"}
    return name + units.get(name, ""), values
