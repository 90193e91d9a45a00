"""Statements and formulas of Siemens 840D blocks: trees of the grammar `siemens.lark`."""

from __future__ import annotations

import re
from collections.abc import Callable
from itertools import pairwise
from typing import Any

from lark import Token, Tree

from postproc.siemens.reading.declarations import Declare, Fill, Parameter, Receive
from postproc.siemens.variables import EITHER_WAY, EMPTY
from postproc.text.block import Block, Word
from postproc.text.expressions import Ambiguous, Constant, Expression, Formula, Operation, Variable, by_levels
from postproc.text.statements import Assign, Begin, Else, End, Jump, Label, Rerun, Select, Step, When

Node = Tree[Token] | Token

FLOW = re.compile(
    r"(?<![A-Z_])(?:IF|GOTO|CASE|FOR|WHILE|UNTIL|REPEAT|LOOP|ELSE|END(?:IF|FOR|WHILE|LOOP)|L\s*\d)|(?<!M)CALL|^\s*%",
    re.I,
)
"""Statements after which the next block does not always run."""
LEVELS = {
    ":": 10,
    **dict.fromkeys(("*", "/", "DIV", "MOD"), 9),
    **dict.fromkeys(("+", "-"), 8),
    **{"B_AND": 7, "B_XOR": 6, "B_OR": 5, "AND": 4, "XOR": 3, "OR": 2, "<<": 1},
    **dict.fromkeys(("==", "<>", "<", ">", "<=", ">="), 0),
}
"""Precedence of the operators: the first bind most, comparisons least."""
COMPARING = frozenset(("==", "<>", "<", ">", "<=", ">="))
LOGIC = frozenset(("AND", "OR", "XOR"))
USUAL_LEVELS: dict[str, float] = {**LEVELS, **dict.fromkeys(COMPARING, 4.5)}
"""As other languages, and most who write programs, have it."""
MODES = frozenset(("AC", "IC", "DC", "ACP", "ACN"))
_ADDRESSES = (
    "CR AR AP RP RPL TURN RND RNDM CHF CHR FRC FRCM FZ FD FA FP FB SPOS SPOSA OVR OVRRAP PW PL SD ADIS ADISPOS SCC "
    "DISC LEAD TILT THETA PHI PSI OFFN"
)
ADDRESSES = frozenset(_ADDRESSES.split())
"""Names of more than one letter that take a value and are not variables."""


# ---- formulas


def formula(node: Node) -> Expression:
    """The expression of a part of a block."""
    if isinstance(node, Token):
        return _constant(node)
    return _FORMULAS[node.data](node.children)


def _constant(token: Token) -> Constant:
    if token.type == "STRING":
        return Constant(str(token)[1:-1])
    if token.type == "BITS":
        return Constant(float(int(token[2:-1], 16 if token[1] in "Hh" else 2)))
    return Constant(number_of(token))


def number_of(text: str) -> float:
    """The value of a number, with EX before a power of ten."""
    return float(re.sub("EX", "E", "".join(text.upper().split())))


def _expression(parts: list[Any]) -> Expression:
    operators = {str(part).upper() for part in parts[1::2]}
    if sum(str(part) in COMPARING for part in parts[1::2]) > 1 and LOGIC.isdisjoint(operators):
        raise Ambiguous("a comparison is compared again: write brackets round the first comparison")
    if any(_is_not(operand) and str(operator) in COMPARING for operand, operator in pairwise(parts)):
        raise Ambiguous(
            "NOT binds more than the comparison: write brackets round NOT and its operand, or round the comparison"
        )
    operands = [str(part).upper() if i % 2 else formula(part) for i, part in enumerate(parts)]
    result = by_levels([*operands], LEVELS)
    if COMPARING.isdisjoint(operators) or LOGIC.isdisjoint(operators):
        return result
    return Operation(EITHER_WAY, (result, by_levels([*operands], USUAL_LEVELS)))


def _is_not(node: Node) -> bool:
    return isinstance(node, Tree) and node.data == "signed" and str(node.children[0]).upper() == "NOT"


def _signed(parts: list[Any]) -> Expression:
    name = {"+": "pos", "-": "neg"}.get(str(parts[0]), str(parts[0]).upper())
    return Operation(name, (formula(parts[1]),))


def _reference(parts: list[Any]) -> Variable:
    return variable(str(parts[0]), parts[1] if len(parts) > 1 else None)


def variable(name: str, indices: Tree[Token] | None = None) -> Variable:
    """A variable; R5 is R with the index 5."""
    name = name.upper()
    found = () if indices is None else tuple(formula(index) for index in indices.children)
    if re.fullmatch(r"R\d+", name):
        return Variable("R", (Constant(float(name[1:])),))
    return Variable(name, found)


