"""Statements and formulas of HEIDENHAIN Klartext: trees of the grammar `heidenhain.lark`."""

from __future__ import annotations

import re
from collections.abc import Callable
from itertools import pairwise
from typing import Any

from lark import Token

from postproc.heidenhain.variables import REPEATS, Forget
from postproc.text.block import Block, Word
from postproc.text.expressions import Ambiguous, Constant, Expression, Formula, Operation, Variable, by_levels
from postproc.text.statements import Assign, Call, Jump, Label, Rerun, Return, Step, When

FLOW = re.compile(r"LBL|PGM|SELECTED", re.IGNORECASE)
"""Text of every block after which the next one does not always run."""
LEVELS = {"^": 3, "*": 2, "/": 2, "%": 2, "DIV": 2, "LEN": 2, "ANG": 2, "+": 1, "-": 1}
HARMLESS_FN = frozenset((14, 15, 16, 19, 20, 26, 27, 29, 37, 38))
"""That set no parameter."""
_Q = re.compile(r"([+-]?)[ \t]*(Q[LR]?)(\d+)", re.IGNORECASE)
_ONE_VALUE = re.compile(r"FN ?18 ?:? ?SYSREAD ?(Q[LR]?\d+) ?=.*", re.IGNORECASE)
_SEVERAL = re.compile(r'FN ?(\d+) ?:? ?(?:TABREAD|CDATA)? ?(Q[LR]?)(\d+) ?=[^"]*(?:"([^"]*)".*)?', re.IGNORECASE)
_OUTPUTS: dict[int, Callable[[str | None], int]] = {
    23: lambda _: 3,
    24: lambda _: 3,
    28: lambda columns: len(columns.split(",")) if columns else 0,
}
"""Number of consecutive parameters that an FN sets, by its number and the names of columns in quotes: centre and radius
of a circle (FN 23, FN 24), one parameter for each column of a table (FN 28); 0 where the block does not give it."""
_SYSREAD = re.compile(
    r"FN ?18 ?:? ?SYSREAD ?Q[LR]?\d+ ?= ?ID ?(\d+) ?NR ?(\d+)(?: ?IDX ?([+-]?(?:\d+|Q[LR]?\d+)))?", re.IGNORECASE
)
OWN = re.compile(r"QL4[5-9]\d(?!\d)", re.IGNORECASE)
"""Parameters that ncomp takes for corrected coordinates."""


def parameter(text: str) -> Expression:
    """`Q5`, `-QL3`."""
    match = _Q.fullmatch(text.strip())
    assert match is not None
    variable = Variable(match[2].upper(), (Constant(float(match[3])),))
    return Operation("neg", (variable,)) if match[1] == "-" else variable


def formula_of(text: str) -> Formula | None:
    """The formula of a word, whose value is a parameter; None for one that is a number."""
    return Formula(parameter(text), carrier=True) if _Q.fullmatch(text.strip()) else None


def _formula(node: Any) -> Expression:
    if isinstance(node, Token):
        return _leaf(node)
    return _FORMULAS[node.data](node.children)


def _leaf(token: Token) -> Expression:
    if token.type == "PI":
        return Operation("PI", ())
    if token.type == "Q":
        return parameter(token) if not token.upper().startswith("QS") else Operation("the text of a QS parameter", ())
    return Constant(float(token.replace(",", ".")))


def _chain(parts: list[Any]) -> Expression:
    """Operands with operators between them; Ambiguous where the order depends on the control."""
    powers = [i for i, part in enumerate(parts) if part == "^"]
    unclear = any(b - a == 2 for a, b in pairwise(powers))
    if unclear or any(getattr(parts[i - 1], "data", "") in ("signed", "function") for i in powers):
        raise Ambiguous(
            "a power of a power, of a function or of a number with a sign depends on the control: write brackets"
        )
    return by_levels([str(p).upper() if i % 2 else _formula(p) for i, p in enumerate(parts)], LEVELS)


