"""A study from its cases to its results: chunk by chunk, until there are enough draws."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from calibration.study.cases import Case
from calibration.study.chunks import DRAWS_OF_CHUNK, Chunk, Outcome, prepared
from calibration.study.exact import Compared, compared
from calibration.study.spread import outcomes
from calibration.study.stopping import enough
from calibration.study.store import Store
from kinematics.running.workers import Team
from kinematics.transforms import Array

CHUNKS_BETWEEN_CHECKS = 8
"""Number of chunks of a case between two checks of the stopping rule, which evaluates them one by one."""
Progress = Callable[[int], None]


@dataclass(frozen=True)
class Draws:
    """Number of draws of each case."""

    number: int | None
    """None where the stopping rule decides."""
    tolerance_um: float = 0.1
    """Tolerance of the stopping rule, um."""
    most: int = 100_000
    """Largest number of draws."""

    def chunks(self, begun: int) -> list[Chunk]:
        """The next chunks of a case after those already begun."""
        if self.number is None:
            last = min(begun + CHUNKS_BETWEEN_CHECKS, -(-self.most // DRAWS_OF_CHUNK))
            return [Chunk(k, DRAWS_OF_CHUNK) for k in range(begun, last)]
        return [
            Chunk(k, min(DRAWS_OF_CHUNK, self.number - k * DRAWS_OF_CHUNK))
            for k in range(begun, -(-self.number // DRAWS_OF_CHUNK))
        ]


@dataclass(frozen=True)
class Result:
    """Result of a case."""

    case: Case
    before: Array
    """RMS errors `(volumes, draws)`, um, without a correction."""
    after: Array
    """RMS errors `(volumes, draws)`, um, after correction by the fits."""
    batches: tuple[Array, ...]
    """RMS errors `(draws,)`, um, after correction, on the grid, by chunk."""
    converged: bool
    """False where an adaptive study ended at its largest number of draws."""
    points: int
    """Observations within reach."""
    minutes: float
    """Duration of the measurement, min."""
    notes: tuple[str, ...]
    check: Compared | None
    """Some draws, by the linear equations and by the exact kinematics."""


@dataclass
class _Progressing:
    """A case in progress."""

    case: Case
    key: str
    outcomes: dict[Chunk, Outcome] = field(default_factory=dict)
    begun: int = 0
    enough: int | None = None
    """Number of chunks that count, once it is known."""

    def evaluate(self, draws: Draws) -> None:
        """Set `enough` where the stopping rule, or a limit on the draws, decides it."""
        chunks = sorted(self.outcomes)
        if draws.number is not None:
            self.enough = len(chunks)
            return
        batches: list[Array] = []
        for k, chunk in enumerate(chunks, start=1):
            batches.append(self.outcomes[chunk].after[0])
            if enough(batches, draws.tolerance_um):
                self.enough = k
                return
        if not draws.chunks(self.begun):
            self.enough = len(chunks)


def run(
    cases: Sequence[Case], draws: Draws, team: Team, store: Store, check_draws: int = 0,
    progress: Progress = lambda _: None,
) -> list[Result]:  # fmt: skip
    """Results of all cases, independent of the workers; `progress` is called with numbers of draws done."""
    in_progress = [_Progressing(case, case.key) for case in cases]
    while unfinished := [each for each in in_progress if each.enough is None]:
        tasks = []
        for each in unfinished:
            for chunk in draws.chunks(each.begun):
                known = store.get(each.key, chunk)
                if known is None:
                    tasks.append((each, chunk))
                else:
                    each.outcomes[chunk] = known
                    progress(chunk.draws)
            each.begun += len(draws.chunks(each.begun))
        by_case = {id(each.case): each for each in unfinished}
        for (case, chunk), outcome in outcomes(team, [(each.case, chunk) for each, chunk in tasks]):
            each = by_case[id(case)]
            store.put(each.key, chunk, outcome)
            each.outcomes[chunk] = outcome
            progress(chunk.draws)
        for each in unfinished:
            each.evaluate(draws)
    return [_result(each, draws, check_draws) for each in in_progress]


def _result(done: _Progressing, draws: Draws, check_draws: int) -> Result:
    chunks = sorted(done.outcomes)[: done.enough]
    outcomes = [done.outcomes[chunk] for chunk in chunks]
    batches = tuple(outcome.after[0] for outcome in outcomes)
    setup = done.case.setup()
    return Result(
        done.case,
        np.concatenate([outcome.before for outcome in outcomes], axis=1),
        np.concatenate([outcome.after for outcome in outcomes], axis=1),
        batches,
        draws.number is not None or enough(batches, draws.tolerance_um),
        len(setup.measurement),
        setup.minutes,
        setup.notes,
        compared(prepared(done.key, done.case), check_draws) if check_draws else None,
    )
