"""The commands in Typer's form, from which their help and their completion in the shell are made."""

from __future__ import annotations

import functools
import inspect
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from kinematics.version import VERSION
from postproc.commands.options.declared import REQUIRED, Declared, signature_of
from postproc.commands.table import COMMANDS, GLOBAL, GROUPS, HELP, command, module, named

METAVARS: dict[type, str] = {bool: " ", int: "N", float: "NUMBER", Path: "FILE"}
"""Shown for the value of an option without a word of its own; a switch has no value."""
SHOWN = ("help", "min", "max", "hidden")
"""Entries of a declaration that Typer shows as they are."""
NO_TYPE = " "
"""Type of a switch in the help."""
PANELS = {
    "programs": "Programs",
    "workplace": "Machines, jobs and the installation",
    "calibrations": "Calibrations",
    "measurements": "Measurements",
    "controls": "Tables of controls",
    "history": "The life of machines",
    "serve": "A page in the browser",
}
"""Heading of the commands of each folder in the list of all."""


class Commands(TyperGroup):
    """Group of commands, each made when it is used; without a name, the arguments are those of the main job."""

    group: str = ""
    """Name of the group before those of its commands; empty for all commands."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Put the name of the command before arguments that do not begin with one."""
        own = {name for parameter in self.get_params(ctx) for name in parameter.opts}
        group_alone = args[:1] and args[0] in GROUPS and set(args[1:]) <= set(HELP)
        if not self.group and args and args[0] not in own and not group_alone:
            name, rest = named(args)
            args = [*name.split(), *rest]
        return super().parse_args(ctx, args)

    def list_commands(self, ctx: Any) -> list[str]:  # noqa: ARG002
        """The names of all commands."""
        names = (name.split() for name in COMMANDS if name.startswith(self.group))
        return list(dict.fromkeys(words[len(self.group.split())] for words in names))

    def get_command(self, ctx: Any, cmd_name: str) -> Any:  # noqa: ARG002
        """The command of a name; None for a name of none."""
        name = f"{self.group} {cmd_name}".strip()
        return _group(name) if name in GROUPS else _typer_command(name) if name in COMMANDS else None


@functools.cache
def _group(name: str) -> Any:
    """A command that has commands of its own."""
    made = Commands(
        name=name,
        help=module(name).__doc__.partition(": ")[2],
        epilog=module(name).EPILOG,
        rich_help_panel=_panel(GROUPS[name]),
        rich_markup_mode="markdown",
    )
    made.group = name
    return _without_types(made)


def _panel(module: str) -> str:
    return PANELS[module.partition(".")[0]]


@functools.cache
def _typer_command(name: str) -> Any:
    """A command in Typer's form."""
    function, epilog = command(name)

    def shown(**_: Any) -> None:
        """Typer shows a command and does not run it."""

    shown.__doc__, shown.__name__ = function.__doc__, function.__name__
    shown.__signature__ = inspect.Signature([_parameter(each) for each in signature_of(function).declared])  # type: ignore[attr-defined]
    single = typer.Typer(add_completion=False, pretty_exceptions_enable=False, rich_markup_mode="markdown")
    single.command(name.rsplit(maxsplit=1)[-1], epilog=epilog, rich_help_panel=_panel(COMMANDS[name]))(shown)
    return _without_types(typer.main.get_command(single))


def _parameter(each: Declared) -> inspect.Parameter:
    """The parameter of a declaration."""
    form = {name: each.field.metadata[name] for name in SHOWN if name in each.field.metadata}
    kind, default, names = each.kind, each.field.default, each.names
    if each.item is not None:
        kind = list[each.item] | None if names else list[each.item]  # type: ignore[name-defined]
    elif each.choices:
        kind = str if default is not None else str | None
    form["metavar"] = (
        each.field.metadata.get("metavar")
        or "|".join(each.choices)
        or next((word for kind, word in METAVARS.items() if kind in each.kinds), "NAME")
    )
    form["autocompletion"] = (lambda: list(each.choices)) if each.choices else each.field.metadata.get("complete")
    if not names:
        declared: Any = typer.Argument(**form)
    else:
        form["help"] += " Repeatable." if each.item is not None else ""
        names = [] if default is True else names  # Typer adds the name that begins with --no
        declared = typer.Option(*names, rich_help_panel=each.panel, **form)
    return inspect.Parameter(
        each.name,
        inspect.Parameter.KEYWORD_ONLY,
        default=inspect.Parameter.empty if default is REQUIRED else default,
        annotation=Annotated[kind, declared],
    )


def _without_types(made: Any) -> Any:
    """A command whose help has no types of Python: no `<bool>` behind --help, no `<list[path]>` behind DATA.csv."""
    help_option = made.get_help_option

    def plain_help_option(ctx: Any) -> Any:
        option = help_option(ctx)
        if option is not None:
            option.metavar = NO_TYPE
        return option

    made.get_help_option = plain_help_option
    for parameter in made.params:
        if parameter.param_type_name == "argument":
            parameter.display_type_rich = lambda ctx: None  # noqa: ARG005
        elif parameter.opts[0] in GLOBAL:
            parameter.metavar = NO_TYPE
    return made


def _version(requested: bool) -> None:
    if requested:
        print(f"ncomp {VERSION}")
        raise typer.Exit


app = typer.Typer(
    name="ncomp",
    cls=Commands,
    pretty_exceptions_enable=False,
    rich_markup_mode="markdown",
    context_settings={"help_option_names": list(HELP)},
    help="""Correct NC programs for the measured errors of a machine tool.

    **ncomp IN.nc --machine M -o OUT.nc** corrects a program for the measured errors of machine M
    (the same as *ncomp correct IN.nc ...*; see *ncomp correct --help*). **ncomp JOB.toml** does the same
    for the programs of a job file. Every command takes **--quiet**, which shows the verdict only, and **--verbose**,
    which shows details, and the steps with their times, and **--plugin FILE.py**, or the name of an installed
    plug-in, which adds a physical cause of error of one's own (docs/develop/recipes.md).
    """,
)


@app.callback()
def _global(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version.")
    ] = False,
) -> None:
    pass


@functools.cache
def command_tree() -> Any:
    """All commands with their options."""
    return _without_types(typer.main.get_command(app))
