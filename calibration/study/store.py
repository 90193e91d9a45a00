"""Finished chunks, kept beside the results until these are written: an interrupted study continues from them."""

from __future__ import annotations

import io
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calibration.study.chunks import Chunk, Outcome
from kinematics.files import write_whole
from kinematics.user_error import UserError


@dataclass(frozen=True)
class Store:
    """A folder of chunks, each in a file named by the key of its case; without a folder, nothing is kept."""

    folder: Path | None

    @classmethod
    def beside(cls, output: str) -> Store:
        """The store of results that are written to `output`; standard output has none."""
        return cls(None if output == "-" else Path(f"{output}.chunks"))

    def get(self, key: str, chunk: Chunk) -> Outcome | None:
        """The outcome of a finished chunk; None where it is missing or damaged."""
        if self.folder is None:
            return None
        with suppress(OSError, ValueError, KeyError, EOFError), np.load(self._path(key, chunk)) as found:
            outcome = Outcome(found["before"], found["after"])
            if outcome.before.shape == outcome.after.shape and outcome.after.shape[-1] == chunk.draws:
                return outcome
        return None

    def put(self, key: str, chunk: Chunk, outcome: Outcome) -> None:
        """Keep a finished chunk."""
        if self.folder is None:
            return
        try:
            self.folder.mkdir(exist_ok=True)
        except OSError as fault:
            raise UserError(f"cannot keep finished draws in {self.folder}: {fault.strerror}") from None
        content = io.BytesIO()
        np.savez(content, before=outcome.before, after=outcome.after)
        write_whole(self._path(key, chunk), content.getvalue())

    def clear(self, keys: Iterable[str]) -> None:
        """Remove the chunks of these cases, and the folder if it is empty then."""
        if self.folder is None or not self.folder.is_dir():
            return
        for key in keys:
            for path in self.folder.glob(f"{key}-*.npz"):
                path.unlink(missing_ok=True)
        with suppress(OSError):
            self.folder.rmdir()

    def _path(self, key: str, chunk: Chunk) -> Path:
        assert self.folder is not None
        return self.folder / f"{key}-{chunk.number}-{chunk.draws}.npz"
