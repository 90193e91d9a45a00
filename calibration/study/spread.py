"""Chunks over workers: this process, several processes, or a Dask cluster (`kinematics/running/workers.py`)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager

from calibration.study.cases import CODE, Case
from calibration.study.chunks import Chunk, Outcome, work
from kinematics.running.workers import Team
from kinematics.running.workers import workers as common
from kinematics.user_error import UserError

Task = tuple[Case, Chunk]


def workers(number: int, dask: str | None) -> AbstractContextManager[Team]:
    """The workers of a study; UserError if the cluster cannot be used."""
    return common(number, dask, CODE)


def outcomes(team: Team, tasks: Sequence[Task]) -> Iterator[tuple[Task, Outcome]]:
    """Every task with its outcome, in the order of completion; UserError if a chunk loses its workers repeatedly."""
    return team.results(work, tasks, _lost)


def _lost(task: Task) -> Outcome:
    raise UserError(
        f"case {task[0].name}: a worker process was ended from outside several times, perhaps for lack of memory: use "
        "fewer processes (--workers 1 needs the least memory)"
    )
