"""Variables, operators and functions of ISO / Fanuc / LinuxCNC programs."""

from __future__ import annotations

import math
from collections.abc import Callable

import msgspec

from postproc.text.expressions import (
    ARITHMETIC,
    COMPARISONS,
    Expression,
    NotKnown,
    Operations,
    Value,
    known_value,
    nearly,
    truth,
)

LOCALS = range(1, 34)
"""Numbers of the variables that a macro has of its own."""
LINUXCNC_LOCALS = 30
SYSTEM = 1000
"""Numbers from here on belong to the control, for FANUC; for LinuxCNC those after 5000."""
LINUXCNC_SYSTEM = 5001
DEBUG = 5599
"""LinuxCNC: whether it shows the texts of (DEBUG, ...)."""
HARMLESS = {
    3000: "it stops the program with an alarm",
    3001: "it is a clock of the control",
    3002: "it is a clock of the control",
    3003: "it selects single blocks",
    3004: "it selects feed hold and override",
    3006: "it stops the program with a message",
}
"""FANUC: system variables that a program may set, and that move nothing."""
SPLIT = 10_000
"""A P of M98 from here on contains a number of repetitions too, on FANUC: P51001 runs O1001 five times."""
EMPTY = ""
"""The value of a variable that has none (FANUC)."""
LINUXCNC_EQUAL = 1e-4
"""LinuxCNC takes numbers that differ by less for one."""
VALUE, RETURNED = "#<_value>", "#<_value_returned>"
"""The value that the last subprogram of LinuxCNC has returned, and whether it has; both 0 before the first."""
EXISTS = "EXISTS"
"""Function of LinuxCNC: true if the variable in its brackets exists."""


SIGNS = {"LT": "<", "LE": "<=", "GT": ">", "GE": ">="}


def _agreed(a: float, b: float) -> bool:
    """True when two numbers are one; NotKnown where that is so for some controls."""
    if not nearly(a, b) and abs(a - b) < LINUXCNC_EQUAL:
        raise NotKnown(f"whether {a:.9g} equals {b:.9g} depends on the control")
    return nearly(a, b)


def _ordered(name: str, sign: str) -> Callable[..., Value]:
    """A comparison; NotKnown where rounding decides it: LinuxCNC compares sums of tenths as they come out."""

    def operation(a: float, b: float) -> Value:
        if a != b and nearly(a, b):
            raise NotKnown(
                f"{a:.17g} {name} {b:.17g}: the result depends on how the control rounds; "
                'write family = "fanuc" or "linuxcnc" in the machine file'
            )
        return COMPARISONS[sign](a, b)

    return operation


def _logic(name: str, result: Callable[[bool, bool], bool]) -> Callable[[float, float], float]:
    def operation(a: float, b: float) -> float:
        if a not in (0.0, 1.0) or b not in (0.0, 1.0):
            raise NotKnown(f"{name} of numbers other than 0 and 1 is logical on some controls and bit by bit on others")
        return truth(result(bool(a), bool(b)))

    return operation


def _round(a: float) -> float:
    if nearly(a % 1.0, 0.5):
        raise NotKnown(f"the rounding of {a:g} depends on the control")
    return float(round(a))


def _modulo(a: float, b: float) -> float:
    if a < 0.0 or b <= 0.0:
        raise NotKnown("MOD of a negative number depends on the control")
    return math.fmod(a, b)


def _power(a: float, b: float) -> float:
    return math.pow(a, b)


def _program(number: float) -> str:
    """The label of a program."""
    return f"O{int(number)}"


def _short(number: float) -> str:
    if number >= SPLIT:
        raise NotKnown(
            "some controls read P with more than four digits as a number of repetitions and a program number: "
            'write family = "fanuc" or "linuxcnc" in the machine file'
        )
    return _program(number)


OPERATIONS: Operations = {
    **ARITHMETIC,
    "**": _power,
    "MOD": _modulo,
    "EQ": lambda a, b: truth(_agreed(a, b)),
    "NE": lambda a, b: truth(not _agreed(a, b)),
    **{name: _ordered(name, sign) for name, sign in SIGNS.items()},
    "AND": _logic("AND", lambda a, b: a and b),
    "OR": _logic("OR", lambda a, b: a or b),
    "XOR": _logic("XOR", lambda a, b: a != b),
    "FIX": lambda a: float(math.floor(a)) if a >= 0.0 else _differing("FIX"),
    "FUP": lambda a: float(math.ceil(a)) if a >= 0.0 else _differing("FUP"),
    "ROUND": _round,
    "program": _short,
    "numbered block": lambda _: _numbered(),
    "repeated program": _short,
    "repetitions": lambda _: 1.0,
    "ATAN2": lambda a, b: math.degrees(math.atan2(a, b)) if b > 0.0 else _differing("ATAN"),
}


