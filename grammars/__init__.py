"""The Lark grammars, one file per dialect; each describes one block of an NC program."""

from __future__ import annotations

from functools import cache
from pathlib import Path

from lark import Lark

FOLDER = Path(__file__).parent


@cache
def block_parser(dialect: str) -> Lark:
    """The parser of one block of a dialect: `iso` or `heidenhain`."""
    text = (FOLDER / f"{dialect}.lark").read_text(encoding="ascii")
    return Lark(text, parser="lalr", lexer="contextual", maybe_placeholders=False, propagate_positions=True)
