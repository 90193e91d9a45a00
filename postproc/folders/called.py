"""The files of called programs, corrected beside the main program: where they go, and what they must not replace."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from kinematics.files.inputs import true_path
from kinematics.user_error import UserError
from postproc.correct.mark import UNCHANGED, called_by
from postproc.text.calls.called_files import posted_suffix
from postproc.text.source import ENCODING

if TYPE_CHECKING:
    from postproc.folders.programs import FolderProgram
    from postproc.interface.programs import Corrected

CALLED = re.compile(rf"NCOMP [^\n]*({UNCHANGED}(?: BY [^\s)]+)?)[) \t]*\r?$", re.MULTILINE)
"""The mark of a called program."""
MARK_HEAD_BYTES = 1 << 16
"""Bytes at the beginning of a program that contain its mark."""
OTHERWISE = "name an output in another folder, or write the calls out by --unroll"


def files_beside(target: Path, done: Corrected) -> dict[Path, bytes]:
    """The called files of a correction by their paths; target: the file of the main program.

    UserError for one that would replace a program that the correction has read, or a file that is no earlier correction
    for the same main program.
    """
    if done.job.beside and target.is_file() and (owner := _called_mark(target)):
        raise UserError(
            f"{done.job.source.name}: its output {target} is the correction of a program that another one calls "
            f"({owner.strip()}): delete it, or name another output"
        )
    files = {_beside(target, Path(done.job.source.name), each.name): each for each in done.called}
    read = {true_path(Path(each.source.name)) for each in done.called} | {true_path(Path(done.job.source.name))}
    for path, each in files.items():
        if true_path(path) in read or true_path(path) == true_path(target):
            raise UserError(
                f"the correction of {each.source.name}, which {done.job.source.name} calls, would replace {path}: "
                f"{OTHERWISE}"
            )
        if path.exists() and not _is_replaced(path, each.data, target, done):
            raise UserError(
                f"the correction of {each.source.name}, which {done.job.source.name} calls, would replace {path}, "
                f"which is not from an earlier correction of this program: delete it, {OTHERWISE}"
            )
    return {path: each.data for path, each in files.items()}


def earlier_beside(program: FolderProgram) -> Iterator[Path]:
    """The earlier corrections of the files that a program calls, in the folder of its output."""
    for path in program.called:
        inside = path.is_relative_to(program.path.parent)
        name = path.relative_to(program.path.parent) if inside else path.name
        output = _beside(program.target, program.path, name)
        if output.is_file() and _called_mark(output).endswith(called_by(program.path)):
            yield output


def _beside(target: Path, main: Path, name: str | Path) -> Path:
    """The output of a called file; with the suffix of a main program as the CAM has posted it, it gets the output's."""
    path, posted = target.parent / name, posted_suffix(main.name)
    return path.with_suffix(target.suffix) if posted and path.suffix.lower() == posted else path


def _called_mark(path: Path) -> str:
    """The end of the mark of a called program in a file; empty without one."""
    match = CALLED.search(path.read_bytes().decode(ENCODING))
    return match[1] if match else ""


def _is_replaced(path: Path, data: bytes, target: Path, done: Corrected) -> bool:
    """True if a file is the same, or an earlier correction that no other main program beside the output may call.

    A mark has the name of the main program, which two of different folders may share; that of a file without
    corrections has none.
    """
    there = path.read_bytes() if path.is_file() else b""
    owned, of_all = (_ends_a_mark(there, end) for end in (called_by(done.job.source.name), UNCHANGED))
    if there == data or (owned and target.is_file()):
        return True
    blocks = [[line for line in each.split(b"\n") if b"NCOMP " not in line] for each in (there, data)]
    return (of_all and blocks[0] == blocks[1]) or ((owned or of_all) and not _others_beside(target))


def _ends_a_mark(data: bytes, end: str) -> bool:
    lines = (line.rstrip(b") \t\r") for line in data.split(b"\n") if b"NCOMP " in line)
    return any(line.endswith(end.encode()) for line in lines)


def _others_beside(target: Path) -> bool:
    """True if there is another corrected main program in the folder of an output."""
    for path in target.parent.iterdir():
        if path.is_file() and true_path(path) != true_path(target):
            with path.open("rb") as file:
                head = file.read(MARK_HEAD_BYTES)
            if b"NCOMP " in head and not CALLED.search(head.decode(ENCODING)):
                return True
    return False
