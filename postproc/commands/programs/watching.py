"""A folder that is looked at again and again, so that network drives, which report no changes, are watched as well."""

from __future__ import annotations

import sys
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path

from kinematics.user_error import UserError
from postproc.commands.programs.folder import (
    REFUSED,
    FolderProgram,
    Outcome,
    check_targets,
    correct_file,
    folders_for,
    present_programs,
)
from postproc.commands.programs.request import Request
from postproc.correct.report import DEMONSTRATION

LOOKS = 4
"""Looks at the folder within the time for which a file must not change."""
EARLIER = ".earlier"
"""Suffix of the earlier output of a program that is refused."""
Fingerprint = tuple[int, int]
"""Time of change, ns, and size of a file."""


class Watch:
    """Corrects the programs of a folder as they are completed."""

    def __init__(self, folder: Path, output: Path, patterns: Sequence[str], request: Request, settle: float) -> None:
        self._folder, self._output, self._patterns, self._settle = folder, output, patterns, settle
        self._inputs = request.inputs
        found, model, self._correction = request.prepared()
        self._title = f"machine {found.name}, calibration {model.id}"
        self._warning = DEMONSTRATION if model.invented else ""
        self._done: dict[Path, Fingerprint] = {}
        self._seen: dict[Path, tuple[Fingerprint | None, float]] = {}
        self._counts: Counter[str] = Counter()
        self._lost = ""
        self._worked = time.monotonic()

    def run(self, idle: float | None) -> None:
        """Watch until the process receives a signal to end, or for a time, s, without work."""
        self._say(f"watching {self._folder}, {self._title}; Ctrl-C ends")
        if self._warning:
            self._say(self._warning)
        try:
            while True:
                for program in self._complete():
                    self._correct(program)
                pending = any(self._done.get(path) != state for path, (state, _) in self._seen.items())
                if idle is not None and not pending and time.monotonic() - self._worked >= idle:
                    break
                time.sleep(self._settle / LOOKS)
        except (KeyboardInterrupt, SystemExit):
            pass
        finally:
            ends = ", ".join(f"{number} {state}" for state, number in sorted(self._counts.items()))
            self._say(f"ended: {ends or 'no program'}")

    def _complete(self) -> Iterator[FolderProgram]:
        """The programs that are new or changed, and no longer written."""
        try:
            programs = present_programs(self._folder, self._output, self._patterns)
            self._lost = ""
        except (UserError, OSError) as fault:
            if str(fault) != self._lost:
                self._say(f"{fault}: waiting until it is there")
            self._lost = str(fault)
            return
        self._seen = {each.path: self._seen.get(each.path, (None, 0.0)) for each in programs}
        for program in programs:
            try:
                state = program.path.stat()
            except OSError:
                continue
            now: Fingerprint = (state.st_mtime_ns, state.st_size)
            before, since = self._seen[program.path]
            if before != now:
                self._seen[program.path] = now, time.monotonic()
                self._worked = time.monotonic()
            elif self._done.get(program.path) != now and time.monotonic() - since >= self._settle:
                self._done[program.path] = now
                yield program

    def _correct(self, program: FolderProgram) -> None:
        """Correct one program, and report its end."""
        start = time.perf_counter()
        try:
            check_targets([program], self._inputs)
            with folders_for([program]):
                outcome = correct_file(self._correction, program)
        except UserError as fault:
            outcome = Outcome("refused", str(fault))
        self._counts[outcome.state] += 1
        self._worked = time.monotonic()
        if outcome.state in REFUSED:
            self._say(f"{outcome.state}: {outcome.reason}{self._put_aside(program)}")
            return
        errors = outcome.result["predicted_error_um"]
        change = f"error {errors['before']['max']:.2f} -> {errors['after']['max']:.2f} um at most"
        self._say(f"{outcome.state}: {program.target}, {change}, {time.perf_counter() - start:.1f} s")

    @staticmethod
    def _put_aside(program: FolderProgram) -> str:
        """Rename the earlier output of a program that is refused; returns the end of its message."""
        aside = program.target.with_name(program.target.name + EARLIER)
        with suppress(OSError):
            if program.target.exists():
                program.target.replace(aside)
                return f"; its earlier output is now {aside}"
        return ""

    @staticmethod
    def _say(text: str) -> None:
        print(f"{time.strftime('%Y-%m-%d %H:%M:%S')} {text}", file=sys.stderr, flush=True)