def _numbered() -> Value:
    raise NotKnown('M97 calls the blocks from a number on, on HAAS only: write family = "fanuc" in the machine file')


def _differing(name: str) -> float:
    raise NotKnown(f"{name} of these numbers depends on the control")


class IsoVariables(msgspec.Struct):
    """The values of `#1`, `#<name>`; those that the program has not set are not known."""

    operations: Operations = msgspec.field(default_factory=lambda: OPERATIONS)
    empty: bool = False
    """#0, and a variable of a macro that its call leaves out, are empty (FANUC)."""
    system: int = SYSTEM
    """Number of the first variable that belongs to the control."""
    last_local: int = 0
    """Number of the last variable that a macro has of its own; 0 where it depends on the control."""
    shared: dict[str, Value | NotKnown] = msgspec.field(default_factory=lambda: {VALUE: 0.0, RETURNED: 0.0})
    own: list[dict[str, Value | NotKnown]] = msgspec.field(default_factory=lambda: [{}])
    """Local variables of the main program, and of each subprogram that runs."""

    def get(self, name: str, indices: tuple[Value, ...]) -> Value:
        """The value of `#` with its number, or of `#<name>`."""
        if self.empty and self._is_empty(name, indices):
            return EMPTY
        asked = name.removeprefix(f"{EXISTS} ")
        key, store = self._stored_at(asked, indices)
        value = store.get(key)
        if asked != name:
            return self._exists(key, value)
        return known_value(value, key)

    def _is_empty(self, name: str, indices: tuple[Value, ...]) -> bool:
        """Whether a variable is #0, or one of a macro's own that nothing has set."""
        if name != "#" or not indices or not isinstance(indices[0], float):
            return False
        number = round(indices[0])
        inside = self.own[-1] is not self.own[0]
        return number == 0 or (inside and number in LOCALS and f"#{number}" not in self.own[-1])

    def _exists(self, key: str, value: Value | NotKnown | None) -> Value:
        if value is None and key.startswith("#<_"):
            raise NotKnown(f"ncomp does not know whether LinuxCNC itself has {key}")
        return truth(value is not None or not key.startswith("#<"))

    def set(self, name: str, indices: tuple[Value, ...], value: Value | NotKnown) -> None:
        """Set it; NotKnown for a system variable."""
        key, store = self._stored_at(name, indices)
        number = int(key[1:]) if key[1:].isdigit() else 0
        if number in HARMLESS and number >= self.system:
            store[key] = NotKnown(HARMLESS[number])
            return
        if number >= self.system and number != DEBUG:
            raise NotKnown(
                f"{key} is a system variable of the control, and the effect of its value is not known to ncomp"
            )
        store[key] = value

    def lose_results(self, expression: Expression) -> None:
        """No function of these controls sets a variable."""

    @property
    def state(self) -> object:
        """The values of all variables."""
        return self.shared, self.own

    def forget(self, reason: str) -> None:
        """Mark the variables as unknown that all programs share."""
        self.shared = dict.fromkeys(self.shared, NotKnown(reason))

    def enter(self, arguments: dict[int, Value | NotKnown] | None) -> None:
        """Begin a macro with variables of its own, or a subprogram without."""
        own = self.own[-1] if arguments is None else {f"#{n}": value for n, value in arguments.items()}
        self.own.append(own)

    def leave(self) -> dict[int, Value | NotKnown]:
        """End it."""
        return {int(name[1:]): value for name, value in self.own.pop().items() if name[1:].isdigit()}

    def _stored_at(self, name: str, indices: tuple[Value, ...]) -> tuple[str, dict[str, Value | NotKnown]]:
        if not indices:
            return name, self.shared if name.startswith("#<_") else self.own[-1]
        (index,) = indices
        if not isinstance(index, float) or not nearly(index, round(index)):
            raise NotKnown(f"#{index} is not the number of a variable: write a whole number")
        number = round(index)
        if number == 0:
            raise NotKnown("#0 is the empty variable on some controls only: write another variable")
        last = self.last_local
        if not last and number > LINUXCNC_LOCALS and number in LOCALS and len(self.own) > 1:
            raise NotKnown(
                f"whether a subprogram has a #{number} of its own depends on the control; "
                'write family = "fanuc" or "linuxcnc" in the machine file'
            )
        local = number <= last if last else number in LOCALS
        return f"#{number}", self.own[-1] if local else self.shared


