"""A correction whose machine, calibration and set-up are read again when one of their files has changed."""

from __future__ import annotations

import time
from collections.abc import Mapping
from pathlib import Path

from kinematics.files import fingerprint, read_input
from postproc.control.setup import Setup
from postproc.correct.report import DEMONSTRATION
from postproc.folders.programs import Correction
from postproc.interface.request import Request


class Renewed:
    """The correction of a long run, by the present content of its files."""

    def __init__(self, request: Request, settle: float) -> None:
        self._settle = settle
        self._seen, self._since = dict[Path, str](), 0.0
        request.prepared(of_several=True)  # its refusal of a file says what is expected there
        self._take(request, _contents(request))

    def renew(self, request: Request) -> str | None:
        """Take the files as they are now; a line on those that have changed, empty for none.

        None where one has changed so recently that it may be incomplete; the log of temperatures is the exception: it
        grows all the time. UserError for a file that cannot be used.
        """
        contents = _contents(request)
        changed = [path for path in {**self._contents, **contents} if self._contents.get(path) != contents.get(path)]
        if not changed and request == self._request:
            return ""
        if contents != self._seen and set(changed) != {request.conditions.get("log")}:
            self._seen, self._since = contents, time.monotonic()
        if time.monotonic() - self._since < self._settle:
            return None
        self._take(request, contents)
        return f"{', '.join(map(str, changed))} changed: {self.title} from now on" if changed else ""

    def _take(self, request: Request, contents: Mapping[Path, str]) -> None:
        found, model, self.correction = request.prepared(of_several=True)
        self.setup = request.setup(found)
        self._request, self._contents = request, dict(contents)
        self.title = f"machine {found.name}, calibration {model.id}"
        self.warning = DEMONSTRATION if model.invented else ""

    correction: Correction
    """Corrects a program by the files as they were at the last renewal."""
    setup: Setup
    """The set-up of all programs, likewise."""
    title: str
    """Machine and calibration, in words."""
    warning: str
    """Empty for a calibration of a real machine."""


def _contents(request: Request) -> dict[Path, str]:
    """Fingerprints of all files that a correction reads, except the program."""
    return {path: fingerprint(read_input(path, "file")) for path in request.files}
