"""The command line in a process of its own, forked from one that has loaded its modules: it may be killed."""

import multiprocessing
import os
import sys
import tempfile
from multiprocessing.context import ForkServerProcess
from pathlib import Path
from subprocess import CompletedProcess

from postproc import cli

FORKS = multiprocessing.get_context("forkserver")
FORKS.set_forkserver_preload(
    ["postproc.cli", "postproc.command_line", "postproc.correct.pipeline", "postproc.correct.report", "postproc.iso.interpreter",
     "postproc.control_data.tool_tables", "postproc.commands.show.terminal", "kinematics.derived.gantry", "jinja2",
     "rendering.page", "typer._adapters", "history.schema", "alembic.runtime.environment", "alembic.script"]
)  # fmt: skip


def start_forked(*arguments: object, before: str = "", streams: tuple[str, str] | None = None) -> ForkServerProcess:
    """Start `ncomp ARGUMENTS` in the current folder, after some Python of the test.

    `streams`: files that take its standard output and its standard error.
    """
    words = [str(argument) for argument in arguments]
    process = FORKS.Process(target=_command, args=(words, before, Path.cwd(), streams or (os.devnull, os.devnull)))
    process.start()
    return process


def run_forked(*arguments: object, before: str = "") -> CompletedProcess[bytes]:
    """Run `ncomp ARGUMENTS` as `start_forked` does, to its end; exit status -N where signal N killed it."""
    with tempfile.TemporaryDirectory() as folder:
        streams = f"{folder}/out", f"{folder}/err"
        process = start_forked(*arguments, before=before, streams=streams)
        process.join(60)
        assert process.exitcode is not None
        return CompletedProcess(arguments, process.exitcode, *(Path(name).read_bytes() for name in streams))


def _command(arguments: list[str], before: str, folder: Path, streams: tuple[str, str]) -> None:
    os.chdir(folder)
    for number, name in enumerate(streams, start=1):
        os.dup2(os.open(name, os.O_WRONLY | os.O_CREAT), number)
    sys.argv = ["ncomp", *arguments]
    exec(before, {})
    cli.run()