def arguments(node: Tree[Token]) -> tuple[Expression, ...]:
    """The arguments of a call, EMPTY for those left out."""
    found = [argument.children for argument in node.children if isinstance(argument, Tree)]
    return tuple(formula(children[0]) if children else EMPTY for children in found)


def _operands(node: Tree[Token]) -> tuple[Expression, ...]:
    """The arguments of a function, which may have none."""
    found = arguments(node)
    return () if found == (EMPTY,) else found


_FORMULAS: dict[str, Callable[[list[Any]], Expression]] = {
    "expression": _expression,
    "signed": _signed,
    "group": lambda parts: formula(parts[0]),
    "listed": lambda parts: Operation("SET", tuple(formula(part) for part in parts)),
    "function": lambda parts: Operation(str(parts[0]).upper(), _operands(parts[1])),
    "reference": _reference,
}


# ---- words with an equals sign


def valued(node: Tree[Token]) -> Word | Assign | Fill:
    """A word `X=...`, or the assignment of a variable."""
    name, *indices, value = node.children
    assert isinstance(name, Token)
    assert isinstance(value, Tree)
    address = name.upper()
    is_word = (name.type == "ADDRESS" and not re.fullmatch(r"R\d*", address)) or address in ADDRESSES
    if not is_word or indices or value.data == "listed":
        assert not indices or isinstance(indices[0], Tree)
        target, given = variable(address, indices[0] if indices else None), formula(value)  # type: ignore[arg-type]
        several = isinstance(given, Operation) and given.name in ("SET", "REP")
        return Fill(target, given) if several else Assign(target, given)  # type: ignore[arg-type]
    return _word(name, value)


def _word(name: Token, value: Tree[Token]) -> Word:
    at, end = name.start_pos or 0, value.meta.end_pos
    inner, mode = _mode(value)
    start, stop = inner.meta.start_pos, inner.meta.end_pos
    number = _plain_number(inner)
    if number is not None:
        return Word(name.upper(), number, at, start, stop, None, mode, end - stop)
    expression = formula(inner)
    if isinstance(expression, Constant) and isinstance(expression.value, str):
        return Word(name.upper(), None, at, start, stop, None, expression.value)
    loose = any(LEVELS[str(operator).upper()] < LEVELS["+"] for operator in inner.children[1::2])
    how = ("(", ")") if loose else ("", "")
    return Word(name.upper(), None, at, start, stop, Formula(expression, *how), mode, end - stop)


def _mode(value: Tree[Token]) -> tuple[Tree[Token], str]:
    """The value of AC(...) and the like, and its mode."""
    only = value.children[0] if len(value.children) == 1 else None
    if isinstance(only, Tree) and only.data == "function" and str(only.children[0]).upper() in MODES:
        mode, given = str(only.children[0]).upper(), only.children[1].children  # type: ignore[union-attr]
        values = [argument.children for argument in given if isinstance(argument, Tree)]
        if len(values) != 1 or not values[0]:
            raise Ambiguous(f"{mode} takes one value: write it in parentheses")
        return values[0][0], mode  # type: ignore[return-value]
    return value, ""


def _plain_number(value: Tree[Token]) -> float | None:
    """The value of a plain number, with a sign or without."""
    node: Any = value
    sign = 1.0
    while isinstance(node, Tree):
        if node.data == "signed" and str(node.children[0]) in "+-":
            sign, node = (sign if node.children[0] == "+" else -sign), node.children[1]
        elif node.data == "expression" and len(node.children) == 1:
            node = node.children[0]
        else:
            return None
    return sign * number_of(node) if node.type == "NUMBER" else None


# ---- statements


def statement(node: Tree[Token]) -> list[Step]:
    """The statements that a part of a block makes."""
    if node.data == "def":
        return _declare(node.children)
    if node.data == "proc":
        return [_receive(node.children)]
    return [_STATEMENTS[node.data](node.children)]


def _declare(parts: list[Any]) -> list[Step]:
    kind = str(parts[1]).upper()
    steps: list[Step] = []
    for item in parts[2:]:
        if item.data == "length":
            continue
        name, *rest = item.children
        indices = [part for part in rest if part.data == "indices"]
        values = [part for part in rest if part.data in ("expression", "listed")]
        sizes = tuple(formula(size) for size in indices[0].children) if indices else ()
        variable_ = variable(str(name))
        if len(str(name)) == 1:
            raise Ambiguous(f"{name} is an address: write a longer name for the variable")
        if variable_.name == "R":
            steps.append(Assign(variable_, formula(values[0]) if values else Constant(0.0)))
        else:
            steps.append(Declare(kind, variable_.name, sizes, formula(values[0]) if values else None))
    return steps


