"""Expressions of NC programs as trees, and their values; the operations are each dialect's own."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Mapping
from typing import Any, NamedTuple, Protocol, TypeAlias

Value: TypeAlias = float | str
"""True is 1.0, false 0.0."""
Operations: TypeAlias = Mapping[str, Callable[..., Value]]

ROUNDED_SUM = 1e-9
"""Numbers that differ by no more, of themselves or of 1, differ by how a control rounds its sums."""


class NotKnown(Exception):
    """A value that the text of the program does not determine, with the reason."""

    def __eq__(self, other: object) -> bool:
        """True for the same reason."""
        return isinstance(other, NotKnown) and self.args == other.args

    def __hash__(self) -> int:
        """By the reason."""
        return hash(self.args)


class Ambiguous(Exception):
    """An expression that controls interpret differently; the reason is its text."""


class Position(float):
    """A position that the program reads from the control, or a number that depends on one; mm.

    The value is that of the program as it stands. A corrected program reads another one, up to `apart` from it.
    """

    apart: float

    def __new__(cls, value: float, apart: float) -> Position:
        """The value, and the difference that a correction may make."""
        made = super().__new__(cls, value)
        made.apart = apart
        return made

    def __getnewargs__(self) -> tuple[float, float]:  # type: ignore[override]
        """The arguments of a copy."""
        return float(self), self.apart


class Constant(NamedTuple):
    """A number or a text."""

    value: Value


class Variable(NamedTuple):
    """A variable, `#5` as `#` with the index 5; indices are expressions too."""

    name: str
    indices: tuple[Expression, ...] = ()


class Operation(NamedTuple):
    """An operator or a function with its operands, as the dialect's table names it."""

    name: str
    operands: tuple[Expression, ...]


Expression: TypeAlias = Constant | Variable | Operation


class Formula(NamedTuple):
    """The expression of a word instead of a number, and the form of an addition to its text."""

    expression: Expression
    before: str = ""
    close: str = ""
    """Text between the expression and the added number."""
    tail: int = 0
    """Number of characters at the end of the text that stay behind the added number."""
    after: str = ""
    carrier: bool = False
    """A word that cannot hold a sum: a variable of ncomp's own takes it, in a block before."""
    instead: bool = False
    """A word that determines the coordinate indirectly, such as an angle: the coordinate replaces it."""
    reads: bool = False
    """A word whose value depends on a position of the control, which a correction changes: a number replaces it."""

    def plus(self, text: str, shift: str) -> str:
        """The text of a word with a signed number added."""
        at = len(text) - self.tail
        return self.before + text[:at] + self.close + shift + text[at:] + self.after


class Scope(Protocol):
    """The variables of a running program."""

    @property
    def operations(self) -> Operations:
        """Operators and functions by name; they raise NotKnown where controls differ."""

    def get(self, name: str, indices: tuple[Value, ...]) -> Value:
        """The value of a variable; NotKnown if the program has not set it."""

    def set(self, name: str, indices: tuple[Value, ...], value: Value | NotKnown) -> None:
        """Give a variable a value, or the reason why it has none that is known; NotKnown when it is none to be set."""

    def lose_results(self, expression: Expression) -> None:
        """Mark the variables that functions in an expression set, in addition to their value, as unknown."""


def evaluate(expression: Expression, scope: Scope) -> Value:
    """The value of an expression; NotKnown, with the reason, where the program does not give it.

    Functions that set variables are not among the operations, so that an expression with a value has set none.
    """
    try:
        return _value(expression, scope)
    except RecursionError:
        raise NotKnown("the formula is too long or nested too deeply: divide it") from None
    except NotKnown:
        scope.lose_results(expression)
        raise


def _value(expression: Expression, scope: Scope) -> Value:
    if isinstance(expression, Constant):
        return _finite(expression.value, "a number with so many digits")
    if isinstance(expression, Variable):
        return scope.get(expression.name, tuple(_value(index, scope) for index in expression.indices))
    values = [_value(operand, scope) for operand in expression.operands]
    operation = scope.operations.get(expression.name)
    if operation is None:
        raise NotKnown(f"{expression.name} is not known to ncomp")
    try:
        value = operation(*values)
        if any(isinstance(operand, Position) for operand in values):
            value = _of_positions(value, operation, values)
    except (ArithmeticError, TypeError, ValueError):
        operands = ", ".join(f"{value:g}" if isinstance(value, float) else repr(value) for value in values)
        raise NotKnown(f"{expression.name} has no value for {operands}: correct the formula") from None
    return _finite(value, expression.name)


def _of_positions(value: Value, operation: Callable[..., Value], operands: list[Value]) -> Value:
    """The result of an operation on positions; NotKnown for a text or a comparison that a correction may change."""
    ends = [(v - v.apart, v + v.apart) if isinstance(v, Position) else (v,) for v in operands]
    others = [operation(*corner) for corner in itertools.product(*ends)]
    if all(type(other) is type(value) and other == value for other in others):
        return value
    if isinstance(value, str) or operation in COMPARISONS.values():
        raise NotKnown(
            "a position that the program reads is too close to the value at which the program goes on in another way, "
            "and a correction may change it: compare it with a value between two positions"
        )
    return Position(value, max(abs(float(other) - value) for other in others))


