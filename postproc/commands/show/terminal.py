"""Output on the terminal: tables, notes and progress."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from rich.console import Console
from rich.text import Text

import rendering.terminal
from rendering.report import Report

console = Console(stderr=True, highlight=False, markup=False, soft_wrap=True)
"""Standard error, for text beside a program or JSON on the standard output."""
output = Console(highlight=False, markup=False, soft_wrap=True)
"""Standard output, for results of commands."""

LONG = 1_000_000
"""Smallest size of a program, bytes, for which progress is shown."""


@contextmanager
def progress_of(total: int, label: str, long: int = LONG) -> Iterator[Callable[[int], None]]:
    """A function to call with each amount done of a total; a bar on a terminal from `long` on, nothing in a pipe."""
    if total < long or not console.is_terminal:
        yield lambda _: None
        return
    from rich.progress import Progress

    with Progress(console=console, transient=True) as bar:
        task = bar.add_task(label, total=total)
        yield lambda done: bar.advance(task, done)


def show(report: Report, *targets: str | Path | None) -> None:
    """Show a report: on standard output, or on standard error where one of these targets is standard output (`-`)."""
    rendering.terminal.show(report, console if "-" in targets else output)


def say_assumed(sentence: str) -> None:
    """Show the part of the set-up that is assumed, as the first line of a run; nothing for an empty sentence."""
    if sentence:
        console.print(Text(sentence, "yellow"))


def say(label: str, text: str) -> None:
    """Show one line that a person must notice."""
    console.print(Text.assemble((f"{label}: ", "yellow"), text))
