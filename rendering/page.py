"""A report as a page: one HTML file that contains its figures and loads nothing else."""

from __future__ import annotations

import base64
import gzip
import json
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path

from kinematics.user_error import UserError
from rendering.report import Report, Section
from rendering.si import si, si_labels

FOLDED = 20
"""Most rows of a table that is not folded."""
WORD = 16
"""Length of a word, in characters, from which it may be broken."""
HERE = Path(__file__).parent


def page(report: Report, done: Callable[[float], None] = lambda _: None) -> bytes:
    """The whole page, with the verdict at its top; done: called with the share of its figures that are drawn."""
    from jinja2 import Environment, FileSystemLoader

    environment = Environment(loader=FileSystemLoader(HERE), autoescape=True, trim_blocks=True, lstrip_blocks=True)
    environment.filters["si"] = si
    environment.tests["unbroken"] = _unbroken
    figures, drawn = [], [each.figure for each in (*report.before, *report.sections) if each.figure]
    for number, figure in enumerate(drawn):
        done(number / len(drawn))
        figures.append(figure().spec())
    return (
        environment.get_template("page.html")
        .render(
            report=report,
            folded=_folded,
            style=(HERE / "page.css").read_text(encoding="utf-8"),
            script=(HERE / "page.js").read_text(encoding="utf-8"),
            figures=as_script(si_labels(figures)) if figures else "",
            library=_library() if figures else "",
        )
        .encode()
    )


def as_script(value: object) -> str:
    """JSON that can stand inside an element of HTML."""
    text = json.dumps(value, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    return text.replace("</", "<\\/").replace("<!--", "<\\u0021--")


def _unbroken(text: str) -> bool:
    """True for a cell with a word that may be wider than a column of a phone: a name of a file."""
    return max(map(len, text.split()), default=0) > WORD


def _folded(section: Section) -> bool:
    """True for a long table, and for text that is only looked up."""
    rows = 0 if section.table is None else len(section.table.rows)
    return rows > FOLDED or (section.detail and section.figure is None)


def _library() -> str:
    """Plotly's JavaScript, packed, as base64."""
    found = find_spec("plotly")
    if found is None or not found.submodule_search_locations:
        raise UserError("the page needs the package plotly: pip install plotly")
    path = Path(found.submodule_search_locations[0]) / "package_data" / "plotly.min.js"
    return base64.b64encode(gzip.compress(path.read_bytes(), mtime=0)).decode()
