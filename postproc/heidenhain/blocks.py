"""Blocks of HEIDENHAIN Klartext programs: the grammar `heidenhain.lark`, and a quick reader of plain blocks.

Nearly all blocks of a CAM program are straight lines; a regular expression reads those and comments, equal to what
the grammar gives (a property test holds them together). Every other block goes to Lark.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator

from lark import Token, Tree
from lark.exceptions import UnexpectedInput, UnexpectedToken

from grammars import block_parser
from postproc.heidenhain.statements import formula_of, setting, statement
from postproc.text.block import Block, Refusal, Word, not_understood
from postproc.text.block_values import check_order
from postproc.text.expressions import Ambiguous
from postproc.text.statements import Code

_VALUE = r"([+-]?)[ \t]*(\d+(?:[.,]\d*)?|[.,]\d+)"
_WORD = rf"[ \t]*({_VALUE})|F[ \t]*MAX|R[0LR]?|F(?![UZ])|M(?!B)"
_PARTS = re.compile(rf"(I?[XYZABCUVW]|[FSM]){_WORD}", re.IGNORECASE)
_PARTS_WITH_VECTORS = re.compile(rf"([NT][XYZ]|I?[XYZABCUVW]|[FSM]){_WORD}", re.IGNORECASE)
_PLAIN, _PLAIN_WITH_VECTORS = (
    re.compile(rf"[ \t]*(?:\d+[ \t]*)?({head}(?:[ \t]*(?>{parts.pattern}))*+)?[ \t]*(?:;[^\n]*)?[\r\n]*", re.IGNORECASE)
    for head, parts in (("L", _PARTS), ("LN", _PARTS_WITH_VECTORS))
)
_NUMBER = re.compile(_VALUE)
_VALUED = re.compile(rf"(DR2(?=[ \t]*[+-])|P[123][XYZ]|[A-Z]+?)[ \t]*({_VALUE}|[+-]?[ \t]*Q[LR]?\d+)", re.IGNORECASE)
_CONTINUED = re.compile(r"~[ \t]*\r(?!\n)")
"""Lines that end with a carriage return alone, in one block."""
_COMMENT = re.compile(r"[ \t]*(?:\d+[ \t]*)?;")
"""The beginning of a block that is a comment."""
_PARAMETER = re.compile(r"(Q\d+)[ \t]*=[ \t]*(.*?)[ \t]*", re.IGNORECASE)


def join_lines(lines: Iterable[tuple[int, str]]) -> Iterator[tuple[int, str]]:
    """Lines joined to blocks: a line that ends with `~` goes on in the next. Number of the first line, text of all."""
    first, text = 0, ""
    for number, line in lines:
        if not text:
            first = number
        text += line
        if "~" in line and line.rstrip(" \t\r\n").endswith("~"):
            continue
        yield first, text
        text = ""
    if text:
        yield first, text


def read_block(line: int, text: str) -> Block:
    """The block of one joined text, its end of line included. Refusal when the grammar doesn't know it."""
    if "\r" in text and _CONTINUED.search(text):
        read = text.replace("\r", "\n")  # so that a comment ends with its line
        return _read(line, read)._replace(text=text)
    return _read(line, text)


def _read(line: int, text: str) -> Block:
    return _read_plain(line, text) or _continued_comment(line, text) or parse_block(line, text)


def _read_plain(line: int, text: str) -> Block | None:
    kind, head, parts, match = "line", "", _PARTS, _PLAIN.fullmatch(text)
    if match is None:
        kind, parts, match = "normal_line", _PARTS_WITH_VECTORS, _PLAIN_WITH_VECTORS.fullmatch(text)
        if match is None:
            return None
        head = text[match.start(1) : match.start(1) + 2]
    start, end = match.span(1)
    if start < 0:
        return Block(line, text, "blank")
    words = tuple(
        [
            Word(m[1].upper(), float((m[3] + m[4]).replace(",", ".")), m.start(), m.start(2), m.end())
            if m[1]
            else _flag(m[0], m.start())
            for m in parts.finditer(text, start + max(len(head), 1), end)
        ]
    )
    return Block(line, text, kind, words, head)


def _continued_comment(line: int, text: str) -> Block | None:
    """A block of a comment alone that goes on behind `~`; None for others. Refusal where that might be a block."""
    first, *more = text.split("\n")
    if not any(more) or not _COMMENT.match(first):
        return None
    for number, rest in enumerate(filter(str.strip, more), start=1):
        try:
            kind = parse_block(line + number, rest).kind
        except Refusal:
            continue
        if kind != "blank":
            raise Refusal(
                line,
                text,
                f"line {number + 1} of this comment, {rest.strip()!r}, may be a block that the control does not run: "
                "take out the ~ before it, or begin it with a semicolon",
            )
    return Block(line, text, "blank")


def parse_block(line: int, text: str) -> Block:
    """The block by the Lark grammar, which defines the language."""
    try:
        tree = block_parser("heidenhain").parse(text.rstrip("\r\n"))
    except UnexpectedInput as fault:
        raise Refusal(line, text, _explain(text, fault)) from None
    skippable = any(isinstance(child, Token) for child in tree.children)
    statements = [child for child in tree.children if isinstance(child, Tree)]
    if not statements:
        return Block(line, text, "blank", (), "", skippable)
    kind, parts = str(statements[0].data), statements[0].children
    try:
        step = statement(kind, parts)
    except Ambiguous as reason:
        raise Refusal(line, text, str(reason)) from None
    if step is not None:
        return check_order(Block(line, text, "control", (), "", skippable, Code((step,))))
    words: list[Word] = []
    detail: list[str] = []
    for item in parts:
        if isinstance(item, Token):
            detail += item.split()
        else:
            words.append(_word(item))
    steps = setting(kind, " ".join(detail), tuple(words))
    code = Code((), tuple(steps)) if steps or any(word.formula for word in words) else None
    return Block(line, text, kind, tuple(words), " ".join(detail), skippable, code)


def _word(item: Tree[Token]) -> Word:
    token = item.children[0]
    assert isinstance(token, Token)
    at = token.start_pos or 0
    if item.data == "flag":
        return _flag(token, at)
    if item.data == "tool":
        return Word("T", _number(token), at, at, at + len(token), formula_of(token))
    match = (_PARAMETER if item.data == "parameter" else _VALUED).fullmatch(token)
    assert match is not None
    formula = formula_of(match[2])
    return Word(match[1].upper(), _number(match[2]), at, at + match.start(2), at + match.end(2), formula)


def _flag(text: str, at: int) -> Word:
    """An address without a number, `F MAX` as FMAX."""
    end = at + len(text)
    return Word("".join(text.upper().split()), None, at, end, end)


def _number(text: str) -> float | None:
    """None when it is no number but a Q parameter or a name, known only while the program runs."""
    match = _NUMBER.fullmatch(text)
    return None if match is None else float((match[1] + match[2]).replace(",", "."))


def _explain(text: str, fault: UnexpectedInput) -> str:
    if isinstance(fault, UnexpectedToken) and fault.token.type == "$END":
        return "the block is not complete: complete it"
    position = fault.pos_in_stream or 0
    where = f"line {fault.line} of the block, column" if fault.line > 1 else "column"
    return f"{where} {fault.column}: {not_understood(text, position, bare=True)}"