_FORMULAS: dict[str, Callable[[list[Any]], Expression]] = {
    "formula": _chain,
    "group": lambda parts: _formula(parts[0]),
    "signed": lambda parts: Operation("neg" if parts[0] == "-" else "pos", (_formula(parts[1]),)),
    "function": lambda parts: Operation(str(parts[0]).upper(), (_formula(parts[1]),)),
}


def _assign(target: Token, value: Any) -> Assign:
    variable = parameter(target.rstrip("= \t"))
    assert isinstance(variable, Variable)
    return Assign(variable, _formula(value))


def _label(token: Token) -> str:
    return f"LBL {int(token)}" if token.isdigit() else f"LBL {token.upper()}"


def _label_call(parts: list[Any]) -> Step:
    name = _label(parts[1])
    if len(parts) < 4:
        return Call(name, None, local=True)
    passes = parts[3]
    if "Q" in passes.upper():
        return Rerun(name, "", Operation(REPEATS, (parameter(passes),)))
    return Rerun(name, "", Constant(float(passes.partition("/")[0].replace(",", "."))))


def _if(parts: list[Any]) -> When:
    _, _, first, comparison, second, _, label = parts
    return When(Operation(comparison.upper(), (_formula(first), _formula(second))), Jump(_label(label)))


def _mark(parts: list[Any]) -> Step:
    name = _label(parts[1])
    return Return(local=True) if name == "LBL 0" else Label(name)


_STATEMENTS: dict[str, Callable[[list[Any]], Step]] = {
    "assignment": lambda parts: _assign(parts[0], parts[1]),
    "fn_set": lambda parts: _assign(parts[1], parts[2]),
    "fn_if": _if,
    "label": _mark,
    "label_call": _label_call,
}


def statement(kind: str, parts: list[Any]) -> Step | None:
    """The statement that a block makes, None for one that is a matter of its words or of its text."""
    return _STATEMENTS[kind](parts) if kind in _STATEMENTS else None


def setting(kind: str, detail: str, words: tuple[Word, ...]) -> list[Step]:
    """Assignments of a block to parameters: by FN that read something, and by the parameters of a cycle."""
    if kind == "cycle_def":
        return [_cycle_parameter(word) for word in words if re.fullmatch(r"Q\d+", word.address)]
    if kind not in ("fn", "probe", "program_call"):
        return []
    match = _SEVERAL.fullmatch(detail)
    if match is not None and (count := _OUTPUTS.get(int(match[1]), _none)(match[4])):
        value = Operation("the value that the control reads", ())
        first = int(match[3])
        numbers = (Constant(float(number)) for number in range(first, first + count))
        return [Assign(Variable(match[2].upper(), (number,)), value) for number in numbers]
    match = _ONE_VALUE.fullmatch(detail)
    if match is not None:
        variable = parameter(match[1])
        assert isinstance(variable, Variable)
        return [Assign(variable, _read(detail))]
    number = re.match(r"FN ?(\d+)", detail, re.IGNORECASE)
    return [] if number and int(number[1]) in HARMLESS_FN else [Forget(f"{detail[:20]} may set parameters")]


def _none(_: str | None) -> int:
    return 0


def _read(detail: str) -> Expression:
    """The value of SYSREAD: known for the tool table."""
    match = _SYSREAD.fullmatch(detail)
    if match is None:
        return Operation("the value that the control reads", ())
    values = [text for text in match.groups() if text is not None]
    return Operation("SYSREAD", tuple(parameter(v) if "Q" in v.upper() else Constant(float(v)) for v in values))


def _cycle_parameter(word: Word) -> Step:
    variable = parameter(word.address)
    assert isinstance(variable, Variable)
    if word.value is not None:
        return Assign(variable, Constant(word.value))
    return Assign(
        variable, word.formula.expression if word.formula else Operation("the value of a cycle parameter", ())
    )


def labels(block: Block) -> list[str]:
    """The names under which jumps and calls find a block."""
    return [] if block.code is None else [step.name for step in block.code.before if isinstance(step, Label)]
