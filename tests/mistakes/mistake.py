"""A mistake that a user makes, and the folder in which it is made."""

from __future__ import annotations

import shlex
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

PROGRAM = """\
%
O0007 (POCKET)
N10 G21 G17 G90 G40 G80 G94
N20 T1 M6
N30 G54
N40 G0 X100. Y100.
N50 G43 H1 Z50. S8000 M3
N60 G1 Z10. F500
N70 X200. Y150.
N80 G2 X220. Y170. I20. J0.
N90 G0 Z100.
N100 M30
%
"""
"""A plain program of the gantry."""


@dataclass(frozen=True)
class Mistake:
    """A command with a mistake, the files that have it, and the parts of the message."""

    made: str
    """The mistake, as a user would describe it afterwards."""
    command: str
    place: str
    """File, line, column, option or entry, as the message names it."""
    cause: str
    cure: str
    files: tuple[tuple[str, str | bytes | Callable[[str], str | bytes]], ...] = ()
    """Files by name: their content, or a change of the file that is there."""
    links: tuple[tuple[str, str], ...] = ()
    """Links by name, each with its target."""

    @property
    def words(self) -> list[str]:
        """The arguments of `ncomp`."""
        return shlex.split(self.command)

    def write(self, folder: Path) -> None:
        """Make the mistake in the files of a folder."""
        for name, content in self.files:
            path = folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            new = content(path.read_text()) if callable(content) else content
            path.write_bytes(new.encode() if isinstance(new, str) else new)
        for name, target in self.links:
            (folder / name).symlink_to(target)


def change(name: str, old: str, new: str) -> tuple[str, Callable[[str], str]]:
    """A file in which one text is replaced."""

    def changed(text: str) -> str:
        assert old in text, (name, old)
        return text.replace(old, new, 1)

    return name, changed


def program(line: str, name: str = "in.nc") -> tuple[str, Callable[[str], str]]:
    """The program with another block in place of its ninth line, N70."""
    return name, lambda _: PROGRAM.replace("N70 X200. Y150.", line)
