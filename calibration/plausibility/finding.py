"""A finding: one result of the checks of a measurement."""

from __future__ import annotations

from typing import NamedTuple


class Finding(NamedTuple):
    """One result of the checks."""

    check: str
    message: str
    """Message: one sentence, with numbers."""
    fatal: bool
    """True if the data cannot be used without a correction."""
