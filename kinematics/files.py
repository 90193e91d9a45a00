"""Outputs are written whole or not at all; inputs are hashed for provenance."""

from __future__ import annotations

import hashlib
import os
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from kinematics.errors import UserError


@contextmanager
def whole_file(path: Path) -> Iterator[BinaryIO]:
    """A binary file that takes the place of `path` when the block ends well, and leaves no trace when it doesn't.

    Temporary file in the same folder, fsync, rename. UserError when the folder can't be written.
    """
    try:
        handle, name = tempfile.mkstemp(prefix=f".{path.name}.", suffix=".tmp", dir=path.parent)
    except OSError as fault:
        raise UserError(f"can't write {path}: {fault.strerror}") from None
    try:
        with os.fdopen(handle, "wb") as file:
            yield file
            file.flush()
            os.fsync(file.fileno())
        mode = path.stat().st_mode if path.exists() else 0o666 & ~_umask()
        Path(name).chmod(mode & 0o777)
        Path(name).replace(path)
    except BaseException as fault:
        Path(name).unlink(missing_ok=True)
        if isinstance(fault, OSError):
            raise UserError(f"can't write {path}: {fault.strerror or fault}") from None
        raise


def write_whole(path: Path, data: bytes) -> None:
    """Write all of `data` as `path`, whole or not at all."""
    with whole_file(path) as file:
        file.write(data)


def write_folder(path: Path, files: Mapping[str, bytes]) -> None:
    """Write files, by name, as a new folder, whole or not at all; UserError when one that is not empty stands there.

    What lies there already could be taken for a part of what is written now.
    """
    if path.exists() and not path.is_dir():
        raise UserError(f"can't write {path}: it is no folder")
    try:
        if path.is_dir() and any(path.iterdir()):
            raise UserError(f"can't write {path}: it is not empty; name a new folder")
        with tempfile.TemporaryDirectory(prefix=f".{path.name}.", dir=path.parent) as made:
            new = Path(made) / "whole"
            new.mkdir()
            for name, data in files.items():
                write_whole(new / name, data)
            new.replace(path)
    except OSError as fault:
        raise UserError(f"can't write {path}: {fault.strerror}") from None


def read_input(path: Path, what: str) -> bytes:
    """The bytes of a user's file; UserError, naming `what` it should have been, when it can't be read."""
    try:
        return path.read_bytes()
    except OSError as fault:
        raise UserError(f"{what} {path}: {fault.strerror or fault}") from None


def fingerprint(data: bytes) -> str:
    """Short SHA-256 that names inputs and calibrations in reports."""
    return hashlib.sha256(data).hexdigest()[:12]


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
