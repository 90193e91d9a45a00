"""Evidence of a program's dialect outside of comments, parentheses and texts, with its line."""

from __future__ import annotations

import re
from typing import NamedTuple

TITLES = {"iso": "ISO", "siemens": "Siemens", "heidenhain": "Klartext"}
OVERRIDE = "--dialect overrides this"
_LONGEST = 60
"""Characters of a line that a message shows."""

_HEIDENHAIN = re.compile(r"^\s*\d*\s*(BEGIN PGM|BLK FORM|TOOL CALL|CYCL DEF|L\s+[XYZABCM]|LN\s)", re.IGNORECASE)
_SIEMENS = re.compile(
    r"%_N_|;\$PATH|^\s*(N\d+\s*)?(R\d+\s*=|DEF\s|PROC\s|EXTERN\s|TRAORI|[A]?TRANS\b|[A]?ROT\b|MCALL|CYCLE\d+|MSG\s*\()"
    r"|[XYZIJKABC]\w*\s*=\s*\S|\b(CR|AR|SPOS)\s*=|\b[A-Z_]\w+\s*=\s*\S|\b(SUPA|TRAFOOF|TRAORI)\b"
    r"|^\s*(N\d+\s*)?(\$[A-Z]{1,2}_[A-Z]|(IF|WHILE|FOR|GOTO[FB]|GOTO(?!\s*\d)|LOOP|REPEAT|CASE)\b[^\[]*$)",
    re.IGNORECASE,
)
_COMMAND = re.compile(r"\s*\$[^\W_]*(?:\W|$)")
"""A system command of grbl; the variables of Siemens controls have `_` in their names."""
_VARIABLE = re.compile(r"#\s*[\d<\[#]")
"""Beginning of a variable of FANUC and LinuxCNC."""
_SUFFIXES = {".h": "heidenhain", ".hnc": "heidenhain", ".klartext": "heidenhain", ".mpf": "siemens", ".spf": "siemens"}
_COMMENTS = re.compile(r'\((?:[^()]|\([^()]*\))*(?:\)|$)|"[^"]*(?:"|$)|;.*')
_NAME = re.compile(r"\s*(?:(?:O|:)?\s*\d*\s*<[^<>]*>|%(?!_N_).*)", re.IGNORECASE)
"""The name of a program, at the start of a line: any text."""


class Evidence(NamedTuple):
    """A dialect, and the line or name that shows it."""

    dialect: str
    reason: str

    @property
    def text(self) -> str:
        """For a message."""
        return f"read as {TITLES[self.dialect]} because {self.reason}; {OVERRIDE}"


def definite(found: Evidence) -> bool:
    """True if a line or the name of the file shows the dialect."""
    return not found.reason.startswith("no line")


def without_comments(line: str) -> str:
    """A line without the name of a program, comments, and contents of parentheses and strings; a Siemens path stays."""
    if ";$PATH" in line:
        return line
    rest = _NAME.sub("", line, count=1) if _NAME.match(line) else line
    return _COMMENTS.sub(lambda match: match[0][0] if match[0][0] != ";" else "", rest)


def evidence(suffix: str, head: str) -> Evidence:
    """The dialect of a program by the suffix of its file, in lower case with its point, and by its beginning."""
    if _SUFFIXES.get(suffix) == "siemens":
        return Evidence("siemens", f"its name ends in {suffix}")
    lines = re.split(r"\r\n|\r|\n", head)
    texts = [without_comments(line) for line in lines]
    signs = {"heidenhain": _HEIDENHAIN, "iso": _VARIABLE, "siemens": _SIEMENS}
    for dialect, sign in signs.items():
        for number, text in enumerate(texts, start=1):
            if sign.search(text) and not _COMMAND.match(text):
                return Evidence(dialect, f"of line {number}: {lines[number - 1].strip()[:_LONGEST]!r}")
    if suffix in _SUFFIXES:
        return Evidence(_SUFFIXES[suffix], f"its name ends in {suffix}")
    return Evidence("iso", "no line at its beginning is Siemens or Klartext")
