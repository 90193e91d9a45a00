"""Readable JSON: a value that fits on a line is written on one, any other with one member on each line."""

from __future__ import annotations

import textwrap
from typing import Any

LINE_WIDTH = 120


def to_json(value: Any) -> str:
    """A value of dicts, lists, strings, numbers, True, False and None; ValueError for a number that is not finite."""
    return _layout(value, "", 0)


def _layout(value: Any, indent: str, used: int) -> str:
    """`value` behind `used` columns of its first line, its further lines indented."""
    if not value or not isinstance(value, dict | list):
        return _flat(value)
    if used + 3 * _least_values(value) < LINE_WIDTH and used + len(flat := _flat(value)) < LINE_WIDTH:
        return flat
    inner = indent + "  "
    if isinstance(value, dict):
        names = [f"{_flat(name)}: " for name in value]
        members = [
            name + _layout(member, inner, len(inner + name)) for name, member in zip(names, value.values(), strict=True)
        ]
        return "{\n" + ",\n".join(inner + member for member in members) + f"\n{indent}}}"
    if any(isinstance(member, dict | list | str) for member in value):
        lines = [_layout(member, inner, len(inner)) for member in value]
        return "[\n" + ",\n".join(inner + line for line in lines) + f"\n{indent}]"
    numbers = textwrap.wrap(_flat(value)[1:-1], LINE_WIDTH - len(inner), break_long_words=False, break_on_hyphens=False)
    return "[\n" + "\n".join(inner + line for line in numbers) + f"\n{indent}]"


def _flat(value: Any) -> str:
    import json

    return json.dumps(value, ensure_ascii=False, allow_nan=False)


def _least_values(value: Any) -> int:
    """A lower bound of the number of values in `value`; each takes three characters of a list at least."""
    if not value or not isinstance(value, dict | list | tuple):
        return 1
    if len(value) > LINE_WIDTH:
        return len(value)
    return sum(map(_least_values, value.values() if isinstance(value, dict) else value))
