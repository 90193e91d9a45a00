"""Figures of reports: panels of traces for Plotly, which the page arranges by its width."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from kinematics.transforms import Array

COLOURS = ("#3b7dd8", "#d9700a", "#4e9a06")
"""Colours of x, y and z; of A and B; of forward and backward."""
INK, GREY, RED = "@ink", "@grey", "#d4372c"
"""Text and thin lines in the colours of the page, which is light or dark."""
PAPER = "@paper"
"""Colour of the page: of arrows on a map."""
ARROW = 38.0
"""Size, px, of the longest arrow of a map."""
LEAST_ARROW = 4.0
"""Size, px, below which the direction of an arrow cannot be seen."""
SIZES = "@sizes"
"""Colours of sizes from zero to the largest, by the page."""
MACHINE, INSTRUMENT, UNEXPLAINED = COLOURS[0], COLOURS[1], "#8a8f98"
BEFORE, AFTER = COLOURS[:2]
MOST_DRAWN_POINTS = 4000
"""Most points that are drawn of one kind."""
SCENE_HEIGHT_PX = 640
"""Height, px, of a 3-D scene that stands alone; a flat one is lower."""
FEW_BARS = 6
"""Most bars of a ranking that have much room."""
HOURS_FROM_S = 1800.0
"""Duration, s, from which times are shown in hours."""
ENDS = {0.0: "left", 1.0: "right"}
HOVER = "%{x}: %{y:.2f} ± %{customdata:.2f}<extra>%{fullData.name}</extra>"
DRAWN_DIGITS = 5
"""Significant digits of drawn numbers."""
Trace = dict[str, Any]


@dataclass
class Panel:
    """Traces in one pair of axes, one polar diagram or one 3-D scene."""

    x: str = ""
    """Label of an axis, with its unit."""
    y: str = ""
    title: str = ""
    z: str = ""
    kind: Literal["xy", "polar", "scene"] = "xy"
    traces: list[Trace] = field(default_factory=list)
    axes: dict[str, Any] = field(default_factory=dict)
    """Further attributes of the axes: `xaxis`, `yaxis`, or of the whole scene or polar diagram."""
    notes: list[Trace] = field(default_factory=list)
    """Annotations in the coordinates of the panel."""
    shapes: list[Trace] = field(default_factory=list)


@dataclass
class Figure:
    """Panels side by side."""

    panels: Sequence[Panel]
    across: int = 1
    """Most panels in a row; a narrow page has fewer."""
    height: int = 260
    """Height of a panel, px."""
    same_x: bool = False
    """One scale along x."""
    same_y: bool = False
    colours: Trace | None = None
    """Colour axis of all panels: `cmin`, `cmax`, `colorscale`, `title`."""

    def spec(self) -> dict[str, Any]:
        """The figure for the page, with rounded numbers."""
        panels = [{key: value for key, value in vars(panel).items() if value} for panel in self.panels]
        spec = {"panels": panels, "across": self.across, "height": self.height, "sameX": self.same_x}
        rounded: dict[str, Any] = _plain(spec | {"sameY": self.same_y, "colours": self.colours})
        return rounded


def grid(panels: Sequence[Panel], across: int, **form: Any) -> Figure:
    """Panels in rows."""
    return Figure(panels, min(across, max(len(panels), 1)), **form)


def clock(seconds: Array) -> tuple[float, str]:
    """Length, s, of the unit in which these times are shown, and the label of their axis."""
    return (3600.0, "time, h") if np.ptp(seconds) >= HOURS_FROM_S else (1.0, "time, s")


def some(rows: np.ndarray, most: int = MOST_DRAWN_POINTS) -> np.ndarray:
    """At most `most` of these rows, evenly spread."""
    return np.asarray(rows[np.linspace(0, len(rows) - 1, min(len(rows), most)).astype(int)])


def colour_axis(least: float, most: float, title: str, *, signed: bool = False) -> Trace:
    """One colour scale for all panels of a figure; `signed`: white at zero."""
    return {
        "cmin": least,
        "cmax": most,
        "colorscale": "RdBu" if signed else SIZES,
        "reversescale": signed,
        "title": title,
    }


def dots(panel: Panel, x: Array, y: Array, colour: str, name: str = "", **style: Any) -> None:
    """Single points."""
    marker = {"color": colour, "size": style.pop("size", 3), "opacity": style.pop("opacity", 0.5)} | style
    panel.traces.append({"type": "scatter", "mode": "markers", "x": x, "y": y, "name": name, "marker": marker})


def line(panel: Panel, x: Array, y: Array, colour: str = COLOURS[0], name: str = "", **style: Any) -> None:
    """A curve."""
    form = {"color": colour, "width": style.pop("width", 1.5)} | style
    panel.traces.append({"type": "scatter", "mode": "lines", "x": x, "y": y, "name": name, "line": form})


def band(panel: Panel, x: Array, y: Array, half: Array, colour: str = COLOURS[0], name: str = "") -> None:
    """A curve with a band of this half-width `(n,)`."""
    area(panel, x, y - half, y + half, colour)
    line(panel, x, y, colour, name)
    panel.traces[-1] |= {"customdata": half, "hovertemplate": HOVER}


def area(panel: Panel, x: Array, low: Array, high: Array, colour: str, opacity: float = 0.22) -> None:
    """The area between two curves."""
    fill = {"fill": "toself", "fillcolor": rgba(colour, opacity), "line": {"width": 0}, "hoverinfo": "skip"}
    known = np.isfinite(low) & np.isfinite(high)
    for part in np.split(np.arange(len(x)), np.flatnonzero(np.diff(known.astype(int))) + 1):
        if len(part) and known[part[0]]:
            across, up = np.concatenate([x[part], x[part][::-1]]), np.concatenate([high[part], low[part][::-1]])
            panel.traces.append({"type": "scatter", "mode": "lines", "x": across, "y": up, "showlegend": False} | fill)


def bars_of_error(panel: Panel, x: Array, y: Array, half: Array, colour: str, name: str = "", size: int = 6) -> None:
    """Points with bars of this half-width `(n,)`."""
    bar = {"type": "data", "array": half, "thickness": 1, "width": 2, "color": colour}
    dots(panel, x, y, colour, name, size=size, opacity=1)
    panel.traces[-1]["error_y"] = bar


def bars(panel: Panel, names: Sequence[str], values: Sequence[float], colour: str, name: str = "") -> None:
    """A bar above each of these names."""
    panel.traces.append({"type": "bar", "x": names, "y": values, "name": name, "marker": {"color": colour}})
    panel.axes.setdefault("xaxis", {"type": "category"})


def coloured_dots(panel: Panel, x: Array, y: Array, values: Array) -> None:
    """Points coloured by `values` on the figure's scale."""
    marker = {"color": values, "coloraxis": "coloraxis", "size": 5}
    trace = {"type": "scatter", "mode": "markers", "x": x, "y": y, "marker": marker}
    panel.traces.append(trace | {"hovertemplate": "%{x:.4g}, %{y:.4g}: %{marker.color:.2f}<extra></extra>"})


