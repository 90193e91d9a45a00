"""Blocks of Siemens 840D programs: the grammar `siemens.lark`, and a quick reader of plain blocks.

Nearly all blocks of a CAM program are words and perhaps a comment; a regular expression reads those, equal to what the
grammar gives. Every other block goes to Lark.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from lark import Token
from lark.exceptions import UnexpectedInput

from grammars import block_parser
from postproc.siemens.reading.declarations import Lose
from postproc.siemens.reading.statements import arguments, formula, number_of, statement, structure, valued
from postproc.siemens.variables import set_by
from postproc.siemens.words import OF_CONTROL, is_known
from postproc.text.block import Block, Refusal, Word, not_understood
from postproc.text.block_values import check_order
from postproc.text.expressions import Ambiguous, Constant, Variable
from postproc.text.line_numbers import original
from postproc.text.plain_lines import read_plain
from postproc.text.statements import Code, Label, Return, Step, When

_WORD = r"[A-Za-z][ \t]*[+-]?(?:\d+(?:\.\d*)?|\.\d+)"
_VECTOR = r"[ \t][A-Ca-c]3=[+-]?(?:\d+(?:\.\d*)?|\.\d+)(?![^ \t\r\n;])"
_PLAIN = re.compile(rf"([ \t]*(?:[Nn]\d+)?(?:[ \t]*{_WORD}|[ \t]*{_VECTOR})*)[ \t]*(?:;[^\r\n]*)?[\r\n]*")
_PARTS = re.compile(r"([A-Za-z](?:3(?==))?)(?:=|[ \t]*)(([+-]?)(\d+\.?\d*|\.\d+)(?:[Ee][Xx][+-]?\d+)?)")


def read_block(line: int, text: str) -> Block:
    """The block of one line of text, its end of line included. Refusal when the grammar doesn't know it."""
    return _read_plain(line, text) or parse_block(line, text)


def _read_plain(line: int, text: str) -> Block | None:
    return read_plain(line, text, _PLAIN, _PARTS)


def parse_block(line: int, text: str) -> Block:
    """The block by the Lark grammar, which defines the language."""
    try:
        tree = block_parser("siemens").parse(text.rstrip("\r\n"))
    except UnexpectedInput as fault:
        raise Refusal(line, text, _explain(text, fault)) from None
    parts = _Parts()
    try:
        for item in tree.children:
            parts.take(item)
    except Ambiguous as reason:
        raise Refusal(line, text, str(reason)) from None
    words, steps = tuple(parts.words), tuple(parts.steps)
    after = _lost(words)
    code = Code(steps, after) if steps or after or any(word.formula for word in words) else None
    if parts.kind == "header" and original(line) > 1:
        code = Code((Return(),))
    kind = parts.kind or ("words" if words else "control" if steps else "blank")
    return _checked(Block(line, text, kind, words, "", parts.skippable, code))


@dataclass
class _Parts:
    """The parts of a block."""

    words: list[Word] = field(default_factory=list)
    steps: list[Step] = field(default_factory=list)
    kind: str = ""
    skippable: bool = False

    def take(self, item: Any) -> None:
        """Sort in one part of the block."""
        name = item.type if isinstance(item, Token) else item.data
        if name == "HEADER":
            self.kind = "header"
        elif name == "SKIP":
            self.skippable = True
        elif name in _WORDS:
            self.words.append(_WORDS[name](item))
        elif name == "valued":
            found = valued(item)
            if isinstance(found, Word):
                self.words.append(found)
            else:
                self.steps.append(found)
        elif name == "LABEL":
            self.steps.append(Label(item.rstrip(": \t").upper()))
        elif name == "STRUCTURE":
            self.steps.append(structure(item))
        elif name != "COMMENT":
            self.steps += statement(item)


def _lost(words: tuple[Word, ...]) -> tuple[Step, ...]:
    """The steps for variables that calls, and functions in their arguments, may set."""
    steps: list[Step] = []
    for word in words:
        if word.arguments:
            steps += [Lose(*found) for argument in word.arguments for found in set_by(argument)]
            if not is_known(word.address, word) and not OF_CONTROL.fullmatch(word.address):
                steps += [Lose(word.address, given) for given in word.arguments if isinstance(given, Variable)]
    return tuple(steps)


def _checked(block: Block) -> Block:
    """Refuse a jump, loop or branch in a block with other words."""
    steps = [] if block.code is None else [step for step in block.code.before if not isinstance(step, Label)]
    if block.code is not None and block.code.turns:
        others = [word for word in block.words if word.address != "N"]
        if others or (len(steps) > 1 and not all(_is_jump(step) for step in steps)):
            raise block.refuse(
                "a jump, loop or branch must be alone in its block: write the other words in a block of their own"
            )
    return check_order(block)


def _is_jump(step: Step) -> bool:
    """True for IF ... GOTO without an ELSE, of which a block may have several."""
    return isinstance(step, When) and step.otherwise is None


def _number(token: Token) -> Word:
    at = token.start_pos or 0
    return Word("N", float(token[1:]), at, at + 1, at + len(token))


def _word(token: Token) -> Word:
    match = _PARTS.fullmatch(token)
    assert match is not None
    at = token.start_pos or 0
    return Word(match[1].upper(), number_of(match[2]), at, at + match.start(2), at + match.end())


def _name(address: str, at: int, end: int) -> Word:
    """A word without a value."""
    return Word(address, None, at, end, end)


def _call(item: Any) -> Word:
    """A call with its arguments; one of none has an empty one."""
    word = _name(item.children[0].upper(), item.meta.start_pos, item.meta.end_pos)
    return word._replace(arguments=arguments(item.children[1]))


def _called(item: Any) -> Word:
    """CALL "PART", CALL "L" << R1, EXTCALL "PART.SPF": the name of the program as its argument."""
    word = _name(item.children[0].upper(), item.meta.start_pos, item.meta.end_pos)
    return word._replace(arguments=(formula(item.children[1]),))


def _called_by_path(item: Any) -> Word:
    """PCALL /_N_WKS_DIR/PART(1, 2): the path as a text, and the arguments of the program behind it."""
    address, path = item.children[0].split(maxsplit=1)
    word = _name(address.upper(), item.meta.start_pos, item.meta.end_pos)
    given = arguments(item.children[1]) if len(item.children) > 1 else ()
    return word._replace(arguments=(Constant(path), *given))


def _bare(token: Token) -> Word:
    """The first word of a token."""
    name = re.split(r"[\s=(]", token.upper(), maxsplit=1)[0]
    return _name(name, token.start_pos or 0, (token.start_pos or 0) + len(token))


_WORDS: dict[str, Callable[[Any], Word]] = {
    "BLOCK_NUMBER": _number,
    "WORD": _word,
    "BARE": _bare,
    "EXTERN": _bare,
    "SYNCHRONOUS": _bare,
    "PARTIAL": _bare,
    "call": _call,
    "called": _called,
    "called_by_path": _called_by_path,
}


def _explain(text: str, fault: UnexpectedInput) -> str:
    column = fault.column if fault.column > 0 else len(text.rstrip())
    rest = text[column - 1 :].strip()
    return f"column {column}: {not_understood(text, column - 1)}" if rest else "the block is not complete: complete it"