def _linuxcnc_logic(result: Callable[[bool, bool], bool]) -> Callable[[float, float], float]:
    return lambda a, b: truth(result(a != 0.0, b != 0.0))


def _close(a: float, b: float) -> bool:
    return abs(a - b) < LINUXCNC_EQUAL


def _half_away(a: float) -> float:
    """The nearest whole number, of two as near the one farther from zero."""
    return math.copysign(math.floor(abs(a) + 0.5), a)


def _fanuc_equal(a: Value, b: Value) -> bool:
    """An empty variable equals another one alone, and not 0."""
    if isinstance(a, str) or isinstance(b, str):
        return a == b
    return _agreed(a, b)


LINUXCNC: Operations = {
    "MOD": lambda a, b: a % abs(b),
    "EQ": lambda a, b: truth(_close(a, b)),
    "NE": lambda a, b: truth(not _close(a, b)),
    "LT": lambda a, b: truth(a < b),
    "LE": lambda a, b: truth(a <= b),
    "GT": lambda a, b: truth(a > b),
    "GE": lambda a, b: truth(a >= b),
    "AND": _linuxcnc_logic(lambda a, b: a and b),
    "OR": _linuxcnc_logic(lambda a, b: a or b),
    "XOR": _linuxcnc_logic(lambda a, b: a != b),
    "FIX": lambda a: float(math.floor(a)),
    "FUP": lambda a: float(math.ceil(a)),
    "ROUND": _half_away,
    "ATAN2": lambda a, b: math.degrees(math.atan2(a, b)),
}
"""Operations as LinuxCNC's interpreter evaluates them."""
FANUC: Operations = {
    "EQ": lambda a, b: truth(_fanuc_equal(a, b)),
    "NE": lambda a, b: truth(not _fanuc_equal(a, b)),
    **{name: COMPARISONS[sign] for name, sign in SIGNS.items()},
    "FIX": lambda a: float(math.trunc(a)),
    "FUP": lambda a: math.copysign(math.ceil(abs(a)), a),
    "ROUND": _half_away,
}
"""Operations by FANUC's manual: fractions are rounded towards zero or away from zero."""


TELLS_VACANT = frozenset(("EQ", "NE"))
"""Operations that tell an empty variable from 0."""
NEEDS_VALUE = frozenset(("neg", "pos", "program", "numbered block", "repeated program", "repetitions"))
"""Operations that have no result for an empty variable: X-#1 is no X0."""


def _with_vacant(name: str, operation: Callable[..., Value]) -> Callable[..., Value]:
    """The operation of FANUC, for which an empty variable counts as 0; NotKnown where it has no result."""
    if name in TELLS_VACANT:
        return operation
    if name in NEEDS_VALUE:
        return lambda value: _vacant() if value == EMPTY else operation(value)
    return lambda *values: operation(*(0.0 if value == EMPTY else value for value in values))


def _vacant() -> Value:
    raise NotKnown(
        "the variable is empty, and its sign (- or +) or a program of its number is not known: give it a value before "
        "this block"
    )


def variables_of(family: str) -> IsoVariables:
    """The variables of a program, for controls of a family."""
    if family in ("any", "grbl", "mach3"):
        return IsoVariables()
    plain = {**OPERATIONS, "program": _program, "repetitions": lambda _: 1.0, "repeated program": _program}
    if family == "linuxcnc":
        return IsoVariables({**plain, **LINUXCNC}, system=LINUXCNC_SYSTEM, last_local=LINUXCNC_LOCALS)
    if family == "fanuc":
        plain |= FANUC
        plain |= {
            "numbered block": float,
            "repetitions": lambda number: float(number // SPLIT) or 1.0,
            "repeated program": lambda n: _program(n % SPLIT),
        }
        plain = {name: _with_vacant(name, operation) for name, operation in plain.items()}
    return IsoVariables(plain, empty=True, last_local=LOCALS[-1])