def _finite(value: Value, name: str) -> Value:
    if isinstance(value, float) and not math.isfinite(value):
        raise NotKnown(f"{name} has no finite value")
    return value


def number(expression: Expression, scope: Scope) -> float:
    """The value of an expression that has to be a number, the same in a corrected program."""
    return same_when_corrected(coordinate(expression, scope))


def same_when_corrected(value: float) -> float:
    """The value; NotKnown for a position that the program reads."""
    if isinstance(value, Position):
        raise NotKnown(
            "it depends on a position that the program reads from the control, which a correction changes: only X, Y "
            "and Z of a move, and comparisons, can depend on it. Write a number"
        )
    return value


def coordinate(expression: Expression, scope: Scope) -> float:
    """The value of an expression that has to be a number, perhaps one that depends on a Position."""
    value = evaluate(expression, scope)
    if not isinstance(value, float):
        raise NotKnown("it is empty: give it a value before this block" if value == "" else f"{value!r} is no number")
    return value


def whole(expression: Expression, scope: Scope) -> int:
    """The value of an expression that has to be a whole number."""
    value = number(expression, scope)
    if value != int(value):
        raise NotKnown(f"{value:g} is not a whole number")
    return int(value)


def variables(expression: Expression) -> Iterator[Variable]:
    """All variables that an expression reads."""
    if isinstance(expression, Variable):
        yield expression
        for index in expression.indices:
            yield from variables(index)
    elif isinstance(expression, Operation):
        for operand in expression.operands:
            yield from variables(operand)


def operations_in(expression: Expression) -> Iterator[Operation]:
    """All operators and functions of an expression."""
    if isinstance(expression, Variable):
        for index in expression.indices:
            yield from operations_in(index)
    elif isinstance(expression, Operation):
        yield expression
        for operand in expression.operands:
            yield from operations_in(operand)


def may_be_one(a: Variable, b: Variable) -> bool:
    """True unless two variables are certainly different ones."""
    if a.name != b.name or len(a.indices) != len(b.indices):
        return False
    pairs = zip(a.indices, b.indices, strict=True)
    return not any(isinstance(i, Constant) and isinstance(j, Constant) and i != j for i, j in pairs)


def by_levels(parts: list[Any], levels: Mapping[str, float], above: float = -math.inf) -> Expression:
    """Operands with operators between them as one tree, from left to right; an operator of a higher level binds more.

    Takes the parts that it reads out of the list: those whose operators are of a level above the given one.
    """
    result: Expression = parts.pop(0)
    while parts and levels[parts[0]] > above:
        operator = parts.pop(0)
        result = Operation(operator, (result, by_levels(parts, levels, levels[operator])))
    return result


def known_value(value: Value | NotKnown | None, shown: str) -> Value:
    """The value that a variable holds; NotKnown, with its name, where the program has set none that is known."""
    if value is None:
        raise NotKnown(f"{shown} is not set by the program: set it before this block")
    if isinstance(value, NotKnown):
        raise NotKnown(f"{shown} is not known: {value}")
    return value


# ---- common parts of the tables of the dialects


def truth(value: bool) -> float:
    """A condition as a number."""
    return 1.0 if value else 0.0


def nearly(a: float, b: float) -> bool:
    """True for numbers that are one but for rounding."""
    return abs(a - b) <= ROUNDED_SUM * max(1.0, abs(a), abs(b))


def equal(a: Value, b: Value) -> bool:
    """True for one text, or one number but for rounding; TypeError for a text and a number."""
    if isinstance(a, str) and isinstance(b, str):
        return a == b
    if isinstance(a, str) or isinstance(b, str):
        raise TypeError
    return nearly(a, b)


COMPARISONS: dict[str, Callable[..., Value]] = {
    "==": lambda a, b: truth(equal(a, b)),
    "<>": lambda a, b: truth(not equal(a, b)),
    "<": lambda a, b: truth(a < b and not equal(a, b)),
    ">": lambda a, b: truth(a > b and not equal(a, b)),
    "<=": lambda a, b: truth(a < b or equal(a, b)),
    ">=": lambda a, b: truth(a > b or equal(a, b)),
}
ARITHMETIC: dict[str, Callable[..., Value]] = {
    "+": lambda a, b: a + b,
    "-": lambda a, b: a - b,
    "*": lambda a, b: a * b,
    "/": lambda a, b: a / b,
    "neg": lambda a: -a,
    "pos": lambda a: +a,
    "ABS": abs,
    "SQRT": math.sqrt,
    "LN": math.log,
    "EXP": math.exp,
    "SIN": lambda a: math.sin(math.radians(a)),
    "COS": lambda a: math.cos(math.radians(a)),
    "TAN": lambda a: math.tan(math.radians(a)),
    "ASIN": lambda a: math.degrees(math.asin(a)),
    "ACOS": lambda a: math.degrees(math.acos(a)),
    "ATAN": lambda a: math.degrees(math.atan(a)),
}
"""Angles in degrees, as all controls have them."""
