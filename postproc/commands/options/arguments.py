"""The arguments of a command line that are plainly right, read without Typer, whose import takes longer than a job."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any, get_args

from postproc.commands.options.declared import REQUIRED, Declared

NUMBERS = {int: re.compile(r"[-+]?[0-9]{1,15}"), float: re.compile(r"[-+]?([0-9]+\.?[0-9]*|\.[0-9]+)")}
"""Forms of numbers that every reader of numbers accepts."""
EXPANDED = re.compile(r"[*?\[~$%]")
"""Characters for which Typer looks for files or variables where the shell does not (Windows)."""


class NotPlain(Exception):
    """An argument that Typer has to read or to refuse."""


def plain_values(declared: Sequence[Declared], words: Sequence[str]) -> dict[str, Any] | None:
    """The values of all declared options and arguments by name, as Typer reads them from these words.

    None for words that are not plainly right: a wrong name, form or number of arguments, and everything that has
    several meanings. Typer reads these, and `misuse` has the messages for those that cannot be read.
    """
    try:
        given = _given(declared, words)
        for each in declared:
            if each.name not in given and each.field.default is REQUIRED:
                return None
        return {each.name: given.get(each.name, each.field.default) for each in declared}
    except NotPlain:
        return None


def _given(declared: Sequence[Declared], words: Sequence[str]) -> dict[str, Any]:
    """The values of the options and arguments that are given."""
    options = {name: each for each in declared for name in each.names}
    refusals = {f"--no{each.names[0][1:]}": each for each in declared if each.names and each.field.default is True}
    given: dict[str, Any] = {}
    free = []
    rest = iter(words)
    for word in rest:
        if word == "-" or not word.startswith("-"):
            free.append(word)
            continue
        name, equals, text = word.partition("=") if word.startswith("--") else (word, "", "")
        each = options.get(name) or refusals.get(name)
        if each is None or (each.name in given and each.item is None) or (each.kind is bool and equals):
            raise NotPlain
        if each.kind is bool:
            given[each.name] = name in options
            continue
        value = text if equals else next(rest, "")
        if not equals and value in options:
            raise NotPlain
        value = _value(each, value)
        given[each.name] = value if each.item is None else [*given.get(each.name, ()), value]
    return given | _arguments([each for each in declared if not each.names], free)


def _arguments(declared: Sequence[Declared], words: Sequence[str]) -> dict[str, Any]:
    """The values of the arguments without names."""
    if [each for each in declared if each.item is not None]:
        if len(declared) > 1 or not words:
            raise NotPlain
        return {declared[0].name: [_value(declared[0], word) for word in words]}
    if len(words) > len(declared):
        raise NotPlain
    return {each.name: _value(each, word) for each, word in zip(declared, words, strict=False)}


def _value(declared: Declared, text: str) -> Any:
    """The value in a word."""
    if not text or not text.isprintable() or (os.name == "nt" and EXPANDED.search(text)):
        raise NotPlain
    kinds = {declared.kind, declared.item, *get_args(declared.kind)}
    if Path in kinds:
        return Path(text)
    for kind, form in NUMBERS.items():
        if kind in kinds:
            return _number(declared, kind, form, text)
    return text


def _number(declared: Declared, kind: type, form: re.Pattern[str], text: str) -> float:
    """A number within the limits of its option."""
    if not form.fullmatch(text):
        raise NotPlain
    number: float = kind(text)
    low, high = (declared.field.metadata.get(limit) for limit in ("min", "max"))
    if (low is not None and number < low) or (high is not None and number > high):
        raise NotPlain
    return number
