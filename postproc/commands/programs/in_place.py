"""Output file of a corrected program: the input only on demand, and then with a backup beside it."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import count
from pathlib import Path

from kinematics.files import fingerprint, read_input
from kinematics.files.inputs import true_path
from kinematics.user_error import UserError

SUFFIX = ".orig"
"""Suffix of a backup, after the name of the program; a number follows if the name is taken."""


def target_of(program: str, output: str | None, *, in_place: bool) -> str:
    """The output file of the corrected program, `-` for standard output.

    UserError for an output that is the input, by any name, without --in-place, and for --in-place with another output.
    """
    if in_place and Path(program).exists() and not Path(program).is_file():
        raise UserError(f"--in-place: {program} is not a file that can be replaced; give -o OUT.nc instead")
    if in_place and program == "-":
        raise UserError("--in-place: standard input is not a file that can be replaced; give -o OUT.nc instead")
    if output == "":
        raise UserError("--output '': the name is empty: name a file, or - for standard output")
    if output not in (None, "-") and not Path(program).exists() and Path(str(output)).is_file():
        raise UserError(
            f"program {program}: No such file, and the output {output} is there: are both exchanged? ncomp IN.nc ... "
            "-o OUT.nc names the program first"
        )
    same = output not in (None, "-") and program != "-" and _same_file(program, str(output))
    if same and not in_place:
        raise UserError(f"--output {output} is the input {program}: --in-place replaces it and keeps a backup")
    if in_place and output is not None and not same:
        raise UserError(f"--in-place replaces the input {program}, and --output names {output}: give one of them")
    return str(true_path(program)) if in_place else output or "-"


@contextmanager
def backup_of(program: str, known: str) -> Iterator[Path]:
    """The path of a copy of the program, complete on disk; the copy is removed when the block fails.

    `known` is the fingerprint of the program as it was read; UserError where the file has changed since.
    """
    path = true_path(program)
    backup = _written(path, read_input(path, "program"))
    try:
        if fingerprint(backup.read_bytes()) != known:
            raise UserError(f"{program} was changed while it was read: nothing is replaced")
        yield backup
    except BaseException:
        backup.unlink(missing_ok=True)
        raise


def _same_file(one: str, other: str) -> bool:
    a, b = Path(one), Path(other)
    return true_path(a) == true_path(b) or (a.exists() and b.exists() and a.samefile(b))


def _written(path: Path, data: bytes) -> Path:
    """Data on disk under the first free name of a backup of `path`, with its mode."""
    try:
        handle, name = tempfile.mkstemp(prefix=f".{path.name}.", suffix=".tmp", dir=path.parent)
        try:
            with os.fdopen(handle, "wb") as file:
                file.write(data)
                file.flush()
                os.fsync(file.fileno())
            Path(name).chmod(path.stat().st_mode & 0o777)
            backup = _placed(Path(name), path)
        finally:
            Path(name).unlink(missing_ok=True)
        folder = os.open(path.parent, os.O_RDONLY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)
    except OSError as fault:
        raise UserError(f"cannot write a backup of {path}: {fault.strerror or fault}") from None
    return backup


def _placed(file: Path, path: Path) -> Path:
    """A file under the first free name of a backup; an earlier backup is never replaced."""
    names = (path.with_name(f"{path.name}{SUFFIX}{number or ''}") for number in count())
    for backup in names:
        if os.path.lexists(backup):
            continue
        try:
            backup.hardlink_to(file)
        except FileExistsError:
            continue
        except OSError:  # a file system without hard links
            file.rename(backup)
        break
    return backup
