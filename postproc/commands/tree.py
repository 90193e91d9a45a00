"""The commands in Typer's form: their help, their completion in the shell, and the messages for wrong arguments."""

from __future__ import annotations

import functools
import sys
from collections.abc import Sequence
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from kinematics.version import VERSION
from postproc.commands.options.declared import Declared, Signature, with_options
from postproc.commands.options.misuse import Misuse, not_understood
from postproc.commands.table import COMMANDS, command, named

HELP_NAMES = ("-h", "--help")
NO_TYPE = " "
"""Type of a switch in the help."""
GLOBAL = ("version", "install_completion", "show_completion")
"""Switches of ncomp without a command."""
PANELS = {
    "programs": "Programs",
    "workplace": "Machines, jobs and the installation",
    "calibrations": "Calibrations",
    "measurements": "Measurements",
    "controls": "Tables of controls",
}
"""Heading of the commands of each folder in the list of all."""


class Commands(TyperGroup):
    """Group of commands, each made when it is used; without a name, the arguments are those of the main job."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Put the name of the main job before its arguments."""
        own = {name for parameter in self.get_params(ctx) for name in parameter.opts}
        if args and args[0] not in COMMANDS and args[0] not in own:
            name, rest = named(args)
            args = [name, *rest]
        return super().parse_args(ctx, args)

    def list_commands(self, ctx: Any) -> list[str]:  # noqa: ARG002
        """The names of all commands."""
        return list(COMMANDS)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:  # noqa: ARG002
        """The command of a name; None for a name of none."""
        return _typer_command(cmd_name) if cmd_name in COMMANDS else None


@functools.cache
def _typer_command(name: str) -> Any:
    """A command in Typer's form. Its signature is read once in a process."""
    function, epilog = command(name)
    single = typer.Typer(add_completion=False, pretty_exceptions_enable=False, rich_markup_mode="markdown")
    single.command(name, epilog=epilog, rich_help_panel=PANELS[COMMANDS[name].partition(".")[0]])(
        with_options(function)
    )
    return _without_types(typer.main.get_command(single))


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
        elif parameter.name in GLOBAL:
            parameter.metavar = NO_TYPE
    return made


def _version(requested: bool) -> None:
    if requested:
        print(f"ncomp {VERSION}")
        raise typer.Exit


app = typer.Typer(
    name="ncomp",
    cls=Commands,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode="markdown",
    context_settings={"help_option_names": list(HELP_NAMES)},
    help="""Correct NC programs for the measured errors of a machine tool.

    **ncomp IN.nc --machine M -o OUT.nc** corrects a program for the measured errors of machine M
    (the same as *ncomp correct IN.nc ...*; see *ncomp correct --help*). **ncomp JOB.toml** does the same
    for the programs of a job file. Every command takes **--quiet**, which shows the verdict only, and **--verbose**,
    which shows details, and the steps with their times.
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


def run_by_typer(words: Sequence[str]) -> None:
    """Run the command of these words; UserError, in the style of all messages, for words that are not understood."""
    tree = command_tree()
    own = {name for parameter in tree.params for name in parameter.opts}
    name, rest = named(words)
    misuse = None if not words or words[0] in {*own, *HELP_NAMES} else Misuse(name, _declared(name), rest)
    if misuse and not set(rest) & set(HELP_NAMES):
        misuse.refuse_doubtful()
    try:
        status = tree(args=list(words), prog_name="ncomp", standalone_mode=False)
    except _usage_errors() as fault:
        if not words:
            print(fault.format_message())
            return
        if misuse:
            misuse.refuse()
        raise not_understood(words, fault) from None
    if isinstance(status, int) and status:
        sys.exit(status)


def _declared(name: str) -> list[Declared]:
    return Signature(command(name)[0]).declared


def _usage_errors() -> Any:
    """The base of the exceptions for wrong arguments; its module depends on the version of Typer."""
    return next(kind for kind in typer.BadParameter.__mro__ if kind.__name__ == "ClickException")
