"""Independent items of work on all cores; BLAS has one thread (`kinematics/blas.py`)."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from typing import TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")


def each(work: Callable[[Item], Result], items: Iterable[Item]) -> list[Result]:
    """Results of `work` for the items, in their order, with one thread for each core. `work` must not call `each`."""
    waiting = list(items)
    threads = min(_cores(), len(waiting))
    if threads < 2:
        return [work(item) for item in waiting]
    with ThreadPoolExecutor(threads) as pool:
        return list(pool.map(work, waiting))


@cache
def _cores() -> int:
    """Number of cores that this process may use; at most OMP_NUM_THREADS, where that is set."""
    allowed = os.environ.get("OMP_NUM_THREADS", "")
    mine = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return min(mine, int(allowed)) if allowed.isdigit() and int(allowed) else mine
