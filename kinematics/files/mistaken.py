"""Mistakes in names and files: the likeliest name that was meant, and the kind of a file that is another one."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

KIND_HEAD_BYTES = 4000
"""Bytes by which the kind of a file is known."""
KINDS = (
    (rb"PK\x03\x04", "a ZIP archive or a spreadsheet"),
    (rb"%PDF-", "a PDF document"),
    (rb"MZ[^\n]{0,80}\0|\x7fELF", "a program of a computer"),
    (rb"\x1f\x8b|BZh|7z\xbc\xaf|Rar!", "a packed archive"),
    (rb"ISO-10303-21", "a STEP model"),
    (rb"0\s*\n\s*SECTION", "a DXF drawing"),
    (rb"solid [^\n]*\n\s*facet", "an STL model"),
    (rb"\x89PNG|\xff\xd8\xff|GIF8", "a picture"),
    (rb"(?i)<(!doctype\s+)?html", "a web page"),
    (rb"<[^\0]*?digitalCalibrationCertificate", "a certificate (DCC)"),
    (rb"<\?xml", "an XML file"),
    (rb'\{[^\0]*?"ncomp_calibration"', "a calibration of ncomp (--calibration)"),
    (rb"\{\s*\"", "a JSON file"),
    (rb"(#[^\n]*\n)*#\s*instrument:", "a measurement file (ncomp fit and ncomp diagnose read it)"),
    (rb"(#[^\n]*\n)*#\s*strategy:", "a plan of a measurement (ncomp simulate and --plan read it)"),
    (rb"(#[^\n]*\n|\s)*(name|chain)\s*=\s*\"", "a machine file (--machine)"),
    (rb"(#[^\n]*\n|\s)*machine\s*=\s*\"[^\0]*\n\[+case\]", "a study (ncomp study reads it)"),
    (rb"(#[^\n]*\n|\s)*machine\s*=\s*\"", "a job file (ncomp JOB.toml)"),
    (rb"(%[^\n]*\n|\([^)\n]*\)|\s)*(O\d+|N?\d*\s*[GM]\d+|\d+\s+BEGIN PGM)", "an NC program"),
)  # fmt: skip
"""Beginnings of files, each with the kind of its file."""
PROGRAM = KINDS[-1][1]
CURES = {
    "a ZIP archive or a spreadsheet": "export the sheet as text (CSV, UTF-8)",
    "a packed archive": "unpack it, and give the file in it",
    "a program of a computer": "give a text file",
    "a PDF document": "give a text file",
    "a picture": "give a text file",
}
"""Cures for files that are no text, by their kind."""


def kind_of_file(data: bytes) -> str:
    """Kind of the file that begins with these bytes, with an article; empty for an unknown one."""
    head = data[:KIND_HEAD_BYTES].removeprefix(b"\xef\xbb\xbf").lstrip(b" \t\r\n")
    return next((kind for begins, kind in KINDS if re.match(begins, head)), "")


def kind_of_program(path: Path) -> str:
    """`an NC program` for a file that is one; empty for all others, and for one that cannot be read."""
    try:
        with path.open("rb") as file:
            kind = kind_of_file(file.read(KIND_HEAD_BYTES))
    except OSError:
        return ""
    return kind if kind == PROGRAM else ""


def not_utf8(data: bytes) -> str:
    """Reason for a file that should be UTF-8 text, with the cure: it is of another kind, or in another encoding."""
    kind = kind_of_file(data)
    if kind not in CURES:
        return "not UTF-8 text: save it as UTF-8"
    return f"this is {kind}: {CURES[kind]}"


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """Question for the likeliest of the known names, behind a blank; empty where none is near."""
    from difflib import get_close_matches

    by_small_letters = {each.lower(): each for each in known}
    near = get_close_matches(name.lower(), list(by_small_letters), 1)
    return f" (did you mean {by_small_letters[near[0]]!r}?)" if near else ""


def none_of(name: str, known: Iterable[str]) -> str:
    """Reason for a name that is none of the known ones, with the likeliest of them."""
    names = list(known)
    return f"{name!r} is none of {', '.join(names)}{did_you_mean(name, names)}"


def missing(path: str | Path) -> str:
    """Hint, behind a blank, for a file that does not exist: the missing folder, or a file of nearly this name there."""
    from pathlib import Path

    path = Path(path)
    try:
        if path.exists():
            return ""
        if path.is_symlink():
            return f" (it is a link to {path.readlink()})"
        if not path.parent.is_dir():
            return f" (the folder {path.parent} does not exist)"
        there = [each for each in path.parent.iterdir() if not each.name.startswith(".")]
        alike = (each.name for each in there if path.stem == each.stem or path.suffix.lower() == each.suffix.lower())
        return did_you_mean(path.name, alike)
    except OSError:
        return ""


def number_hint(text: str) -> str:
    """Hint, with its separator, for a text that should be a number."""
    text = text.strip()
    if re.match(r"\d{4}-\d\d?-\d\d?|\d\d?[.:]\d\d?[.:]\d\d", text):
        return "; write a time in s from the begin in place of a date or clock time, or name the column time"
    if re.fullmatch(r"[-+]?\d+,\d*", text):
        return "; write the decimal point as '.'"
    if inch := re.fullmatch(r"([-+]?\d*\.?\d+)\s*(in|inch|inches|\")", text):
        return f"; write mm, without the unit: {25.4 * float(inch[1]):g}"
    if re.fullmatch(r"[-+]?[\d.]+\s*[^\d\s.,;].{0,8}", text):
        return "; write the number without its unit"
    return "; separate numbers by ','" if ";" in text else ""


def document_of(data: bytes, source: str) -> bytes:
    """The document in a certificate, and the data of any other file; `source` names it in a UserError."""
    if re.match(rb"(\xef\xbb\xbf)?\s*<[^\0]*?digitalCalibrationCertificate", data[:4000]) is None:
        return data
    from kinematics.files.certificate import carried

    return carried(data, source).document
