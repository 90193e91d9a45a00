"""Files of results as lines of text, so that a difference is shown where it is."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Sequence
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

DIGITS = 9
"""Significant digits of a number of JSON that are stored."""
WIDTH = 110
"""Characters: a value of JSON that is longer is split into its entries."""
EACH = 8
"""Numbers on a line of a long list."""
ENTRIES = 16
"""A list of JSON of more entries is thinned to about as many, and its norm stands in front where they are numbers."""
LINES = 80
"""A text file of more lines is thinned to about as many."""
HIDDEN = {"script", "style", "svg", "head"}
BLOCKS = {"p", "tr", "li", "h1", "h2", "h3", "h4", "div", "section", "summary", "caption", "figcaption", "dt", "dd"}


def lines_of(path: Path) -> list[str]:
    """A file as lines: JSON by the paths of its values, the visible text of a page, any other text thinned."""
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".json":
        return list(_of_json("", _without_covariance(json.loads(text))))
    if path.suffix == ".html":
        return _of_page(text)
    return _thinned(text.splitlines())


def _of_json(path: str, value: Any) -> Iterator[str]:
    short = _compact(value)
    if len(short) <= WIDTH or not isinstance(value, (dict, list)):
        yield f"{path}: {short}"
    elif isinstance(value, dict):
        for key, each in value.items():
            yield from _of_json(f"{path}.{key}" if path else key, each)
    elif all(isinstance(each, (int, float)) for each in value):
        yield f"{path}.norm: {_compact(math.hypot(*value))} of {len(value)}"
        for start in range(0, len(entries := value[:: _step(value, ENTRIES)]), EACH):
            yield f"{path}[{start}:]: {_compact(entries[start : start + EACH])}"
    else:
        for number in range(0, len(value), _step(value, ENTRIES)):
            yield from _of_json(f"{path}[{number}]", value[number])


def _step(values: Sequence[Any], most: int) -> int:
    return math.ceil(len(values) / most)


def _compact(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.{DIGITS}g}"
    if isinstance(value, list):
        return f"[{', '.join(map(_compact, value))}]"
    if isinstance(value, dict):
        return f"{{{', '.join(f'{key}: {_compact(each)}' for key, each in value.items())}}}"
    return json.dumps(value, ensure_ascii=False)


def _without_covariance(value: Any) -> Any:
    """A calibration with the standard uncertainties and the norm of its covariance in place of the matrix."""
    if isinstance(value, dict) and isinstance(matrix := value.get("covariance"), list) and matrix:
        norm = math.sqrt(math.fsum(entry**2 for row in matrix for entry in row))
        u = [math.sqrt(max(row[number], 0.0)) for number, row in enumerate(matrix)]
        return {**value, "covariance": {"norm": norm, "u": u}}
    return value


class _Visible(HTMLParser):
    """Collects the visible text of a page, a line for each block."""

    def __init__(self) -> None:
        super().__init__()
        self.hidden = 0
        self.lines = [""]

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        del attrs
        self.hidden += tag in HIDDEN
        if tag in BLOCKS:
            self.lines.append("")
        elif tag in ("td", "th"):
            self.lines[-1] += " | "

    def handle_endtag(self, tag: str) -> None:
        self.hidden -= tag in HIDDEN
        if tag in BLOCKS:
            self.lines.append("")

    def handle_data(self, data: str) -> None:
        if not self.hidden:
            self.lines[-1] += data


def _of_page(text: str) -> list[str]:
    page = _Visible()
    page.feed(text)
    return [" ".join(line.split()) for line in page.lines if line.strip()]


def _thinned(lines: list[str]) -> list[str]:
    if len(lines) <= LINES:
        return lines
    half = LINES // 2
    step = _step(lines[half:], half)
    return [*lines[:half], f"(every {step}th of the others; {len(lines)} lines in all)", *lines[half::step]]
