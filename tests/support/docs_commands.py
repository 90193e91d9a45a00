"""The commands in the pages of the documentation, in the order of each page."""

from __future__ import annotations

import re
import shlex
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
PAGES = (ROOT / "README.md", *sorted(DOCS.rglob("*.md")))
FENCE = re.compile(r"^\s*```(\w*)")
SHELL = {"", "sh", "text"}


@dataclass(frozen=True)
class Command:
    """A command of a page, and the line where it begins."""

    page: Path
    line: int
    text: str

    @property
    def words(self) -> list[str]:
        """The arguments, without the name of the program."""
        return shlex.split(self.text)[1:]

    @property
    def where(self) -> str:
        """Page and line."""
        return f"{self.page.relative_to(ROOT).as_posix()}:{self.line}"


def commands(page: Path, program: str = "ncomp") -> list[Command]:
    """The commands of a program in the blocks of code of a page; a backslash continues a line."""
    found, fence, begun = [], None, None
    for number, line in enumerate(page.read_text().splitlines(), 1):
        if mark := FENCE.match(line):
            fence = mark[1] if fence is None else None
            continue
        if begun is not None:
            first, text = begun
        elif _is_code(line, fence) and re.match(rf"\s*(\$ )?{program} ", line):
            first, text = number, ""
        else:
            continue
        text += " " + line.strip().removeprefix("$ ")
        begun = (first, text[:-1]) if text.endswith("\\") else None
        if begun is None:
            found.append(Command(page, first, _without_remark(text.strip())))
    return found


def _is_code(line: str, fence: str | None) -> bool:
    return fence in SHELL if fence is not None else line.startswith("    ")


def _without_remark(text: str) -> str:
    """A command without the remark that follows it: behind `#`, or behind three blanks."""
    return re.split(r"\s{3,}|\s+#\s", text)[0]


def all_commands() -> list[Command]:
    """The commands `ncomp ...` of all pages."""
    return [each for page in PAGES for each in commands(page)]