def ranked(rows: Sequence[tuple[str, float, str]], label: str, unit: str = "%") -> Figure:
    """A bar to the right below each name, with its share, or its value in a unit, and its colour."""
    factor = 100.0 if unit == "%" else 1.0
    panel = Panel(label, axes={"bare": True, "yaxis": {"visible": False, "range": [len(rows) - 0.45, -0.75]}})
    most = max(share for _, share, _ in rows)
    panel.axes["xaxis"] = {"range": [0.0, 1.05 * factor * most]}
    bar = {"type": "bar", "orientation": "h", "width": 0.42, "hoverinfo": "skip", "showlegend": False}
    shares, colours = [factor * share for _, share, _ in rows], [colour for _, _, colour in rows]
    panel.traces.append(bar | {"y": list(range(len(rows))), "x": shares, "marker": {"color": colours}})
    for number, (name, share, _) in enumerate(rows):
        text = f"{name}: <b>{percent(share) if unit == '%' else f'{share:.2f} {unit}'}</b>"
        panel.notes.append({"x": 0, "y": number - 0.5, "text": text, "xanchor": "left", "yanchor": "middle"})
    return Figure([panel], height=70 + (46 if len(rows) <= FEW_BARS else 36) * len(rows))


def percent(share: float) -> str:
    """A share, rounded to a per cent; a small one is not shown as none."""
    return "< 1%" if 0.0 < share < 0.005 else f"{share:.0%}"


