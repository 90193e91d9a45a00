"""Workers for independent tasks: this process, several processes of this machine, or a Dask cluster.

Results are independent of the workers. A task whose worker was lost is done again, alone, so that one task cannot take
others with it. Workers end with this process, and when it is interrupted: the task in work is abandoned, and its
temporary files are removed.
"""

from __future__ import annotations

import hashlib
import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED as ANY
from concurrent.futures import BrokenExecutor, Executor, Future, ProcessPoolExecutor, wait
from contextlib import ExitStack, contextmanager, suppress
from functools import cache, partial
from importlib import resources
from itertools import islice
from multiprocessing.connection import Connection
from typing import Any, NoReturn, TypeVar

from kinematics.files import remove_unpublished
from kinematics.running.stops import end, send_discarded_again, stops_wait
from kinematics.user_error import UserError

LOCAL = "local"
"""Address of a Dask cluster on this machine, which the command makes for itself."""
ATTEMPTS = 3
"""Number of times that a task is done alone after its worker was lost."""
RETRIES = 10
"""Number of times that Dask itself repeats a task."""
CONNECT_S = 20
GRACE_S = 5.0
"""Time, s, after which a worker that must end is ended in the midst of its work."""
LARGEST_TASK = "2 GiB"
"""Size of a task for Dask without a warning: programs travel in their tasks."""
Task = tuple[Any, ...]
Result = TypeVar("Result")


class Team:
    """Workers that compute results, by an executor that is replaced when it breaks."""

    def __init__(self, start: Callable[[], Executor], at_once: int = 1, lost: tuple[type[Exception], ...] = ()) -> None:
        """`at_once`: number of tasks that are given out together; `lost`: exceptions of a lost worker."""
        self._start, self._at_once = start, at_once
        self._lost: tuple[type[Exception], ...] = (BrokenExecutor, *lost)
        self.executor = start()

    def results(
        self, function: Callable[..., Result], tasks: Iterable[Task], lost: Callable[[Task], Result]
    ) -> Iterator[tuple[Task, Result]]:
        """Every task with the result of the function, in the order of completion; `lost`: result without a worker.

        A task is taken from `tasks` when a worker is free.
        """
        waiting, given = iter(tasks), dict[Future[Result], Task]()
        while True:
            try:
                yield from self._together(function, waiting, given)
                return
            except self._lost:
                suspects = list(given.values())
                self._replace(given)
                given.clear()
            for task in suspects:
                yield task, self._alone(function, task, lost)

    def _together(
        self, function: Callable[..., Result], waiting: Iterator[Task], given: dict[Future[Result], Task]
    ) -> Iterator[tuple[Task, Result]]:
        """Results of the waiting tasks; `given` holds those in work."""
        while True:
            for task in islice(waiting, self._at_once - len(given)):
                given[self._submitted(function, task)] = task
            if not given:
                return
            for future in wait(given, return_when=ANY).done:
                result = future.result()
                yield given.pop(future), result

    def _submitted(self, function: Callable[..., Result], task: Task) -> Future[Result]:
        try:
            return self.executor.submit(function, *task)
        except BrokenExecutor as fault:
            broken: Future[Result] = Future()
            broken.set_exception(fault)
            return broken

    def _alone(self, function: Callable[..., Result], task: Task, lost: Callable[[Task], Result]) -> Result:
        for _ in range(ATTEMPTS):
            try:
                return self.executor.submit(function, *task).result()
            except self._lost:
                self._replace()
        return lost(task)

    def _replace(self, given: Iterable[Future[Any]] = ()) -> None:
        for future in given:
            future.cancel()
        self.close()
        self.executor = self._start()

    def close(self) -> None:
        """End the workers after their present tasks."""
        self.executor.shutdown(cancel_futures=True)


class Here(Executor):
    """Does each task in this process, when it is submitted."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """The finished task; an interruption ends it at once."""
        future: Future[Any] = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as fault:
            future.set_exception(fault)
        return future


class Processes(ProcessPoolExecutor):
    """Processes of this machine that end when this process does."""

    def __init__(self, number: int) -> None:
        self._heard, self._held = multiprocessing.Pipe(duplex=False)
        # spawned, because a fork keeps locks that other threads of this process hold
        super().__init__(number, multiprocessing.get_context("spawn"), _prepare, (self._heard,))

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """The task, to be done by a worker, which is started if none is free."""
        with stops_wait():
            return super().submit(_do, fn, *args, **kwargs)

    def abandon(self) -> None:
        """End the workers in the midst of their tasks."""
        self._held.close()

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the workers after their present tasks."""
        super().shutdown(wait, cancel_futures=cancel_futures)
        self._held.close()
        self._heard.close()


