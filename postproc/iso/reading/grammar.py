"""The grammar `iso.lark` of ISO / Fanuc / LinuxCNC blocks, which defines the language."""

from __future__ import annotations

import re
from typing import Any

from lark import Token, Tree
from lark.exceptions import UnexpectedCharacters, UnexpectedInput

from grammars import block_parser
from postproc.iso.reading.blocks import NO_NUMBER, PARTS
from postproc.iso.reading.calls import CALLS
from postproc.iso.reading.statements import computed_word, returned, statement
from postproc.text.block import Block, Refusal, Word, not_understood
from postproc.text.block_values import check_order
from postproc.text.expressions import Ambiguous
from postproc.text.statements import Code, Step


def parse_block(line: int, text: str) -> Block:
    """The block by the grammar. Refusal for a text that the grammar does not know."""
    try:
        tree = block_parser("iso").parse(text.rstrip("\r\n"))
    except UnexpectedInput as fault:
        raise Refusal(line, text, _explain(text, fault)) from None
    words: list[Word] = []
    steps: list[Step] = []
    statements = 0
    kind, detail, skippable = "", "", False
    try:
        items: list[Any] = tree.children
        for item in items:
            match item.type if isinstance(item, Token) else item.data:
                case "WORD" | "CORNER":
                    words.append(_word(item))
                case "computed":
                    words.append(computed_word(item))
                case "PROGRAM" | "REPEATED" as construct:
                    words.append(_program(item) if construct == "PROGRAM" else _repeated(item, text))
                case "SKIP":
                    skippable = True
                case "COMMENT" | "OUTPUT":
                    pass
                case "TAPE_MARK" | "COMMAND" | "NUMBER" | "bracket" as construct:
                    kind, detail = construct.lower(), _text_of(text, item)
                case _:
                    statements += 1
                    steps += (*returned(item), statement(item))
    except Ambiguous as reason:
        raise Refusal(line, text, str(reason)) from None
    code = Code(tuple(steps)) if steps or any(word.formula for word in words) else None
    kind = kind or ("words" if words else "control" if steps else "blank")
    block = Block(line, text, kind, tuple(words), detail, skippable, code)
    if statements > 1 and code is not None and code.turns:
        raise block.refuse(
            "a jump, loop or branch must be the only statement of its block: write the other statement "
            "in a block of its own"
        )
    return check_order(block)


def _text_of(text: str, item: Tree[Token] | Token) -> str:
    return str(item) if isinstance(item, Token) else text[item.meta.start_pos : item.meta.end_pos]


def _word(token: Token) -> Word:
    comma = "," if token.startswith(",") else ""
    match = PARTS.search(token)
    assert match is not None
    at = token.start_pos or 0
    return Word(comma + match[1].upper(), float(match[3] + match[4]), at, at + match.start(2), at + match.end())


def _repeated(token: Token, text: str) -> Word:
    """P of M98 with a blank between the number of repetitions and that of the program; Ambiguous outside of a call."""
    if not CALLS.search(text):
        raise Ambiguous("the number has no address before it: write the address")
    at, digits = token.start_pos or 0, "".join(token[1:].split())
    return Word("P", float(digits), at, at + 1, at + len(token))


def _program(token: Token) -> Word:
    """A program that is named without O, as FANUC allows it: by a colon and its number, or by a name."""
    at = token.start_pos or 0
    number = float(token[1:]) if token.startswith(":") else NO_NUMBER
    return Word("O", number, at, at + 1, at + len(token))


CORNERS = {
    "C": "breaks the corner by a chamfer",
    "R": "rounds the corner",
    "A": "gives the end of the line by its angle",
}
"""Addresses behind a comma (FANUC, HAAS)."""
_CORNER = re.compile(r",[ \t]*([CRA])[ \t]*[+-]?[#\[][^ \t]*", re.IGNORECASE)


def _explain(text: str, fault: UnexpectedInput) -> str:
    column = fault.column if fault.column > 0 else len(text.rstrip())
    rest = text[column - 1 :].strip() if column else text
    if isinstance(fault, UnexpectedCharacters) and rest[:1] in "()":
        return (
            f"column {column}: controls differ in parentheses that do not match or that are nested: write the comment "
            "in one pair"
        )
    if corner := _CORNER.match(rest):
        return f"{corner[0].strip()} {CORNERS[corner[1].upper()]}, and is corrected as a number only: write one"
    return f"column {column}: {not_understood(text, max(column - 1, 0))}"
