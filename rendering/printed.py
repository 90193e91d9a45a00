"""A page of a report as PDF."""

from __future__ import annotations

from pathlib import Path

from kinematics.files import read_input
from kinematics.files.mistaken import kind_of_file
from kinematics.user_error import UserError
from rendering.browser import pdf_of

MARK = b'name="generator" content="ncomp"'
PAGE_HEAD_BYTES = 1 << 16
"""Bytes in which a page is recognised."""


def printed_page(page: Path) -> bytes:
    """The PDF of a page that a command has written; UserError for another file, and without a browser."""
    content = read_input(page, "report")
    if MARK not in content[:PAGE_HEAD_BYTES]:
        kind = kind_of_file(content) or "another kind of file"
        raise UserError(f"report {page}: expected a page written by --report, found {kind}")
    return pdf_of(page)
