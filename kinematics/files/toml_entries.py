"""TOML files of users: entries of a type, and messages with the line and the entry that was meant."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterable
from dataclasses import fields, is_dataclass
from typing import Any, TypeVar, get_args, get_type_hints

import msgspec

from kinematics.files.mistaken import did_you_mean, kind_of_file, not_utf8
from kinematics.user_error import UserError

T = TypeVar("T")
NOUNS = {
    "str": "a text in quotes",
    "int": "a whole number",
    "float": "a number",
    "bool": "true or false",
    "array": "a list in [ ]",
    "object": "a table",
    "null": "nothing",
}
"""Types of msgspec's messages, for people."""
TOML = ("machine file", "job file", "study", "report head")
"""Kinds of files in TOML."""
_MISTAKES = (
    (r'"[^"]*\\', "; write paths with / in place of \\, or in single quotes"),
    (r"\d['\u2019]\d{3}|=\s*\d+\.\d{3},\d", "; write numbers without separators of thousands: 1250.5"),
    (r"=\s*[-+]?\d+,\d", "; write the decimal point as '.'"),
    (r"=\s*\d+[-./]\d+[-./]\d", "; write a date as year-month-day: 2026-11-03"),
    (r"=\s*[A-Za-z]", "; write texts in quotes"),
)
"""Typing mistakes in a line of TOML, each with its cure."""
_KEY = r"\"[^\"]*\"|'[^']*'|[\w-]+"
_HEADER = re.compile(rf"\s*\[{{1,2}}\s*((?:{_KEY})(?:\s*\.\s*(?:{_KEY}))*)\s*\]{{1,2}}")
_ENTRY = re.compile(rf"\s*((?:{_KEY})(?:\s*\.\s*(?:{_KEY}))*)\s*=")


def utf8_text(data: bytes, where: str) -> str:
    """The text of a file, with any line ends; UserError for another encoding. `where` names the file."""
    try:
        return data.decode().replace("\r\n", "\n").replace("\r", "\n")
    except UnicodeDecodeError:
        raise UserError(f"{where}: {not_utf8(data)}") from None


def read_table(text: str, where: str) -> dict[str, Any]:
    """The table in a TOML text; UserError with the line, for text that is none. `where` names it: `job file a.toml`."""
    try:
        return tomllib.loads(text.removeprefix("\ufeff"))  # the mark of UTF-8 by editors of Windows
    except tomllib.TOMLDecodeError as fault:
        reason = str(fault)
        place = re.fullmatch(r"(.*) \(at line (\d+), column (\d+)\)", reason)
        if (other := kind_of_file(text.encode())) and not any(kind in other for kind in TOML):
            raise UserError(f"{where}: this is {other}, no {where.split(' ', maxsplit=1)[0]} file: give one") from None
        line = f":{place[2]}" if place else ""
        shown = text.splitlines()[int(place[2]) - 1].strip() if place and text.splitlines()[int(place[2]) - 1 :] else ""
        reason = f"column {place[3]}: {place[1]}{_typing_hint(shown)}" if place else reason
        raise UserError(f"{where}{line}: {shown!r}: {reason}") from None
    except RecursionError:
        raise UserError(f"{where}: its lists and tables are nested too deeply: delete the surplus brackets") from None


def _typing_hint(line: str) -> str:
    """Cure of the likely typing mistake in a line, behind a separator."""
    if line.startswith("[") and "twice" not in line:
        return "; a table begins with its name in brackets, once in a file"
    return next((cure for mistake, cure in _MISTAKES if re.search(mistake, line)), "; expected name = value")


def at_line(text: str, where: str, fault: UserError) -> UserError:
    """The message of a fault in a text, with the line of the entry by whose path (`axes.X.travel: ...`) it begins."""
    message = re.sub(r"^axis (\w+): (\w+)", r"axes.\1.\2", str(fault))
    named = re.match(rf"(?:{_KEY})(?:\.(?:{_KEY})|\[\d+\])*", message)
    line = line_of(text, named[0]) if named else None
    return UserError(f"{where}{f':{line}' if line else ''}: {fault}")


