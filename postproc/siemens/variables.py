"""Variables, operators and functions of Siemens 840D programs."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

from postproc.siemens.control_data import PARTS, ControlData, chained, fine_translation, translation, unscaled, unturned
from postproc.text.expressions import (
    ARITHMETIC,
    COMPARISONS,
    Expression,
    NotKnown,
    Operation,
    Operations,
    Value,
    Variable,
    known_value,
    nearly,
    operations_in,
    same_when_corrected,
    truth,
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
_COUNTERS = "$AC_TIMER $AC_MARKER $AC_PARAM"
SETTINGS = frozenset((*_SPEEDS.split(), *(f"$A_{name}" for name in _OUTPUTS.split()), *_COUNTERS.split()))
"""Speeds of axes, positions of spindles, outputs, timers and markers: they move nothing elsewhere."""
MOST_FIELD_ELEMENTS = 100_000
"""Elements of a field."""
EMPTY = Operation("an omitted argument", ())
"""An argument that is left out."""
_TEXTS = "STRLEN TOUPPER TOLOWER INDEX RINDEX MINDEX SUBSTR MATCH SPRINT NUMBER ISNUMBER"
_NAMES = "ISVAR ISAXIS ISFILE AXNAME AXTOINT AXTOSPI SPI GETT GETDNO CTABEXISTS MODAXVAL"
READING = frozenset(("SET", "REP", *_TEXTS.split(), *_NAMES.split()))
"""Functions that ncomp does not follow, and that write no result into their arguments.

