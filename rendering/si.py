"""Symbols of the SI on pages, for the plain letters that terminals, keys and files use."""

from __future__ import annotations

import re
from typing import Any

ALONE = (r"(?<![\w.\-=/\\])", r"(?![\w\-=])(?!\.\w)")
"""A unit is a word of its own: it is no part of a name, an option, a path or a key."""
SYMBOLS = [
    (re.compile(f"{ALONE[0]}{plain}{ALONE[1]}"), symbol)
    for plain, symbol in (
        (r"um/m", "µm/m"), (r"um", "µm"), (r"urad/m", "µrad/m"), (r"urad", "µrad"), (r"degC", "°C"),
        (r"chi2/dof", "χ²/dof"), (r"dBIC", "ΔBIC"),
    )
]  # fmt: skip
AFTER_NUMBER = (
    (re.compile(r"(?<=\d)%"), "\N{NO-BREAK SPACE}%"),
    (re.compile(r"(?<=\d) deg\b(?!C)"), "°"),
    (re.compile(r"(?<=[,(] )deg\b(?!C)"), "°"),
)
SIGNS = ((" -> ", " → "), (" +- ", " ± "), (" >= ", " ≥ "), (" <= ", " ≤ "))


def si(text: str) -> str:
    """A sentence or a label with the symbols of the SI."""
    for pattern, symbol in (*SYMBOLS, *AFTER_NUMBER):
        text = pattern.sub(symbol, text)
    for plain, sign in SIGNS:
        text = text.replace(plain, sign)
    return text


def si_labels(value: Any) -> Any:
    """The same for all texts of a figure."""
    if isinstance(value, str):
        return si(value)
    if isinstance(value, dict):
        return {key: si_labels(each) for key, each in value.items()}
    if isinstance(value, list):
        return value if value and isinstance(value[0], (float, int)) else [si_labels(each) for each in value]
    return value
