"""Workers for chunks: this process, several processes of this machine, or a cluster of Dask.

Each returns every outcome, in any order; the last two repeat a chunk whose worker was lost.
"""

from __future__ import annotations

import multiprocessing
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from typing import Any, Protocol

from calibration.study.cases import Case, code
from calibration.study.chunks import Chunk, Outcome, work
from kinematics.user_error import UserError

RETRIES = 10
"""Number of times that a chunk is begun anew after its worker was lost."""
CONNECT_S = 20
Task = tuple[Case, Chunk]


class Workers(Protocol):
    """Workers that compute the outcomes of chunks."""

    def outcomes(self, tasks: Sequence[Task]) -> Iterator[tuple[Task, Outcome]]:
        """Every task with its outcome, in the order of completion."""


class Here:
    """This process, one chunk after the other."""

    def outcomes(self, tasks: Sequence[Task]) -> Iterator[tuple[Task, Outcome]]:
        """See `Workers`."""
        for task in tasks:
            yield task, work(*task)


class Processes:
    """Processes of this machine."""

    def __init__(self, number: int) -> None:
        self._number = number
        self._pool: ProcessPoolExecutor | None = None

    def outcomes(self, tasks: Sequence[Task]) -> Iterator[tuple[Task, Outcome]]:
        """See `Workers`."""
        left, lost = list(tasks), 0
        while left:
            futures = {self._submitted(task): task for task in left}
            try:
                for future in as_completed(futures):
                    outcome = future.result()
                    left.remove(futures[future])
                    yield futures[future], outcome
            except BrokenProcessPool:
                self.close()
                lost += 1
                if lost > RETRIES:
                    raise UserError(
                        f"a worker process was ended from outside {lost} times, the last time on case "
                        f"{left[0][0].name}; is there memory enough? (--workers 1 takes the least)"
                    ) from None

    def close(self) -> None:
        """End the processes."""
        if self._pool is not None:
            self._pool.shutdown(cancel_futures=True)
            self._pool = None

    def _submitted(self, task: Task) -> Future[Outcome]:
        if self._pool is None:
            # spawned, because a fork keeps locks that other threads of this process hold
            self._pool = ProcessPoolExecutor(self._number, multiprocessing.get_context("spawn"))
        return self._pool.submit(work, *task)


class Cluster:
    """The workers of a Dask scheduler."""

    def __init__(self, address: str) -> None:
        try:
            from distributed import Client
        except ImportError:
            raise UserError("--dask needs Dask: pip install 'ncomp[dask]'") from None
        try:
            self._client: Any = Client(address, timeout=CONNECT_S)  # type: ignore[no-untyped-call]
        except (OSError, TimeoutError, ValueError) as fault:
            raise UserError(f"--dask {address}: {fault}") from None
        self._check(address)

    def outcomes(self, tasks: Sequence[Task]) -> Iterator[tuple[Task, Outcome]]:
        """See `Workers`."""
        from distributed import KilledWorker
        from distributed import as_completed as completed

        futures = {
            self._client.submit(work, *task, key=f"{task[0].key}-{task[1]}", retries=RETRIES, pure=True): task
            for task in tasks
        }
        try:
            for future in completed(list(futures)):  # type: ignore[no-untyped-call]
                yield futures[future], future.result()
        except KilledWorker as fault:
            raise UserError(f"--dask: the cluster gives up on a chunk whose workers were lost: {fault}") from None

    def close(self) -> None:
        """Disconnect from the cluster, which continues to run."""
        self._client.close()

    def _check(self, address: str) -> None:
        """UserError unless there are workers, all with the same code as this process."""
        try:
            found = self._client.run(code)
        except Exception as fault:  # a worker without ncomp can raise any error
            raise UserError(f"--dask {address}: ncomp does not run on the workers: {fault}") from None
        if not found:
            raise UserError(f"--dask {address}: the cluster has no workers")
        others = sorted(worker for worker, theirs in found.items() if theirs != code())
        if others:
            raise UserError(f"--dask {address}: another version of ncomp runs on {', '.join(others)}")


@contextmanager
def workers(number: int, dask: str | None) -> Iterator[Workers]:
    """The workers of the Dask scheduler at an address, or `number` processes of this machine."""
    if dask is None and number == 1:
        yield Here()
        return
    team = Processes(number) if dask is None else Cluster(dask)
    try:
        yield team
    finally:
        team.close()
