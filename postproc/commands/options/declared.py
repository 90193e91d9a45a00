"""Options declared once, as fields of frozen dataclasses or as parameters of one command."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from dataclasses import MISSING, Field, field, fields, is_dataclass
from functools import cache, cached_property
from pathlib import Path
from typing import Annotated, Any, Literal, get_args, get_origin, get_type_hints

import msgspec

from kinematics.files.inputs import run_with_inputs
from kinematics.user_error import UserError
from postproc.commands.options.files import Form, refuse_inputs, refuse_same_output, refuse_unwritable

MACHINE, SET_UP, MODEL, DATA, OUTPUT = "Machine", "Set-up", "Model", "Data", "Output"
"""Headings in the help of the options that many commands have."""
REQUIRED = MISSING
"""Default of an option that must be given."""


def option(help: str, metavar: str | None = None, *names: str, default: Any = None, **form: Any) -> Any:
    """A declared option: `name: type = option(...)`, or `Annotated[type, option(...)]` for several commands.

    Its long name is the name of the field or parameter, unless `names` has another. `tuple[type, ...]` is a repeatable
    option, `Literal` one of some values; numbers must be finite. form: `min` and `max`; `complete`, a function that
    returns values for the shell; `panel`, the heading in the help, unless the dataclass has one for all its options;
    `hidden`, True for an option that the help does not show.

    An option that names a file says so: `reads` is True for the path of an input, or a function that returns the path,
    or a list of paths, of a value which may be something else too; `writes` is the `Form` of an output, and
    `may_replace` the name of the input that the command itself compares with it.
    """
    return field(default=default, metadata={"names": names, "help": help, "metavar": metavar, **form})


def output_option(help: str, metavar: str, default: Any = REQUIRED) -> Any:
    """The file of a command's main result; `-` is standard output where its type is a text."""
    return option(help, metavar, "-o", default=default, writes="file")


def argument(help: str, metavar: str, default: Any = REQUIRED, **form: Any) -> Any:
    """A declared argument, without a name on the command line: `name: type = argument(...)`.

    form: `complete`, `reads`, `writes` and `may_replace`, as of `option`.
    """
    return field(default=default, metadata={"help": help, "metavar": metavar, **form})


class Declared(msgspec.Struct, frozen=True):
    """An option or argument with its name and its type."""

    name: str
    kind: Any
    field: Field[Any]
    group: str | None
    """Heading of the dataclass that has it."""

    @property
    def names(self) -> list[str]:
        """The names on the command line, the long one first; none for an argument."""
        given = self.field.metadata.get("names")
        if given is None:
            return []
        own = f"--{self.name.replace('_', '-')}"
        return sorted(given if any(name.startswith("--") for name in given) else (own, *given), reverse=True, key=len)

    @property
    def label(self) -> str:
        """Its name in messages."""
        return self.names[0] if self.names else str(self.field.metadata["metavar"])

    @property
    def panel(self) -> str | None:
        """Heading in the help; None for that of the options of one command."""
        return self.field.metadata.get("panel") or self.group or (OUTPUT if self.writes else None)

    @property
    def default(self) -> Any:
        """The value if it is not given."""
        default = self.field.default
        return tuple(default or ()) if self.item is not None and default is not REQUIRED else default

    @property
    def kinds(self) -> tuple[Any, ...]:
        """Its type, and those of which this is made."""
        return (self.kind, self.item, *get_args(self.kind))

    @property
    def item(self) -> Any:
        """The type of each value of a repeatable option; None for one value."""
        return get_args(self.kind)[0] if get_origin(self.kind) is tuple else None

    @property
    def choices(self) -> tuple[str, ...]:
        """The values of a `Literal`, also of one that may be None; empty for other types."""
        return next((get_args(kind) for kind in self.kinds if get_origin(kind) is Literal), ())

    @property
    def writes(self) -> Form | None:
        """What the named output is; None for an option that names none."""
        return self.field.metadata.get("writes")

    def inputs(self, value: Any) -> list[Path]:
        """The files that the command reads by this value of the option."""
        reads, given = self.field.metadata.get("reads"), value if isinstance(value, tuple) else (value,)
        if not reads:
            return []
        named = [Path(each) for each in given if each is not None] if reads is True else [reads(each) for each in given]
        several = (path if isinstance(path, list) else [path] for path in named)
        return [path for paths in several for path in paths if path is not None]


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
        """Run the command with the values of all options and arguments by name."""
        self._check_files(given)
        with run_with_inputs():
            values = {}
            for name, group in self._groups.items():
                own = {each.name: given[each.name] for each in group}
                values[name] = self._hints[name](**own) if is_dataclass(self._hints[name]) else own[name]
            self.command(**values)

    def _check_files(self, found: Mapping[str, Any]) -> None:
        """UserError, before any work, for an output that is an input or another output, or that cannot be written."""
        inputs = {each.name: each.inputs(found[each.name]) for each in self.declared}
        outputs = [each for each in self.declared if each.writes]
        refuse_same_output({each.label: found[each.name] for each in outputs})
        for each in outputs:
            output, compared_by_command = found[each.name], each.field.metadata.get("may_replace")
            others = [path for name, paths in inputs.items() if name != compared_by_command for path in paths]
            refuse_inputs(others, [output])
            if each.writes == "file" and output not in (None, "-"):
                refuse_unwritable(each.label, output)


@cache
def signature_of(command: Callable[..., None]) -> Signature:
    """The declarations of a command, which are read once."""
    return Signature(command)


def refuse_given(reason: str, options: Any, *names: str) -> None:
    """UserError `--name reason` for the first of these options, in a dataclass, that has not its default value."""
    for each in _fields(type(options)):
        if each.name in names and getattr(options, each.name) != each.default:
            raise UserError(f"{each.names[0]} {reason}")


def _fields(group: Any) -> list[Declared]:
    hints = get_type_hints(group, include_extras=True)
    return [_declared(each.name, hints[each.name], each, getattr(group, "PANEL", None)) for each in fields(group)]


def _declared(name: str, kind: Any, default: Any, panel: str | None = None) -> Declared:
    """The declaration in the type, or else in the default, of a field or parameter."""
    if get_origin(kind) is Annotated:
        kind, default = get_args(kind)[:2]
    return Declared(name, kind, default, panel)
