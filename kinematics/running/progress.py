"""Progress of long work: the step in work, and its share where the whole of the step is known."""

from __future__ import annotations

from collections.abc import Callable
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


class Unseen:
    """Passes numbers of bytes on, without those that were seen before."""

    def __init__(self, progress: Callable[[int], None], before: int = 0) -> None:
        self._progress, self._before, self._seen = progress, before, 0

    def __call__(self, size: int) -> None:
        """`size`: number of further bytes."""
        new = max(self._seen + size - max(self._seen, self._before), 0)
        self._seen += size
        self._progress(new)

    def again(self) -> Unseen:
        """The progress of a second pass over the same bytes."""
        return Unseen(self._progress, self._seen)
