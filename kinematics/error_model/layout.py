"""Readable JSON: a value that fits on a line is written on one, any other with one member on each line."""

from __future__ import annotations

import json
import textwrap
from typing import Any

WIDTH = 120


def to_json(value: Any) -> str:
    """A value of dicts, lists, strings, numbers, True, False and None; ValueError for a number that is not finite."""
    return _layout(value, "", 0)


def _layout(value: Any, indent: str, used: int) -> str:
    """`value` behind `used` columns of its first line, its further lines indented."""
    flat = json.dumps(value, ensure_ascii=False, allow_nan=False)
    if used + len(flat) < WIDTH or not value or not isinstance(value, dict | list):
        return flat
    inner = indent + "  "
    if isinstance(value, dict):
        names = [f"{json.dumps(name, ensure_ascii=False)}: " for name in value]
        members = [
            name + _layout(member, inner, len(inner + name)) for name, member in zip(names, value.values(), strict=True)
        ]
        return "{\n" + ",\n".join(inner + member for member in members) + f"\n{indent}}}"
    if any(isinstance(member, dict | list | str) for member in value):
        lines = [_layout(member, inner, len(inner)) for member in value]
        return "[\n" + ",\n".join(inner + line for line in lines) + f"\n{indent}]"
    numbers = textwrap.wrap(flat[1:-1], WIDTH - len(inner), break_long_words=False, break_on_hyphens=False)
    return "[\n" + "\n".join(inner + line for line in numbers) + f"\n{indent}]"
