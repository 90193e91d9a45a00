"""Answers that a command needs: from its options, or requested on a terminal until they can be used."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable
from typing import TypeVar

from kinematics.user_error import UserError

T = TypeVar("T")


class Answers:
    """Asks for values that the options leave open; without a terminal an open answer has its default or is refused."""

    def __init__(self) -> None:
        self.asks = sys.stdin is not None and sys.stdin.isatty() and sys.stderr.isatty()

    def one(self, given: str | None, option: str, question: str, read: Callable[[str], T], default: str | None) -> T:
        """The answer to a question, read from the option's value or from the terminal.

        UserError for a value that cannot be used, and for an open answer without a default where nobody can be asked.
        """
        if given is not None:
            try:
                return read(given)
            except UserError as fault:
                raise UserError(f"{option}{'' if option.endswith('=') else ' '}{given}: {fault}") from None
        if not self.asks:
            if default is None:
                raise UserError(f"{option} is missing: {question}")
            return read(default)
        return self._asked(question, read, default)

    def _asked(self, question: str, read: Callable[[str], T], default: str | None) -> T:
        import typer

        while True:
            try:
                shown = default is not None
                text = typer.prompt(question, default=default if shown else "", show_default=shown, err=True)
                if not shown and not str(text).strip():
                    raise UserError("an answer is needed; Ctrl-C ends without writing anything")
                return read(str(text).strip())
            except UserError as fault:
                typer.echo(f"  {fault}", err=True)
            except typer.Abort:
                raise UserError("ended by the user: nothing was written") from None


def by_name(values: Iterable[str], option: str, known: Iterable[str]) -> dict[str, str]:
    """Values `NAME=VALUE` of a repeatable option by name; UserError for another form, and for an unknown name."""
    names, found = list(known), dict[str, str]()
    for text in values:
        name, equals, value = text.partition("=")
        name = name.strip().upper()
        if not equals or not value.strip():
            raise UserError(f"{option} {text}: expected {option} {names[0] if names else 'X'}=...")
        if name not in names:
            raise UserError(f"{option} {text}: the chain has no axis {name}: its axes are {', '.join(names)}")
        if name in found:
            raise UserError(f"{option}: {name} is given twice: give it once")
        found[name] = value.strip()
    return found
