"""A folder that is looked at again and again, so that network drives, which report no changes, are watched as well."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol

from kinematics.user_error import UserError
from postproc.folders.called import earlier_beside
from postproc.folders.programs import (
    REFUSED,
    Correction,
    FolderProgram,
    Outcome,
    check_folders,
    check_patterns,
    check_targets,
    correct_file,
    folders_for,
    present_programs,
)
from postproc.folders.sets import Sets
from postproc.interface.job_file import own_in_job, read_job
from postproc.interface.renewed import Renewed
from postproc.interface.request import Request
from postproc.program_set import SET_UP

LOOKS = 4
"""Looks at the folder within the time for which a file must not change."""
EARLIER = ".earlier"
"""Suffix of the earlier output of a program that is refused."""
Fingerprint = tuple[int, ...]
"""Time of change, ns, and size of a file, and of the file with its set-up."""


@dataclass(frozen=True)
class Folder:
    """The programs of a folder, with one set-up."""

    name: Path
    output: Path
    patterns: Sequence[str]
    given: Callable[[], Request]
    """Machine, calibration and set-up as they are given, or in the job file now."""
    job: Path | None

    def __post_init__(self) -> None:
        """UserError for folders and patterns that cannot be used."""
        check_folders(self.name, self.output)
        check_patterns(self.patterns)

    @property
    def request(self) -> Request:
        """Machine, calibration and set-up as they are now."""
        return self.given()

    def with_own(self, program: FolderProgram) -> FolderProgram:
        """The program with its set-up in the job file."""
        return program if self.job is None else replace(program, own=own_in_job(self.job, program.path))

    def programs(self) -> list[FolderProgram]:
        """The programs that are there now."""
        return present_programs(self.name, self.output, self.patterns)


class JobFile:
    """The programs of a job file, which is read again at each look."""

    def __init__(self, path: Path) -> None:
        self.name = path
        self.programs()

    request: Request
    """Machine, calibration and set-up as they are in the file now."""

    def programs(self) -> list[FolderProgram]:
        """The programs that are there now; UserError for a file that cannot be used."""
        job = read_job(self.name, there=False)
        self.request = job.request
        return [program for program in job.programs if program.path.is_file()]

    def with_own(self, program: FolderProgram) -> FolderProgram:
        """The program, which has its set-up from the job file."""
        return program


class Results(Protocol):
    """The results of each program in addition to its correction."""

    def named(self, program: FolderProgram) -> Mapping[str, str | Path | None]:
        """The files of a program's results by their options."""

    def correct(self, correction: Correction, program: FolderProgram, request: Request) -> Outcome:
        """Correct a program, and write its results."""


class NoResults:
    """The correction alone."""

    def named(self, _: FolderProgram) -> Mapping[str, str | Path | None]:
        """No file."""
        return {}

    def correct(self, correction: Correction, program: FolderProgram, _: Request) -> Outcome:
        """Correct a program."""
        return correct_file(correction, program)


