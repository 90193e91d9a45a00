"""The words of a command, read by its declarations: the values of all options and arguments, or the first mistake.

Typer reads the same values from the same declarations, but its import takes longer than a short job
(benchmarks/cold_start.py); so it makes the help and the completion only. tests/test_options.py compares both.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NoReturn

from kinematics.files.mistaken import did_you_mean
from kinematics.user_error import UserError
from postproc.commands.options.declared import REQUIRED, Declared, signature_of
from postproc.commands.table import command, siblings

DASHES = re.compile("^[-\u2010-\u2015\u2212]+")
"""Hyphen, and the dashes that text programs put in its place."""
NUMBER_FORMS = {int: "a whole number", float: "a number"}
ONCE = ("correct", "batch", "watch", "verify", "check", "export", "job")
"""Commands that refuse an option that is given twice: their outputs go to machines. Of others the last one counts."""
EVERYWHERE = ("--quiet", "--verbose", "--plugin", "--help", "--version")
"""Options that no command declares."""
JOB = ": the options of ncomp correct are entries of the job file (docs/job.md)"


class Words:
    """The words that a command accepts."""

    def __init__(self, command: str, declared: Sequence[Declared]) -> None:
        self.command, self.declared = command, declared
        self.options = {name: each for each in declared for name in each.names}
        self.switched_off = {
            f"--no{each.names[0][1:]}": each for each in declared if each.names and each.default is True
        }
        self.names = [*self.options, *self.switched_off, *EVERYWHERE]

    def values(self, words: Sequence[str]) -> dict[str, Any]:
        """The value of each declaration by name; UserError for the first mistake."""
        free: list[str] = []
        given: dict[str, Any] = {}
        rest = iter(words)
        for word in rest:
            if word == "--":
                free += rest
            elif word == "-" or not word.startswith("-"):
                if word != "-" and DASHES.match(word) and (meant := self._meant(word)):
                    self._refuse(f"unexpected argument {word!r}{meant}")
                free.append(word)
            else:
                self._option(word, rest, given)
        given |= self._arguments(free)
        for each in self.declared:
            if each.default is REQUIRED and each.name not in given:
                named = f"{each.label} {_metavar(each)}" if each.names else each.label
                self._refuse(f"{named} is missing: {_help(each)}")
        return {each.name: given.get(each.name, each.default) for each in self.declared}

    def _option(self, word: str, rest: Iterator[str], given: dict[str, Any]) -> None:
        """Add the value of one option, which may be the next word."""
        name, equals, text = word.partition("=") if word.startswith("--") else (word, "", "")
        if name not in self.options and word[:2] in self.options and f"-{word}" not in self.names:
            name, equals, text = word[:2], "=", word[2:]  # -oFILE
        each = self.options.get(name) or self.switched_off.get(name)
        if each is None:
            self._refuse_unknown(name)
        if each.kind is bool:
            if equals:
                self._refuse(f"{name} takes no value, and {text!r} is given")
            given[each.name] = name in self.options
            return
        if each.name in given and each.item is None and self.command in ONCE:
            self._refuse(f"{name} is given twice: give it once")
        value = text if equals else next(rest, None)
        if value is None or (not equals and value in self.names):
            follows = "" if value is None else f"; {value} follows it"
            self._refuse(f"{name} needs a value, {_metavar(each)}{follows}: {_help(each)}")
        made = self._value(name, each, value)
        given[each.name] = made if each.item is None else (*given.get(each.name, ()), made)

    def _arguments(self, words: Sequence[str]) -> dict[str, Any]:
        """The values of the arguments without names; a repeatable one has all words."""
        arguments = [each for each in self.declared if not each.names]
        if arguments and arguments[0].item is not None:
            (each,) = arguments
            return {each.name: tuple(self._value(each.label, each, word) for word in words)} if words else {}
        if len(words) > len(arguments):
            expected = " ".join(each.label for each in arguments) or "no arguments"
            self._refuse(f"unexpected argument {words[len(arguments)]!r}: expected {expected}")
        return {each.name: self._value(each.label, each, word) for each, word in zip(arguments, words, strict=False)}

    def _value(self, name: str, each: Declared, text: str) -> Any:
        """The value in a word; `name`: the option as it is given."""
        if each.choices and text not in each.choices:
            *others, last = each.choices
            meant = did_you_mean(text, each.choices)
            raise UserError(f"{each.label} {text}: expected {', '.join(others)} or {last}{meant}")
        kind = next((kind for kind in (Path, *NUMBER_FORMS) if kind in each.kinds), str)
        return self._number(name, each, kind, text) if kind in NUMBER_FORMS else kind(text)

    def _number(self, name: str, each: Declared, kind: type, text: str) -> float:
        """A finite number within the limits of its option."""
        try:
            number: float = kind(text)
        except ValueError:
            point = "; write the decimal point as '.'" if re.fullmatch(r"[-+]?\d+,\d+", text) else ""
            unit = f" ({_metavar(each)})" if each.field.metadata.get("metavar") else ""
            self._refuse(f"{name} {text}: expected {NUMBER_FORMS[kind]}{unit}{point}")
        if not math.isfinite(number):
            raise UserError(f"{each.label} {number}: expected a finite number")
        low, high = (each.field.metadata.get(limit) for limit in ("min", "max"))
        if low is not None and number < low:
            self._refuse(f"{name} {text}: expected {low:g} or more")
        if high is not None and number > high:
            self._refuse(f"{name} {text}: expected {high:g} or less")
        return number

    def _meant(self, name: str) -> str:
        """Question for the option that was likely meant by a word, also by one with another dash."""
        plain = DASHES.sub("", name)
        return did_you_mean(f"--{plain}" if len(plain) > 1 else name, self.names)

    def _refuse_unknown(self, name: str) -> NoReturn:
        """Refuse an option that this command does not have; the message names the one that does, or a likely name."""
        declared = {other: signature_of(command(other)[0]).declared for other in siblings(self.command)}
        of = [f"ncomp {other}" for other, options in declared.items() if any(name in each.names for each in options)]
        if of:
            self._refuse(f"{name} is an option of {' and of '.join(of)}")
        self._refuse(f"unknown option {name}{self._meant(name) or (JOB if self.command == 'job' else '')}")

    def _refuse(self, reason: str) -> NoReturn:
        raise UserError(f"{self.command}: {reason}; 'ncomp {self.command} --help' lists its options")


def _metavar(each: Declared) -> str:
    return each.field.metadata.get("metavar") or "|".join(each.choices) or each.name.upper()


def _help(each: Declared) -> str:
    """The first sentence of the help, as the end of a message."""
    text: str = re.split(r"[.;:](?:\s|$)", each.field.metadata["help"])[0]
    return text[:1].lower() + text[1:] if text[1:2].islower() else text
