"""A report as a page: one HTML file that contains its figures and loads nothing else."""

from __future__ import annotations

import base64
import gzip
import json
import re
from collections.abc import Callable, Sequence
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from kinematics.user_error import UserError
from rendering.report import Report, Section, Table
from rendering.si import si, si_labels

if TYPE_CHECKING:
    from jinja2 import Template

FOLDED = 20
"""Most rows of a table that is not folded."""
BREAKABLE_CHARACTERS = 16
"""Length of a word, in characters, from which it may be broken."""
PHONE = 364
"""Width of the page of a phone, px."""
USUAL_LETTER_PX, TIGHT_LETTER_PX = (8.0, 7.2), (7.0, 4.0)
"""Width, px, of a letter of a table there and of the gap behind a column, in usual and in small print."""
BROAD, SLIM = "mwMWOQGµ", "iljtfrI.,:;|()[]/-"
"""Letters that are wider and narrower than others, by half of a letter."""
BOLD = 1.13
"""Width of a letter of the heading row, in letters."""
UNBROKEN_CHARACTERS = 26
"""Most characters of the cells of a first column that are not broken on a wide page."""
NUMBER = re.compile(r"[-+<>≤≥ ]*\d[\d.,]*(e[-+]?\d+)?( ± [\d.,]+)?( ?%)?")
HERE = Path(__file__).parent


class Form(NamedTuple):
    """Form of a table."""

    numeric: list[bool]
    """True for a column of numbers behind the first column: they are aligned to the right."""
    phone: str
    """Class for a table that is too wide for a phone: `tight` for small print; `cards`: each row is a card with named
    values; empty for others."""
    short: bool
    """True for short cells in the first column."""


def page(report: Report, done: Callable[[float], None] = lambda _: None) -> bytes:
    """The whole page, with the verdict at its top; done: called with the share of its figures that are drawn."""
    figures, drawn = [], [each.figure for each in report.sections if each.figure]
    for number, figure in enumerate(drawn):
        done(number / len(drawn))
        figures.append(figure().spec())
    return (
        _template()
        .render(
            report=report,
            folded=_folded,
            form_of=_form,
            style=(HERE / "page.css").read_text(encoding="utf-8"),
            script=(HERE / "page.js").read_text(encoding="utf-8"),
            figures=as_script(si_labels(figures)) if figures else "",
            library=_library() if figures else "",
        )
        .encode(errors="replace")  # a name of a file may hold bytes that are no text
    )


@cache
def _template() -> Template:
    """The page with its gaps, translated once in a process."""
    from jinja2 import Environment, FileSystemLoader

    environment = Environment(loader=FileSystemLoader(HERE), autoescape=True, trim_blocks=True, lstrip_blocks=True)
    environment.filters["si"], environment.filters["css_text"] = si, css_text
    environment.tests["unbroken"] = _unbroken
    return environment.get_template("page.html")


def as_script(value: object) -> str:
    """JSON for the inside of an element of HTML."""
    text = json.dumps(value, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    return text.replace("</", "<\\/").replace("<!--", "<\\u0021--")


def css_text(text: str) -> str:
    """A text for the inside of an element `style`: every character but letters, digits and spaces by its number."""
    return '"' + "".join(c if c.isalnum() or c == " " else f"\\{ord(c):x} " for c in f"ncomp · {text}") + '"'


def _unbroken(text: str) -> bool:
    """True for a cell with a word that may be wider than a column of a phone: a name of a file."""
    return max(map(len, text.split()), default=0) > BREAKABLE_CHARACTERS


def _form(table: Table) -> Form:
    columns = [[name, *cells] for name, *cells in zip(table.head, *table.rows, strict=True)]
    numeric = [number > 0 and _numbers(cells[1:]) for number, cells in enumerate(columns)]
    words = [max(BOLD * _widest(cells[:1]), _widest(cells[1:])) for cells in columns]
    fits = [
        sum(letter * letters + gap for letters in words) <= PHONE for letter, gap in (USUAL_LETTER_PX, TIGHT_LETTER_PX)
    ]
    short = max((len(cell) for cell in columns[0]), default=0) <= UNBROKEN_CHARACTERS
    return Form(numeric, "" if fits[0] else "tight" if fits[1] else "cards", short)


def _widest(cells: Sequence[str]) -> float:
    """Width of the widest word, in letters."""
    return max((_letters(word) for cell in cells for word in cell.split()), default=0.0)


def _letters(word: str) -> float:
    """Width of a word, in letters; a long word may be broken."""
    broad, slim = (sum(letter in kind for letter in word[:BREAKABLE_CHARACTERS]) for kind in (BROAD, SLIM))
    return min(len(word), BREAKABLE_CHARACTERS) + (broad - slim) / 2.0


def _numbers(cells: Sequence[str]) -> bool:
    """True for cells with numbers, of which some may be empty."""
    given = [cell for cell in cells if cell]
    return bool(given) and all(NUMBER.fullmatch(cell) for cell in given)


def _folded(section: Section) -> bool:
    """True for a long table, and for text that is only looked up."""
    rows = 0 if section.table is None else len(section.table.rows)
    return rows > FOLDED or (section.detail and section.figure is None)


@cache
def _library() -> str:
    """Plotly's JavaScript, packed, as base64; packed once in a process."""
    found = find_spec("plotly")
    if found is None or not found.submodule_search_locations:
        raise UserError("the page needs the package plotly: pip install plotly")
    path = Path(found.submodule_search_locations[0]) / "package_data" / "plotly.min.js"
    return base64.b64encode(gzip.compress(path.read_bytes(), mtime=0)).decode()
