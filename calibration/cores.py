"""Independent items of work on all cores; BLAS has one thread (`kinematics/running/blas.py`)."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from typing import TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")


def each(
    work: Callable[[Item], Result], items: Iterable[Item], done: Callable[[float], None] = lambda _: None
) -> list[Result]:
    """Results of `work` for the items, in their order, with one thread for each core. `work` must not call `each`.

    done: called with the share of the results that are there.
    """
    waiting = list(items)
    threads = min(_cores(), len(waiting))
    if threads < 2:
        return _collected(map(work, waiting), len(waiting), done)
    with ThreadPoolExecutor(threads) as pool:
        return _collected(pool.map(work, waiting), len(waiting), done)


def _collected(results: Iterable[Result], number: int, done: Callable[[float], None]) -> list[Result]:
    found = []
    for result in results:
        found.append(result)
        done(len(found) / number)
    return found


@cache
def _cores() -> int:
    """Number of cores that this process may use; at most OMP_NUM_THREADS, where that is set."""
    allowed = os.environ.get("OMP_NUM_THREADS", "")
    mine = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return min(mine, int(allowed)) if allowed.isdigit() and int(allowed) else mine