def _receive(parts: list[Any]) -> Receive:
    """PROC: the parameters of a subprogram."""
    saves = any(str(part).upper() == "SAVE" for part in parts[2:])
    found = []
    for part in parts[2:]:
        if isinstance(part, Token):
            continue
        tokens = {child.type: str(child).upper() for child in part.children if isinstance(child, Token)}
        trees = [child for child in part.children if isinstance(child, Tree)]
        if any(tree.data == "indices" for tree in trees):
            raise Ambiguous("a parameter that is an array is not followed: write its elements as parameters")
        first = next((formula(tree) for tree in trees if tree.data == "expression"), None)
        found.append(Parameter(tokens["TYPE"], tokens["IDENTIFIER"], first, by_reference="VAR" in tokens))
    return Receive(tuple(found), saves)


DIRECTIONS = {"GOTO": "FB", "GOTOC": "FB", "GOTOF": "F", "GOTOB": "B"}


def _jump(parts: list[Any]) -> Jump:
    word, target = str(parts[0]).upper(), parts[1]
    if word not in DIRECTIONS:
        raise Ambiguous(f"{word} jumps to the beginning of the program, which is not followed: write GOTOB and a label")
    label = str(target).strip('"').upper()
    return Jump(label, DIRECTIONS[word], optional=word == "GOTOC")


def _if_jump(parts: list[Any]) -> When:
    otherwise = _jump(parts[4].children) if len(parts) > 3 else None
    return When(formula(parts[1]), _jump(parts[2].children), otherwise)


def _case(parts: list[Any]) -> Select:
    cases, default = [], None
    for i, part in enumerate(parts):
        if isinstance(part, Tree) and part.data == "constant":
            values: list[Any] = part.children
            constant: Expression = _constant(values[-1])
            if values[0] == "-":
                constant = Operation("neg", (constant,))
            cases.append((constant, _jump(parts[i + 1].children)))
        elif isinstance(part, Token) and part.type == "DEFAULT":
            default = _jump(parts[i + 1].children)
    return Select(formula(parts[1]), tuple(cases), default)


def _for(parts: list[Any]) -> Begin:
    names = [part for part in parts if isinstance(part, Token) and part.type == "IDENTIFIER"]
    indices = [part for part in parts if isinstance(part, Tree) and part.data == "indices"]
    first, last = [part for part in parts if isinstance(part, Tree) and part.data == "expression"]
    counter = variable(str(names[0]), indices[0] if indices else None)
    return Begin("FOR", "", formula(last), counter, formula(first))


def _repeat(parts: list[Any]) -> Step:
    names = [str(part).upper() for part in parts[1:] if isinstance(part, Token)]
    passes = [formula(part.children[-1]) for part in parts if isinstance(part, Tree)]
    times = passes[0] if passes else None
    if not names:
        return Begin("DO")
    if str(parts[0]).upper() == "REPEATB":
        return Rerun(names[0], names[0], times)
    return Rerun(names[0], names[1] if len(names) > 1 else "", times, "ENDLABEL")


_STATEMENTS: dict[str, Callable[[list[Any]], Step]] = {
    "if_jump": _if_jump,
    "if": lambda parts: Begin("IF", "", formula(parts[1])),
    "jump": _jump,
    "case": _case,
    "for": _for,
    "while": lambda parts: Begin("WHILE", "", formula(parts[1])),
    "until": lambda parts: End("DO", "", until=formula(parts[1])),
    "repeat": _repeat,
    "repeat_block": _repeat,
    "loop": lambda _: Begin("LOOP"),
}


def program_name(block: Block) -> str:
    """The name in the first line of an archived program: PART for `%_N_PART_SPF`."""
    match = re.match(r"%_N_(\w+)_(?:MPF|SPF)\b", block.text.strip(), re.I)
    return match[1].upper() if match else ""


def structure(token: Token) -> Step:
    """ELSE, ENDIF, ENDFOR, ENDWHILE, ENDLOOP."""
    word = token.upper()
    return Else() if word == "ELSE" else End(word.removeprefix("END"))


def labels(block: Block) -> list[str]:
    """The names under which jumps and calls find a block."""
    found = [f"%{program_name(block)}"] if block.kind == "header" else []
    for word in block.words:
        if word.address == "N" and word.value is not None:
            found += [f"N{word.value:.0f}", f"{word.value:.0f}"]
    if block.code is not None:
        found += [step.name for step in block.code.before if isinstance(step, Label)]
    return found
