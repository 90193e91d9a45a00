"""Blocks of ISO / Fanuc / LinuxCNC programs: the grammar `iso.lark`, and a quick way for plain blocks.

Nearly all blocks of a CAM program are words and perhaps one comment; a regular expression reads those, equal to what
the grammar gives (a property test holds them together). Every other block goes to Lark.
"""

from __future__ import annotations

import itertools
import re

from lark import Token
from lark.exceptions import UnexpectedCharacters, UnexpectedInput

from grammars import block_parser
from postproc.program import Block, Refusal, Word

# Written so that there is one way only to match a text: trying all would take for ever on a long block.
_WORD = r"[A-Za-z][ \t]*(?:[+-][ \t]*)?(?:\d+(?:\.\d*)?|\.\d+)"
WORDS = re.compile(rf"(?:[ \t]*{_WORD})+[ \t]*")
"""A text that holds words and nothing else."""
_PLAIN = re.compile(rf"((?:[ \t]*{_WORD})*)[ \t]*(?:\([^()\r\n]*\)[ \t]*|;[^\r\n]*)?[\r\n]*")
_PARTS = re.compile(r"([A-Za-z])[ \t]*(([+-]?)[ \t]*(\d+\.?\d*|\.\d+))")

CONSTRUCTS = ("TAPE_MARK", "SUBROUTINE", "KEYWORD", "assignment", "computed", "bracket", "NUMBER")
"""What a block may hold beside words; the first that it holds names its kind, several values to compute `compound`."""


def read_block(line: int, text: str) -> Block:
    """The block of one line of text, its end of line included. Refusal when the grammar doesn't know it."""
    return _read_plain(line, text) or parse_block(line, text)


def _read_plain(line: int, text: str) -> Block | None:
    match = _PLAIN.fullmatch(text)
    if match is None:
        return None
    words = tuple(
        [
            Word(m[1].upper(), float(m[3] + m[4]), m.start(), m.start(2), m.end())
            for m in _PARTS.finditer(text, 0, match.end(1))
        ]
    )
    return Block(line, text, "words" if words else "blank", words)


def parse_block(line: int, text: str) -> Block:
    """The block by the Lark grammar, which defines the language."""
    try:
        tree = block_parser("iso").parse(text.rstrip("\r\n"))
    except UnexpectedInput as fault:
        raise Refusal(line, text, _explain(text, fault)) from None
    words: list[Word] = []
    details: dict[str, list[str]] = {}
    for item in tree.children:
        if isinstance(item, Token) and item.type == "WORD":
            words.append(_word(item))
        elif isinstance(item, Token):
            details.setdefault(item.type, []).append(str(item))
        else:
            details.setdefault(item.data, []).append(text[item.meta.start_pos : item.meta.end_pos])
    skippable = details.pop("SKIP", None) is not None
    details.pop("COMMENT", None)
    kind, detail = "words" if words else "blank", ""
    for construct in CONSTRUCTS:
        if construct in details:
            kind, detail = construct.lower(), details[construct][0]
            break
    if kind in ("assignment", "computed") and sum(map(len, details.values())) > 1:
        kind, detail = "compound", " ".join(itertools.chain(*details.values()))
    return Block(line, text, kind, tuple(words), detail, skippable)


def _word(token: Token) -> Word:
    match = _PARTS.fullmatch(token)
    assert match is not None
    at = token.start_pos or 0
    return Word(match[1].upper(), float(match[3] + match[4]), at, at + match.start(2), at + match.end())


def _explain(text: str, fault: UnexpectedInput) -> str:
    column = fault.column if fault.column > 0 else len(text.rstrip())
    rest = text[column - 1 :].strip() if column else text
    if isinstance(fault, UnexpectedCharacters) and rest[:1] in "()":
        return f"column {column}: parentheses that do not match, or one inside another: controls read these differently"
    return f"column {column}: {rest[:20]!r} is not understood"
