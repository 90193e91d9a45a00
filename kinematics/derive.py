"""Derives the first-order error transform J of a chain with sympy, as NumPy source.

`python -m machines.derive --all` stores the source of the shipped machines in `kinematics/derived/`.

The chain, the frame and the centre of the error motions are those of `kinematics.forward`. To first order every error
motion displaces the tool as if it were alone: axis i, whose frame is seen from the workpiece through the rotation P_i,
adds

    position     P_i F_i (e_i + w_i x arm_i)        orientation     P_i F_i w_i

with F_i its error frame, e_i and w_i its translations and rotations, and arm_i from its error centre to the tool
point. Numbers are exact: decimals of the machine's file are rationals, lengths of directions are square roots.

The derivation is written once; `let` decides the use of its intermediate results. `_Definitions.let` gives them names
and lines of code, `_somewhere` substitutes numbers, which shows the entries of J that are always zero, and multiplying
out (in the tests) gives closed forms in the axis positions and the tool.
"""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Sequence
from functools import cache
from typing import Any, NamedTuple

from kinematics.effects import COMPONENTS
from kinematics.machine import ISO_DIRECTION, Axis, Machine

Matrix = Any
"""A sympy matrix."""
Let = Callable[[str, Matrix], Matrix]
"""Takes the name and the value of an intermediate result; returns the value for the further calculation."""

_WIDTH = 120


@cache
def _sympy() -> Any:
    """The sympy package: imported by the first derivation, since a run on a shipped machine needs none."""
    import sympy  # type: ignore[import-untyped]

    return sympy


class Links(NamedTuple):
    """A chain in symbols, from which all results are derived."""

    rotations: list[Matrix]
    """Rotation of each axis, 3 x 3."""
    frames: list[Matrix]
    """Error frame of each axis, 3 x 3."""
    arms: list[Matrix]
    """From each axis' error centre to the tool point, in the frame of its error motions, mm."""
    tip: Matrix
    """The tool point in the workpiece frame, mm: forward kinematics."""


def links(machine: Machine, let: Let) -> Links:
    """Rotations, error frames and arms of all axes, from the tool back to the workpiece."""
    sp = _sympy()
    rotations: list[Matrix] = []
    arms: list[Matrix] = []
    tip = sp.Matrix(sp.symbols("tx ty tz"))
    for axis in reversed(machine.axes):
        q, point = sp.Symbol(axis.name), _exact(axis.point)
        if axis.rotary:
            rotation = _rotation(axis, let)
            arm = let(f"arm_{axis.name}", tip - point)
            turned = let(f"turned_{axis.name}", rotation * arm)
            rotations.append(rotation)
            arms.append(turned if axis.side == "tool" else arm)
            tip = let(f"tip_{axis.name}", turned + point)
        else:
            step = q * _unit(axis)
            rotations.append(sp.eye(3))
            # the error centre travels with the axis, so an axis that carries the tool keeps its distance to it
            travelled = sp.zeros(3, 1) if axis.side == "tool" else step
            arms.append(let(f"arm_{axis.name}", tip - point + travelled))
            tip = let(f"tip_{axis.name}", tip + step)
    return Links(rotations[::-1], [_error_frame(axis) for axis in machine.axes], arms[::-1], tip)


def error_transform(machine: Machine, let: Let) -> Matrix:
    """J (6, axes * 6): rows position x y z, then rotation vector; columns axis by axis in chain order, E_X ... E_C."""
    sp = _sympy()
    chain = links(machine, let)
    before = sp.eye(3)
    columns = []
    for axis, rotation, frame, arm in zip(machine.axes, *chain[:3], strict=True):
        after = let(f"to_w_{axis.name}", before * rotation)
        view = before if axis.side == "tool" else after
        axes = let(f"frame_{axis.name}", view * frame)
        columns += [sp.Matrix([*axes[:, k], 0, 0, 0]) for k in range(3)]
        for k in range(3):
            name = f"{COMPONENTS[3 + k]}{axis.name}"
            swing = let(f"swing_{name}", frame[:, k].cross(arm))
            columns.append(sp.Matrix([*let(f"E_{name}", view * swing), *axes[:, k]]))
        before = after
    return sp.Matrix.hstack(*columns)


def _exact(values: Sequence[float]) -> Matrix:
    """A vector of a machine's file as rationals: 154.996 is 38749/250."""
    sp = _sympy()
    return sp.Matrix([sp.Rational(repr(float(v))) for v in values])


def _unit(axis: Axis) -> Matrix:
    """`Axis.unit_direction`, exact."""
    d = _exact(axis.direction)
    return d / _sympy().sqrt(d.dot(d))


def _cross_matrix(v: Matrix) -> Matrix:
    """The matrix that takes u to v x u."""
    return _sympy().Matrix([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])


def _rotation(axis: Axis, let: Let) -> Matrix:
    """Rotation of a rotary axis (Rodrigues)."""
    sp = _sympy()
    q, k = sp.Symbol(axis.name), _cross_matrix(_unit(axis))
    cosine = let(f"cos_{axis.name}", sp.Matrix([sp.cos(q)]))[0]
    sine = let(f"sin_{axis.name}", sp.Matrix([sp.sin(q)]))[0]
    rotation = (sp.eye(3) + k * k + sine * k - cosine * k * k).applyfunc(sp.expand)
    return let(f"rot_{axis.name}", rotation)