def _prepare(heard: Connection) -> None:
    """In a worker: end with the process that holds the other end."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # a terminal sends it to all processes; the first one decides
    signal.signal(signal.SIGTERM, _end_process)
    send_discarded_again()
    threading.Thread(target=_listen, args=(heard,), daemon=True).start()


def _listen(heard: Connection) -> None:
    with suppress(EOFError, OSError):
        heard.recv()
    with suppress(OSError, AttributeError):
        signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGTERM)
    time.sleep(GRACE_S)
    remove_unpublished()
    os._exit(128 + signal.SIGTERM)


def _end_process(*_: object) -> NoReturn:
    """Between tasks: the executor would take an exception for a result."""
    remove_unpublished()
    os._exit(128 + signal.SIGTERM)


def _do(function: Callable[..., Result], *task: Any) -> Result:
    """In a worker: the result of a task. A worker that must end does so after the task's own removals."""
    try:
        try:
            signal.signal(signal.SIGTERM, end)
            return function(*task)
        finally:
            signal.signal(signal.SIGTERM, _end_process)
    except SystemExit:
        _end_process()


@contextmanager
def workers(number: int, dask: str | None, packages: tuple[str, ...]) -> Iterator[Team]:
    """The workers of the Dask scheduler at an address, or `number` workers of this machine, by Dask for `local`.

    packages: those of which the workers of a cluster must have the same code. UserError if the cluster cannot be used.
    """
    if dask is not None:
        with _cluster(number, dask, packages) as team:
            yield team
        return
    team = Team(partial(Processes, number), number) if number > 1 else Team(Here)
    try:
        yield team
    except BaseException:
        if isinstance(team.executor, Processes):
            team.executor.abandon()
        raise
    finally:
        team.close()


@cache
def code(packages: tuple[str, ...]) -> str:
    """Fingerprint of the code of packages."""
    digest = hashlib.sha256()
    for package in packages:
        for path in sorted(resources.files(package).rglob("*.py")):  # type: ignore[attr-defined]
            digest.update(path.read_bytes())
    return digest.hexdigest()[:8]


@contextmanager
def _cluster(number: int, address: str, packages: tuple[str, ...]) -> Iterator[Team]:
    """The workers of a cluster, which continues to run, or of one that is made for the command."""
    try:
        import dask
        from distributed import Client, KilledWorker, LocalCluster
    except ImportError:
        raise UserError("--dask needs Dask: pip install 'ncomp[dask]'") from None
    own = {"n_workers": number, "threads_per_worker": 1, "dashboard_address": None}
    with ExitStack() as stack:
        stack.enter_context(dask.config.set({"distributed.admin.large-graph-warning-threshold": LARGEST_TASK}))
        try:
            cluster = stack.enter_context(LocalCluster(**own)) if address == LOCAL else address  # type: ignore[no-untyped-call]
            client: Any = stack.enter_context(Client(cluster, timeout=CONNECT_S))  # type: ignore[no-untyped-call]
        except (OSError, TimeoutError, ValueError) as fault:
            raise UserError(f"--dask {address}: {fault}") from None
        _check(client, address, packages)
        threads = sum(client.nthreads().values())
        yield Team(partial(client.get_executor, retries=RETRIES), threads, (KilledWorker,))


def _check(client: Any, address: str, packages: tuple[str, ...]) -> None:
    """UserError unless there are workers, all with the same code as this process."""
    try:
        found = client.run(code, packages)
    except Exception as fault:  # a worker without ncomp can raise any error
        raise UserError(f"--dask {address}: ncomp does not run on the workers: {fault}") from None
    if not found:
        raise UserError(f"--dask {address}: the cluster has no workers")
    others = sorted(worker for worker, theirs in found.items() if theirs != code(packages))
    if others:
        raise UserError(f"--dask {address}: another version of ncomp runs on {', '.join(others)}")
