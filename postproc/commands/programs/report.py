"""`ncomp report`: a page of ncomp printed to PDF."""

from __future__ import annotations

from pathlib import Path

from kinematics.user_error import UserError
from postproc.commands.options.declared import REQUIRED, argument, option
from postproc.commands.options.shared import check_files, result

EPILOG = (
    "Examples:\n\n"
    "`ncomp report diagnosis.html --pdf diagnosis.pdf`\n\n"
    "then file the PDF, or print it and write in the gaps of its head"
)
MARK = b'name="generator" content="ncomp"'
HEAD = 1 << 16
"""Bytes in which a page is recognised."""


def report(
    *,
    page: Path = argument("A page written by --report.", "FILE.html"),
    pdf: str = option("File for the PDF; `-` is standard output.", "OUT.pdf", default=REQUIRED),
) -> None:
    """Print a page of --report to PDF: A4, page numbers, light colours, all lists open; needs Chromium or Chrome."""
    from kinematics.files import read_input
    from kinematics.files.mistaken import kind_of_file
    from rendering.browser import pdf_of

    check_files((page,), {"--pdf": pdf})
    content = read_input(page, "report")
    if MARK not in content[:HEAD]:
        kind = kind_of_file(content) or "another kind of file"
        raise UserError(f"report {page}: expected a page written by --report, found {kind}")
    with result(pdf) as file:
        file.write(pdf_of(page))