def _error_frame(axis: Axis) -> Matrix:
    """`Axis.error_frame`, exact: 1/(1 + c) is written (1 - c)/|v|^2, which keeps roots out of denominators."""
    sp = _sympy()
    letter, line = _exact(ISO_DIRECTION[axis.name[0]]), _unit(axis)
    if letter.dot(line) < 0:
        line = -line
    v, c = letter.cross(line), letter.dot(line)
    square = sp.expand(v.dot(v))
    if square == 0:
        return sp.eye(3)
    k = _cross_matrix(v)
    return (sp.eye(3) + k + k * k * (1 - c) / square).applyfunc(sp.expand)


def _somewhere(machine: Machine) -> Let:
    """The `let` that evaluates at an arbitrary pose and tool, to 50 digits.

    The entries of J are polynomials of degree 1 in each axis' position or its sine and cosine, so an entry that
    vanishes there, to 30 digits, vanishes everywhere.
    """
    sp = _sympy()
    names = (*machine.names, "tx", "ty", "tz")
    pose = {sp.Symbol(name): sp.sqrt(sp.prime(i + 2)).evalf(60) for i, name in enumerate(names)}
    return lambda _name, values: values.evalf(50, subs=pose)


class _Definitions:
    """Lines of code in the making: a value met again, or its negative, is not computed twice."""

    def __init__(self) -> None:
        self._values: dict[Any, Any] = {}
        self._names: dict[Any, Any] = {}

    def let(self, name: str, values: Matrix) -> Matrix:
        """Name the entries of a matrix; zeros, numbers and plain or negated variables keep no name."""
        letters = {1: [""], 3: ["_x", "_y", "_z"], 9: [f"_{r}{c}" for r in "xyz" for c in "xyz"]}[len(values)]
        named = [self._let(name + letter, _fold(value)) for letter, value in zip(letters, values, strict=True)]
        return _sympy().Matrix(*values.shape, named)

    def _let(self, name: str, value: Any) -> Any:
        if value.is_number or value.is_Symbol or (-value).is_Symbol:
            return value
        if -value in self._names:
            return -self._names[-value]
        if value not in self._names:
            symbol = _sympy().Symbol(name)
            self._names[value] = symbol
            self._values[symbol] = value
        return self._names[value]

    def lines(self, results: dict[str, Any]) -> list[str]:
        """Code that assigns each result to its targets, with the intermediate results that it needs before."""
        targets: dict[Any, list[str]] = {}
        for target, value in results.items():
            targets.setdefault(value, []).append(target)
        needed = {symbol for value in targets if not value.is_Symbol for symbol in value.free_symbols}
        code: list[str] = []
        for symbol, value in reversed(self._values.items()):
            if symbol in needed or symbol in targets:
                needed |= value.free_symbols
                names = [symbol.name] * (symbol in needed) + targets.pop(symbol, [])
                code.append(" = ".join((*names, _printer().doprint(value))))
        code.reverse()
        return [*code, *(" = ".join((*names, _printer().doprint(value))) for value, names in targets.items())]


def _fold(value: Any) -> Any:
    """Numbers that are no integers become floats: sqrt(2)/2 x is 0.7071067811865476 x."""
    sp = _sympy()
    if value.is_Integer or value.is_Symbol or isinstance(value, sp.sin | sp.cos):
        return value
    if value.is_Rational:
        return sp.Float(value.p / value.q)
    if value.is_number:
        return sp.Float(float(value.evalf(30)))
    if value.is_Mul:
        number, rest = value.as_independent(*value.free_symbols, as_Add=False)
        return _fold(number) * sp.Mul(*map(_fold, sp.Mul.make_args(rest)))
    return value.func(*map(_fold, value.args))


@cache
def _printer() -> Any:
    """Writes Python source: floats in full (`str` of a sympy Float has 15 digits) and NumPy's functions."""

    class Printer(_sympy().printing.str.StrPrinter):  # type: ignore[misc]
        def _print_Float(self, number: Any) -> str:
            return repr(float(number))

        def _print_Function(self, function: Any) -> str:
            return f"np.{super()._print_Function(function)}"

    return Printer()


_SOURCE = '''\
"""First-order error transform of the chain {chain}. Generated by `python -m machines.derive`; do not edit."""

import numpy as np

CHAIN_HASH = "{hash}"


def error_transform(q, tool):
    """J `(n, 6, {columns})` of axis positions {names} and tool vectors; see `kinematics.error_transform`."""
{body}
'''


def source(machine: Machine) -> str:
    """The derived module of a machine, without the entries of J that are always zero; always the same text."""
    definitions, columns = _Definitions(), 6 * len(machine.axes)
    J, numbers = error_transform(machine, definitions.let), error_transform(machine, _somewhere(machine))
    entries = {f"J[{r}, {c}]": J[r, c] for c in range(columns) for r in range(6) if abs(numbers[r, c]) > 1e-30}
    first, names = machine.names[0], ", ".join(machine.names)
    body = [
        f"{names}{',' * (columns == 6)} = np.ascontiguousarray(np.asarray(q, float).T)",
        "tx, ty, tz = np.asarray(tool, float).T",
        f"J = np.zeros((6, {columns}, np.broadcast({first}, tx).size))",
        *definitions.lines(entries),
        "return J.transpose(2, 0, 1)",
    ]
    wrapped = (textwrap.wrap(line, _WIDTH - 6, subsequent_indent="    ", break_on_hyphens=False) for line in body)
    text = textwrap.indent("\n".join(" \\\n".join(lines) for lines in wrapped), "    ")
    return _SOURCE.format(chain=machine.chain, hash=machine.chain_hash, columns=columns, names=names, body=text)
