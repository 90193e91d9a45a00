"""Programs of a folder, and the correction of each, by workers."""

from __future__ import annotations

import io
import os
import time
import traceback
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path, PurePath
from typing import TYPE_CHECKING, Any, BinaryIO, Literal

from kinematics.files import read_input, whole_file, write_whole, writing
from kinematics.files.inputs import FileSet, overwritten, run_with_inputs, true_path
from kinematics.files.mistaken import missing
from kinematics.running.workers import Team
from kinematics.user_error import UserError
from postproc.correct.mark import mark_in_program
from postproc.folders.called import files_beside
from postproc.text.calls.called_files import SUFFIXES
from postproc.text.source import ENCODING, Source, open_source, text_source

if TYPE_CHECKING:
    from postproc.control.setup import Setup
    from postproc.control.without_effect import Unused
    from postproc.folders.own_set_up import OwnSetUp
    from postproc.interface.programs import Corrected

State = Literal["corrected", "unchanged", "already corrected", "refused", "failed"]
REFUSED: tuple[State, ...] = ("already corrected", "refused", "failed")
"""States of programs without an output."""
Correction = Callable[..., "Corrected"]
"""`ncomp.correct` with everything but the program and the output."""


@dataclass(frozen=True)
class FolderProgram:
    """A program of a folder, and the file of its correction."""

    name: str
    """Path from the folder, with slashes."""
    path: Path
    """File of the program."""
    target: Path
    """File of its correction."""
    size: int
    """Number of bytes."""
    own: OwnSetUp | None = None
    """The set-up that is given for it alone, in its entry of a job file."""
    setup: Setup | None = field(default=None, compare=False)
    """The whole set-up, if it is not that of all programs."""
    called: tuple[Path, ...] = ()
    """Files of the programs that it calls, which are corrected with it."""
    shared: tuple[str, ...] = ()
    """Those of them that other programs of the run call too."""
    stated: bool = False
    """True where an entry of a job file names this file alone, with its output."""
    own_names: tuple[str, ...] = ()
    """Names of the parts of its own set-up; a program that does not use them is refused."""


@dataclass(frozen=True)
class Outcome:
    """The end of a program's correction."""

    state: State
    """The end: corrected, unchanged, already corrected, refused, or failed by a fault of ncomp."""
    reason: str = ""
    """Reason for a refusal, with file and line."""
    result: dict[str, Any] = field(default_factory=dict)
    """The JSON of the correction; empty without one."""
    assumption: str = ""
    """The part of the set-up that is assumed, as a sentence."""
    unused: tuple[Unused, ...] = ()
    """Parts of the set-up that were given and that the program does not use."""
    seconds: float = 0.0
    """Duration, s."""


LOST = Outcome(
    "refused",
    "the process that corrected it was ended from outside several times, perhaps for lack of memory: use fewer "
    "processes (--jobs 1 needs the least memory)",
)
"""Outcome of a program whose workers were lost."""


def programs_of(folder: Path, output: Path, patterns: Sequence[str]) -> list[FolderProgram]:
    """The programs of a folder and its subfolders, in the order of their names, without hidden files and the output.

    patterns: of names, or of paths from any folder (`roughing/*.nc`); none: the usual suffixes. UserError for a folder
    that cannot be read or has no program, and for a pattern without a name.
    """
    check_folders(folder, output)
    check_patterns(patterns)
    found = present_programs(folder, output, patterns)
    if not found:
        expected = " or ".join(patterns) if patterns else f"a name that ends in {', '.join(SUFFIXES)}"
        raise UserError(f"folder {folder} has no program: expected {expected}; --glob PATTERN chooses others")
    return found


def check_folders(folder: Path, output: Path) -> None:
    """UserError for a folder of programs that cannot be read, and for an output folder that is the same."""
    if not folder.is_dir():
        why = "it is a file: 'ncomp correct' corrects one program" if folder.exists() else "No such file or directory"
        raise UserError(f"folder {folder}: {why}{missing(folder)}")
    if true_path(folder) == true_path(output):
        raise UserError(f"the output folder {output} is the input: name another one")
    if output.exists() and not output.is_dir():
        raise UserError(f"cannot write {output}: it is a file: name a folder")


def check_patterns(patterns: Iterable[str]) -> None:
    """UserError for a pattern of names without a name."""
    for pattern in patterns:
        if not PurePath(pattern).name:
            raise UserError(f"--glob {pattern or repr('')}: expected a pattern of names, such as *.nc or roughing/*.nc")


def present_programs(folder: Path, output: Path, patterns: Sequence[str]) -> list[FolderProgram]:
    """The programs in a folder, as `programs_of`; none where there is none."""
    return [
        FolderProgram(name.as_posix(), path, output / name, path.stat().st_size)
        for path in sorted(_files(folder, true_path(output)))
        if _wanted(name := path.relative_to(folder), patterns)
    ]


def _files(folder: Path, output: Path) -> Iterator[Path]:
    """The files in a folder and its subfolders but `output`."""
    for root, folders, files in os.walk(folder, onerror=_refuse_folder):
        here = Path(root)
        folders[:] = [name for name in folders if not name.startswith(".") and true_path(here / name) != output]
        yield from (here / name for name in files if not name.startswith(".") and (here / name).is_file())


def _refuse_folder(fault: OSError) -> None:
    raise UserError(f"folder {fault.filename}: {fault.strerror or fault}")


def _wanted(name: PurePath, patterns: Sequence[str]) -> bool:
    return any(name.match(pattern) for pattern in patterns) if patterns else name.suffix.lower() in SUFFIXES


