"""Parts of figures that several reports draw."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from kinematics.transforms import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes

COLOURS = ("#3465a4", "#cc5500", "#4e9a06")
MANY = 4000
"""Most points that are drawn of one kind."""
LONG = 1800.0
"""Duration, s, from which times are shown in hours."""


def clock(seconds: Array) -> tuple[float, str]:
    """Length, s, of the unit in which these times are shown, and the label of their axis."""
    return (3600.0, "time, h") if np.ptp(seconds) >= LONG else (1.0, "time, s")


def some(rows: np.ndarray, most: int = MANY) -> np.ndarray:
    """At most `most` of these rows, evenly spread."""
    return np.asarray(rows[np.linspace(0, len(rows) - 1, min(len(rows), most)).astype(int)])


def dots(panel: Axes, x: Array, y: Array, colour: str, **style: Any) -> None:
    """Single points, drawn as a bitmap."""
    panel.plot(x, y, ".", color=colour, rasterized=True, **({"markersize": 2} | style))


def band(panel: Axes, x: Array, y: Array, half: Array, colour: str = COLOURS[0], label: str | None = None) -> None:
    """A curve with a band of this half-width `(n,)`."""
    panel.fill_between(x, y - half, y + half, color=colour, alpha=0.2, linewidth=0)
    panel.plot(x, y, color=colour, linewidth=1, label=label)


def against_normal(panel: Axes, white: Array, most: float) -> None:
    """Distribution of residuals in standard uncertainties, with that of noise alone; larger ones count as `most`."""
    edges = np.linspace(-most, most, round(10 * most) + 1)
    bins: list[float] = edges.tolist()
    panel.hist(np.clip(white.ravel(), -most, most), bins, density=True, color=COLOURS[0], alpha=0.5, label="residuals")
    panel.plot(edges, np.exp(-(edges**2) / 2) / np.sqrt(2 * np.pi), color="#222", linewidth=1, label="noise")
    panel.set_xlabel("residual / standard uncertainty")
