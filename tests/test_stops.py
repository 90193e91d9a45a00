"""Signals end a command also where Python discards the exception of their handler."""

import signal
import subprocess
import sys

import pytest

DISCARDED = """
import os, signal, sys, time, weakref
import postproc.command_line
from postproc.cli import run

class Lock: pass

def stop(_):
    os.kill(os.getpid(), {stop})
    for _ in range(100): pass  # the handler is called here, in a callback that discards exceptions

def work():
    signal.signal(signal.SIGINT, signal.default_int_handler)
    lock = Lock()
    ended = weakref.ref(lock, stop)
    del lock
    os.write(1, b"goes on\\n")
    {then}
    print("never here", flush=True)

postproc.command_line.command_line = work
run()
"""
"""A command that is stopped in the callback of a weak reference, as the end of the lock of an imported module is."""


@pytest.mark.parametrize("stop", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize(
    "then", ["time.sleep(60)", "end = time.monotonic() + 60\n    while time.monotonic() < end: pass"]
)
def test_a_signal_in_a_callback_ends_the_command(stop, then):
    program = DISCARDED.format(stop=int(stop), then=then)
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False, timeout=50)
    said = "ncomp: interrupted\n" if stop == signal.SIGINT else ""
    assert (done.returncode, done.stdout, done.stderr) == (128 + stop, "goes on\n", said)


def test_another_fault_in_a_callback_is_shown():
    program = "import weakref\nfrom kinematics.running.stops import end_by_exception\nend_by_exception()\n"
    program += "class Lock: pass\nlock = Lock()\nended = weakref.ref(lock, lambda _: 1 / 0)\ndel lock\nprint('on')\n"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False, timeout=50)
    assert (done.returncode, done.stdout) == (0, "on\n")
    assert "ZeroDivisionError" in done.stderr
