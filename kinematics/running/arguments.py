"""Arguments of public functions, checked and converted by the annotations in their signatures.

An annotation is read as text: the classes that it names need not be imported, because an object of a class that nobody
has imported does not exist.
"""

from __future__ import annotations

import ast
import functools
import inspect
import math
import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from numbers import Integral, Real
from pathlib import Path
from typing import Any

from kinematics.files.mistaken import did_you_mean
from kinematics.user_error import UserError

SHOWN_CHARACTERS = 60
"""Largest number of characters of a refused value in a message."""
MADE_BY = {
    "Conditions": "ncomp.conditions",
    "ErrorModel": "ncomp.load_calibration or ncomp.fit(...).model",
    "Machine": "ncomp.load_machine",
    "Measurement": "ncomp.read_measurement",
    "Plan": "ncomp.plan",
    "Setup": "ncomp.set_up",
}
"""The functions that make the objects of a class."""
MISSING = object()
"""The value of an argument that is of another kind than the annotation."""


def checked(
    function: Callable[..., Any], positional: tuple[Any, ...], named: Mapping[str, Any]
) -> inspect.BoundArguments:
    """The arguments of a call, converted: a text in the place of a list becomes a list of one, for example.

    UserError for an argument that the function does not have, or that is of another kind.
    """
    signature = inspect.signature(function)
    for name in named:
        if not isinstance(name, str):
            raise UserError(f"{function.__name__}(): {name!r} is no name of an argument: expected a text")
    try:
        given = signature.bind(*positional, **named)
    except TypeError as fault:
        unknown = next((name for name in named if name not in signature.parameters), None)
        hint = "" if unknown is None else did_you_mean(unknown, signature.parameters)
        raise UserError(f"{function.__name__}(): {fault}{hint}") from None
    for name, value in given.arguments.items():
        if signature.parameters[name].kind is inspect.Parameter.VAR_KEYWORD:
            continue
        annotation = str(signature.parameters[name].annotation)
        converted = _converted(value, _parsed(annotation))
        if converted is MISSING:
            expected = " or ".join(dict.fromkeys(_expected(_parsed(annotation))))
            raise UserError(f"{function.__name__}(): {name}={_shown(value)}: expected {expected}")
        given.arguments[name] = converted
    return given


@functools.cache
def _parsed(annotation: str) -> ast.expr:
    return ast.parse(annotation, mode="eval").body