def check_targets(
    programs: Iterable[FolderProgram], others: Iterable[Path], results: Mapping[str, str | Path | None]
) -> None:
    """UserError, before any work is done, for an output that would overwrite an input or another output.

    others: further inputs; results: outputs of all programs together, by their options.
    """
    read, written = FileSet(), FileSet()
    for path in (*others, *(each.path for each in programs)):
        read.add(path)
    for name, result in results.items():
        if result not in (None, "-"):
            written.add(str(result), name)
    for each in programs:
        if each.target in read:
            raise overwritten(each.target, "another output folder")
        if (other := written.find(each.target)) is not None:
            raise UserError(f"{other} names {each.target}, the output of {each.name}: name another file")
        written.add(each.target, each.name)


@contextmanager
def folders_for(programs: Iterable[FolderProgram]) -> Iterator[None]:
    """The folders of the outputs; new ones that remain empty are removed."""
    needed = {folder for each in programs for folder in (each.target.parent, *each.target.parent.parents)}
    new = sorted(folder for folder in needed if not folder.exists())
    try:
        for folder in new:
            with writing(folder):
                folder.mkdir(exist_ok=True)
        yield
    finally:
        for folder in reversed(new):
            with suppress(OSError):
                folder.rmdir()


def corrected(
    programs: Iterable[FolderProgram], correction: Correction, team: Team, *, sent: bool
) -> Iterator[tuple[FolderProgram, Outcome]]:
    """Every program with the end of its correction, in the order of completion; the largest programs begin.

    sent: programs and corrections travel between this process and the workers, which need not have the same disk.
    """
    ordered = sorted(programs, key=lambda each: -each.size)
    if sent:  # a worker may not see called files
        ordered, here = [each for each in ordered if not each.called], [each for each in ordered if each.called]
        yield from ((each, correct_file(correction, each)) for each in here)
    else:
        tasks = ((each,) for each in ordered)
        for (program,), outcome in team.results(partial(correct_file, correction), tasks, lambda _: LOST):
            yield program, outcome
        return
    unread: list[tuple[FolderProgram, Outcome]] = []
    for (program, _), (outcome, text) in team.results(
        partial(correct_text, correction), _texts(ordered, unread), lambda _: (LOST, b"")
    ):
        yield program, outcome if outcome.state in REFUSED else _written(program, outcome, text)
    yield from unread


def _texts(
    programs: Iterable[FolderProgram], unread: list[tuple[FolderProgram, Outcome]]
) -> Iterator[tuple[FolderProgram, bytes]]:
    """Tasks with the bytes of the programs; those that cannot be read go to `unread`."""
    for each in programs:
        try:
            yield each, read_input(each.path, "program")
        except UserError as fault:
            unread.append((each, Outcome("refused", str(fault))))


def _written(program: FolderProgram, outcome: Outcome, text: bytes) -> Outcome:
    try:
        write_whole(program.target, text)
    except UserError as fault:
        return Outcome("refused", str(fault), seconds=outcome.seconds)
    return outcome


def correct_file(
    correction: Correction, program: FolderProgram, after: Callable[[Corrected], None] = lambda _: None
) -> Outcome:
    """Correct a program into its file, which is written whole or not at all; `after` is called before it is written."""
    opened, beside = partial(open_source, str(program.path)), dict[Path, bytes]()

    def called(done: Corrected) -> None:
        """Name the files of called programs, which are written with the program."""
        beside.update(files_beside(program.target, done))
        after(done)

    as_files = partial(correction, beside=True, shared=program.shared)
    return _outcome(as_files, program, opened, whole_file(program.target, beside), called)


def correct_text(correction: Correction, program: FolderProgram, data: bytes) -> tuple[Outcome, bytes]:
    """Correct a program whose file this process does not see; the bytes of its correction, empty without one."""
    file = io.BytesIO()
    source = partial(text_source, data.decode(ENCODING), str(program.path))
    return _outcome(correction, program, source, nullcontext(file)), file.getvalue()


def _outcome(
    correction: Correction,
    program: FolderProgram,
    opened: Callable[[], Source],
    output: AbstractContextManager[BinaryIO],
    after: Callable[[Corrected], None] = lambda _: None,
) -> Outcome:
    """Correct a program; a fault ends its own correction only."""
    start, source = time.perf_counter(), None
    own = {} if program.setup is None else {"setup": program.setup}
    try:
        with run_with_inputs():
            source = opened()
            with output as file:
                done = correction(source, output=file, **own)
                _refuse_own(done, program)
                after(done)
    except UserError as fault:
        state: State = "already corrected" if source is not None and _marked(source) else "refused"
        outcome = Outcome(state, str(fault))
    except OSError as fault:
        outcome = Outcome("refused", f"cannot use {fault.filename or 'the disk'}: {fault.strerror or fault}")
    except Exception as fault:
        traceback.print_exc()
        outcome = Outcome("failed", f"internal fault: {fault!r}; please report it with the program that shows it")
    else:
        report = done.report
        changed = report.changed_blocks or report.added_blocks
        outcome = Outcome(
            "corrected" if changed else "unchanged",
            result=report.json(),
            assumption=report.assumption,
            unused=tuple(report.unused),
        )
    return replace(outcome, seconds=time.perf_counter() - start)


def _refuse_own(done: Corrected, program: FolderProgram) -> None:
    """UserError for a part of the program's own set-up that has no effect on it."""
    from postproc.control.without_effect import refuse_without_effect

    refuse_without_effect(each for each in done.report.unused if each.name in program.own_names)


def _marked(source: Source) -> bool:
    try:
        return mark_in_program(source) is not None
    except UserError:
        return False
