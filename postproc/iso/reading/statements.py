"""Statements of ISO / Fanuc / LinuxCNC blocks: trees of the grammar `iso.lark`."""

from __future__ import annotations

import re
from collections.abc import Callable
from itertools import pairwise
from typing import Any

from lark import Token, Tree

from postproc.iso.variables import EXISTS, RETURNED, VALUE
from postproc.text.block import Word
from postproc.text.expressions import Ambiguous, Constant, Expression, Formula, Operation, Variable
from postproc.text.statements import (
    Again,
    Assign,
    Begin,
    Call,
    Else,
    End,
    Jump,
    Leave,
    Return,
    Step,
    When,
)

Node = Tree[Token] | Token


# ---- expressions


def expression(node: Node) -> Expression:
    """The expression of a part of a block."""
    if isinstance(node, Token):
        return Constant(float(node))
    return _EXPRESSIONS[node.data](node.children)


def _variable(inner: Node) -> Variable:
    """`#5`, `#[...]`, `##5` or `#<name>`, by the text after the first `#`."""
    if isinstance(inner, Token) and inner.type == "NAME":
        return Variable("#" + re.sub(r"[ \t]", "", inner).lower())
    return Variable("#", (expression(inner),))


def _chain(children: list[Node], name: Callable[[Token], str]) -> Expression:
    """Operands with operators between them, worked out from left to right."""
    result = expression(children[0])
    for operator, operand in zip(children[1::2], children[2::2], strict=True):
        assert isinstance(operator, Token)
        result = Operation(name(operator), (result, expression(operand)))
    return result


def _product(children: list[Node]) -> Expression:
    """Powers first, then from left to right; the arc tangent takes the bracket after its slash."""
    parts = list(children)
    powers = [i for i, part in enumerate(parts) if part == "**"]
    if any(b - a == 2 for a, b in pairwise(powers)) or any(_is_signed(parts[i - 1]) for i in powers):
        raise Ambiguous(
            "the order of evaluation depends on the control for powers of powers or of signed numbers: write brackets"
        )
    while "**" in parts:
        i = [str(part) for part in parts].index("**")
        parts[i - 1 : i + 2] = [Tree("power", [parts[i - 1], parts[i + 1]])]
    result = _factor(parts[0])
    for i in range(1, len(parts), 2):
        operator, operand = str(parts[i]).upper(), parts[i + 1]
        arc = operator == "/" and isinstance(result, Operation) and result.name == "ATAN"
        if arc and not (isinstance(operand, Tree) and operand.data == "bracket"):
            raise Ambiguous("the meaning of a division after ATAN depends on the control: write ATAN[y]/[x]")
        if arc and isinstance(result, Operation):
            result = Operation("ATAN2", (*result.operands, _factor(operand)))
        else:
            result = Operation(operator, (result, _factor(operand)))
    return result


def _is_signed(node: Node) -> bool:
    return isinstance(node, Tree) and node.data == "signed"


def _factor(node: Node) -> Expression:
    if isinstance(node, Tree) and node.data == "power":
        return Operation("**", tuple(_factor(child) for child in node.children))
    return expression(node)


def _condition(children: list[Node]) -> Expression:
    operators = {str(operator).upper() for operator in children[1::2]}
    if not operators:
        return expression(children[0])
    if len(operators) > 1 or (len(children) > 3 and not operators <= {"AND", "OR", "XOR"}):
        raise Ambiguous("the order of evaluation of this condition depends on the control: write brackets")
    if operators <= {"AND", "OR", "XOR"} and not all(map(_is_operand, children[::2])):
        raise Ambiguous("the order of evaluation of this condition depends on the control: write brackets")
    return _chain(children, lambda operator: str(operator).upper())


def _linuxcnc_value(bracket: Tree[Token]) -> Expression:
    """The condition of an O-word, which only LinuxCNC has: comparisons come before AND, OR and XOR."""
    children: list[Node] = [*_condition_of(bracket)]
    groups: list[list[Node]] = [[]]
    logic: list[str] = []
    for child in children:
        if isinstance(child, Token) and child.type == "LOGIC":
            logic.append(str(child).upper())
            groups.append([])
        else:
            groups[-1].append(child)
    result = _condition(groups[0])
    for name, group in zip(logic, groups[1:], strict=True):
        result = Operation(name, (result, _condition(group)))
    return result


def _is_operand(node: Node) -> bool:
    """True for a sum of one operand alone."""
    while isinstance(node, Tree) and node.data in ("sum", "product") and len(node.children) == 1:
        node = node.children[0]
    return isinstance(node, Token) or node.data not in ("sum", "product")


def computed_word(node: Tree[Token]) -> Word:
    """A word with an expression as its number."""
    address, operand = node.children
    assert isinstance(address, Token)
    start, end = _span(operand)
    at = address.start_pos or 0
    arithmetic = isinstance(operand, Tree) and operand.data == "bracket" and len(_condition_of(operand)) == 1
    how = ("", "", 1, "") if arithmetic else ("[", "", 0, "]")
    return Word(str(address).upper(), None, at, start, end, Formula(expression(operand), *how))


