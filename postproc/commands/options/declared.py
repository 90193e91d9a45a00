"""Options declared once, as fields of frozen dataclasses or as parameters of one command."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Mapping
from dataclasses import MISSING, Field, field, fields, is_dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Literal, get_args, get_origin, get_type_hints

import msgspec

from kinematics.files.mistaken import did_you_mean
from kinematics.user_error import UserError

METAVARS: dict[type, str] = {bool: " ", int: "N", float: "NUMBER", Path: "FILE"}
"""Shown for the value of an option without a word of its own; a switch has no value."""
REQUIRED = MISSING
"""Default of an option that must be given."""


def option(help: str, metavar: str | None = None, *names: str, default: Any = None, **form: Any) -> Any:
    """A declared option: `name: type = option(...)`, or `Annotated[type, option(...)]` for several commands.

    Its long name is the name of the field or parameter, unless `names` has another. `tuple[type, ...]` is a repeatable
    option, `Literal` one of some values; numbers must be finite. form: `min` and `max`; `complete`, a function that
    returns values for the shell; `panel`, the heading in the help, unless the dataclass has one for all its options.
    """
    return field(default=default, metadata={"names": names, "help": help, "metavar": metavar, **form})


def argument(help: str, metavar: str, default: Any = REQUIRED, **form: Any) -> Any:
    """A declared argument, without a name on the command line: `name: type = argument(...)`. form: `complete`."""
    return field(default=default, metadata={"help": help, "metavar": metavar, **form})


class Declared(msgspec.Struct, frozen=True):
    """An option or argument with its name and its type."""

    name: str
    kind: Any
    field: Field[Any]
    panel: str | None

    @property
    def names(self) -> list[str]:
        """The names on the command line, the long one first; none for an argument."""
        given = self.field.metadata.get("names")
        if given is None:
            return []
        own = f"--{self.name.replace('_', '-')}"
        return sorted(given if any(name.startswith("--") for name in given) else (own, *given), reverse=True, key=len)

    @property
    def item(self) -> Any:
        """The type of each value of a repeatable option; None for one value."""
        return get_args(self.kind)[0] if get_origin(self.kind) is tuple else None

    @property
    def choices(self) -> tuple[str, ...]:
        """The values of a `Literal`, also of one that may be None; empty for other types."""
        kinds = (self.kind, *get_args(self.kind))
        return next((get_args(kind) for kind in kinds if get_origin(kind) is Literal), ())

    def parameter(self) -> inspect.Parameter:
        """The parameter for Typer."""
        import typer

        form = dict(self.field.metadata)
        names, kind, default = self.names, self.kind, self.field.default
        if self.item is not None:
            kind = list[self.item] | None if names else list[self.item]  # type: ignore[name-defined]
        elif self.choices:
            kind = str if get_origin(kind) is Literal else str | None
            form["metavar"] = form["metavar"] or "|".join(self.choices)
            form["complete"] = lambda: list(self.choices)
        complete = form.pop("complete", None)
        form["metavar"] = form["metavar"] or next(
            (word for kind, word in METAVARS.items() if self._holds(kind)), "NAME"
        )
        if form.pop("names", None) is None:
            declared: Any = typer.Argument(autocompletion=complete, **form)
        else:
            help_text = form.pop("help") + (" Repeatable." if self.item is not None else "")
            panel = form.pop("panel", self.panel)
            names = [] if default is True else names  # Typer adds the name that begins with --no
            declared = typer.Option(*names, help=help_text, rich_help_panel=panel, autocompletion=complete, **form)
        return inspect.Parameter(
            self.name,
            inspect.Parameter.KEYWORD_ONLY,
            default=inspect.Parameter.empty if default is REQUIRED else default,
            annotation=Annotated[kind, declared],
        )

    def _holds(self, kind: type) -> bool:
        return kind in (self.kind, self.item, *get_args(self.kind))

    def value(self, given: Any) -> Any:
        """The value for the command; UserError for a value that the type excludes."""
        if self.item is not None:
            given = tuple(given or ())
        elif self.choices and given is not None and given not in self.choices:
            *others, last = self.choices
            raise UserError(
                f"{self.names[0]} {given}: expected {', '.join(others)} or {last}"
                f"{did_you_mean(str(given), self.choices)}"
            )
        for number in given if isinstance(given, tuple) else (given,):
            if isinstance(number, float) and not math.isfinite(number):
                raise UserError(f"{self.names[0]} {number}: expected a finite number")
        return given


class Signature(msgspec.Struct, frozen=True, dict=True):
    """A command with the declarations of its options and arguments, also of those in dataclasses of options."""

    command: Callable[..., None]

    @cached_property
    def _hints(self) -> dict[str, Any]:
        return get_type_hints(self.command, include_extras=True)

    @cached_property
    def _groups(self) -> dict[str, list[Declared]]:
        """The declarations by the name of the command's parameter."""
        parameters = inspect.signature(self.command).parameters
        return {
            name: _fields(kind) if is_dataclass(kind) else [_declared(name, kind, parameters[name].default)]
            for name, kind in self._hints.items()
            if name in parameters
        }

    @property
    def declared(self) -> list[Declared]:
        """All declarations, in the order of the command's parameters."""
        return [each for group in self._groups.values() for each in group]

    def run(self, given: Mapping[str, Any]) -> None:
        """Run the command with the values of its options by name; UserError for a value that a type excludes."""
        values = {}
        for name, group in self._groups.items():
            found = {each.name: each.value(given[each.name]) for each in group}
            values[name] = self._hints[name](**found) if is_dataclass(self._hints[name]) else found[name]
        self.command(**values)


def with_options(command: Callable[..., None]) -> Callable[..., None]:
    """The command for Typer, with one parameter for each declared option."""
    signature = Signature(command)

    def run(**given: Any) -> None:
        signature.run(given)

    run.__doc__, run.__name__ = command.__doc__, command.__name__
    run.__signature__ = inspect.Signature([each.parameter() for each in signature.declared])  # type: ignore[attr-defined]
    return run


def refuse_given(reason: str, options: Any, *names: str) -> None:
    """UserError `--name reason` for the first of these options, in a dataclass, that has not its default value."""
    for each in _fields(type(options)):
        if each.name in names and getattr(options, each.name) != each.value(each.field.default):
            raise UserError(f"{each.names[0]} {reason}")


def numbers(text: str, count: int, where: str, separator: str = ",") -> tuple[float, ...]:
    """`count` finite numbers in a text; UserError, with the option's name in `where`, for any other text."""
    try:
        values = tuple(float(entry) for entry in text.split(separator))
    except ValueError:
        values = ()
    if len(values) != count or not all(map(math.isfinite, values)):
        expected = "a number" if count == 1 else f"{count} numbers with {separator!r} between them"
        raise UserError(f"{where}: {text!r} is not {expected}")
    return values


def _fields(group: Any) -> list[Declared]:
    hints = get_type_hints(group, include_extras=True)
    return [_declared(each.name, hints[each.name], each, getattr(group, "PANEL", None)) for each in fields(group)]


def _declared(name: str, kind: Any, default: Any, panel: str | None = None) -> Declared:
    """The declaration in the type, or else in the default, of a field or parameter."""
    if get_origin(kind) is Annotated:
        kind, default = get_args(kind)[:2]
    return Declared(name, kind, default, panel)
