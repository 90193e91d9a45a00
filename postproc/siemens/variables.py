"""Variables, operators and functions of Siemens 840D programs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from postproc.siemens.control_data import PARTS, ControlData, chained, translation, unscaled, unturned
from postproc.text.expressions import (
    ARITHMETIC,
    COMPARISONS,
    Expression,
    NotKnown,
    Operation,
    Operations,
    Scope,
    Value,
    evaluate,
    known_value,
    nearly,
    truth,
    whole,
)

NAMES = frozenset("XYZABCUVWE") | PARTS
"""Names of axes and of parts of a frame: they may be the index of a variable."""
CONSTANTS = {"TRUE": 1.0, "FALSE": 0.0, "$PI": math.pi}
MACHINING = {
    "_OFF": 0.0, "_FINISH": 1.0, "_SEMIFIN": 2.0, "_ROUGH": 3.0,
    "_ORI_FINISH": 11.0, "_ORI_SEMIFIN": 12.0, "_ORI_ROUGH": 13.0,
    "_TOP_SURFACE_SMOOTH_OFF": 1e6, "_TOP_SURFACE_SMOOTH_ON": 2e6,
}  # fmt: skip
"""Names of the control for the second argument of CYCLE832; SINUMERIK ONE, NC programming 12/2019, p. 1108."""
DATA = ("$P_UIFR", "$TC_")
"""Tables of the control that a program may fill."""
EITHER_WAY = "read with comparisons last, and with comparisons first"
_SPEEDS = "ACC ACCLIMA JERKLIM JERKLIMA VELOLIM VELOLIMA OVRA FL FGREF FA SPOS SPOSA"
_OUTPUTS = "OUT OUTA DBB DBW DBD DBR"
SETTINGS = frozenset((*_SPEEDS.split(), *(f"$A_{name}" for name in _OUTPUTS.split())))
"""Speeds of axes, positions of spindles, and outputs: they move nothing elsewhere."""
MOST = 100_000
"""Elements of a field."""


def _quotient(a: float, b: float) -> float:
    return float(math.trunc(a / b + math.copysign(1e-12, a * b)))


def _modulo(a: float, b: float) -> float:
    if a < 0.0 or b <= 0.0:
        raise NotKnown("the result of MOD with a negative number or 0 is not documented: write positive numbers")
    return math.fmod(a, b)


def _rounded(a: float) -> float:
    if nearly(a % 1.0, 0.5) and a < 0.0:
        raise NotKnown(f"the rounding of {a:g} is not documented: write the whole number")
    return float(math.floor(a + 0.5))


def _joined(a: Value, b: Value) -> str:
    parts = [part if isinstance(part, str) else f"{part:.10g}" for part in (a, b)]
    return "".join(parts)


def _agreed(as_documented: Value, as_usual: Value) -> Value:
    if as_documented != as_usual:
        raise NotKnown("a comparison binds less than AND and OR: write brackets round each comparison")
    return as_documented


OPERATIONS: Operations = {
    **ARITHMETIC,
    **COMPARISONS,
    "DIV": _quotient,
    "MOD": _modulo,
    "AND": lambda a, b: truth(bool(a) and bool(b)),
    "OR": lambda a, b: truth(bool(a) or bool(b)),
    "XOR": lambda a, b: truth(bool(a) != bool(b)),
    "NOT": lambda a: truth(not a),
    "B_AND": lambda a, b: float(_bits(a) & _bits(b)),
    "B_OR": lambda a, b: float(_bits(a) | _bits(b)),
    "B_XOR": lambda a, b: float(_bits(a) ^ _bits(b)),
    "<<": _joined,
    "POT": lambda a: a * a,
    "ATAN2": lambda a, b: math.degrees(math.atan2(a, b)),
    "TRUNC": lambda a: float(math.trunc(a)),
    "ROUND": _rounded,
    "MINVAL": min,
    "MAXVAL": max,
    "BOUND": lambda low, high, value: min(max(low, value), high),
    EITHER_WAY: _agreed,
    "CTRANS": translation,
    "CFINE": translation,
    "CROT": unturned,
    "CSCALE": unscaled,
    "CMIRROR": unturned,
    ":": chained,
}


def _bits(a: float) -> int:
    if a != int(a) or a < 0.0:
        raise NotKnown(f"{a:g} in a bit operation is no whole number of 0 or more: write such a number")
    return int(a)


@dataclass
class _Level:
    """The variables of a program, or of a subprogram while it runs."""

    values: dict[tuple[str, tuple[int, ...]], Value | NotKnown] = field(default_factory=dict)
    kinds: dict[str, str] = field(default_factory=dict)
    """Types of the declared variables, by name."""
    arguments: dict[int, Value | NotKnown] = field(default_factory=dict)
    """By their position in the call, from 1."""


@dataclass
class SiemensVariables:
    """R parameters, which all programs share, and declared variables; nothing is known of others."""

    operations: Operations = field(default_factory=lambda: OPERATIONS)
    shared: dict[tuple[str, tuple[int, ...]], Value | NotKnown] = field(default_factory=dict)
    levels: list[_Level] = field(default_factory=lambda: [_Level()])
    data: ControlData = field(default_factory=ControlData)
    passive: frozenset[str] = frozenset()
    """Names of axes outside the chain."""
    basic_unit_is_inch: bool = False
    """Tables of the control are in inches."""

    @property
    def depth(self) -> int:
        """Subprograms in one another."""
        return len(self.levels) - 1

    def get(self, name: str, indices: tuple[Value, ...]) -> Value:
        """The value of a variable; the name of an axis alone is its own value."""
        shown = name + (f"[{', '.join(map(_shown, indices))}]" if indices and name != "R" else "")
        if name == "R" and indices:
            shown = f"R{_shown(indices[0])}"
        here = self.levels[-1]
        if name in CONSTANTS and not indices:
            return CONSTANTS[name]
        if name in MACHINING and name not in here.kinds:
            return MACHINING[name]
        if name.startswith("$"):
            raise NotKnown(f"{shown} belongs to the control, and its value is not known to ncomp: write a number")
        if name in SETTINGS:
            raise NotKnown(f"{shown} is a setting of an axis, and its value is not known to ncomp: write a number")
        if name in NAMES and not indices and name not in here.kinds:
            return name
        value = (self.shared if name == "R" else here.values).get((name, _whole_indices(indices)))
        if value is None and any(name in level.kinds for level in self.levels[:-1]):
            raise NotKnown(
                f"{shown} belongs to the calling program, and only some controls read it here: write it as a parameter"
            )
        return known_value(value, shown)

    def set(self, name: str, indices: tuple[Value, ...], value: Value | NotKnown) -> None:
        """Set it; NotKnown for one that is not declared: it could be an axis."""
        if name in SETTINGS or name in self.passive:
            return
        if name.startswith(DATA):
            if isinstance(value, NotKnown):
                raise value
            if self.basic_unit_is_inch:
                raise NotKnown(
                    f"{name} is in inches on this control, which is not supported: set it before the program"
                )
            self.data.set(name, indices, value)
            return
        if name.startswith("$"):
            raise NotKnown(
                f"{name} belongs to the control, and its effect is not known to ncomp: remove the assignment"
            )
        here = self.levels[-1]
        if name != "R" and name not in here.kinds:
            raise NotKnown(
                f"{name} is neither a declared variable nor an axis: write DEF, or passive_axes in the machine file"
            )
        if here.kinds.get(name) == "INT" and isinstance(value, float):
            value = _rounded(value)
        (self.shared if name == "R" else here.values)[name, _whole_indices(indices)] = value

    def declare(self, kind: str, name: str, sizes: Sequence[int], values: Sequence[Value | NotKnown | None]) -> None:
        """A new variable, with first values in the order of its elements, last index first."""
        here = self.levels[-1]
        here.kinds[name] = kind
        empty: Value = "" if kind in ("STRING", "CHAR", "AXIS", "FRAME") else 0.0
        elements = math.prod(sizes)
        if elements > MOST:
            raise NotKnown(f"the array has {elements} elements: write at most {MOST}")
        for i in range(elements):
            reversed_indices, left = [], i
            for size in reversed(sizes):
                left, index = divmod(left, size)
                reversed_indices.append(index)
            given = values[i] if i < len(values) else None
            here.values[name, tuple(reversed(reversed_indices))] = empty
            if given is not None:
                self.set(name, tuple(float(index) for index in reversed(reversed_indices)), given)

    def enter(self, arguments: dict[int, Value | NotKnown] | None) -> None:
        """A subprogram has variables of its own."""
        self.levels.append(_Level(arguments=arguments or {}))

    def leave(self) -> dict[int, Value | NotKnown]:
        """The variables of a subprogram end with it; returned: the arguments of its call."""
        return self.levels.pop().arguments


class Receive(NamedTuple):
    """PROC: the parameters of a subprogram take the arguments of its call."""

    parameters: tuple[tuple[str, str, Expression | None], ...]
    """Kind, name, and the value that holds where the call gives none."""

    def run(self, scope: Scope) -> None:
        """Declare them with the given values; in a program that nothing has called they are not known."""
        assert isinstance(scope, SiemensVariables)
        arguments = scope.levels[-1].arguments
        if len(arguments) and max(arguments) > len(self.parameters):
            raise NotKnown("the call has more arguments than the subprogram has parameters: remove the others")
        for i, (kind, name, default) in enumerate(self.parameters, start=1):
            omitted = NotKnown(f"the call omits the argument for {name}")
            given = arguments.get(i, omitted if default is None else _known(default, scope))
            scope.declare(kind, name, (), [given])


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
            return [None if part == EMPTY else _known(part, scope) for part in first.operands]
        if isinstance(first, Operation) and first.name == "REP":
            if not first.operands:
                raise NotKnown("REP has no value: write one in its parentheses")
            times = whole(first.operands[1], scope) if len(first.operands) > 1 else elements
            return [_known(first.operands[0], scope)] * min(times, elements, MOST)
        return [] if first is None else [_known(first, scope)]


EMPTY = Operation("an omitted argument", ())
"""An argument that is left out."""


def _known(expression: Expression, scope: Scope) -> Value | NotKnown:
    try:
        return evaluate(expression, scope)
    except NotKnown as reason:
        return reason


def _whole_indices(indices: tuple[Value, ...]) -> tuple[int, ...]:
    found = []
    for index in indices:
        if not isinstance(index, float):
            raise NotKnown(f"{index} is an axis as an index: write a number")
        if index != int(index) or index < 0.0:
            raise NotKnown(f"{index:g} is no index: write a whole number of 0 or more")
        found.append(int(index))
    return tuple(found)


def _shown(index: Value) -> str:
    return index if isinstance(index, str) else f"{index:g}"
