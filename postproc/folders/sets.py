"""Which of several programs call one another: a called one is corrected with its main program, and not by itself."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from kinematics.files.inputs import true_path
from kinematics.user_error import UserError
from postproc.control.setup import Setup
from postproc.dialects import Dialect, find_dialect
from postproc.program_set import called_files, calls_in
from postproc.text.expressions import NotKnown
from postproc.text.notes import Notes
from postproc.text.source import open_source

if TYPE_CHECKING:
    from postproc.folders.programs import FolderProgram

State = tuple[int, int, frozenset[str]]
"""Time of change, ns, and size of a file, and the names of the programs that it can call."""


class Sets:
    """The calls of programs, each read again only when it changes; calls by a calculated name are not seen."""

    def __init__(self, dialect: str) -> None:
        """`dialect`: of all programs, or `auto`."""
        self._dialect = dialect
        self._labels: dict[Path, tuple[State, set[str]]] = {}

    def main_programs(self, programs: Iterable[FolderProgram], setup: Setup) -> list[FolderProgram]:
        """The programs that no other one calls, each with the files that it calls and those of them that others call.

        Programs that call one another in a circle remain, so that they are refused. UserError for a called one whose
        own entry of a job file names another output than that beside its main program.
        """
        given = list(programs)
        reached = {each.path: self._reached(each.path, setup) for each in given}
        called = {true_path(path) for each in given for path in reached[each.path] if not _same(path, each.path)}
        roots = [each for each in given if true_path(each.path) not in called]
        below = {true_path(path) for each in roots for path in reached[each.path]}
        roots += [each for each in given if true_path(each.path) in called - below]
        for each in given:
            if each.stated and each not in roots:
                _refuse_other_output(
                    each, [root for root in roots if true_path(each.path) in map(true_path, reached[root.path])]
                )
        users = Counter(true_path(path) for each in roots for path in reached[each.path])
        return [
            replace(
                each,
                called=tuple(reached[each.path]),
                shared=tuple(str(path) for path in map(true_path, reached[each.path]) if users[path] > 1),
            )
            for each in given
            if each in roots
        ]

    def _reached(self, path: Path, setup: Setup) -> list[Path]:
        """The files that a program calls, and those that these call."""
        found: dict[Path, None] = {}
        waiting = [path]
        while waiting:
            for called in self._called(waiting.pop(), path.parent, setup):
                if called not in found:
                    found[called] = None
                    waiting.append(called)
        return list(found)

    def _called(self, path: Path, main: Path, setup: Setup) -> Iterator[Path]:
        """The files that the program in a file calls; main: folder of the main program."""
        with suppress(UserError, OSError):
            source, there = open_source(str(path)), path.stat()
            language = find_dialect(self._dialect, source.name, source.text_head)
            files = called_files(source, language, setup, main)
            state = there.st_mtime_ns, there.st_size, frozenset(files.names())
            if path not in self._labels or self._labels[path][0] != state:
                self._labels[path] = state, self._calls(path, language, setup)
            for label in sorted(self._labels[path][1]):
                try:
                    found = files.find(label)
                except NotKnown:
                    yield from files.namesakes(label)
                else:
                    yield from [found.path] if found else []

    @staticmethod
    def _calls(path: Path, dialect: Dialect, setup: Setup) -> set[str]:
        scope = dialect.interpreter(setup.machine, setup, Notes()).scope
        return set(calls_in(open_source(str(path)), dialect, setup, scope))


def _same(one: Path, other: Path) -> bool:
    return true_path(one) == true_path(other)


def _refuse_other_output(program: FolderProgram, callers: Sequence[FolderProgram]) -> None:
    """UserError for a program whose output is not where it is written with a program that calls it."""
    for caller in callers:
        beside = caller.target.parent / os.path.relpath(program.path, caller.path.parent)
        if true_path(beside) != true_path(program.target):
            raise UserError(
                f'programs."{program.name}": {caller.path} calls this program, so that its correction is written '
                f"beside that of {caller.path.name}, as {beside}: take out this entry, or give it this output"
            )
