"""A process that does tasks of this one, in their order, while this one goes on.

It keeps its state from task to task. Tasks travel through a pair of sockets, their columns straight to their new
memory. The process ends when this one ends, whatever the reason, because its socket is then closed: a task in work is
abandoned, and its temporary files are removed.
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
import time
import traceback
from collections.abc import Callable
from contextlib import suppress
from multiprocessing.connection import wait
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any, NoReturn
from weakref import WeakSet

import numpy as np

from kinematics.files import forget_unpublished, remove_unpublished
from kinematics.running.memory import keep_freed_memory
from kinematics.running.stops import STOPS, end, send_discarded_again, stops_wait

BUFFERS = 5
"""Protocol of pickle that leaves the memory of columns where it is."""
SIZE = struct.Struct("<Q")
"""A number before a message: of its parts, and of their bytes."""

THREADS = Path("/proc/self/task")
"""Folder with an entry for each thread of this process, in Linux."""

ROOM = 1 << 22
"""Bytes on their way, as far as the system permits: who has sent a message then need not wait for its receiver."""
GIVES_WAY = 10
"""Niceness of a helper: its first process does the longest part of the work, and should never wait for a processor."""
GRACE_S = 5.0
"""Time, s, after which a process that must end is ended in the midst of its work."""
Message = list[memoryview]
"""A pickled item: its text, and the memory of its columns."""


class LostProcess(Exception):
    """The process has ended before its tasks were done."""


_own_ends: WeakSet[socket.socket] = WeakSet()
"""Ends that this process holds of the sockets of its child processes."""


class ChildProcess:
    """A process that calls a function with one task after the other."""

    def __init__(self, work: Callable[[Any], Any], *, helper: bool = True) -> None:
        """`work` is sent to the process: its own state is there, and not in this process.

        helper: the process works for the task of this one, gives way to it, and is its fork where that is possible.
        Otherwise it is a new interpreter with tasks of its own, of the same priority.
        """
        self._socket, other = socket.socketpair()
        for mine in (self._socket, other):
            mine.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, ROOM)
        _own_ends.add(self._socket)
        self._process = _process_class(helper)(target=_serve, args=(other, work, helper), daemon=True)
        with stops_wait():
            self._process.start()
        other.close()
        self._messages: queue.SimpleQueue[Message | None] = queue.SimpleQueue()
        self._sender: threading.Thread | None = None

    @property
    def pid(self) -> int | None:
        """Its number in the system."""
        return self._process.pid

    def give(self, task: Any) -> None:
        """A further task, whose columns must stay unchanged; LostProcess where the process has ended."""
        message = _message(task)
        if not self._process.is_alive():
            raise LostProcess
        if self._sender is None:
            self._sender = threading.Thread(target=self._send_all, daemon=True)
            self._sender.start()
        self._messages.put(message)

    def answer(self) -> Any:
        """The result of the first task without one, when it is done; its exception, or LostProcess."""
        try:
            done, answer = _item(_received(self._socket))
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

    def stop(self) -> None:
        """Tell the process to end, in the midst of its work if it has any."""
        self._messages.put(None)
        with suppress(OSError):
            self._socket.shutdown(socket.SHUT_RDWR)  # ends a process that has just begun, and has lost the signal
        self._process.terminate()

    def end(self) -> None:
        """End the process, and wait until it has ended."""
        self.stop()
        self._process.join()
        if self._sender is not None:
            self._sender.join()
        self._socket.close()

    def _send_all(self) -> None:
        with suppress(OSError):  # the process has ended: `answer` finds it
            while (message := self._messages.get()) is not None:
                _send(self._socket, message)


def _process_class(helper: bool) -> type[BaseProcess]:
    """A fork of this process where it has no other thread, with which the new one need not load its modules again.

    Otherwise a new interpreter: a fork keeps the locks that other threads hold, for ever.
    """
    alone = helper and THREADS.is_dir() and len(list(THREADS.iterdir())) == 1
    return multiprocessing.get_context("fork").Process if alone else multiprocessing.get_context("spawn").Process


def _message(item: Any) -> Message:
    buffers: list[pickle.PickleBuffer] = []
    text = pickle.dumps(item, BUFFERS, buffer_callback=buffers.append)
    return [memoryview(text), *(buffer.raw() for buffer in buffers)]


def _item(message: Message) -> Any:
    text, *buffers = message
    return pickle.loads(text, buffers=buffers)


def _send(to: socket.socket, message: Message) -> None:
    to.sendall(b"".join(map(SIZE.pack, [len(message), *(part.nbytes for part in message)])))
    for part in message:
        to.sendall(part)


def _received(source: socket.socket) -> Message:
    (number,) = SIZE.unpack(_bytes_from(source, SIZE.size))
    sizes = [size for (size,) in SIZE.iter_unpack(_bytes_from(source, number * SIZE.size))]
    return [_bytes_from(source, size) for size in sizes]


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


def _serve(other: socket.socket, work: Callable[[Any], Any], helper: bool) -> None:
    """In the process: do the tasks until the other end is closed."""
    for mine in tuple(_own_ends):  # of the first process, which would not be seen to end
        mine.close()
    forget_unpublished()
    for stop in STOPS:
        signal.signal(stop, signal.SIG_DFL)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # a terminal sends it to all processes; the first one decides
    signal.signal(signal.SIGTERM, _end_process)
    send_discarded_again()
    if helper:
        if hasattr(os, "nice"):
            os.nice(GIVES_WAY)
        keep_freed_memory()
    messages: queue.SimpleQueue[Message] = queue.SimpleQueue()
    threading.Thread(target=_receive_all, args=(other, messages), daemon=True).start()
    with suppress(OSError):
        while True:
            _send(other, _answer(work, messages.get()))


def _answer(work: Callable[[Any], Any], message: Message) -> Message:
    """The answer to a task. A process that must end does so after the task's own removals."""
    try:
        try:
            signal.signal(signal.SIGTERM, end)
            answer = True, work(_item(message))
        finally:
            signal.signal(signal.SIGTERM, _end_process)
        return _message(answer)
    except SystemExit:
        _end_process()
    except Exception as fault:
        fault.add_note(traceback.format_exc())
        return _message((False, fault))


def _end_process(*_: object) -> NoReturn:
    """Between tasks: nothing is to be removed but files of tasks that were abandoned."""
    remove_unpublished()
    os._exit(128 + signal.SIGTERM)


def _receive_all(other: socket.socket, messages: queue.SimpleQueue[Message]) -> None:
    with suppress(EOFError, OSError):
        while True:
            messages.put(_received(other))
    end_in_the_midst()


def end_in_the_midst() -> None:
    """In a process that has lost its first one: end its task, with the removals of the task, and then the process."""
    with suppress(OSError, AttributeError):
        signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGTERM)
    time.sleep(GRACE_S)
    _end_process()
