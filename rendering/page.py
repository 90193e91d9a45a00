"""A report as a page: one HTML file that contains its figures and loads nothing else."""

from __future__ import annotations

import io
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from rendering.report import Report

if TYPE_CHECKING:
    from matplotlib.figure import Figure

STYLE: Any = {
    "font.size": 8,
    "axes.grid": True,
    "grid.alpha": 0.3,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "svg.hashsalt": "ncomp",  # the same data give the same page
    "svg.fonttype": "none",
}
SVG_DPI = 72
"""Units per inch of an SVG."""


def page(report: Report) -> bytes:
    """The whole page, with the verdict at its top."""
    from jinja2 import Environment, PackageLoader

    environment = Environment(
        loader=PackageLoader(__package__, "."), autoescape=True, trim_blocks=True, lstrip_blocks=True
    )
    return environment.get_template("page.html").render(report=report, svg=svg).encode()


def svg(draw: Callable[[Figure], None]) -> str:
    """A figure as SVG; `draw` sets its size."""
    import matplotlib as mpl
    from matplotlib.backends.backend_svg import FigureCanvasSVG
    from matplotlib.figure import Figure

    out = io.StringIO()
    with mpl.rc_context(STYLE):
        canvas = Figure(layout="constrained")
        FigureCanvasSVG(canvas)
        draw(canvas)
        bitmaps, canvas.dpi = canvas.dpi, SVG_DPI
        if layout := canvas.get_layout_engine():  # savefig would execute it twice, and draw twice
            layout.execute(canvas)
            canvas.set_layout_engine(None)
        canvas.savefig(out, format="svg", dpi=bitmaps, metadata={"Date": None})
    return out.getvalue()[out.getvalue().index("<svg") :]
