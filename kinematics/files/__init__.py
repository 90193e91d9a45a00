"""Outputs are written whole or not at all; inputs are hashed for provenance."""

from __future__ import annotations

import atexit
import errno
import hashlib
import io
import os
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack, closing, contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

from kinematics.files.inputs import fingerprint_as_read, note_input, refuse_input, true_path
from kinematics.files.mistaken import missing
from kinematics.user_error import UserError

CURES = {
    errno.EISDIR: "give the name of a file",
    errno.ENOSPC: "make room on the disk, or name a file on another one",
    errno.EACCES: "change its permissions, or name another file",
    errno.EROFS: "name a file on a disk that can be written",
    errno.ENOTDIR: "a part of the path is a file; name a folder",
    errno.ENAMETOOLONG: "choose a shorter name",
    errno.ELOOP: "the link points to itself; name the file",
    errno.EEXIST: "name another one",
}
"""Cures of system errors."""

if TYPE_CHECKING:
    from typing_extensions import Buffer


def reason_of(fault: OSError) -> str:
    """The reason of a system error, with its cure where there is one."""
    reason = fault.strerror or str(fault)
    cure = CURES.get(fault.errno or 0)
    return f"{reason}: {cure}" if cure else reason


@contextmanager
def writing(output: str | Path) -> Iterator[None]:
    """UserError that names the file, for a system error during writing; a closed pipe is no such error."""
    try:
        yield
    except BrokenPipeError:
        raise
    except OSError as fault:
        link = missing(output) if os.path.islink(output) else ""  # noqa: PTH114 - is_symlink raises in a closed folder
        raise UserError(f"cannot write {output}: {reason_of(fault)}{link}") from None


class _NamedFile(io.FileIO):
    """A file whose faults name the result that it is to become."""

    def __init__(self, handle: int, becomes: str | Path) -> None:
        super().__init__(handle, "w+b")
        self.becomes = becomes

    def write(self, data: Buffer, /) -> int:
        """Number of bytes written; UserError where the disk is full."""
        with writing(self.becomes):
            return super().write(data)


def named_file(handle: int, becomes: str | Path) -> io.BufferedRandom:
    """A buffered file whose faults in writing name the result that it is to become."""
    return io.BufferedRandom(_NamedFile(handle, becomes))


class Draft:
    """A result in a temporary file of the same folder, before it replaces an existing file.

    UserError for a file that this run has read, when the folder cannot be written, or the disk is full. A link stays,
    and its target is replaced.
    """

    def __init__(self, path: Path) -> None:
        refuse_input(path)
        self.path, self._target = path, true_path(path)
        with writing(path):
            if self._target.is_symlink():
                raise OSError(errno.ELOOP, os.strerror(errno.ELOOP))
        self._temporary = self._target.with_name(f".{path.name}.{os.urandom(4).hex()}.tmp")
        _unpublished.add(self._temporary)
        with writing(path):
            handle = os.open(self._temporary, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o600)
        self.file = named_file(handle, path)

    def complete(self) -> None:
        """Bring all of it to the disk, with the permissions of the file that it replaces; UserError for an input."""
        refuse_input(self.path)  # a program may name further inputs while it is read
        with writing(self.path):
            self.file.flush()
            os.fsync(self.file.fileno())
            mode = self._target.stat().st_mode if self._target.exists() else 0o666 & ~_umask()
            self._temporary.chmod(mode & 0o777)

    def publish(self) -> None:
        """Replace the existing file in one step."""
        with writing(self.path):
            self._temporary.replace(self._target)

    def close(self) -> None:
        """Leave no trace, unless it is published."""
        with suppress(OSError, UserError):
            self.file.close()
        self._temporary.unlink(missing_ok=True)
        _unpublished.discard(self._temporary)


_unpublished: set[Path] = set()
"""Temporary files of this process, each from before it exists."""


@atexit.register
def remove_unpublished() -> None:
    """Remove the temporary files of this process: for one that ends in the midst of its work."""
    for temporary in tuple(_unpublished):
        with suppress(OSError):
            temporary.unlink()


def forget_unpublished() -> None:
    """In a fork: the temporary files are those of the first process."""
    _unpublished.clear()


@contextmanager
def whole_file(path: Path, beside: Mapping[Path, bytes] | None = None) -> Iterator[BinaryIO]:
    """A binary file that replaces `path` if the block ends without an error, and leaves no trace otherwise.

    beside: further files, which the block may name, and which are written with this one or not at all.
    """
    with closing(Draft(path)) as draft:
        yield draft.file
        draft.complete()
        with completed(beside or {}) as others:
            for each in (*others, draft):
                each.publish()


@contextmanager
def completed(files: Mapping[Path, bytes]) -> Iterator[list[Draft]]:
    """Files that are complete on the disk and wait for their publication; new folders that remain empty are removed."""
    with ExitStack() as stack:
        for folder in sorted({each for path in files for each in path.parents if not each.exists()}):
            with writing(folder):
                folder.mkdir(exist_ok=True)
            stack.callback(_remove_empty, folder)
        drafts = [stack.enter_context(closing(Draft(path))) for path in files]
        for draft, data in zip(drafts, files.values(), strict=True):
            draft.file.write(data)
            draft.complete()
        yield drafts


def _remove_empty(folder: Path) -> None:
    with suppress(OSError):
        folder.rmdir()


def write_whole(path: Path, data: bytes) -> None:
    """Write all of `data` as `path`, whole or not at all."""
    with whole_file(path) as file:
        file.write(data)


@contextmanager
def whole_folder(path: Path, files: Mapping[str, bytes]) -> Iterator[None]:
    """Files, by name, that become a new folder when the block ends well; UserError when one that is not empty is there.

    Files that exist already could be mistaken for a part of the new ones. If the block or the writing fails, the folder
    is removed.
    """
    if path.exists() and not path.is_dir():
        raise UserError(f"cannot write {path}: it is no folder; name a new folder")
    if not path.parent.exists():
        raise UserError(f"cannot write {path}: No such file or directory{missing(path)}: make the folder")
    with writing(path):
        if path.is_dir() and any(path.iterdir()):
            raise UserError(f"cannot write {path}: it is not empty; name a new folder")
        with tempfile.TemporaryDirectory(prefix=f".{path.name}.", dir=path.parent) as made:
            new = Path(made) / "whole"
            new.mkdir()
            for name, data in files.items():
                write_whole(new / name, data)
            yield
            new.replace(path)


def write_folder(path: Path, files: Mapping[str, bytes]) -> None:
    """Write files, by name, as a new folder, whole or not at all; UserError as for `whole_folder`."""
    with whole_folder(path, files):
        pass


def read_input(path: Path, contents: str) -> bytes:
    """The bytes of a user's file; UserError, with the expected `contents`, if it cannot be read."""
    if str(path) == "-" and not path.exists():
        raise UserError(f"{contents} -: it is not read from standard input; write it into a file and name the file")
    try:
        data = path.read_bytes()
        note_input(path, fingerprint(data))
        return data
    except OSError as fault:
        raise UserError(f"{contents} {path}: {reason_of(fault)}{missing(path)}") from None


def changed_since_read(paths: Iterable[Path]) -> list[Path]:
    """The inputs of this run whose content has changed since they were read."""
    return [
        path
        for path in paths
        if (known := fingerprint_as_read(path)) and not (path.is_file() and fingerprint(path.read_bytes()) == known)
    ]


def fingerprint(data: bytes) -> str:
    """Short SHA-256 that names inputs and calibrations in reports."""
    return hashlib.sha256(data).hexdigest()[:12]


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
