"""The command line of ncomp."""

from __future__ import annotations

import functools
import io
import os
import signal
import sys
from collections.abc import Callable
from contextlib import suppress
from typing import Annotated, Any, NoReturn

import typer
from typer.core import TyperGroup

from kinematics.user_error import UserError
from postproc.commands.calibrations import compare, continuous, diagnose, fit, iso230, three_points
from postproc.commands.measurements import plan, predict, simulate, simulate_continuous, study, tracker
from postproc.commands.options.declared import with_options
from postproc.commands.programs import check, correct, export, import_tables, machines, verify

MAIN_JOB = "correct"


class MainJobFirst(TyperGroup):
    """Group of commands: without a subcommand, the arguments are those of the main job."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Put the name of the main job before its arguments."""
        own = {name for parameter in self.get_params(ctx) for name in parameter.opts}
        if args and args[0] not in self.commands and args[0] not in own:
            args = [MAIN_JOB, *args]
        return super().parse_args(ctx, args)


app = typer.Typer(
    name="ncomp",
    cls=MainJobFirst,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode="markdown",
    context_settings={"help_option_names": ["-h", "--help"]},
    help="""Correct NC programs for the measured errors of a machine tool.

    **ncomp IN.nc --machine M -o OUT.nc** corrects a program for the measured errors of machine M
    (the same as *ncomp correct IN.nc ...*; see *ncomp correct --help*).
    """,
)

COMMANDS: dict[str, tuple[Callable[..., None], str]] = {
    MAIN_JOB: (correct.correct, correct.EPILOG),
    "verify": (verify.verify, verify.EPILOG),
    "check": (check.check, check.EPILOG),
    "compare": (compare.compare, compare.EPILOG),
    "machines": (machines.machines, machines.EPILOG),
    "export": (export.export, export.EPILOG),
    "fit": (fit.fit, fit.EPILOG),
    "diagnose": (diagnose.diagnose, diagnose.EPILOG),
    "import": (import_tables.import_tables, import_tables.EPILOG),
    "iso230": (iso230.iso230, iso230.EPILOG),
    "tracker": (tracker.tracker, tracker.EPILOG),
    "continuous": (continuous.continuous, continuous.EPILOG),
    "plan": (plan.plan, plan.EPILOG),
    "predict": (predict.predict, predict.EPILOG),
    "simulate": (simulate.simulate, simulate.EPILOG),
    "simulate-continuous": (simulate_continuous.simulate_continuous, simulate_continuous.EPILOG),
    "study": (study.study, study.EPILOG),
    "three-points": (three_points.three_points, three_points.EPILOG),
}
"""Each command with the examples below its help."""
for _name, (_command, _epilog) in COMMANDS.items():
    app.command(_name, epilog=_epilog)(with_options(_command))


@functools.cache
def command_tree() -> Any:
    """All commands with their options. The signatures are read once in a process."""
    return typer.main.get_command(app)


def run() -> None:
    """Entry point."""
    for stop in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(stop, _stopped)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # a terminal without lines for tables shows question marks
    try:
        try:
            command_tree()(prog_name="ncomp")
        finally:
            if sys.stdout is not None:
                sys.stdout.flush()
    except UserError as fault:
        _end(2, str(fault))
    except BrokenPipeError:
        _end(1)
    except OSError as fault:
        _end(2, f"cannot use {fault.filename or 'standard output'}: {fault.strerror or fault}")
    except Exception as fault:
        import traceback

        traceback.print_exc()
        _end(1, f"internal fault: {fault!r}; please report it with the program that shows it")


def _end(status: int, message: str = "") -> NoReturn:
    """End with a message; output that standard output did not accept is discarded."""
    if message:
        with suppress(OSError):
            print(f"ncomp: {message}", file=sys.stderr)
    try:
        if sys.stdout is not None:
            sys.stdout.flush()
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    sys.exit(status)


def _stopped(number: int, _: object) -> NoReturn:
    """End with the exit code of a signal, 128 + number, after the removal of temporary files."""
    sys.exit(128 + number)


def _version(requested: bool) -> None:
    if requested:
        from importlib.metadata import version

        print(f"ncomp {version('ncomp')}")
        raise typer.Exit


@app.callback()
def _global(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version.")
    ] = False,
) -> None:
    pass
