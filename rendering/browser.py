"""A page printed to PDF by Chromium, over its DevTools protocol."""

from __future__ import annotations

import base64
import json
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, BinaryIO

from kinematics.user_error import UserError

NAMES = (
    *("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome"),
    *("microsoft-edge", "msedge", "brave-browser"),
)
"""Programs on the PATH that print pages."""
FLAGS = (
    *("--headless", "--disable-gpu", "--enable-unsafe-swiftshader", "--disable-quic", "--no-first-run"),
    *("--disable-background-networking", "--disable-component-update", "--disable-sync", "--remote-debugging-pipe"),
)
"""3-D figures are drawn without a graphics card; nothing is sent."""
CURE = (
    "install one (Debian: apt-get install chromium; Windows and macOS: Chrome or Edge) and put it on the PATH, or open "
    "the page in any browser and print it from there"
)
PATIENCE = 300.0
"""Time, s, in which all figures of a page are drawn."""
WAIT = """new Promise(resolve => {
  const root = document.documentElement;
  const look = () => ["printable", "failed"].includes(root.dataset.ready)
    ? resolve([root.dataset.ready, root.dataset.fault || ""]) : setTimeout(look, 50);
  look();
})"""


def chromium() -> str:
    """Path of the browser; UserError with the cure where there is none."""
    for name in NAMES:
        if path := shutil.which(name):
            return path
    raise UserError(f"printing needs Chromium, Chrome or Edge, and none is on the PATH: {CURE}")


def pdf_of(page: Path) -> bytes:
    """A page of ncomp as PDF, printed when all its figures are drawn."""
    with _started() as browser:
        target = browser.call("Target.createTarget", url="about:blank")["targetId"]
        session = browser.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        browser.call("Page.enable", session)
        browser.call("Page.navigate", session, url=page.resolve().as_uri())
        browser.event("Page.loadEventFired")
        found = browser.call("Runtime.evaluate", session, expression=WAIT, awaitPromise=True, returnByValue=True)
        ready, fault = found["result"]["value"]
        if ready != "printable":
            raise UserError(f"{page}: the figures cannot be drawn: {fault}")
        printed = browser.call("Page.printToPDF", session, preferCSSPageSize=True, printBackground=True)
        with suppress(UserError):
            browser.call("Browser.close")
        return base64.b64decode(printed["data"])


class _Browser:
    """Chromium at the ends of two pipes; a message is JSON that ends with a zero byte."""

    def __init__(self, path: str, to: BinaryIO, back: BinaryIO) -> None:
        self._path, self._to, self._back = path, to, back
        self._number, self._left = 0, b""
        self._events: list[str] = []

    def call(self, method: str, session: str | None = None, **parameters: Any) -> dict[str, Any]:
        """The result of a method."""
        self._number += 1
        message = {"id": self._number, "method": method, "params": parameters}
        if session is not None:
            message["sessionId"] = session
        try:
            self._to.write(json.dumps(message).encode() + b"\0")
        except BrokenPipeError:
            raise self._ended() from None
        while True:
            answer = self._read()
            if answer.get("id") == self._number:
                break
            self._events.append(answer.get("method", ""))
        if "error" in answer:
            raise UserError(f"the browser refused {method}: {answer['error'].get('message', '')}")
        return dict(answer["result"])

    def event(self, name: str) -> None:
        """Wait for an event."""
        while name not in self._events:
            self._events.append(self._read().get("method", ""))

    def _read(self) -> dict[str, Any]:
        while b"\0" not in self._left:
            part = self._back.read1(1 << 20)  # type: ignore[attr-defined]
            if not part:
                raise self._ended()
            self._left += part
        message, _, self._left = self._left.partition(b"\0")
        return dict(json.loads(message))

    def _ended(self) -> UserError:
        return UserError(f"the browser {self._path} has ended, or needed more than {PATIENCE:g} s: {CURE}")


@contextmanager
def _started() -> Iterator[_Browser]:
    """A browser with an empty profile of its own, which ends with the block; as root without its sandbox."""
    import threading

    path = chromium()
    if not hasattr(os, "posix_spawn"):
        raise UserError(
            f"printing from the command line needs Linux or macOS: open the page in {path} and print it there"
        )
    as_root = ("--no-sandbox",) if os.geteuid() == 0 else ()
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        process, to_end, back_end = _spawned([path, *FLAGS, *as_root, f"--user-data-dir={profile}", "about:blank"])
        watch = threading.Timer(PATIENCE, _end, (process,))
        watch.start()
        try:
            with os.fdopen(to_end, "wb", buffering=0) as to, os.fdopen(back_end, "rb") as back:
                yield _Browser(path, to, back)
        finally:
            watch.cancel()
            _end(process)
            os.waitpid(process, 0)


def _spawned(command: list[str]) -> tuple[int, int, int]:
    """A process that reads commands from its file 3 and answers in its file 4; with our ends of both."""
    import fcntl

    (in_end, to_end), (back_end, out_end) = os.pipe(), os.pipe()
    theirs = [fcntl.fcntl(end, fcntl.F_DUPFD_CLOEXEC, 10) for end in (in_end, out_end)]
    actions: list[Any] = [(os.POSIX_SPAWN_OPEN, i, os.devnull, os.O_RDWR, 0) for i in range(3)]
    actions += [(os.POSIX_SPAWN_DUP2, end, number) for end, number in zip(theirs, (3, 4), strict=True)]
    try:
        return os.posix_spawn(command[0], command, os.environ, file_actions=actions, setpgroup=0), to_end, back_end
    finally:
        for end in (in_end, out_end, *theirs):
            os.close(end)


def _end(process: int) -> None:
    """End the browser with the processes that it has started."""
    import signal

    with suppress(ProcessLookupError):
        os.killpg(process, signal.SIGKILL)
