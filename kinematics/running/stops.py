"""Signals that end this process, also where Python discards the exception of their handler.

Python discards an exception that arises inside some callbacks: one of them ends the lock of each imported module. A
Ctrl-C at this moment would be printed and forgotten, so the signal is sent once more.
"""

from __future__ import annotations

import _thread
import signal
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import NoReturn

STOPS = [getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]
AGAIN_S = 0.01
"""Time, s, after which a discarded signal is sent again: the callback has ended by then."""


def end_by_exception() -> None:
    """Signals end this process by an exception in its main thread, so that temporary files are removed."""
    for stop in STOPS:
        if stop != signal.SIGINT:  # Python's own handler raises KeyboardInterrupt
            signal.signal(stop, end)
    send_discarded_again()


def end(number: int, _: object) -> NoReturn:
    """End with the exit code of a signal, 128 + number."""
    sys.exit(128 + number)


def send_discarded_again() -> None:
    """A signal whose exception Python discards is sent to this thread once more."""
    sys.unraisablehook = _discarded


def _discarded(fault: sys.UnraisableHookArgs) -> None:
    value = fault.exc_value
    code = 128 + signal.SIGINT if isinstance(value, KeyboardInterrupt) else getattr(value, "code", None)
    number = next((stop for stop in STOPS if code == 128 + stop), None)
    if number is None:
        sys.__unraisablehook__(fault)
    else:
        _thread.start_new_thread(_send, (number, _thread.get_ident()))  # `threading` may hold its locks here


def _send(number: signal.Signals, thread: int) -> None:
    time.sleep(AGAIN_S)
    if hasattr(signal, "pthread_kill"):
        signal.pthread_kill(thread, number)  # also ends a wait of this thread
    else:
        signal.raise_signal(number)


@contextmanager
def stops_wait() -> Iterator[None]:
    """Signals that end this process are handled behind the block.

    For the start of a process: one that this process starts only half would complain of it on the terminal.
    """
    import threading

    if threading.current_thread() is not threading.main_thread():  # handlers are called in the main thread
        yield
        return
    arrived: list[int] = []
    handlers = {stop: handler for stop in STOPS if callable(handler := signal.getsignal(stop))}
    for stop in handlers:
        signal.signal(stop, lambda number, _: arrived.append(number))
    try:
        yield
    finally:
        for stop, handler in handlers.items():
            signal.signal(stop, handler)
        for number in arrived:
            signal.raise_signal(number)
