"""All cores for pieces of work that don't need each other; BLAS has one thread meanwhile.

Threads of BLAS get in each other's way on the small matrices of this package: two of them take twice as long as one.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import cache
from typing import TypeVar

from threadpoolctl import ThreadpoolController  # type: ignore[import-untyped]

Item = TypeVar("Item")
Result = TypeVar("Result")


def each(work: Callable[[Item], Result], items: Iterable[Item]) -> list[Result]:
    """`work` of every item, in their order, in as many threads as there are cores. It must not call this itself."""
    waiting = list(items)
    threads = min(_cores(), len(waiting))
    if threads < 2:
        return [work(item) for item in waiting]
    with blas_in_one_thread(), ThreadPoolExecutor(threads) as pool:
        return list(pool.map(work, waiting))


@contextmanager
def blas_in_one_thread() -> Iterator[None]:
    """Within this BLAS has one thread."""
    with _blas().limit(limits=1, user_api="blas"):
        yield


@cache
def _blas() -> ThreadpoolController:
    return ThreadpoolController()


@cache
def _cores() -> int:
    """Cores that this process may use; no more than OMP_NUM_THREADS, where that is set."""
    allowed = os.environ.get("OMP_NUM_THREADS", "")
    mine = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return min(mine, int(allowed)) if allowed.isdigit() and int(allowed) else mine
