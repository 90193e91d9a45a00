"""The correction of many programs, and its summary: the end of each program, for people and as JSON."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from kinematics.error_model.model import ErrorModel
from kinematics.files.report_head import calibration_text
from kinematics.machine import Machine
from kinematics.running.workers import workers
from postproc.control.tool_table import shown_tool
from postproc.correct.report import DEMONSTRATION, RELATIVE, SIGNS
from postproc.folders.programs import REFUSED, Correction, FolderProgram, Outcome, corrected, folders_for
from rendering.report import Report, Section, Table, facts
from rendering.shown import Shown

LISTED_PROGRAMS = 40
"""Largest number of corrected programs that the terminal lists; the page and the JSON file have all."""
HEAD = (
    *("program", "result", "moves", "blocks changed", "blocks added"),
    *("largest error before, um", "largest error after, um", "u (k=1), um", "time, s"),
)
SET_UPS = (
    "program",
    "SHA-256",
    "work offsets",
    "datum",
    "tool lengths, mm",
    "largest error between block ends after, um",
)
UNCERTAINTY = "u is the RMS standard uncertainty of the prediction over the program."


@dataclass(frozen=True, repr=False)
class Summary(Shown):
    """The end of the correction of each program, by program, in the order of names."""

    machine: Machine
    """The machine."""
    model: ErrorModel
    """The calibration."""
    outcomes: Mapping[FolderProgram, Outcome]
    """End of each program: state, reason, and the JSON of its correction."""
    seconds: float
    """Duration, s."""
    workers: int
    """Number of processes."""

    @property
    def headline(self) -> str:
        """The result in a few words."""
        numbers = ", ".join(f"{number} {state}" for state, number in sorted(self.counts.items()))
        return f"{self.machine.name}, {numbers}"

    @property
    def counts(self) -> Counter[str]:
        """Number of programs by state."""
        return Counter(outcome.state for outcome in self.outcomes.values())

    @property
    def status(self) -> int:
        """Exit status: 1 after an internal fault, 2 if a program was refused or the set-up is unused, otherwise 0."""
        mistaken = bool(self.unused) or any(self.counts[state] for state in REFUSED)
        return 1 if self.counts["failed"] else 2 if mistaken else 0

    @property
    def unused(self) -> list[str]:
        """Sentences on parts of the set-up that no program uses, where one uses others that were not given."""
        from postproc.control.without_effect import unused_by_all

        return unused_by_all([outcome.unused for outcome in self.outcomes.values() if outcome.result])

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
        yield from self.unused
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
            yield Section("Programs", table=Table(HEAD, rows), detail=len(rows) > LISTED_PROGRAMS)
            set_ups = [self._set_up(each, outcome) for each, outcome in self.outcomes.items() if outcome.result]
            text = "Compare them with the control. SHA-256 is that of the program as it was read, as in its mark."
            yield Section("Set-ups", text, Table(SET_UPS, set_ups), detail=len(rows) > LISTED_PROGRAMS)
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
            f"{errors['anywhere']['before']:.2f}", f"{errors['anywhere']['after']:.2f}",
            f"{errors['standard_uncertainty_of_prediction']['rms']:.2f}", f"{outcome.seconds:.2f}",
        )  # fmt: skip

    @staticmethod
    def _set_up(program: FolderProgram, outcome: Outcome) -> tuple[str, ...]:
        """The set-up with which a program was corrected, and its error between block ends."""
        result = outcome.result
        between = result["predicted_error_um"]["between_block_ends_after"]
        return (
            program.name, result["program"]["sha256"],
            "\n".join(f"{name}: {value}" for name, value in result["work_offsets"].items()),
            "\n".join(map(_datum, result["datum"])),
            "\n".join(f"{shown_tool(tool)}: {length}" for tool, length in result["tools"].items()),
            f"{between['max']:.2f}" if between["count"] else "",
        )  # fmt: skip

    def _reason(self, program: FolderProgram, outcome: Outcome) -> str:
        name = "" if str(program.path) in outcome.reason else f"{program.path}: "
        earlier = f"; {program.target} is the output of an earlier run" if self._earlier(program, outcome) else ""
        return name + outcome.reason + earlier

    @staticmethod
    def _earlier(program: FolderProgram, outcome: Outcome) -> bool:
        """True if the output of an earlier run is still there."""
        return outcome.state in REFUSED and program.target.exists()


def _datum(datum: Mapping[str, Any]) -> str:
    """How a work offset was obtained."""
    text = f"{datum['work_offset']}: {datum['obtained']}"
    if "position" not in datum:
        return text
    linear_first = sorted(datum["position"].items(), key=lambda item: (item[0][0] in "ABC", item[0]))
    position = " ".join(f"{axis} {at:g}" for axis, at in linear_first)
    return f"{text} at {position}, probe {datum['probe_mm']:g} mm"


def correct_all(
    programs: Sequence[FolderProgram],
    machine: Machine,
    model: ErrorModel,
    correction: Correction,
    number: int,
    dask: str | None,
    progress: Callable[[int], None] = lambda _: None,
) -> Summary:
    """Correct programs, each into its own file, by `number` processes or a Dask cluster.

    machine, model: those of the summary; correction: corrects one program. progress: called with the number of bytes of
    each program that is done.
    """
    start, number, ends = time.perf_counter(), min(number, len(programs)), {}
    with folders_for(programs), workers(number, dask, _packages()) as team:
        for program, outcome in corrected(programs, correction, team, sent=dask is not None):
            ends[program] = outcome
            progress(program.size)
    ordered = {program: ends[program] for program in programs}
    return Summary(machine, model, ordered, time.perf_counter() - start, number)


def _packages() -> tuple[str, ...]:
    """Names of the packages that correct programs."""
    import grammars
    import kinematics
    import machines
    import postproc

    packages: Iterable[object] = (postproc, kinematics, machines, grammars)
    return tuple(getattr(package, "__name__", "") for package in packages)
