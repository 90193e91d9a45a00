"""A figure of a report as an object of Plotly."""

from __future__ import annotations

from typing import Any

from rendering.figures import Figure

GAP = 0.06
"""Share of a figure between two of its panels."""
WIDTH_PX = 900
MARGINS_PX, TITLE_PX = 80, 60
"""Height above and below all panels, and of the title of each row of them."""


def plotly_figure(figure: Figure) -> Any:
    """The panels of a figure in rows, as `plotly.graph_objects.Figure`."""
    from plotly import graph_objects  # type: ignore[import-untyped]

    spec = figure.spec()
    panels = spec["panels"]
    across = min(spec["across"], len(panels))
    down = -(-len(panels) // across)
    data: list[dict[str, Any]] = []
    layout: dict[str, Any] = {
        "width": WIDTH_PX,
        "height": MARGINS_PX + down * (spec["height"] + TITLE_PX),
        "annotations": [],
    }
    layout["shapes"] = []
    for i, panel in enumerate(panels):
        column, row = i % across, i // across
        high = 1.0 / down
        domain = {
            "x": [column / across + GAP / 2, (column + 1) / across - GAP / 2],
            "y": [1.0 - (row + 1) * high + GAP / 2, 1.0 - row * high - GAP / 2],
        }
        where = _placed(layout, panel, "" if i == 0 else str(i + 1), domain)
        data += [{**trace, **where} for trace in panel.get("traces", ())]
    if spec["colours"]:
        layout["coloraxis"] = spec["colours"]
    return graph_objects.Figure({"data": data, "layout": layout}, skip_invalid=True)


def _placed(
    layout: dict[str, Any], panel: dict[str, Any], number: str, domain: dict[str, list[float]]
) -> dict[str, str]:
    """Add the axes, the title and the notes of a panel to the layout; the names of the axes for its traces."""
    own = panel.get("axes", {})
    if panel.get("title"):
        middle = sum(domain["x"]) / 2
        layout["annotations"].append(
            {"text": panel["title"], "x": middle, "y": domain["y"][1], "xref": "paper", "yref": "paper"}
            | {"showarrow": False, "xanchor": "center", "yanchor": "bottom"}
        )
    kind = panel.get("kind", "xy")
    if kind == "scene":
        titles = {f"{name}axis": {"title": panel.get(name, "")} | own.get(f"{name}axis", {}) for name in "xyz"}
        layout[f"scene{number}"] = {"domain": domain, "aspectmode": "data", **titles, **own.get("scene", {})}
        return {"scene": f"scene{number}"}
    if kind == "polar":
        layout[f"polar{number}"] = {"domain": domain, **own.get("polar", {})}
        return {"subplot": f"polar{number}"}
    for name, other in (("x", "y"), ("y", "x")):
        layout[f"{name}axis{number}"] = {
            "title": panel.get(name, ""), "domain": domain[name], "anchor": f"{other}{number}",
            **own.get(f"{name}axis", {}),
        }  # fmt: skip
    for note in panel.get("notes", ()):
        layout["annotations"].append({"showarrow": False, "yref": f"y{number}", **note, "xref": f"x{number}"})
    for shape in panel.get("shapes", ()):
        across = f"x{number} domain" if shape.get("xref") == "domain" else f"x{number}"
        layout["shapes"].append({"yref": f"y{number}", **shape, "xref": across})
    return {"xaxis": f"x{number}", "yaxis": f"y{number}"}
