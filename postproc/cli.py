"""The entry point of ncomp: it turns exceptions and signals into messages and exit codes.

It imports little, so that a signal that arrives while Python imports the rest ends the process like a later one.
"""

from __future__ import annotations

import atexit
import gc
import io
import os
import signal
import sys
from contextlib import suppress
from typing import NoReturn

from kinematics.running.stops import end_by_exception
from kinematics.user_error import UserError

OBJECTS = 200_000
"""New objects after which Python looks for unreachable ones: a short job makes 60,000. Python's own 700 take a fifth of
its time."""


def run() -> None:
    """Entry point."""
    gc.set_threshold(OBJECTS)
    atexit.register(gc.freeze)  # Python would look through all objects for unreachable ones once more
    end_by_exception()
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # a terminal without lines for tables shows question marks
    try:
        try:
            from postproc.command_line import command_line

            command_line()
        finally:
            if sys.stdout is not None:
                sys.stdout.flush()
    except UserError as fault:
        _end(2, str(fault))
    except KeyboardInterrupt:
        _end(128 + signal.SIGINT, "interrupted")
    except BrokenPipeError:
        _end(1)
    except OSError as fault:
        from kinematics.files import reason_of

        _end(2, f"cannot use {fault.filename or 'standard output'}: {reason_of(fault)}")
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
