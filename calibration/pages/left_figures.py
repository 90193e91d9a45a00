"""Figures of residuals: shares of causes, residuals before and after, the unexplained residual."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from calibration.diagnosis.diagnose import Diagnosis
from calibration.diagnosis.improvement import in_micro
from calibration.diagnosis.report_text import title
from calibration.diagnosis.residual.unexplained import in_lengths, variables
from calibration.fit.fit import Fit
from calibration.observation.full_model import moving_axes
from calibration.observation.normal_equations import whitened, whiteners
from calibration.pages import clock, figure
from kinematics.state import REFERENCE
from kinematics.transforms import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes

COLOURS = ("#3465a4", "#cc5500", "#4e9a06")
MACHINE, INSTRUMENT, LEFT = "#3465a4", "#cc5500", "#888888"
MANY = 4000
"""Most points that are drawn of one kind."""
MEANS_ALONG, PER_MEAN = 16, 8
OUTER = 0.5
"""Share of the points, per cent, that may lie outside of a panel on each side."""


def share_chart(found: Diagnosis) -> str:
    """Share of the squares without any cause, by named cause, and the share that is left at the end."""
    bars = [(title(c), c.share, INSTRUMENT if c.where == "instrument" else MACHINE) for c in found.causes]
    bars.append(("left: noise, and what is unexplained", found.left_share, LEFT))
    with figure(8.0, 0.5 + 0.3 * len(bars)) as (canvas, drawn):
        place = canvas.subplots()
        for number, (_, share, colour) in enumerate(bars):
            place.barh(number, 100 * share, color=colour, height=0.6)
            place.annotate(f"{share:.0%}", (100 * share, number), (3, 0), textcoords="offset points", va="center")
        place.set_yticks(range(len(bars)), [name for name, _, _ in bars])
        place.invert_yaxis()
        place.set_xlim(0, 112 * max(share for _, share, _ in bars))
        place.set_xlabel("% of the squares that are left without any of these causes, in terms of the noise")
        place.grid(visible=False)
    return drawn[0]


def before_and_after(found: Diagnosis) -> str:
    """Residuals of the present and of the new model, against time and the position of each axis."""
    measurement = found.measurement
    across = dict(_axes_of_figures(found))
    kept = np.flatnonzero(found.before.fit.kept & found.after.fit.kept)
    rows = kept[np.linspace(0, len(kept) - 1, min(len(kept), MANY)).astype(int)]
    names = "xyz" if measurement.axis is None else [""]
    with figure(8.6, 4.0) as (canvas, drawn):
        grid = canvas.subplots(2, len(across), squeeze=False, sharey=True, sharex="col")
        for line, what, stage in zip(grid, ("before", "after"), (found.before, found.after), strict=True):
            values = in_micro(stage.fit, stage.fit.residual)
            for place, x in zip(line, across.values(), strict=True):
                for k in range(values.shape[1]):
                    _dots(place, x[rows], values[rows, k], COLOURS[k], None)
                    place.plot(*_means(x[kept], values[kept, k]), color=COLOURS[k], linewidth=1.5, label=names[k])
            line[0].set_ylabel(f"{what}, um")
        for place, label in zip(grid[-1], across, strict=True):
            place.set_xlabel(label)
        low, high = np.percentile(in_micro(found.before.fit, found.before.fit.residual)[rows], (OUTER, 100 - OUTER))
        grid[0][0].set_ylim(1.2 * min(low, -1e-3), 1.2 * max(high, 1e-3))
        if measurement.axis is None:
            grid[0][-1].legend(loc="upper right", fontsize=7, framealpha=0.7)
    return drawn[0]


def against_noise(found: Diagnosis) -> str:
    """Distribution of the residuals in standard uncertainties, before and after, with that of noise alone."""
    edges = np.linspace(-6, 6, 61)
    with figure(8.0, 2.3) as (canvas, drawn):
        places = canvas.subplots(1, 2, sharey=True)
        for place, what, stage in zip(places, ("before", "after"), (found.before, found.after), strict=True):
            white = np.clip(_standard(stage.fit).ravel(), -6, 6)
            place.hist(white, edges, density=True, color=COLOURS[0], alpha=0.5, label="residuals")
            place.plot(edges, np.exp(-(edges**2) / 2) / np.sqrt(2 * np.pi), color="#222", linewidth=1, label="noise")
            place.set_title(what)
            place.set_xlabel("residual / standard uncertainty")
            place.legend(fontsize=7, frameon=False)
    return drawn[0]


def unexplained_shape(found: Diagnosis) -> str:
    """Smooth shape of the unexplained residual over each variable that it depends on, and over two of them."""
    assert found.unexplained is not None
    linearised = found.named.linearised
    measurement = found.measurement
    values = np.zeros_like(linearised.fit.residual)
    values[linearised.rows] = in_lengths(linearised, found.unexplained)
    micro = in_micro(linearised.fit, values)[linearised.rows]
    known = variables(measurement, linearised.rows)
    chosen = dict(_shown(found, name, known[name]) for name in found.unexplained.variables)
    with figure(8.6, 2.6) as (canvas, drawn):
        places = canvas.subplots(1, len(chosen) + (len(chosen) > 1), squeeze=False)[0]
        for place, (name, x) in zip(places, chosen.items(), strict=False):
            for k in range(micro.shape[1]):
                _dots(place, x, micro[:, k], COLOURS[k], "xyz"[k] if micro.shape[1] > 1 else None)
            place.set_xlabel(name)
        places[0].set_ylabel("unexplained, um")
        if micro.shape[1] > 1:
            places[0].legend(loc="upper right", markerscale=3, fontsize=7, framealpha=0.7)
        if len(chosen) > 1:
            k = int(np.argmax(np.sum(micro**2, axis=0)))
            (first, x), (second, y) = list(chosen.items())[:2]
            most = float(np.abs(micro[:, k]).max())
            dots = places[-1].scatter(x, y, c=micro[:, k], cmap="RdBu_r", vmin=-most, vmax=most, s=9, rasterized=True)
            places[-1].set_xlabel(first)
            places[-1].set_ylabel(second)
            canvas.colorbar(dots, ax=places[-1], label=f"{'xyz'[k] if micro.shape[1] > 1 else 'unexplained'}, um")
    return drawn[0]


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


def _standard(fit: Fit) -> Array:
    white = whitened(whiteners(fit.measurement), fit.residual)[fit.kept]
    return np.asarray(white / fit.variance_factor**0.5)


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


def _dots(place: Axes, x: Array, y: Array, colour: str, label: str | None) -> None:
    place.plot(x, y, ".", markersize=2, color=colour, label=label, alpha=0.4, rasterized=True)
