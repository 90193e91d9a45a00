"""Effects as text: `backlash:axis=X,width=12`, JSON, or a file of effects; checked against the table of effects."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec

from kinematics.effects import KINDS, Effect
from kinematics.error_model.decoding_faults import reason_of_fault
from kinematics.files import read_input
from kinematics.files.mistaken import did_you_mean
from kinematics.machine import Machine
from kinematics.user_error import UserError

_OPEN, _CLOSED = "[{", "]}"


def read_effects(texts: Sequence[str], machine: Machine, option: str = "--effect") -> list[Effect]:
    """Effects of a machine from texts: `kind:field=value,...`, a JSON object, or the path of a JSON file of effects.

    Values are read as JSON if possible (numbers, rows `[1, 2]`, objects), otherwise as text. UserError for an effect
    that is not in the table, or an axis that the machine does not have; `option` is the name of the option in messages.
    """
    found: list[Effect] = []
    for text in texts:
        where = f"{option} {text}"
        if text.lstrip().startswith("{"):
            found.append(_effect(_json(text, where), where))
        elif text.partition(":")[0] not in KINDS and text.lower().endswith(".json"):
            found += _from_file(Path(text))
        else:
            found.append(_effect(_fields(text, where), where))
        for effect in found:
            for axis in effect.axes:
                if axis not in machine.names:
                    raise UserError(f"{where}: machine {machine.name} ({machine.chain}) has no axis {axis}")
    return found


def given_effects(given: Sequence[str | Effect], machine: Machine) -> list[Effect]:
    """Effects of a machine from texts, as `read_effects`, followed by those that are given as objects."""
    texts = [each for each in given if isinstance(each, str)]
    return [*read_effects(texts, machine), *(each for each in given if not isinstance(each, str))]


def _from_file(path: Path) -> list[Effect]:
    """Effects in a file: a list, a single effect, or an object with a list `effects`, such as a calibration."""
    where = f"file of effects {path}"
    content = _json(read_input(path, "file of effects"), where)
    if isinstance(content, dict) and isinstance(content.get("effects"), list):
        content = content["effects"]
    if not isinstance(content, list):
        content = [content]
    return [_effect(each, where) for each in content]


def _fields(text: str, where: str) -> dict[str, Any]:
    kind, _, entries = text.partition(":")
    fields: dict[str, Any] = {"kind": kind.strip()}
    for entry in _split(entries):
        name, equals, value = entry.partition("=")
        if not equals:
            last = list(fields)[-1]
            lists = "" if last == "kind" else f"; lists are written {last}=[1,2]"
            raise UserError(f"{where}: {entry.strip()!r} is not of the form field=value{lists}")
        try:
            fields[name.strip()] = msgspec.json.decode(value)
        except msgspec.DecodeError:
            fields[name.strip()] = value.strip()
    return fields


def _split(text: str) -> list[str]:
    """Parts between the commas outside brackets."""
    parts, depth, start = [], 0, 0
    for i, letter in enumerate(text):
        depth += (letter in _OPEN) - (letter in _CLOSED)
        if letter == "," and depth == 0:
            parts.append(text[start:i])
            start = i + 1
    return [*parts, text[start:]] if text.strip() else []


def _json(text: str | bytes, where: str) -> Any:
    try:
        return msgspec.json.decode(text)
    except (msgspec.DecodeError, UnicodeDecodeError) as fault:
        raise UserError(f"{where}: {fault}") from None


def _effect(content: Any, where: str) -> Effect:
    kind: Any = content.get("kind") if isinstance(content, dict) else None
    if kind not in KINDS:
        raise UserError(
            f"{where}: no effect {kind!r}{did_you_mean(str(kind), KINDS)}; there are {', '.join(KINDS)} "
            "(docs/effects.md)"
        )
    # calibration files also contain units; these are checked where calibrations are read
    fields = {name: value for name, value in content.items() if name != "units"}
    try:
        effect: Effect = msgspec.convert(fields, Effect)
    except msgspec.ValidationError as fault:
        names = (field.name for field in msgspec.structs.fields(KINDS[kind]) if field.name not in ("u", "note"))
        raise UserError(
            f"{where}: {reason_of_fault(str(fault))}; {kind} has {', '.join(names)}{_of_lists(str(fault), fields)}"
        ) from None
    return effect


def _of_lists(fault: str, fields: Mapping[str, Any]) -> str:
    """Hint on the notation of a list, for a value that is not a list."""
    field = re.search(r"Expected `array`.* at `\$\.(\w+)`", fault)
    if field is None or isinstance(fields[field[1]], list):
        return ""
    return f"; lists are written {field[1]}=[{fields[field[1]]}]"
