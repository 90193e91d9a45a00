"""Q parameters of HEIDENHAIN Klartext programs, and the operators and functions of their formulas."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import NamedTuple

from kinematics.machine import Control
from postproc.text.expressions import (
    ARITHMETIC,
    COMPARISONS,
    Expression,
    NotKnown,
    Operations,
    Scope,
    Value,
    known_value,
    nearly,
)

PRESET_Q = range(100, 200)
"""Q100 to Q199 are set by the control: Q108 is the radius of the tool."""
REPEATS = "number of repeats"
"""The operation that makes a number of repeats of a value."""


def _integer(a: float) -> float:
    return float(math.trunc(a))


def _modulo(a: float, b: float) -> float:
    if a < 0.0 or b <= 0.0:
        raise NotKnown("the result of % with a negative number or 0 is not documented: write positive numbers")
    return math.fmod(a, b)


OPERATIONS: Operations = {
    **ARITHMETIC,
    "DIV": ARITHMETIC["/"],
    "^": math.pow,
    "%": _modulo,
    "LEN": math.hypot,
    "ANG": lambda a, b: math.degrees(math.atan2(a, b)) % 360.0,
    "SQ": lambda a: a * a,
    "LOG": math.log10,
    "NEG": ARITHMETIC["neg"],
    "INT": _integer,
    "FRAC": lambda a: a - math.trunc(a),
    "SGN": lambda a: math.copysign(1.0, a) if not nearly(a, 0.0) else _zero(),
    "PI": lambda: math.pi,
    "EQU": COMPARISONS["=="],
    "NE": COMPARISONS["<>"],
    "GT": COMPARISONS[">"],
    "LT": COMPARISONS["<"],
}


def _not_whole(a: float) -> float:
    if a != math.floor(a):
        raise NotKnown(
            f"{a:g} repeats are truncated on some controls and rounded on others: write "
            'repeats = "truncate" or "round" under [control] in the machine file'
        )
    return a


def _truncated(a: float) -> float:
    return float(math.trunc(_beyond_rounding(a, a)))


def _rounded(a: float) -> float:
    return float(math.floor(_beyond_rounding(a, a + 0.5) + 0.5))


def _beyond_rounding(a: float, border: float) -> float:
    """The value; NotKnown where the rounding of the control's arithmetic decides, as `border` is all but whole."""
    if border != round(border) and nearly(border, round(border)):
        raise NotKnown(f"{a:.17g} repeats depend on the rounding of the control's arithmetic: write a whole number")
    return a


_REPEATS = {"": _not_whole, "truncate": _truncated, "round": _rounded}


def operations_of(control: Control) -> Operations:
    """Operators and functions as a control works them out."""
    return {**OPERATIONS, REPEATS: _REPEATS[control.repeats]}


def _zero() -> float:
    raise NotKnown("SGN of 0 depends on the control")


@dataclass
class QParameters:
    """The values of Q, QL and QR parameters; those that the program has not set are not known."""

    operations: Operations = field(default_factory=lambda: operations_of(Control()))
    values: dict[tuple[str, Value], Value | NotKnown] = field(default_factory=dict)
    unit: str = "MM"
    """Unit of the main program."""
    callers: list[dict[tuple[str, Value], Value | NotKnown] | None] = field(default_factory=list)
    """The QL parameters of the programs that call the present one; None for a label, which has none of its own."""

    def get(self, name: str, indices: tuple[Value, ...]) -> Value:
        """The value of a parameter by its kind, Q, QL or QR, and its number."""
        (number,) = indices
        value, shown = self.values.get((name, number)), f"{name}{number:g}"
        if value is None and name == "Q" and isinstance(number, float) and int(number) in PRESET_Q:
            raise NotKnown(f"the control sets {shown}, and its value is not known to ncomp")
        return known_value(value, shown)

    def set(self, name: str, indices: tuple[Value, ...], value: Value | NotKnown) -> None:
        """Set it."""
        self.values[name, indices[0]] = value

    def lose_results(self, expression: Expression) -> None:
        """No function of a formula sets a parameter."""

    @property
    def state(self) -> object:
        """The values of all parameters."""
        return self.values, self.callers

    def forget(self, reason: str) -> None:
        """Mark all parameters as unknown."""
        self.values = dict.fromkeys(self.values, NotKnown(reason))

    def enter(self, arguments: dict[int, Value | NotKnown] | None) -> None:
        """A label has no parameters of its own, and a called program, which has arguments, its own QL."""
        if arguments is None:
            self.callers.append(None)
            return
        self.callers.append({key: value for key, value in self.values.items() if key[0] == "QL"})
        self._drop_locals()

    def leave(self) -> dict[int, Value | NotKnown]:
        """The QL parameters of a called program end with it."""
        before = self.callers.pop()
        if before is not None:
            self._drop_locals()
            self.values |= before
        return {}

    def _drop_locals(self) -> None:
        self.values = {key: value for key, value in self.values.items() if key[0] != "QL"}


class Forget(NamedTuple):
    """A function of the control that may set any parameter."""

    reason: str

    def run(self, scope: Scope) -> None:
        """Forget all values: none is known."""
        assert isinstance(scope, QParameters)
        scope.forget(self.reason)
