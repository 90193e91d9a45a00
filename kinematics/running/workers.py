"""Workers for independent tasks: this process, several processes of this machine, or a Dask cluster.

Results are independent of the workers. A task whose worker was lost is done again, alone, so that one task cannot take
others with it. Workers end with this process, and when it is interrupted: the task in work is abandoned, and its
temporary files are removed.
"""

from __future__ import annotations

import hashlib
import pickle
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED as ANY
from concurrent.futures import BrokenExecutor, Executor, Future, ThreadPoolExecutor, wait
from contextlib import ExitStack, contextmanager
from functools import cache
from importlib import resources
from itertools import islice
from typing import Any, TypeVar

from kinematics.running.caller import in_words_of_caller
from kinematics.running.child_process import ChildProcess, LostProcess
from kinematics.user_error import UserError

LOCAL = "local"
"""Address of a Dask cluster on this machine, which the command makes for itself."""
ATTEMPTS = 3
"""Number of times that a task is done alone after its worker was lost."""
RETRIES = 10
"""Number of times that Dask itself repeats a task."""
CONNECT_S = 20
LARGEST_TASK = "2 GiB"
"""Size of a task for Dask without a warning: programs travel in their tasks."""
Task = tuple[Any, ...]
Call = tuple[Callable[..., Any], tuple[Any, ...], dict[str, Any]]
"""A function, and its arguments without and with names."""
Result = TypeVar("Result")


class Team:
    """Workers that compute results, by an executor that replaces lost workers itself."""

    def __init__(self, executor: Executor, at_once: int = 1, lost: tuple[type[Exception], ...] = ()) -> None:
        """`at_once`: number of tasks that are given out together; `lost`: exceptions of a lost worker."""
        self.executor, self._at_once = executor, at_once
        self._lost: tuple[type[Exception], ...] = (BrokenExecutor, *lost)

    def results(
        self, function: Callable[..., Result], tasks: Iterable[Task], lost: Callable[[Task], Result]
    ) -> Iterator[tuple[Task, Result]]:
        """Every task with the result of the function, in the order of completion; `lost`: result without a worker.

        A task is taken from `tasks` when a worker is free. One that has lost its worker is done after all others.
        """
        function = function if isinstance(self.executor, Here) else Sent(function)
        waiting, given, again = iter(tasks), dict[Future[Result], Task](), list[Task]()
        while True:
            for task in islice(waiting, self._at_once - len(given)):
                given[self._submitted(function, task)] = task
            if not given:
                break
            for future in wait(given, return_when=ANY).done:
                task = given.pop(future)
                try:
                    result = future.result()
                except self._lost:
                    again.append(task)
                else:
                    yield task, result
        for task in again:
            yield task, self._alone(function, task, lost)

    def _submitted(self, function: Callable[..., Result], task: Task) -> Future[Result]:
        future: Future[Result] = self.executor.submit(*in_words_of_caller(function), *task)
        return future

    def _alone(self, function: Callable[..., Result], task: Task, lost: Callable[[Task], Result]) -> Result:
        for _ in range(ATTEMPTS):
            try:
                return self._submitted(function, task).result()
            except self._lost:
                continue
        return lost(task)


class Sent:
    """A function for other processes: each makes it once, with the machine and the calibration that belong to it."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self._text = pickle.dumps(function)

    def __call__(self, *arguments: Any) -> Any:
        """The result of the function, in a process with the last one or a new one."""
        made: tuple[bytes, Callable[..., Any]] | None = getattr(_LAST, "made", None)
        if made is None or made[0] != self._text:
            made = _LAST.made = self._text, pickle.loads(self._text)
        return made[1](*arguments)


_LAST = threading.local()
"""`made`: the text of the last function of a thread, and the function."""


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


class Processes(Executor):
    """Processes of this machine, one for each task in work, that end when this process does."""

    def __init__(self, number: int) -> None:
        """`number`: largest number of tasks in work."""
        self._threads = ThreadPoolExecutor(number)
        """Each thread waits for one process."""
        self.processes: list[ChildProcess] = []
        """All that were started; those that are lost stay in the list."""
        self._free: list[ChildProcess] = []

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """The task, to be done by a process, which is started if none is free; BrokenExecutor where that is lost."""
        if self._free:
            process = self._free.pop()
        else:
            process = ChildProcess(_called, helper=False)
            self.processes.append(process)
        return self._threads.submit(self._done, process, (fn, args, kwargs))

    def _done(self, process: ChildProcess, task: Call) -> Any:
        try:
            process.give(task)
            result = process.answer()
        except LostProcess:
            raise BrokenExecutor from None
        except Exception:
            self._free.append(process)
            raise
        self._free.append(process)
        return result

    def abandon(self) -> None:
        """End the processes in the midst of their tasks."""
        for process in self.processes:
            process.stop()

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the processes after their present tasks."""
        self._threads.shutdown(wait, cancel_futures=cancel_futures)
        for process in self.processes:
            process.end()


def _called(call: Call) -> Any:
    """In a process: the result of a task."""
    function, arguments, named = call
    return function(*arguments, **named)


@contextmanager
def workers(number: int, dask: str | None, packages: tuple[str, ...]) -> Iterator[Team]:
    """The workers of the Dask scheduler at an address, or `number` workers of this machine, by Dask for `local`.

    packages: those of which the workers of a cluster must have the same code. UserError if the cluster cannot be used.
    """
    if dask is not None:
        with _cluster(number, dask, packages) as team:
            yield team
        return
    if number < 2:
        yield Team(Here())
        return
    with Processes(number) as processes:
        try:
            yield Team(processes, number)
        except BaseException:
            processes.abandon()
            raise


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
    server = {"dashboard": False, "dashboard_address": "127.0.0.1:0"}  # a free port: two clusters at once do not meet
    own = {"n_workers": number, "threads_per_worker": 1, "dashboard_address": None, "scheduler_kwargs": server}
    with ExitStack() as stack:
        stack.enter_context(dask.config.set({"distributed.admin.large-graph-warning-threshold": LARGEST_TASK}))
        try:
            cluster = stack.enter_context(LocalCluster(**own)) if address == LOCAL else address  # type: ignore[no-untyped-call]
            client: Any = stack.enter_context(Client(cluster, timeout=CONNECT_S))  # type: ignore[no-untyped-call]
        except (OSError, TimeoutError, ValueError) as fault:
            raise UserError(f"--dask {address}: {fault}") from None
        _check(client, address, packages)
        threads = sum(client.nthreads().values())
        yield Team(client.get_executor(retries=RETRIES), threads, (KilledWorker,))


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