def _shown(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= SHOWN_CHARACTERS and text.isprintable() else f"<{type(value).__name__}>"


def _converted(value: Any, kind: ast.expr) -> Any:
    """The value as one of this kind; MISSING if it is none."""
    if isinstance(kind, ast.BinOp):
        found = (_converted(value, each) for each in (kind.left, kind.right))
        return next((each for each in found if each is not MISSING), MISSING)
    if isinstance(kind, ast.Constant):
        return value if value is kind.value else MISSING
    if isinstance(kind, ast.Subscript):
        return GENERIC[ast.unparse(kind.value)](value, kind.slice)
    name = ast.unparse(kind)
    if name in PLAIN:
        return PLAIN[name](value)
    return value if name in {each.__name__ for each in type(value).__mro__} else MISSING


def _integer(value: Any) -> Any:
    return int(value) if isinstance(value, Integral) and not isinstance(value, bool) else MISSING


def _number(value: Any) -> Any:
    is_number = isinstance(value, Real) and not isinstance(value, bool)
    return float(value) if is_number and math.isfinite(value) else MISSING


def _boolean(value: Any) -> Any:
    return bool(value) if type(value).__name__ in ("bool", "bool_") else MISSING


def _options(value: Any) -> Any:
    return value if isinstance(value, (str, Mapping)) else _sequence(value, ast.Name("str"))


def _array(value: Any) -> Any:
    import numpy as np

    if value is None:
        return MISSING
    try:
        return np.asarray(value, float)
    except (TypeError, ValueError):
        return MISSING


def _sequence(value: Any, kind: ast.expr) -> Any:
    """A list of values; one text, or one path, counts as a list of one."""
    if isinstance(value, (str, os.PathLike)):
        value = [value]
    if not isinstance(value, Iterable) or isinstance(value, (bytes, Mapping)):
        return MISSING
    found = [_converted(each, kind) for each in value]
    return MISSING if any(each is MISSING for each in found) else found


def _within(value: Any, parts: ast.expr) -> Any:
    """A number within its limits, `Annotated[float, 0, 5000]`; None for no upper limit."""
    kind, low, high = parts.elts  # type: ignore[attr-defined]
    found = _converted(value, kind)
    if found is MISSING or found is None:
        return found
    least, most = ast.literal_eval(low), ast.literal_eval(high)
    return found if least <= found <= (math.inf if most is None else most) else MISSING


PLAIN: dict[str, Callable[[Any], Any]] = {
    "str": lambda value: str(value) if isinstance(value, str) else MISSING,
    "int": _integer,
    "float": _number,
    "bool": _boolean,
    "Path": lambda value: Path(value) if isinstance(value, os.PathLike) else MISSING,
    "Texts": _options,
    "Array": _array,
    "BinaryIO": lambda value: value if hasattr(value, "write") else MISSING,
    "Progress": lambda value: value if callable(value) else MISSING,
}
"""Conversion of values by the name of their kind."""
GENERIC: dict[str, Callable[[Any, ast.expr], Any]] = {
    "Literal": lambda value, kind: value if isinstance(value, str) and value in _values(kind) else MISSING,
    "tuple": lambda value, _: tuple(value) if isinstance(value, (tuple, list)) else MISSING,
    "list": lambda value, _: list(value) if isinstance(value, (tuple, list)) else MISSING,
    "Callable": lambda value, _: value if callable(value) else MISSING,
    "Mapping": lambda value, _: value if isinstance(value, Mapping) else MISSING,
    "Sequence": _sequence,
    "Iterable": _sequence,
    "Annotated": _within,
}
"""Conversion of values by the name of a kind with parameters."""
TEXTS = {
    "str": "a text",
    "int": "a whole number",
    "float": "a finite number",
    "bool": "True or False",
    "Path": "a path",
    "Texts": "NAME=VALUE or values by name",
    "Array": "an array of numbers",
    "BinaryIO": "a file that is open for writing bytes",
    "Progress": "a function",
    "None": "None",
}


def _values(kind: ast.expr) -> list[str]:
    parts = kind.elts if isinstance(kind, ast.Tuple) else [kind]
    return [ast.literal_eval(each) for each in parts]


def _expected(kind: ast.expr) -> Iterator[str]:
    """What a kind of argument is, in words."""
    if isinstance(kind, ast.BinOp):
        yield from _expected(kind.left)
        yield from _expected(kind.right)
        return
    name = ast.unparse(kind.value if isinstance(kind, ast.Subscript) else kind)
    if not isinstance(kind, ast.Subscript):
        made = f" (of {MADE_BY[name]})" if name in MADE_BY else ""
        yield TEXTS.get(name) or f"{'an' if name[0] in 'AEIOU' else 'a'} {name}{made}"
    elif name == "Literal":
        yield from map(repr, _values(kind.slice))
    elif name == "Annotated":
        of, low, high = kind.slice.elts  # type: ignore[attr-defined]
        upper = ast.unparse(high)
        limits = f"{ast.unparse(low)} or above" if upper == "None" else f"{ast.unparse(low)} to {upper}"
        yield from (text if text == "None" else f"{text}, {limits}" for text in _expected(of))
    elif name in ("tuple", "list"):
        yield f"a {name}"
    elif name in ("Sequence", "Iterable"):
        yield f"a list of {' or '.join(_expected(kind.slice))}"
    else:
        yield "a function" if name == "Callable" else "values by name"
