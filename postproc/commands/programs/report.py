"""`ncomp report`: a page of ncomp printed to PDF."""

from __future__ import annotations

from pathlib import Path

import ncomp
from postproc.commands.options.declared import REQUIRED, argument, option
from postproc.commands.options.shared import result

EPILOG = (
    "Examples:\n\n"
    "`ncomp report diagnosis.html --pdf diagnosis.pdf`\n\n"
    "then file the PDF, or print it and write in the gaps of its head"
)


def report(
    *,
    page: Path = argument("A page written by --report.", "FILE.html", reads=True),
    pdf: str = option("File for the PDF; `-` is standard output.", "OUT.pdf", default=REQUIRED, writes="file"),
) -> None:
    """Print a page of --report to PDF: A4, page numbers, light colours, all lists open; needs Chromium or Chrome."""
    with result(pdf) as file:
        file.write(ncomp.report(page))
