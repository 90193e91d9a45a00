"""Reports as HTML: one file that contains its figures and loads nothing else."""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from kinematics.transforms import Array

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LONG = 1800.0
"""Duration, s, from which times are shown in hours."""
STYLE: Any = {
    "font.size": 8,
    "axes.grid": True,
    "grid.alpha": 0.3,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "svg.hashsalt": "ncomp",  # the same data give the same report
    "svg.fonttype": "none",
}


@dataclass(frozen=True)
class Table:
    """Rows of text below a heading row."""

    head: Sequence[str]
    rows: Sequence[Sequence[str]]


@dataclass(frozen=True)
class Section:
    """A heading with its content: text, a table, a figure as SVG."""

    title: str
    text: str = ""
    table: Table | None = None
    figure: str = ""


def page(title: str, lead: str, sections: Sequence[Section], verdict: str = "") -> bytes:
    """The whole page, with the verdict at its top."""
    from jinja2 import Environment, PackageLoader

    environment = Environment(
        loader=PackageLoader("calibration.pages", "."), autoescape=True, trim_blocks=True, lstrip_blocks=True
    )
    template = environment.get_template("page.html")
    return template.render(title=title, lead=lead, sections=sections, verdict=verdict).encode()


def clock(seconds: Array) -> tuple[float, str]:
    """Length, s, of the unit in which these times are shown, and the label of their axis."""
    return (3600.0, "time, h") if np.ptp(seconds) >= LONG else (1.0, "time, s")


@contextmanager
def figure(width: float, height: float) -> Iterator[tuple[Figure, list[str]]]:
    """A figure to draw on, its size in inches, and a list that holds its SVG once it is drawn."""
    import matplotlib as mpl
    from matplotlib.figure import Figure

    drawn: list[str] = []
    with mpl.rc_context(STYLE):
        canvas = Figure(figsize=(width, height), layout="constrained")
        yield canvas, drawn
        out = io.StringIO()
        canvas.savefig(out, format="svg", metadata={"Date": None})
    drawn.append(out.getvalue()[out.getvalue().index("<svg") :])