Others may, as CALCDAT, INTERSEC, CALCPOSI, GETACTTD, GETTCOR, CORRTRAFO and MEASURE do, and the procedures READ, WRITE,
DELETE, CONTPRON, CONTDCON, EXECUTE, GETSELT, GETEXET and those for files."""


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


CONVERSIONS: Mapping[str, Callable[[float], float]] = {"INT": _rounded, "BOOL": lambda a: truth(a != 0.0)}
"""Numbers as variables of other types than REAL take them (Job planning 07/2010, implicit data type conversions)."""


def _joined(a: Value, b: Value) -> str:
    parts = [part if isinstance(part, str) else f"{part:.10g}" for part in (a, b)]
    return "".join(parts)


def _agreed(as_documented: Value, as_usual: Value) -> Value:
    if as_documented != as_usual:
        raise NotKnown("a comparison binds less than AND and OR: write brackets round each comparison")
    return as_documented


NAME = re.compile(r"(?:_N_)?(\w+?)(?:[._](?:SPF|MPF))?")
"""The name of a program, in a name or in that of its file."""


def label(name: Value, home: Value) -> str:
    """The label of a program by its name, or by a path whose folder is the one of the calling program, `home`.

    NotKnown for other paths.
    """
    folder, _, last = str(name).upper().strip().rpartition("/")
    if (folder and folder != home) or not (match := NAME.fullmatch(last)):
        raise NotKnown(
            "a program is called by its name, or by a path in its own folder (;$PATH=, or NAME.WPD), and looked for "
            'in the folders of the programs: write CALL "NAME"'
        )
    return f"%{match[1]}"


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
    "ROUNDUP": lambda a: float(math.ceil(a)),
    "ROUND": _rounded,
    "MINVAL": min,
    "MAXVAL": max,
    "BOUND": lambda low, high, value: min(max(low, value), high),
    EITHER_WAY: _agreed,
    "CTRANS": translation,
    "CFINE": fine_translation,
    "CROT": unturned,
    "CSCALE": unscaled,
    "CMIRROR": unturned,
    ":": chained,
    "called program": label,
}


def _bits(a: float) -> int:
    if a != int(a) or a < 0.0:
        raise NotKnown(f"{a:g} in a bit operation is no whole number of 0 or more: write such a number")
    return int(a)


CONTOUR_ANGLES = frozenset(("ANG", "ANG1", "ANG2"))
"""Addresses of angles of straight lines (contour definition programming)."""
MEASURED = frozenset(("$AA_IW", "$AA_IM", "$AA_IB", "$AA_IEN", "$AA_IBN"))
"""Actual positions of an axis, in the coordinates of the workpiece, the machine and between them."""


class Positions(Protocol):
    """The positions of the axes, as a program reads them."""

    def value(self, name: str, indices: tuple[Value, ...]) -> Value:
        """That of an axis, by the name of a variable of MEASURED and its index; NotKnown where it is not certain."""

    @property
    def state(self) -> object:
        """All that a program reads."""


@dataclass
class _Level:
    """The variables of a program, or of a subprogram while it runs."""

    values: dict[tuple[str, tuple[int, ...]], Value | NotKnown] = field(default_factory=dict)
    kinds: dict[str, str] = field(default_factory=dict)
    """Types of the declared variables, by name."""
    sizes: dict[str, tuple[int, ...]] = field(default_factory=dict)
    """Sizes of the declared variables, by name; () for one that is no array."""
    arguments: dict[int, Value | NotKnown] = field(default_factory=dict)
    """By their position in the call, from 1."""
    passed: dict[int, tuple[str, tuple[Value, ...]]] = field(default_factory=dict)
    """Variables of the caller among the arguments, by their position: names and indices."""
    returned: dict[str, tuple[str, tuple[Value, ...]]] = field(default_factory=dict)
    """Variables of the caller that get the value of a parameter at the end, by its name."""


@dataclass
class SiemensVariables:
    """R parameters, which all programs share, and declared variables; nothing is known of others."""

    operations: Operations = field(default_factory=lambda: OPERATIONS)
    shared: dict[tuple[str, tuple[int, ...]], Value | NotKnown] = field(default_factory=dict)
    levels: list[_Level] = field(default_factory=lambda: [_Level()])
    of_control: _Level = field(default_factory=_Level)
    """Variables that the control has (GUD), by the definitions that the user gives."""
    data: ControlData = field(default_factory=ControlData)
    passed: dict[int, tuple[str, tuple[Value, ...]]] = field(default_factory=dict)
    """Variables among the arguments of the call that runs next."""
    passive: frozenset[str] = frozenset()
    """Names of axes outside the chain."""
    basic_unit_is_inch: bool = False
    """Tables of the control are in inches."""
    positions: Positions | None = None
    """The positions of the axes; None while no program runs."""

    @property
    def depth(self) -> int:
        """Subprograms in one another."""
        return len(self.levels) - 1

    def _of(self, name: str) -> _Level:
        """Where a variable belongs: to the program that runs, unless only the control has it."""
        here = self.levels[-1]
        return self.of_control if name in self.of_control.kinds and name not in here.kinds else here

    def get(self, name: str, indices: tuple[Value, ...]) -> Value:
        """The value of a variable; the name of an axis alone is its own value."""
        shown = name + (f"[{', '.join(map(_shown, indices))}]" if indices and name != "R" else "")
        if name == "R" and indices:
            shown = f"R{_shown(indices[0])}"
        here = self._of(name)
        if name in CONSTANTS and not indices:
            return CONSTANTS[name]
        if name in MACHINING and name not in here.kinds:
            return MACHINING[name]
        if name in MEASURED:
            if self.positions is None:
                raise NotKnown(f"{shown} is read from the control while no program runs: write a number")
            return self.positions.value(name, indices)
        if name.startswith("$"):
            raise NotKnown(f"{shown} belongs to the control, and its value is not known to ncomp: write a number")
        if name in SETTINGS:
            raise NotKnown(f"{shown} is a setting of an axis, and its value is not known to ncomp: write a number")
        if name in NAMES and not indices and name not in here.kinds:
            return name
        value = (self.shared if name == "R" else here.values).get((name, _whole_indices(indices)))
        if value is None and here is self.of_control:
            raise NotKnown(f"{shown} has a value on the control, which is not known to ncomp: set it in the program")
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
            value = same_when_corrected(value) if isinstance(value, float) else value
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
        here = self._of(name)
        if name in CONTOUR_ANGLES and name not in here.kinds:
            raise NotKnown(f"{name} gives the end of a line by its angle, which is not followed: write its coordinates")
        if name != "R" and name not in here.kinds:
            raise NotKnown(
                f"{name} is neither a declared variable nor an axis: write DEF, or passive_axes in the machine file; "
                "--definitions gives the variables of the control"
            )
        at, sizes = _whole_indices(indices), here.sizes.get(name)
        if sizes == () and at and here.kinds[name] == "STRING":
            at, value = (), NotKnown("a character of it was set, and texts are followed as a whole only")
        elif sizes is not None and (len(at) != len(sizes) or any(i >= size for i, size in zip(at, sizes, strict=True))):
            raise NotKnown(f"{_named(name, at)} is no element of {_named(name, sizes)}, as DEF declares it")
        if name != "R" and isinstance(value, float):
            value = _converted(value, here.kinds[name])
        (self.shared if name == "R" else here.values)[name, at] = value

    def fill(self, name: str, indices: tuple[Value, ...], values: Sequence[Value | NotKnown | None]) -> None:
        """Give an element of an array, and those behind it, values in the order of their indices, the last one first.

        The element of a None is not set.
        """
        for at, value in zip(self._elements(name, indices, len(values)), values, strict=True):
            if value is not None:
                self.set(name, tuple(map(float, at)), value)

    def elements_behind(self, name: str, indices: tuple[Value, ...]) -> int:
        """Number of elements from one on to the last of its array; of R parameters, to the last that is set."""
        if name == "R":
            (first,) = _whole_indices(indices)
            return max(*(at[0] + 1 - first for _, at in self.shared), 0, 0)
        sizes = self._of(name).sizes.get(name, ())
        at = (*_whole_indices(indices), *(0 for _ in sizes))[: len(sizes)]
        return math.prod(sizes) - sum(i * math.prod(sizes[level + 1 :]) for level, i in enumerate(at))

    def _elements(self, name: str, indices: tuple[Value, ...], count: int) -> list[tuple[int, ...]]:
        """The indices of elements from one on; NotKnown where the array has fewer."""
        if name.startswith("$"):
            raise NotKnown(
                f"{name} belongs to the control, and a list of values for it is not followed: write one value"
            )
        at = _whole_indices(indices)
        if name == "R" and len(at) == 1:
            return [(at[0] + i,) for i in range(count)]
        if count > self.elements_behind(name, indices):
            raise NotKnown(
                f"{_named(name, at)} has fewer elements behind it than the list has values: correct the list"
            )
        sizes = self._of(name).sizes.get(name, ())
        first = math.prod(sizes) - self.elements_behind(name, indices)
        return list(itertools.islice(itertools.product(*map(range, sizes)), first, first + count))

    def lose_results(self, expression: Expression) -> None:
        """Mark the variables as unknown that functions get as arguments, for they may write their results there."""
        for name, variable in set_by(expression):
            self.lose(name, variable)

    def lose(self, name: str, variable: Variable) -> None:
        """Mark a variable, all elements of an array, as unknown: a function or procedure of a name may set it."""
        for values in (self.shared, self.levels[-1].values, self.of_control.values):
            for key in values:
                if key[0] == variable.name:
                    values[key] = NotKnown(f"{name} may write a result there")

    @property
    def state(self) -> object:
        """The values of all variables, the data of the control that the program has set, and positions it may read."""
        positions = None if self.positions is None else self.positions.state
        return self.shared, self.levels, self.of_control, self.data, positions

    def forget(self, reason: str) -> None:
        """Mark the R parameters, and the variables of the control, as unknown."""
        self.shared = dict.fromkeys(self.shared, NotKnown(reason))
        self.of_control.values = dict.fromkeys(self.of_control.values, NotKnown(reason))

    def define(self, kind: str, name: str, sizes: Sequence[int]) -> None:
        """A variable of the control (GUD), which all programs share, with a value that nothing states."""
        self.of_control.kinds[name], self.of_control.sizes[name] = kind, tuple(sizes)

    def declare(self, kind: str, name: str, sizes: Sequence[int], values: Sequence[Value | NotKnown | None]) -> None:
        """A new variable, with first values in the order of its elements, last index first."""
        here = self.levels[-1]
        here.kinds[name], here.sizes[name] = kind, tuple(sizes)
        empty: Value = "" if kind in ("STRING", "CHAR", "AXIS", "FRAME") else 0.0
        elements = math.prod(sizes)
        if elements > MOST_FIELD_ELEMENTS:
            raise NotKnown(f"the array has {elements} elements: write at most {MOST_FIELD_ELEMENTS}")
        every = list(itertools.product(*(range(size) for size in sizes)))
        for at in every:
            here.values[name, at] = empty
        for at, value in zip(every, values, strict=False):
            if value is not None:
                self.set(name, tuple(map(float, at)), value)

    def enter(self, arguments: dict[int, Value | NotKnown] | None) -> None:
        """A subprogram has variables of its own."""
        self.levels.append(_Level(arguments=arguments or {}, passed=self.passed))
        self.passed = {}

    def leave(self) -> dict[int, Value | NotKnown]:
        """The variables of a subprogram end with it; returned: the arguments of its call."""
        ended = self.levels.pop()
        for name, (target, indices) in ended.returned.items():
            self.set(target, indices, ended.values[name, ()])
        return ended.arguments


def _converted(value: float, kind: str) -> float:
    """The value as a variable of a type takes it."""
    return value if kind == "REAL" else CONVERSIONS.get(kind, float)(same_when_corrected(value))


def set_by(expression: Expression) -> Iterator[tuple[str, Variable]]:
    """The variables that functions of an expression may set, each with the name of the function."""
    for function in operations_in(expression):
        if function.name not in OPERATIONS and function.name not in READING:
            yield from ((function.name, given) for given in function.operands if isinstance(given, Variable))


def _whole_indices(indices: tuple[Value, ...]) -> tuple[int, ...]:
    found = []
    for index in indices:
        if not isinstance(index, float):
            raise NotKnown(f"{index} is an axis as an index: write a number")
        same_when_corrected(index)
        if index != int(index) or index < 0.0:
            raise NotKnown(f"{index:g} is no index: write a whole number of 0 or more")
        found.append(int(index))
    return tuple(found)


def _named(name: str, at: tuple[int, ...]) -> str:
    return f"{name}[{', '.join(map(str, at))}]" if at else name


def _shown(index: Value) -> str:
    return index if isinstance(index, str) else f"{index:g}"
