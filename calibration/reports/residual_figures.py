"""Figures of a diagnosis: shares of the causes, residuals before and after, the unexplained residual."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from calibration.diagnosis.improvement import in_micro
from calibration.diagnosis.residual.unexplained import in_lengths, variables
from calibration.diagnosis.result import Diagnosis
from calibration.observation.full_model import moving_axes
from calibration.reports.causes.text import title
from calibration.reports.fit import in_uncertainties
from kinematics.state import REFERENCE
from kinematics.transforms import Array
from rendering.figures import COLOURS, against_normal, clock, dots, some

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MACHINE, INSTRUMENT, UNEXPLAINED = "#3465a4", "#cc5500", "#888888"
MEANS_ALONG, PER_MEAN = 16, 8
OUTER = 0.5
"""Share of the points, per cent, that may lie outside of a panel on each side."""


def share_chart(found: Diagnosis, canvas: Figure) -> None:
    """Share of the squares without any cause, by named cause, and the share that no cause explains."""
    bars = [(title(c), c.share, INSTRUMENT if c.where == "instrument" else MACHINE) for c in found.causes]
    bars.append(("noise and unexplained residual", found.unexplained_share, UNEXPLAINED))
    canvas.set_size_inches(8.0, 0.5 + 0.3 * len(bars))
    panel = canvas.subplots()
    for number, (_, share, colour) in enumerate(bars):
        panel.barh(number, 100 * share, color=colour, height=0.6)
        panel.annotate(f"{share:.0%}", (100 * share, number), (3, 0), textcoords="offset points", va="center")
    panel.set_yticks(range(len(bars)), [name for name, _, _ in bars])
    panel.invert_yaxis()
    panel.set_xlim(0, 112 * max(share for _, share, _ in bars))
    panel.set_xlabel("% of the squared residuals of the model without any of these causes, in units of the noise")
    panel.grid(visible=False)


def before_and_after(found: Diagnosis, canvas: Figure) -> None:
    """Residuals of the present and of the new model, against time and the position of each axis."""
    measurement = found.measurement
    across = dict(_axes_of_figures(found))
    kept = np.flatnonzero(found.before.fit.kept & found.after.fit.kept)
    rows = some(kept)
    names = "xyz" if measurement.axis is None else [""]
    canvas.set_size_inches(8.6, 4.0)
    grid = canvas.subplots(2, len(across), squeeze=False, sharey=True, sharex="col")
    for line, name, stage in zip(grid, ("before", "after"), (found.before, found.after), strict=True):
        values = in_micro(stage.fit, stage.fit.residual)
        for panel, x in zip(line, across.values(), strict=True):
            for k in range(values.shape[1]):
                dots(panel, x[rows], values[rows, k], COLOURS[k], alpha=0.4)
                panel.plot(*_means(x[kept], values[kept, k]), color=COLOURS[k], linewidth=1.5, label=names[k])
        line[0].set_ylabel(f"{name}, um")
    for panel, label in zip(grid[-1], across, strict=True):
        panel.set_xlabel(label)
    low, high = np.percentile(in_micro(found.before.fit, found.before.fit.residual)[rows], (OUTER, 100 - OUTER))
    grid[0][0].set_ylim(1.2 * min(low, -1e-3), 1.2 * max(high, 1e-3))
    if measurement.axis is None:
        grid[0][-1].legend(loc="upper right", fontsize=7, framealpha=0.7)


def against_noise(found: Diagnosis, canvas: Figure) -> None:
    """Distribution of the residuals in standard uncertainties, before and after, with that of noise alone."""
    canvas.set_size_inches(8.0, 2.3)
    panels = canvas.subplots(1, 2, sharey=True)
    for panel, name, stage in zip(panels, ("before", "after"), (found.before, found.after), strict=True):
        against_normal(panel, in_uncertainties(stage.fit), 6.0)
        panel.set_title(name)
        panel.legend(fontsize=7, frameon=False)


def unexplained_shape(found: Diagnosis, canvas: Figure) -> None:
    """Smooth shape of the unexplained residual over each variable that it depends on, and over two of them."""
    assert found.unexplained is not None
    linearised = found.named.linearised
    values = np.zeros_like(linearised.fit.residual)
    values[linearised.rows] = in_lengths(linearised, found.unexplained)
    micro = in_micro(linearised.fit, values)[linearised.rows]
    known = variables(found.measurement, linearised.rows)
    chosen = dict(_shown(found, name, known[name]) for name in found.unexplained.variables)
    canvas.set_size_inches(8.6, 2.6)
    panels = canvas.subplots(1, len(chosen) + (len(chosen) > 1), squeeze=False)[0]
    for panel, (name, x) in zip(panels, chosen.items(), strict=False):
        for k in range(micro.shape[1]):
            dots(panel, x, micro[:, k], COLOURS[k], label="xyz"[k], alpha=0.4)
        panel.set_xlabel(name)
    panels[0].set_ylabel("unexplained, um")
    if micro.shape[1] > 1:
        panels[0].legend(loc="upper right", markerscale=3, fontsize=7, framealpha=0.7)
    if len(chosen) > 1:
        k = int(np.argmax(np.sum(micro**2, axis=0)))
        (first, x), (second, y) = list(chosen.items())[:2]
        most = float(np.abs(micro[:, k]).max())
        mapped = panels[-1].scatter(x, y, c=micro[:, k], cmap="RdBu_r", vmin=-most, vmax=most, s=9, rasterized=True)
        panels[-1].set_xlabel(first)
        panels[-1].set_ylabel(second)
        canvas.colorbar(mapped, ax=panels[-1], label=f"{'xyz'[k] if micro.shape[1] > 1 else 'unexplained'}, um")


def _axes_of_figures(found: Diagnosis) -> Iterator[tuple[str, Array]]:
    measurement = found.measurement
    state, machine = measurement.state, measurement.machine
    if state.time is not None and np.ptp(state.time) > 0:
        unit, label = clock(state.time)
        yield label, state.time / unit
    for axis in moving_axes(measurement):
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
    return f"{name}, mm/min" if name == "feed" else name, values
