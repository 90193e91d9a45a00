"""A process that does tasks of this one, in their order, while this one goes on.

It keeps its state from task to task, which the workers of `kinematics/running/workers.py` do not. Tasks travel through
a pair of sockets, their columns straight to their new memory. The process ends when this one ends, whatever the
reason, because its socket is then closed.
"""

from __future__ import annotations

import multiprocessing
import os
import pickle
import queue
import signal
import socket
import struct
import threading
import traceback
from collections.abc import Callable
from contextlib import suppress
from multiprocessing.connection import wait
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any
from weakref import WeakSet

import numpy as np

from kinematics.running.memory import keep_freed_memory
from kinematics.running.stops import STOPS, stops_wait

BUFFERS = 5
"""Protocol of pickle that leaves the memory of columns where it is."""
SIZE = struct.Struct("<Q")
"""A number before a message: of its parts, and of their bytes."""

THREADS = Path("/proc/self/task")
"""Folder with an entry for each thread of this process, in Linux."""

ROOM = 1 << 22
"""Bytes on their way, as far as the system permits: who has sent a message then need not wait for its receiver."""
GIVES_WAY = 10
"""Niceness of the process: this one does the longest part of the work, and should never wait for a processor."""


class LostProcess(Exception):
    """The process has ended before its tasks were done."""


_own_ends: WeakSet[socket.socket] = WeakSet()
"""Ends that this process holds of the sockets of its second processes."""


class SecondProcess:
    """A process that calls a function with one task after the other."""

    def __init__(self, work: Callable[[Any], Any]) -> None:
        """`work` is sent to the process: its own state is there, and not in this process."""
        self._socket, other = socket.socketpair()
        for end in (self._socket, other):
            end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, ROOM)
        _own_ends.add(self._socket)
        self._process = _process_class()(target=_serve, args=(other, work), daemon=True)
        with stops_wait():
            self._process.start()
        other.close()
        self._tasks: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self._sender: threading.Thread | None = None

    def give(self, task: Any) -> None:
        """A further task, whose columns must stay unchanged; LostProcess where the process has ended."""
        if not self._process.is_alive():
            raise LostProcess
        if self._sender is None:
            self._sender = threading.Thread(target=self._send_all, daemon=True)
            self._sender.start()
        self._tasks.put((task,))

    def answer(self) -> Any:
        """The result of the first task without one, when it is done; its exception, or LostProcess."""
        try:
            done, answer = _received(self._socket)
        except (EOFError, OSError):
            raise LostProcess from None
        if not done:
            raise answer
        return answer

    def answers_within(self, seconds: float) -> bool:
        """True if `answer` waits for this time at most."""
        try:
            return bool(wait([self._socket], seconds))
        except OSError:
            return True

    def end(self) -> None:
        """End the process, in the midst of its work if it has any."""
        self._tasks.put(None)
        with suppress(OSError):
            self._socket.shutdown(socket.SHUT_RDWR)  # ends a process that has just begun, and has lost the signal
        self._process.terminate()
        self._process.join()
        if self._sender is not None:
            self._sender.join()
        self._socket.close()

    def _send_all(self) -> None:
        with suppress(OSError):  # the process has ended: `answer` finds it
            while (given := self._tasks.get()) is not None:
                _send(self._socket, given[0])


def _process_class() -> type[BaseProcess]:
    """A fork of this process where it has no other thread, with which the new one need not load its modules again.

    Otherwise a new interpreter: a fork keeps the locks that other threads hold, for ever.
    """
    alone = THREADS.is_dir() and len(list(THREADS.iterdir())) == 1
    return multiprocessing.get_context("fork").Process if alone else multiprocessing.get_context("spawn").Process


def _send(to: socket.socket, item: Any) -> None:
    buffers: list[pickle.PickleBuffer] = []
    text = pickle.dumps(item, BUFFERS, buffer_callback=buffers.append)
    parts = [memoryview(text), *(buffer.raw() for buffer in buffers)]
    to.sendall(b"".join(map(SIZE.pack, [len(parts), *(part.nbytes for part in parts)])))
    for part in parts:
        to.sendall(part)


def _received(source: socket.socket) -> Any:
    (number,) = SIZE.unpack(_bytes_from(source, SIZE.size))
    sizes = [size for (size,) in SIZE.iter_unpack(_bytes_from(source, number * SIZE.size))]
    text, *buffers = (_bytes_from(source, size) for size in sizes)
    return pickle.loads(text, buffers=buffers)


def _bytes_from(source: socket.socket, size: int) -> memoryview:
    """The next bytes; EOFError where the other end is closed."""
    data = np.empty(size, np.uint8).data
    received = 0
    while received < size:
        more = source.recv_into(data[received:])
        if not more:
            raise EOFError
        received += more
    return data


def _serve(other: socket.socket, work: Callable[[Any], Any]) -> None:
    """In the process: do the tasks until the other end is closed."""
    for end in tuple(_own_ends):  # of the first process, which would not be seen to end
        end.close()
    for stop in STOPS:
        signal.signal(stop, signal.SIG_DFL)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # a terminal sends it to all processes; the first one decides
    if hasattr(os, "nice"):
        os.nice(GIVES_WAY)
    keep_freed_memory()
    with suppress(EOFError, OSError):
        while True:
            task = _received(other)
            try:
                answer = True, work(task)
            except Exception as fault:
                fault.add_note(traceback.format_exc())
                answer = False, fault
            _send(other, answer)
