"""Faults that no test can notice, each with its reason."""

from __future__ import annotations

ARGUED: dict[tuple[str, str, str, str], str] = {}
"""Reason by file, function, code before and code after."""
