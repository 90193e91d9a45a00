"""The input files of a run, which none of its outputs replaces.

A command line is one run. Every reader of a user's file notes it (`kinematics.files.read_input`, `open_source` of
`postproc/text/source.py`), and every writer asks before it replaces a file (`kinematics.files.Draft`). A program that
calls ncomp from Python decides itself which files it replaces: without a run nothing is noted.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from kinematics.user_error import UserError


def true_path(path: str | Path) -> Path:
    """The absolute path without links; a link that points to itself stays, and its reading names the fault."""
    return Path(os.path.realpath(path))


class FileSet:
    """Files with a label each. All names of one file are equal: other spellings, symbolic links and hard links."""

    def __init__(self) -> None:
        self._labels: dict[Path, str] = {}

    def add(self, path: str | Path, label: str = "") -> None:
        """Add a file."""
        self._labels[true_path(path)] = label

    def find(self, path: str | Path) -> str | None:
        """The label of a file, None for one that is not in the set."""
        true = true_path(path)
        if true in self._labels or not _has_hard_links(true):
            return self._labels.get(true)
        return next((label for each, label in self._labels.items() if each.is_file() and each.samefile(true)), None)

    def __contains__(self, path: str | Path) -> bool:
        return self.find(path) is not None


def _has_hard_links(path: Path) -> bool:
    return path.is_file() and path.stat().st_nlink > 1


class _Run:
    """The files of the present run; None without one."""

    read: FileSet | None = None
    replaceable = FileSet()


_RUN = _Run()


@contextmanager
def run_with_inputs() -> Iterator[None]:
    """Note the inputs that are read in this block, and refuse to replace them."""
    before = _RUN.read, _RUN.replaceable
    _RUN.read, _RUN.replaceable = FileSet(), FileSet()
    try:
        yield
    finally:
        _RUN.read, _RUN.replaceable = before


def note_input(path: str | Path, fingerprint: str = "") -> None:
    """Note that this file is read, with the fingerprint of its content if that is known."""
    if _RUN.read is not None:
        _RUN.read.add(path, fingerprint)


def fingerprint_as_read(path: str | Path) -> str:
    """Fingerprint of the content that this run has read last; empty where it is not known."""
    return "" if _RUN.read is None else _RUN.read.find(path) or ""


def allow_to_replace(path: str | Path) -> None:
    """Let this run replace one of its inputs, because the user has asked for it."""
    _RUN.replaceable.add(path)


def refuse_input(output: str | Path) -> None:
    """UserError for an output that would replace an input of this run."""
    if _RUN.read is not None and output in _RUN.read and output not in _RUN.replaceable:
        raise overwritten(output)


def overwritten(output: str | Path, cure: str = "another file") -> UserError:
    """The refusal of an output that is an input."""
    return UserError(f"{output} is an input and would be overwritten; name {cure}")
