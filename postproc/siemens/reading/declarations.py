"""Steps of Siemens 840D programs that declare variables, or set several at once."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

from postproc.siemens.variables import EMPTY, MOST_FIELD_ELEMENTS, SiemensVariables
from postproc.text.expressions import Expression, NotKnown, Operation, Scope, Value, Variable, evaluate, whole


class Pass(NamedTuple):
    """The variables among the arguments of a call, which the subprogram may set."""

    variables: tuple[tuple[int, Variable], ...]
    """By their position in the call, from 1."""

    def run(self, scope: Scope) -> None:
        """Name them for the subprogram that begins next."""
        assert isinstance(scope, SiemensVariables)
        scope.passed = {i: (v.name, tuple(evaluate(index, scope) for index in v.indices)) for i, v in self.variables}


class Parameter(NamedTuple):
    """A parameter of a subprogram."""

    kind: str
    name: str
    first: Expression | None
    """The value for a call that gives none."""
    by_reference: bool = False
    """VAR: at the end of the subprogram the variable of the call gets its value."""


class Receive(NamedTuple):
    """PROC: the parameters of a subprogram take the arguments of its call."""

    parameters: tuple[Parameter, ...]
    saves: bool = False
    """SAVE: the modal G codes of the caller hold again behind the subprogram."""

    def run(self, scope: Scope) -> None:
        """Declare them with the given values; in a program that nothing has called they are not known."""
        assert isinstance(scope, SiemensVariables)
        here = scope.levels[-1]
        arguments = here.arguments
        if len(arguments) and max(arguments) > len(self.parameters):
            raise NotKnown("the call has more arguments than the subprogram has parameters: remove the others")
        for i, (kind, name, default, by_reference) in enumerate(self.parameters, start=1):
            omitted = _omitted(name) if scope.depth else _not_called()
            given = arguments.get(i, omitted if default is None else _known(default, scope))
            scope.declare(kind, name, (), [given])
            if by_reference and scope.depth:
                if i not in here.passed:
                    raise NotKnown(f"{name} is declared with VAR: call the subprogram once, with a variable for it")
                here.returned[name] = here.passed[i]


class Fill(NamedTuple):
    """`FIELD[2]=SET(1,2,3)`, `FIELD[2]=REP(9)`: elements of an array, from one on."""

    target: Variable
    value: Operation

    @property
    def written(self) -> Variable:
        """Any element of the array."""
        return Variable(self.target.name, tuple(ANY for _ in self.target.indices))

    def run(self, scope: Scope) -> None:
        """Set them; the element of an argument that is left out is unknown then."""
        assert isinstance(scope, SiemensVariables)
        name, indices = self.target.name, tuple(evaluate(index, scope) for index in self.target.indices)
        if self.value.name == "REP":
            values = _repeated(self.value, scope, lambda: scope.elements_behind(name, indices))
        else:
            left_out = NotKnown("the list of its values leaves it out")
            values = [left_out if value is None else value for value in _listed(self.value, scope)]
        scope.fill(name, indices, values)


class Lose(NamedTuple):
    """A procedure or function that ncomp does not follow, with a variable that it may set."""

    name: str
    variable: Variable

    def run(self, scope: Scope) -> None:
        """Mark the variable as unknown."""
        assert isinstance(scope, SiemensVariables)
        scope.lose(self.name, self.variable)


class Declare(NamedTuple):
    """DEF: a new variable."""

    kind: str
    name: str
    sizes: tuple[Expression, ...]
    first: Expression | None

    def run(self, scope: Scope) -> None:
        """Declare it; SET gives the elements one by one, REP all alike."""
        assert isinstance(scope, SiemensVariables)
        sizes = [whole(size, scope) for size in self.sizes]
        scope.declare(self.kind, self.name, sizes, self._values(scope, math.prod(sizes)))

    def _values(self, scope: Scope, elements: int) -> list[Value | NotKnown | None]:
        first = self.first
        if isinstance(first, Operation) and first.name == "SET":
            return _listed(first, scope)
        if isinstance(first, Operation) and first.name == "REP":
            return _repeated(first, scope, lambda: elements)[:elements]
        return [] if first is None else [_known(first, scope)]


ANY = Operation("any index", ())


def _listed(values: Operation, scope: Scope) -> list[Value | NotKnown | None]:
    """The values of SET; None for one that is left out."""
    return [None if part == EMPTY else _known(part, scope) for part in values.operands]


def _repeated(values: Operation, scope: Scope, elements: Callable[[], int]) -> list[Value | NotKnown | None]:
    """The values of REP; `elements` gives their number where REP has none."""
    if not values.operands:
        raise NotKnown("REP has no value: write one in its parentheses")
    times = whole(values.operands[1], scope) if len(values.operands) > 1 else elements()
    return [_known(values.operands[0], scope)] * min(times, MOST_FIELD_ELEMENTS)


def _known(expression: Expression, scope: Scope) -> Value | NotKnown:
    try:
        return evaluate(expression, scope)
    except NotKnown as reason:
        return reason


def _omitted(name: str) -> NotKnown:
    return NotKnown(f"the call omits the argument for {name}")


def _not_called() -> NotKnown:
    return NotKnown("this is a subprogram, and no program has called it with a value: give the program that calls it")