def line_of(text: str, path: str) -> int | None:
    """Number of the line of an entry (`case[1].points`), or of the closest table around it; None for neither."""
    wanted = [part.strip("\"'") for part in re.findall(rf"{_KEY}", path.replace("[", ".").replace("]", ""))]
    best, line, table, counts = 0, None, list[str](), dict[str, int]()
    for number, content in enumerate(text.splitlines(), 1):
        header = _HEADER.match(content)
        if header:
            table = _keys(header[1])
            if content.strip().startswith("[["):
                index = counts[header[1]] = counts.get(header[1], -1) + 1
                table = [*table, str(index)]
        entry = None if header else _ENTRY.match(content)
        full = [*table, *_keys(entry[1])] if entry else table
        shared = min(len(full), len(wanted))
        if (header or entry) and shared > best and full[:shared] == wanted[:shared]:
            best, line = shared, number
    return line


def _keys(dotted: str) -> list[str]:
    return [key.strip("\"'") for key in re.findall(_KEY, dotted)]


def refuse_unknown(table: Iterable[str], known: Iterable[str], where: str = "") -> None:
    """UserError for a key that is not known, with the key that was meant. `where`: path of the table, `axes.X`."""
    names = list(known)
    for key in table:
        if key not in names:
            path = f"{where}.{key}" if where else key
            raise UserError(f"{path} is not known{did_you_mean(key, names)}; known are {', '.join(names)}")


def entry(value: object, kind: type[T], where: str = "") -> T:
    """A value of a table as `kind`; UserError that begins with the path of the wrong entry, `where` or below it."""
    _refuse_unknown_below(value, kind, where)
    try:
        return msgspec.convert(value, kind)
    except msgspec.ValidationError as fault:
        raise UserError(_for_people(str(fault), where, kind)) from None


def _refuse_unknown_below(value: object, kind: Any, where: str) -> None:
    """UserError for an unknown key of a table and of the tables in it."""
    inner = [kind, *get_args(kind)]
    known = next((each for each in inner if field_names(each)), None)
    if isinstance(value, dict) and known is not None:
        refuse_unknown(value, field_names(known), where)
        hints = get_type_hints(known)
        for key, below in value.items():
            _refuse_unknown_below(below, hints[key], f"{where}.{key}" if where else key)
    elif isinstance(value, list):
        for index, below in enumerate(value):
            for each in inner[1:]:
                _refuse_unknown_below(below, each, f"{where}[{index}]")


def field_names(kind: Any) -> list[str]:
    """Names of the fields of a dataclass or Struct; none for other types."""
    if is_dataclass(kind):
        return [field.name for field in fields(kind)]
    return list(getattr(kind, "__struct_fields__", ()))


def _type_at(kind: Any, below: str) -> Any:
    """The type of the entry at a path below a type."""
    for name in re.findall(r"\.(\w+)", below):
        known = next((each for each in (kind, *get_args(kind)) if field_names(each)), None)
        kind = None if known is None else get_type_hints(known).get(name)
    return kind


def _for_people(message: str, where: str, kind: Any) -> str:
    """A message of msgspec with the path of the entry at its beginning and the types in words."""
    reason, _, below = message.partition(" - at `$")
    path = where + below.rstrip("`").replace("[...]", "")
    path = path.removeprefix(".")
    if missing := re.fullmatch(r"Object missing required field `(\w+)`", reason):
        return f"{f'{path}.' if path else ''}{missing[1]} is missing: write {missing[1]} = ... into the file"
    if (wrong := re.fullmatch(r"Invalid enum value (.*)", reason)) and field_names(kind):
        choices = get_args(_type_at(kind, below))
        values = [value for choice in choices if choice is not type(None) for value in get_args(choice) or (choice,)]
        *others, last = (repr(value) for value in values) if values else ("another one",)
        reason = f"Expected {', '.join(others)}{' or ' if others else ''}{last}, not {wrong[1]}"
    if length := re.search(r"`array` of length (\d+), got (\d+)", reason):
        comma = " (write the decimal point as '.')" if int(length[2]) == 2 * int(length[1]) else ""
        comma = " (write one pair of brackets around them)" if length[2] == "1" else comma
        reason = reason.replace(length[0], f"a list of {length[1]} entries, not of {length[2]}{comma}")
    for name, noun in NOUNS.items():
        reason = re.sub(rf"`([^`]*)\b{name}\b([^`]*)`", rf"`\1{noun}\2`", reason)
    reason = reason.replace(", got ", ", not ").replace("`", "").replace(" | ", " or ")
    if reason.endswith(", not a table") and path:
        reason += "; write a name with a point in it in quotes"
    return f"{path}: {reason[:1].lower()}{reason[1:]}" if path else reason
