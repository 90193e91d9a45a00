"""Mistakes in the arguments of a command line: one message in the style of all others, whatever Typer finds."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from typing import Any, NoReturn, get_args

from kinematics.files.mistaken import did_you_mean
from kinematics.user_error import UserError
from postproc.commands.options.declared import REQUIRED, Declared

DASHES = re.compile("^[-\u2010-\u2015\u2212]+")
"""Hyphen, and the dashes that text programs put in its place."""
NUMBER_FORMS = {int: "a whole number", float: "a number"}
HELP = ("--help", "-h")
ONCE = ("correct", "batch", "watch", "verify", "check", "export", "job")
"""Commands that refuse an option that is given twice: their outputs go to machines. Of others the last one counts."""
EVERYWHERE = ("--quiet", "--verbose", "--help")
"""Options of every command."""

JOB = {"job": ": the options of ncomp correct are entries of the job file (docs/job.md)"}
"""The place of an unknown option, by command."""


class Misuse:
    """The arguments of one command."""

    def __init__(self, command: str, declared: Sequence[Declared], words: Sequence[str]) -> None:
        self.command, self.declared, self.words = command, declared, words
        self.options = {name: each for each in declared for name in each.names}
        self.refusals = {f"--no{each.names[0][1:]}" for each in declared if each.names and each.field.default is True}
        self.names = [*self.options, *sorted(self.refusals), *EVERYWHERE]

    def refuse_doubtful(self) -> None:
        """UserError for a line that Typer accepts and that is doubtful.

        These are an option in place of a value, an option that is given twice, one dash in place of two, and
        another dash.
        """
        self._walk(all_mistakes=False)

    def refuse(self) -> None:
        """UserError for the first mistake; none where there is none."""
        free, given = self._walk(all_mistakes=True)
        arguments = [each for each in self.declared if not each.names]
        most = sum(1 for each in arguments) if all(each.item is None for each in arguments) else len(free)
        if len(free) > most:
            expected = " ".join(each.field.metadata["metavar"] for each in arguments) or "no arguments"
            self._refuse(f"unexpected argument {free[most]!r}: expected {expected}")
        for number, each in enumerate(arguments):
            if each.field.default is REQUIRED and number >= len(free):
                self._refuse(f"{each.field.metadata['metavar']} is missing: {_help(each)}")
        for each in self.declared:
            if each.names and each.field.default is REQUIRED and each.name not in given:
                self._refuse(f"{each.names[0]} {_metavar(each)} is missing: {_help(each)}")

    def _walk(self, all_mistakes: bool) -> tuple[list[str], set[str]]:
        """The words that are no options, and the names of the options that are given."""
        free: list[str] = []
        given: set[str] = set()
        rest = iter(self.words)
        for word in rest:
            if word == "--":
                free += rest
            elif word == "-" or not word.startswith("-"):
                if meant := self._dashed(word):
                    self._refuse(f"unexpected argument {word!r}{meant}")
                free.append(word)
            elif word in HELP:
                continue
            else:
                self._option(word, rest, given, all_mistakes)
        return free, given

    def _option(self, word: str, rest: Any, given: set[str], all_mistakes: bool) -> None:
        """Examine one option with its value."""
        name, equals, text = word.partition("=") if word.startswith("--") else (word, "", "")
        each = self.options.get(name)
        if each is None and f"-{word}" in self.names:
            self._refuse(f"unknown option {word} (did you mean '-{word}'?)")
        if each is None and name[:2] in self.options and not word.startswith("--"):
            name, equals, text = name[:2], "=", name[2:]  # -oFILE
            each = self.options[name]
        if each is None and name not in self.refusals:
            if all_mistakes:
                meant = did_you_mean(self._likely(name), [*self.names, "--version"])
                self._refuse(f"unknown option {name}{meant or JOB.get(self.command, '')}")
            return
        if each is None or each.kind is bool:
            if equals and all_mistakes:
                self._refuse(f"{name} takes no value, and {text!r} is given")
            return
        if each.name in given and each.item is None and self.command in ONCE:
            self._refuse(f"{name} is given twice: give it once")
        given.add(each.name)
        value = text if equals else next(rest, None)
        if value is None or (not equals and value in self.names):
            follows = "" if value is None else f"; {value} follows it"
            self._refuse(f"{name} needs a value, {_metavar(each)}{follows}: {_help(each)}")
        if all_mistakes:
            self._number(name, each, str(value))

    def _number(self, name: str, each: Declared, text: str) -> None:
        """Refuse a text that is no number, or a number beyond the limits, for an option of numbers."""
        kinds = {each.kind, each.item, *get_args(each.kind)}
        kind = next((kind for kind in NUMBER_FORMS if kind in kinds), None)
        if kind is None:
            return
        try:
            number = kind(text)
        except ValueError:
            point = "; write the decimal point as '.'" if re.fullmatch(r"[-+]?\d+,\d+", text) else ""
            unit = f" ({_metavar(each)})" if each.field.metadata.get("metavar") else ""
            self._refuse(f"{name} {text}: expected {NUMBER_FORMS[kind]}{unit}{point}")
        low, high = (each.field.metadata.get(limit) for limit in ("min", "max"))
        if low is not None and not number >= low:
            self._refuse(f"{name} {text}: expected {low:g} or more")
        if high is not None and not number <= high:
            self._refuse(f"{name} {text}: expected {high:g} or less")

    def _likely(self, name: str) -> str:
        return "--" + DASHES.sub("", name) if len(DASHES.sub("", name)) > 1 else name

    def _dashed(self, word: str) -> str:
        """Question for an option that is written with another dash."""
        return did_you_mean(self._likely(word), self.names) if DASHES.match(word) else ""

    def _refuse(self, reason: str) -> NoReturn:
        raise UserError(f"{self.command}: {reason}; 'ncomp {self.command} --help' lists its options")


def _metavar(each: Declared) -> str:
    return each.field.metadata.get("metavar") or "|".join(each.choices) or each.name.upper()


def _help(each: Declared) -> str:
    """The first sentence of the help, as the end of a message."""
    text: str = re.split(r"[.;:](?:\s|$)", each.field.metadata["help"])[0]
    return text[:1].lower() + text[1:] if text[1:2].islower() else text


def not_understood(words: Iterable[str], fault: Exception) -> UserError:
    """The message of Typer, in one line, for words in which `Misuse` finds no mistake."""
    message = getattr(fault, "format_message", lambda: str(fault))()
    return UserError(f"{' '.join(words)}: {' '.join(message.split())}")
