"""The command line in this process: no process is started."""

import io
import signal
import sys
from collections.abc import Callable, Sequence
from typing import NamedTuple
from unittest import mock

from postproc import cli
from postproc.command_line import command_line
from postproc.commands.show.terminal import LEVEL


class Done(NamedTuple):
    """How a command ended: exit status, standard output, standard error."""

    status: int
    out: bytes
    err: str

    @property
    def shown(self) -> str:
        """Everything that the terminal shows."""
        return self.out.decode() + self.err


def run_command(*arguments: object, stdin: bytes = b"") -> Done:
    """Run `ncomp ARGUMENTS` from its entry point, which turns exceptions into messages and exit codes."""
    return _run(cli.run, arguments, stdin)


def run_raising(*arguments: object) -> Done:
    """Run `ncomp ARGUMENTS` below its entry point: exceptions are raised, UserError where it refuses."""
    return _run(command_line, arguments)


def succeed(*arguments: object) -> Done:
    """Run a command that has to end with 0; UserError where it refuses."""
    done = run_raising(*arguments)
    assert done.status == 0, done.shown
    return done


def refusal(*arguments: object) -> str:
    """Message of a command that has to refuse."""
    done = run_command(*arguments)
    assert done.status == 2, done.shown
    return done.err


def instead(line: Sequence[object], *arguments: object) -> tuple[object, ...]:
    """A command line with these options in place of its own of the same names; all have a value."""
    given = set(arguments[::2])
    kept, words = list[object](), list(line)
    while words:
        word = words.pop(0)
        if word in given:
            words.pop(0)
        else:
            kept.append(word)
    return (*kept, *arguments)


def _run(entry: Callable[[], object], arguments: tuple[object, ...], stdin: bytes = b"") -> Done:
    """Call an entry point with its own arguments and streams; signals act on the tests as before."""
    out, err = (io.TextIOWrapper(io.BytesIO(), encoding="utf-8", write_through=True) for _ in range(2))
    given = io.TextIOWrapper(io.BytesIO(stdin))
    status, handlers = 0, {number: signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGHUP)}
    with mock.patch.multiple(sys, argv=["ncomp", *map(str, arguments)], stdin=given, stdout=out, stderr=err):
        LEVEL.quiet = LEVEL.verbose = False
        hook = sys.unraisablehook
        try:
            entry()
        except SystemExit as end:
            status = end.code if isinstance(end.code, int) else int(end.code is not None)
        finally:
            sys.unraisablehook = hook
            for number, handler in handlers.items():
                signal.signal(number, handler)
    return Done(status, out.buffer.getvalue(), err.buffer.getvalue().decode())  # type: ignore[attr-defined]
