"""What a page of a report contains: its figures, their texts and their panels."""

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

LINK = re.compile(r"""(?:src|href|xlink:href)\s*=\s*["'](?!#|data:)|@import|url\((?!#|["']?data:)""")
LIBRARY = re.compile(r'<script type="text/plain" id="library">.*?</script>', re.DOTALL)
FIGURES = re.compile(r'<script type="application/json" id="figures">(.*?)</script>', re.DOTALL)


def text_of(page: str | Path) -> str:
    """The page without its library, which is packed."""
    return LIBRARY.sub("", page if isinstance(page, str) else page.read_text())


def figures(page: str | Path) -> list[dict[str, Any]]:
    """The figures of a page."""
    found = FIGURES.search(text_of(page))
    return [] if found is None else json.loads(found[1])


def panels(page: str | Path) -> list[dict[str, Any]]:
    """The panels of all figures."""
    return [panel for figure in figures(page) for panel in figure["panels"]]


def texts(page: str | Path) -> list[str]:
    """The words of each figure."""
    return ["\n".join(_texts(figure)) for figure in figures(page)]


def _texts(value: Any) -> Iterator[str]:
    if isinstance(value, str):
        yield value
    elif isinstance(value, (list, dict)):
        for each in value.values() if isinstance(value, dict) else value:
            yield from _texts(each)
