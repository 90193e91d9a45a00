"""The summary of the correction of a folder: what became of each program, for people and as JSON."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from kinematics.error_model.model import ErrorModel
from kinematics.files.report_head import calibration_text
from kinematics.machine import Machine
from postproc.commands.programs.folder import REFUSED, FolderProgram, Outcome
from postproc.correct.report import DEMONSTRATION, RELATIVE, SIGNS
from rendering.report import Report, Section, Table, facts

LISTED = 40
"""Largest number of corrected programs that the terminal lists; the page and the JSON file have all."""
HEAD = (
    *("program", "result", "moves", "blocks changed", "blocks added"),
    *("largest error before, um", "largest error after, um", "u (k=1), um", "time, s"),
)
UNCERTAINTY = "u is the RMS standard uncertainty of the prediction over the program."


@dataclass(frozen=True)
class Summary:
    """The end of the correction of each program, by program, in the order of names."""

    machine: Machine
    model: ErrorModel
    outcomes: Mapping[FolderProgram, Outcome]
    seconds: float
    workers: int

    @property
    def counts(self) -> Counter[str]:
        """Number of programs by state."""
        return Counter(outcome.state for outcome in self.outcomes.values())

    @property
    def status(self) -> int:
        """Exit status: 1 after an internal fault, 2 if a program was refused, otherwise 0."""
        return 1 if self.counts["failed"] else 2 if any(self.counts[state] for state in REFUSED) else 0

    def json(self) -> dict[str, Any]:
        """The machine-readable form."""
        return {
            "machine": self.machine.name,
            "calibration": self.model.id,
            "demonstration": self.model.demonstration,
            "seconds": round(self.seconds, 3),
            "workers": self.workers,
            "counts": dict(self.counts),
            "programs": [
                {
                    "name": program.name,
                    "output": None if outcome.state in REFUSED else str(program.target),
                    "earlier_output": self._earlier(program, outcome),
                    "state": outcome.state,
                    "reason": outcome.reason,
                    "seconds": round(outcome.seconds, 3),
                    "result": outcome.result or None,
                }
                for program, outcome in self.outcomes.items()
            ],
        }

    def report(self, command: str) -> Report:
        """The summary for people; `command`: the command line."""
        lead = f"machine {self.machine.name} · calibration {self.model.id}"
        head = self.machine.report.filled(
            machine=self.machine.name, calibration=calibration_text(self.model), command=command
        )
        return Report("Correction of a folder", lead, list(self._sections()), "\n".join(self._verdict()), head=head)

    def _verdict(self) -> Iterator[str]:
        yield from sorted({outcome.assumption for outcome in self.outcomes.values() if outcome.assumption})
        if self.model.invented:
            yield DEMONSTRATION
        numbers = ", ".join(f"{number} {state}" for state, number in sorted(self.counts.items()))
        yield f"{len(self.outcomes)} programs in {self.seconds:.1f} s: {numbers}."

    def _sections(self) -> Iterator[Section]:
        refused = [(program, outcome) for program, outcome in self.outcomes.items() if outcome.state in REFUSED]
        if refused:
            yield facts("Programs without an output", [(end.state, self._reason(each, end)) for each, end in refused])
        rows = [self._row(each, outcome) for each, outcome in self.outcomes.items() if outcome.result]
        if rows:
            yield Section("Programs", table=Table(HEAD, rows), detail=len(rows) > LISTED)
            relative = any(
                end.result.get("errors_relative_to") == "datum" for end in self.outcomes.values() if end.result
            )
            yield Section("Conventions", f"{SIGNS} {UNCERTAINTY}\n{RELATIVE if relative else ''}", detail=True)
        if notes := [(each.name, note) for each, end in self.outcomes.items() for note in end.result.get("notes", ())]:
            yield Section("Notes", table=Table(("program", "note"), notes), detail=True)

    @staticmethod
    def _row(program: FolderProgram, outcome: Outcome) -> tuple[str, ...]:
        blocks, moves, errors = (outcome.result[key] for key in ("blocks", "moves", "predicted_error_um"))
        return (
            program.name, outcome.state, str(moves["read"]), str(blocks["changed"]), str(blocks["added"]),
            f"{errors['before']['max']:.2f}", f"{errors['after']['max']:.2f}",
            f"{errors['standard_uncertainty_of_prediction']['rms']:.2f}", f"{outcome.seconds:.2f}",
        )  # fmt: skip

    def _reason(self, program: FolderProgram, outcome: Outcome) -> str:
        name = "" if str(program.path) in outcome.reason else f"{program.path}: "
        earlier = f"; {program.target} is the output of an earlier run" if self._earlier(program, outcome) else ""
        return name + outcome.reason + earlier

    @staticmethod
    def _earlier(program: FolderProgram, outcome: Outcome) -> bool:
        """True if the output of an earlier run is still there."""
        return outcome.state in REFUSED and program.target.exists()