def _condition_of(bracket: Tree[Token]) -> list[Node]:
    (condition,) = bracket.children
    assert isinstance(condition, Tree)
    return condition.children


def _span(node: Node) -> tuple[int, int]:
    if isinstance(node, Token):
        return node.start_pos or 0, node.end_pos or 0
    return node.meta.start_pos, node.meta.end_pos


def _function(name: str, operand: Expression) -> Expression:
    """A function; EXISTS takes the variable itself and not its value."""
    if name == EXISTS and isinstance(operand, Variable):
        return Variable(f"{EXISTS} {operand.name}", operand.indices)
    return Operation(name, (operand,))


_EXPRESSIONS: dict[str, Callable[[list[Any]], Expression]] = {
    "bracket": lambda parts: expression(parts[0]),
    "condition": _condition,
    "sum": lambda parts: _chain(parts, str),
    "product": _product,
    "signed": lambda parts: Operation("neg" if parts[0] == "-" else "pos", (expression(parts[1]),)),
    "function": lambda parts: _function(str(parts[0]).upper(), expression(parts[1])),
    "variable": lambda parts: _variable(parts[0]),
}


# ---- statements


def statement(node: Tree[Token]) -> Step:
    """The statement that a part of a block makes."""
    return _STATEMENTS[node.data](node.children)


def _assign(parts: list[Any]) -> Assign:
    target, value = parts
    return Assign(_variable(target.children[0]), expression(value))


def returned(node: Tree[Token]) -> list[Assign]:
    """The return value of a subprogram of LinuxCNC."""
    if node.data != "subroutine" or not re.search(r"(ENDSUB|RETURN)$", str(node.children[0]), re.IGNORECASE):
        return []
    values = [expression(part) for part in node.children[1:]]
    value = values[0] if values else Constant(0.0)
    return [Assign(Variable(VALUE), value), Assign(Variable(RETURNED), Constant(float(bool(values))))]


_SUBROUTINE = re.compile(r"O[ \t]*(\d+|<[^<>]*>)[ \t]*([A-Z \t]+)", re.IGNORECASE)
_TESTED = frozenset(("IF", "ELSEIF", "WHILE", "REPEAT"))


def _subroutine(parts: list[Any]) -> Step:
    match = _SUBROUTINE.fullmatch(str(parts[0]))
    assert match is not None
    name = re.sub(r"[ \t]", "", match[1]).lower()
    key, word = "O" + (name if name.startswith("<") else f"{int(name)}"), re.sub(r"[ \t]", "", match[2]).upper()
    values = [_linuxcnc_value(part) for part in parts[1:]]
    if len(values) != (word in _TESTED) and word not in ("CALL", "ENDSUB", "RETURN"):
        raise Ambiguous(f"{word} has {len(values)} values: write {'one' if word in _TESTED else 'none'}")
    test = values[0] if values else None
    others: dict[str, Step] = {
        "ELSEIF": Else(key, test),
        "ELSE": Else(key),
        "BREAK": Leave(key),
        "CONTINUE": Again(key),
        "CALL": Call(key, tuple(enumerate(values, start=1)), begun=True),
        "RETURN": Return("RETURN is outside of a subprogram: write M2 to end the program"),
    }
    if word in others:
        return others[word]
    return End(word.removeprefix("END"), key) if word.startswith("END") else Begin(word, key, test)


def _computed_call(parts: list[Any]) -> Call:
    """`o[#5] call [1]` and `o#5 call` of LinuxCNC: the subprogram of a number."""
    number = expression(parts[1]) if parts[1].data == "variable" else _linuxcnc_value(parts[1])
    name, values = Operation("program", (number,)), [_linuxcnc_value(part) for part in parts[3:]]
    return Call(name, tuple(enumerate(values, start=1)), begun=True)


def _key(number: Token) -> str:
    if not number.isdecimal():
        raise Ambiguous(f"{number} is not the number of a loop: write a whole number")
    return f"DO{int(number)}"


_STATEMENTS: dict[str, Callable[[list[Any]], Step]] = {
    "assignment": _assign,
    "if_goto": lambda parts: When(expression(parts[1]), Jump(expression(parts[3]))),
    "if_then": lambda parts: When(expression(parts[1]), statement(parts[3])),
    "goto": lambda parts: Jump(expression(parts[1])),
    "while": lambda parts: Begin("WHILE", _key(parts[3]), expression(parts[1])),
    "do": lambda parts: Begin("WHILE", _key(parts[1]), Constant(1.0)),
    "end": lambda parts: End("WHILE", _key(parts[1])),
    "subroutine": _subroutine,
    "computed_call": _computed_call,
}
