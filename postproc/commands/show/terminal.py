"""Output on the terminal: tables, notes and progress."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from functools import cached_property
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Literal, Protocol

import msgspec
from msgspec.structs import replace

import rendering.terminal
from kinematics.running.progress import Progress
from rendering.plain import PlainText, is_plain
from rendering.report import Report

if TYPE_CHECKING:
    from rich.console import Console


class Level(msgspec.Struct):
    """How much a command shows; one for the whole process, because the command line sets it."""

    quiet: bool = False
    verbose: bool = False


LEVEL = Level()
NOTES: list[str] = []
"""Notes of the present command, which its page shows as well."""
PROGRESS = "NCOMP_PROGRESS"
"""Environment variable with a file, into which the present step is written for another program: its share, 0 to 1, or
nothing where it is not known, a tabulator, and its name."""
EVERY_S = 0.2
"""Time, s, between two shares of a step in this file."""
BAR = 20
"""Length of the bar of a share, characters."""


class Status(Protocol):
    """The present step of a command."""

    @property
    def update(self) -> Progress:
        """Change the step and its share."""


class Screen:
    """Standard output or standard error: with Rich on a terminal, and as plain text in a pipe or a file."""

    def __init__(self, name: Literal["stdout", "stderr"]) -> None:
        self._name: Literal["stdout", "stderr"] = name
        self._status: Status | None = None

    @property
    def to(self) -> Console | PlainText:
        """The present stream."""
        stream = getattr(sys, self._name)
        return PlainText(stream) if is_plain(stream) else self.rich

    @cached_property
    def rich(self) -> Console:
        """The console of Rich."""
        from rich.console import Console

        return Console(stderr=self._name == "stderr", highlight=False, markup=False, soft_wrap=True)

    @property
    def is_terminal(self) -> bool:
        """True on a terminal."""
        return self.to.is_terminal

    def print(self, text: str, style: str = "") -> None:
        """Show lines of text."""
        self.to.print(text, style=style)

    @contextmanager
    def status(self, text: str) -> Iterator[Status]:
        """Show on a terminal the step of the command, its share and its time; `update` of the result changes them.

        --verbose shows the steps as lines, also in a pipe. A status within another one continues it.
        """
        if self._status is not None:
            self._status.update(text)
            yield self._status
            return
        if PROGRESS in os.environ:
            running: AbstractContextManager[Status] = nullcontext(Noted(Path(os.environ[PROGRESS]), text))
        elif LEVEL.verbose or LEVEL.quiet or not self.is_terminal:
            running = nullcontext(Steps(self, text, shown=LEVEL.verbose))
        else:
            running = _running(self.rich, text)
        with running as shown:
            self._status = shown
            try:
                yield shown
            finally:
                self._status = None


class Steps:
    """The steps of a command as lines with the time, s, since its begin."""

    def __init__(self, screen: Screen, text: str, *, shown: bool) -> None:
        self._screen, self._shown, self._last, self._start = screen, shown, "", time.perf_counter()
        self.update(text)

    def update(self, text: str, _share: float | None = None, /) -> None:
        """The next step."""
        if self._shown and text != self._last:
            self._screen.print(f"{time.perf_counter() - self._start:7.1f} s  {text}")
        self._last = text


class Noted:
    """The present step in a file."""

    def __init__(self, file: Path, text: str) -> None:
        self._file, self._last, self._written = file, "", 0.0
        self.update(text)

    def update(self, text: str, share: float | None = None, /) -> None:
        """The next step, or its share."""
        now = time.monotonic()
        if text != self._last or now - self._written >= EVERY_S:
            self._last, self._written = text, now
            with suppress(OSError):
                self._file.write_text(f"{'' if share is None else f'{share:.3f}'}\t{text}", encoding="utf-8")


@contextmanager
def _running(console: Console, text: str) -> Iterator[Status]:
    """A line of a terminal with the present step, its share where it is known, and the time since the begin."""
    from rich.progress import Progress, ProgressColumn, SpinnerColumn, Task, TextColumn, TimeElapsedColumn
    from rich.progress_bar import ProgressBar
    from rich.table import Table
    from rich.text import Text

    class Share(ProgressColumn):
        """A bar and a percentage; nothing for a step whose rest is not known."""

        def render(self, task: Task) -> Table | Text:
            share = task.fields["share"]
            if share is None:
                return Text()
            found = Table.grid(padding=(0, 1))
            found.add_row(ProgressBar(total=1.0, completed=share, width=BAR), f"{100.0 * share:3.0f} %")
            return found

    columns = SpinnerColumn(), TextColumn("{task.description}", markup=False), Share(), TimeElapsedColumn()
    with Progress(*columns, console=console, transient=True) as shown:
        task = shown.add_task(text, total=None, share=None)

        def update(step: str, share: float | None = None, /) -> None:
            shown.update(task, description=step, share=share)

        yield SimpleNamespace(update=update)


console = Screen("stderr")
"""Standard error, for text beside a program or JSON on the standard output."""
output = Screen("stdout")
"""Standard output, for results of commands."""

PROGRESS_BYTES = 1_000_000
"""Smallest size of a program, bytes, for which progress is shown."""


@contextmanager
def progress_of(total: int, label: str, long: int = PROGRESS_BYTES) -> Iterator[Callable[[int], None]]:
    """A function to call with each amount done of a total; a bar on a terminal from `long` on.

    Nothing in a pipe, unless another program asks for the progress.
    """
    if total < long or not (console.is_terminal or PROGRESS in os.environ):
        yield lambda _: None
        return
    with console.status(label) as status:
        done = 0

        def add(amount: int) -> None:
            nonlocal done
            done += amount
            status.update(label, min(done / total, 1.0))

        yield add


def show(report: Report, *targets: str | Path | None) -> None:
    """Show a report: on standard output, or on standard error where one of these targets is standard output (`-`)."""
    if LEVEL.quiet:
        report = replace(report, sections=())
    elif LEVEL.verbose:
        report = replace(report, sections=[replace(each, detail=False) for each in report.sections])
    rendering.terminal.show(report, (console if "-" in targets else output).to)


def say_assumed(sentence: str) -> None:
    """Show the part of the set-up that is assumed, as the first line of a run; nothing for an empty sentence."""
    if sentence:
        NOTES.append(sentence)
        console.print(sentence, "yellow")


def say(label: str, text: str) -> None:
    """Show one line that a person should notice; not with --quiet."""
    if label == "note":
        NOTES.append(text)
    if LEVEL.quiet:
        return
    if not console.is_terminal:
        console.print(f"{label}: {text}")
        return
    from rich.text import Text

    console.rich.print(Text.assemble((f"{label}: ", "yellow"), text))
