"""A study from its file to its results."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from calibration.design.volume import Volume
from calibration.study.cases import Case, read_cases, with_volume
from calibration.study.definition import StudyEntry, read_study
from calibration.study.results import summary, write_results
from calibration.study.run import Draws, Result, run
from calibration.study.spread import workers
from calibration.study.store import Store
from kinematics.files import whole_file
from kinematics.machine import Machine
from kinematics.user_error import UserError
from rendering.shown import Shown


@dataclass(frozen=True, repr=False)
class Studied(Shown):
    """The results of a study."""

    definition: StudyEntry
    """The content of the study's file."""
    draws: Draws
    """Number of draws of each case, or the rule that stops them."""
    results: Sequence[Result]
    """Result of each case: errors before and after, um, by draw."""
    store: Store
    """Draws that are done, kept until the results are written."""

    @property
    def headline(self) -> str:
        """The result in a few words."""
        return f"{len(self.results)} cases on {self.definition.machine}"

    def json(self) -> dict[str, Any]:
        """The results for programs, with every draw, um."""
        return summary(self.results)

    def save(self, path: str | Path) -> None:
        """Write a table with one row for each case (docs/study.md), whole or not at all; kept draws are removed."""
        with whole_file(Path(path)) as file:
            write_results(self.results, file)
        self.clear()

    def clear(self) -> None:
        """Remove the draws that are kept."""
        self.store.clear(result.case.key for result in self.results)


@dataclass(frozen=True)
class Study:
    """A study before it runs."""

    definition: StudyEntry
    """The content of its file."""
    cases: tuple[Case, ...]
    """The methods that it compares."""

    @classmethod
    def read(cls, path: Path) -> Study:
        """The study in a file; UserError with the case that cannot be used."""
        defined = read_study(path)
        try:
            return cls(defined, tuple(read_cases(defined, path.parent)))
        except UserError as fault:
            raise UserError(f"study {path}: {fault}") from None

    @property
    def machine(self) -> Machine:
        """The nominal machine."""
        return self.cases[0].plan.machine

    def along(self, volume: Volume) -> Study:
        """The study with further positions at which the errors are evaluated."""
        return replace(self, cases=tuple(with_volume(case, volume) for case in self.cases))

    @property
    def draws(self) -> Draws:
        """The number of draws of each case, or the rule that stops them."""
        given = None if self.definition.draws == "adaptive" else self.definition.draws
        return Draws(given, self.definition.tolerance_um, self.definition.most_draws)

    def run(self, number: int, dask: str | None, store: Store, progress: Callable[[int], None]) -> Studied:
        """Run it with `number` processes or a Dask cluster; progress: called with numbers of draws done."""
        with workers(number, dask) as team:
            results = run(self.cases, self.draws, team, store, self.definition.check_draws, progress)
        return Studied(self.definition, self.draws, results, store)
