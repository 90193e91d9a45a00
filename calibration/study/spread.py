"""Workers for chunks: an executor of this process, of several processes of this machine, or of a Dask cluster.

Results are independent of the executor. A chunk whose worker was lost is repeated, by Dask itself or by `Workers`.
"""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, Executor, ProcessPoolExecutor, ThreadPoolExecutor, as_completed
from contextlib import contextmanager
from functools import partial
from typing import Any

from calibration.study.cases import Case, code
from calibration.study.chunks import Chunk, Outcome, work
from kinematics.user_error import UserError

RETRIES = 10
"""Number of times that a chunk is repeated after its worker was lost."""
CONNECT_S = 20
Task = tuple[Case, Chunk]


class Workers:
    """Workers that compute the outcomes of chunks, by an executor that is replaced when it breaks."""

    def __init__(self, start: Callable[[], Executor]) -> None:
        self._start = start
        self.executor = start()

    def outcomes(self, tasks: Sequence[Task]) -> Iterator[tuple[Task, Outcome]]:
        """Every task with its outcome, in the order of completion; UserError if workers are lost again and again."""
        remaining, lost = list(tasks), 0
        while remaining:
            try:
                futures = {self.executor.submit(work, *task): task for task in remaining}
                for future in as_completed(futures):
                    outcome = future.result()
                    remaining.remove(futures[future])
                    yield futures[future], outcome
            except BrokenExecutor:
                self.close()
                self.executor = self._start()
                lost += 1
                if lost > RETRIES:
                    raise UserError(
                        f"case {remaining[0][0].name}: a worker process was ended from outside {lost} times, perhaps "
                        "for lack of memory: use fewer processes (--workers 1 needs the least memory)"
                    ) from None

    def close(self) -> None:
        """End the workers after their present chunks."""
        self.executor.shutdown(cancel_futures=True)


@contextmanager
def workers(number: int, dask: str | None) -> Iterator[Workers]:
    """The workers of the Dask scheduler at an address, or `number` processes of this machine.

    UserError if the cluster cannot be used, or if it abandons a chunk.
    """
    if dask is not None:
        with _cluster(dask) as team:
            yield team
        return
    # spawned, because a fork keeps locks that other threads of this process hold
    spawned = partial(ProcessPoolExecutor, number, multiprocessing.get_context("spawn"))
    team = Workers(spawned if number > 1 else partial(ThreadPoolExecutor, 1))
    try:
        yield team
    finally:
        team.close()


@contextmanager
def _cluster(address: str) -> Iterator[Workers]:
    """The workers of a cluster, which continues to run."""
    try:
        from distributed import Client, KilledWorker
    except ImportError:
        raise UserError("--dask needs Dask: pip install 'ncomp[dask]'") from None
    try:
        client: Any = Client(address, timeout=CONNECT_S)  # type: ignore[no-untyped-call]
    except (OSError, TimeoutError, ValueError) as fault:
        raise UserError(f"--dask {address}: {fault}") from None
    with client:
        _check(client, address)
        try:
            yield Workers(partial(client.get_executor, retries=RETRIES))
        except KilledWorker as fault:
            raise UserError(f"--dask {address}: it abandons a chunk whose workers were lost: {fault}") from None


def _check(client: Any, address: str) -> None:
    """UserError unless there are workers, all with the same code as this process."""
    try:
        found = client.run(code)
    except Exception as fault:  # a worker without ncomp can raise any error
        raise UserError(f"--dask {address}: ncomp does not run on the workers: {fault}") from None
    if not found:
        raise UserError(f"--dask {address}: the cluster has no workers")
    others = sorted(worker for worker, theirs in found.items() if theirs != code())
    if others:
        raise UserError(f"--dask {address}: another version of ncomp runs on {', '.join(others)}")