class Watch:
    """Corrects the programs of a folder as they are completed.

    say: called with a line on each program, and on changes of the files that the corrections read; progress: called
    with each program and its end.
    """

    def __init__(
        self,
        source: Folder | JobFile,
        settle: float,
        say: Callable[[str], None],
        results: Results,
        progress: Callable[[FolderProgram, Outcome], None] = lambda *_: None,
    ) -> None:
        self._source, self._settle, self._say = source, settle, say
        self._results, self._progress = results, progress
        self._renewed, self._sets = (
            Renewed(source.request, settle),
            Sets(source.request.correction.get("dialect", "auto")),
        )
        self._done: dict[Path, Fingerprint | None] = {}
        self._seen: dict[Path, tuple[Fingerprint | None, float]] = {}
        self._counts: Counter[str] = Counter()
        self._lost = self._unusable = ""
        self._worked = time.monotonic()

    def run(self, idle: float | None) -> dict[str, int]:
        """Watch until Ctrl-C, or for a time, s, without work; returns the number of ends by state."""
        self._say(f"watching {self._source.name}, {self._renewed.title}; Ctrl-C ends")
        if self._renewed.warning:
            self._say(self._renewed.warning)
        try:
            while True:
                ready = True
                for program in self._complete():
                    if not (ready := self._ready()):
                        break
                    self._correct(program)
                pending = ready and any(self._done.get(path) != state for path, (state, _) in self._seen.items())
                if idle is not None and not pending and time.monotonic() - self._worked >= idle:
                    break
                time.sleep(self._settle / LOOKS)
        except KeyboardInterrupt:
            pass
        finally:
            ends = ", ".join(f"{number} {state}" for state, number in sorted(self._counts.items()))
            self._say(f"ended: {ends or 'no program'}")
        return dict(self._counts)

    def _complete(self) -> Iterator[FolderProgram]:
        """The programs that are new or changed, and no longer written."""
        try:
            programs = self._sets.main_programs(self._source.programs(), self._renewed.setup)
            self._lost = ""
        except (UserError, OSError) as fault:
            if str(fault) != self._lost:
                self._say(f"{fault}: waiting until it is there")
            self._lost = str(fault)
            return
        self._seen = {each.path: self._seen.get(each.path, (None, 0.0)) for each in programs}
        for program in programs:
            now = _state(program)
            if now is None:
                continue
            before, since = self._seen[program.path]
            if before != now:
                self._seen[program.path] = now, time.monotonic()
                self._worked = time.monotonic()
            elif self._done.get(program.path) != now and time.monotonic() - since >= self._settle:
                yield program

    def _ready(self) -> bool:
        """Take machine, calibration and set-up as they are now; False while one of their files cannot be used."""
        try:
            changes = self._renewed.renew(self._source.request)
        except UserError as fault:
            if str(fault) != self._unusable:
                self._say(f"{fault}: programs wait until it can be used")
            self._unusable = str(fault)
            return False
        self._unusable = ""
        if changes is None:
            self._worked = time.monotonic()
            return False
        if changes:
            self._say(changes)
        return True

    def _correct(self, program: FolderProgram) -> None:
        """Correct one program, and report its end."""
        start = time.perf_counter()
        self._done[program.path] = self._seen[program.path][0]
        try:
            request = self._source.request
            check_targets([program], request.files, self._results.named(program))
            (program,) = request.of_each([self._source.with_own(program)])
            with folders_for([program]):
                outcome = self._results.correct(self._renewed.correction, program, request)
        except UserError as fault:
            outcome = Outcome("refused", str(fault))
        self._counts[outcome.state] += 1
        self._tell(program, outcome, time.perf_counter() - start)
        self._progress(program, outcome)
        self._worked = time.monotonic()

    def _tell(self, program: FolderProgram, outcome: Outcome, seconds: float) -> None:
        """Say the end of a program; the earlier output of a program that is refused is put aside."""
        if outcome.state in REFUSED:
            self._say(f"{outcome.state}: {outcome.reason}{self._put_aside(program)}")
            return
        errors = outcome.result["predicted_error_um"]["anywhere"]
        change = f"error {errors['before']:.2f} -> {errors['after']:.2f} um at most"
        unused = "".join(f"; NOTE: {each.mistake}" for each in outcome.unused if each.mistake)
        self._say(f"{outcome.state}: {program.target}, {change}, {seconds:.1f} s{unused}")

    @staticmethod
    def _put_aside(program: FolderProgram) -> str:
        """Rename the earlier outputs of a program that is refused, and of its called ones; the end of its message."""
        renamed = []
        for output in (program.target, *earlier_beside(program)):
            aside = output.with_name(output.name + EARLIER)
            with suppress(OSError):
                if output.exists():
                    output.replace(aside)
                    renamed.append(str(aside))
        return f"; its earlier output is now {', '.join(renamed)}" if renamed else ""


def _state(program: FolderProgram) -> Fingerprint | None:
    """The state of a program, of the file with its set-up and of those that it calls; None for one not there."""
    found: list[int] = []
    for path in (program.path, program.path.with_name(program.path.name + SET_UP), *program.called):
        with suppress(OSError):
            state = path.stat()
            found += [state.st_mtime_ns, state.st_size]
    return tuple(found) if program.path.is_file() else None
