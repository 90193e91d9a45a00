"""Results in a session: one line, in a notebook the tables of their report, figures of Plotly, and columns."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rendering.report import Report, Section, Table

MOST_NOTEBOOK_ROWS = 40
"""Largest number of rows of a table in a notebook."""
VIEWS: dict[str, Callable[[Any], Report]] = {}
"""The report of a result, by the name of its class; the packages of the public functions fill it."""
COLUMNS: dict[str, Callable[[Any], dict[str, Any]]] = {}
"""The columns of a result, by the name of its class, if the class does not have them itself."""


class Shown:
    """A result that shows itself."""

    __slots__ = ()

    @property
    def headline(self) -> str:
        """The result in a few words, with units."""
        return ""

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {self.headline}>"

    def _repr_html_(self) -> str | None:
        """The tables of the report, for a notebook; None for a result without a report."""
        view = VIEWS.get(type(self).__name__)
        return None if view is None else html_of(view(self))

    @property
    def columns(self) -> dict[str, Any]:
        """Arrays of one length by name, with units in the names, for a table of data; empty for a result without."""
        make = COLUMNS.get(type(self).__name__)
        return {} if make is None else make(self)

    @property
    def plots(self) -> dict[str, Any]:
        """The figures of the report by their titles, as Plotly's `Figure`."""
        from rendering.plotly_figures import plotly_figure

        view = VIEWS.get(type(self).__name__)
        drawn = () if view is None else [each for each in view(self).sections if each.figure is not None]
        return {each.title: plotly_figure(each.figure()) for each in drawn if each.figure is not None}


def html_of(report: Report) -> str:
    """The verdict and the tables of a report as HTML."""
    from html import escape

    paragraphs = [("b", report.refusal), *(("span", line) for line in report.verdict.split("\n"))]
    text = "".join(f"<p><{tag}>{escape(line)}</{tag}></p>" for tag, line in paragraphs if line)
    return f"<h3>{escape(report.title)}</h3>{text}{''.join(map(_section, report.sections))}"


def _section(section: Section) -> str:
    from html import escape

    if section.table is None:
        return ""
    title = f"<h4>{escape(section.title)}</h4>" if section.title else ""
    return title + _table(section.table)


def _table(table: Table) -> str:
    from html import escape

    head = "".join(f"<th>{escape(name)}</th>" for name in table.head)
    rows = ["".join(f"<td>{escape(cell)}</td>" for cell in row) for row in table.rows[:MOST_NOTEBOOK_ROWS]]
    more = len(table.rows) - MOST_NOTEBOOK_ROWS
    end = f"<p>{more} more rows</p>" if more > 0 else ""
    body = "".join(f"<tr>{row}</tr>" for row in rows)
    return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>{end}"