def extent(
    panel: Panel, x: float, low: float, high: float, label: str, colour: str = INK, *, below: bool = False
) -> None:
    """A vertical line between two values, with a label at its upper end, or at the lower one."""
    form = {"color": colour, "width": 2}
    panel.shapes.append({"type": "line", "x0": x, "x1": x, "y0": low, "y1": high, "line": form})
    end = {"y": low, "yanchor": "top"} if below else {"y": high, "yanchor": "bottom"}
    panel.notes.append({"x": x, "text": label} | end)


def level(
    panel: Panel,
    y: float,
    label: str = "",
    colour: str = GREY,
    *,
    dash: str = "solid",
    at: float = 1.0,
    below: bool = False,
) -> None:
    """A line from left to right, with a label at a share of its length, above it or below it."""
    form = {"color": colour, "width": 1, "dash": dash}
    panel.shapes.append({"type": "line", "xref": "domain", "x0": 0, "x1": 1, "y0": y, "y1": y, "line": form})
    if label:
        note = {"xref": "domain", "x": at, "xanchor": ENDS.get(at, "center"), "y": y, "text": label}
        panel.notes.append(note | {"yanchor": "top" if below else "bottom"})


def steps(x: Array, y: Array) -> tuple[Array, Array]:
    """Corners of a curve that is constant between the edges `x` `(n + 1,)`, with the values `y` `(n,)`."""
    return np.repeat(x, 2)[1:-1], np.repeat(y, 2)


def heat(panel: Panel, x: Array, y: Array, values: Array) -> None:
    """Cells coloured by `values` `(cells along x, along y)` on the figure's scale; `x`, `y`: their edges or middles."""
    trace = {"type": "heatmap", "x": x, "y": y, "z": values.T, "coloraxis": "coloraxis", "hoverongaps": False}
    panel.traces.append(trace | {"hovertemplate": "%{x:.4g}, %{y:.4g}: %{z:.2f}<extra></extra>"})


def arrows(panel: Panel, at: tuple[Array, Array], parts: tuple[Array, Array], vectors: Array, longest: float) -> None:
    """Arrows on a map, which end at the points `at`; they have the colour of the paper.

    parts: to the right and up, each `(n,)`; vectors `(n, 3)`: shown to the pointer; longest: length of the longest one.
    """
    length = np.hypot(*parts)
    marker = {
        "symbol": "arrow",
        "angle": np.degrees(np.arctan2(*parts)),
        "size": np.maximum(ARROW * length / longest, LEAST_ARROW),
        "color": PAPER,
        "opacity": 0.95,
        "line": {"width": 0},
    }
    trace = {"type": "scatter", "mode": "markers", "x": at[0], "y": at[1], "marker": marker, "showlegend": False}
    hover = "%{x:.4g}, %{y:.4g}: %{customdata[0]:.2f}, %{customdata[1]:.2f}, %{customdata[2]:.2f} um in x, y, z"
    panel.traces.append(trace | {"customdata": vectors, "hovertemplate": f"{hover}<extra></extra>"})


def against_normal(panel: Panel, white: Array, most: float) -> None:
    """Distribution of residuals in standard uncertainties, with that of noise alone; larger ones count as `most`."""
    edges = np.linspace(-most, most, round(10 * most) + 1)
    density, _ = np.histogram(np.clip(white.ravel(), -most, most), edges, density=True)
    middle = (edges[1:] + edges[:-1]) / 2.0
    bar = {"type": "bar", "x": middle, "y": density, "name": "residuals", "width": float(np.diff(edges)[0])}
    panel.traces.append(bar | {"marker": {"color": COLOURS[0], "opacity": 0.85, "line": {"width": 0}}})
    line(panel, edges, np.exp(-(edges**2) / 2) / np.sqrt(2 * np.pi), INK, "noise alone")
    panel.x, panel.y = "residual / standard uncertainty", "density"


def rgba(colour: str, opacity: float) -> str:
    """A colour `#rrggbb` with this opacity."""
    red, green, blue = (int(colour[i : i + 2], 16) for i in (1, 3, 5))
    return f"rgba({red},{green},{blue},{opacity:g})"


def _plain(value: Any) -> Any:
    """Numbers rounded, arrays as lists, gaps as None: ready for JSON."""
    if isinstance(value, np.ndarray):
        return [_plain(each) for each in value.tolist()]
    if isinstance(value, Mapping):
        return {key: _plain(each) for key, each in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(each) for each in value]
    if isinstance(value, (float, np.floating)):
        return float(f"{value:.{DRAWN_DIGITS}g}") if np.isfinite(value) else None
    return value.item() if isinstance(value, np.generic) else value
