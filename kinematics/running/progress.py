"""Progress of long work: the step in work, and its share where the whole of the step is known."""

from __future__ import annotations

from typing import Protocol


class Progress(Protocol):
    """Shows the step in work."""

    def __call__(self, step: str, share: float | None = None, /) -> None:
        """`share`: work done of the step, 0 to 1; None where its rest is not known."""


def silent(step: str, share: float | None = None, /) -> None:
    """Show nothing."""


def numbered(progress: Progress, number: int, of: int) -> Progress:
    """The progress of one of several steps: its texts begin with its number."""
    return lambda step, share=None, /: progress(f"{number} of {of}: {step}", share)
