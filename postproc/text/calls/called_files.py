"""The files of programs that a program calls: in its own folder, and in the folders that the user names."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from postproc.text.expressions import NotKnown

SUFFIXES = (
    *(".nc", ".ngc", ".cnc", ".tap", ".gcode", ".gc", ".g", ".eia", ".iso", ".min", ".din", ".ptp"),
    *(".mpf", ".spf", ".h", ".hnc", ".klartext"),
)
"""Suffixes of NC programs, in lower case."""
OPTION = "give its folder by --subprograms"


class Found(NamedTuple):
    """The file of a called program."""

    path: Path
    name: str
    """Path from the folder that was searched, with slashes: that of its correction, from the folder of the output."""


class CalledFiles:
    """Finds the files of called programs, without regard to upper and lower case."""

    def __init__(self, folders: Sequence[Path], names: Callable[[str], Iterable[str]], posted: str) -> None:
        """folders: in the order of the search; names: those by which the program in a file of some name is called.

        posted: suffix of the programs of a set as the CAM has posted them, for example `.posted`; such a file comes
        before others of its name, which may be earlier corrections. Empty for none.
        """
        self.folders, self._names, self._posted = folders, names, posted
        self._listed: dict[Path, dict[str, list[Path]]] = {}

    def names(self, caller: Path | None = None) -> set[str]:
        """All names by which programs of these folders, and of the one of a calling program, are called."""
        return {name for folder in self._searched(caller) for name in self._called(folder)}

    def find(self, name: str, caller: Path | None = None) -> Found | None:
        """The file of a called program, None if there is none; caller: folder of the calling program.

        `A/B` is the program B in the folder A. NotKnown for two files, and for one outside of the folder.
        """
        *inner, last = name.split("/")
        for folder in self._searched(caller):
            here: Path | None = folder
            for part in inner:
                here = None if here is None else _only(_entries(here, part, folders=True), name)
            path = None if here is None else _only(self._called(here).get(last, []), name)
            if path is not None:
                return self._inside(path, folder, name)
        return None

    def namesakes(self, name: str) -> list[Path]:
        """The files of one name, none of which a call reads."""
        return [path for folder in self._searched(None) for path in self._called(folder).get(name, [])]

    def missing(self, caller: Path | None = None) -> str:
        """Where a program was looked for in vain."""
        searched = self._searched(caller)
        if not searched:
            return f", and its folder is not known: {OPTION}"
        folders = ", ".join("the present folder" if str(folder) == "." else str(folder) for folder in searched)
        return f", and no file of it is in {folders}: write it there, or {OPTION}"

    def _searched(self, caller: Path | None) -> list[Path]:
        return list(dict.fromkeys((*(() if caller is None else (caller,)), *self.folders)))

    def _inside(self, path: Path, folder: Path, name: str) -> Found:
        """A file that was found in a folder; NotKnown if a link leads out of the folders."""
        searched = [each.resolve() for each in self.folders]
        base = next(each for each in searched if folder.resolve().is_relative_to(each))
        if not path.resolve().is_relative_to(base):
            raise NotKnown(
                f"{shown_name(name)} is not read, because {path} is a link to {path.resolve()}, outside of its folder: "
                "copy the file into the folder"
            )
        return Found(path, (folder.resolve() / path.relative_to(folder)).relative_to(base).as_posix())

    def _called(self, folder: Path) -> dict[str, list[Path]]:
        """The files of a folder by the names by which they are called."""
        if folder not in self._listed:
            found: dict[str, list[Path]] = {}
            for path in _entries(folder, None, folders=False):
                if path.suffix.lower() in (*SUFFIXES, "", self._posted):
                    for name in self._names(path.name):
                        found.setdefault(name, []).append(path)
            for paths in found.values() if self._posted else ():
                paths[:] = [path for path in paths if path.suffix.lower() == self._posted] or paths
            self._listed[folder] = found
        return self._listed[folder]


def posted_suffix(name: str) -> str:
    """The suffix of a file, in lower case, if it is none of an NC program; otherwise empty."""
    suffix = Path(name).suffix.lower()
    return "" if suffix in SUFFIXES else suffix


def shown_name(name: str) -> str:
    """The name of a program as in a message: the label of a call without the marks that ncomp gives it."""
    return name.replace("%", "").replace("PGM ", "")


def _entries(folder: Path, name: str | None, *, folders: bool) -> list[Path]:
    """The files or folders of a folder, in the order of their names; `name`: those that have it."""
    found = []
    with suppress(OSError), os.scandir(folder) as entries:
        for entry in entries:
            wanted = entry.name[:1] != "." if name is None else entry.name.upper() == name
            with suppress(OSError):  # a link to itself
                if wanted and (entry.is_dir() if folders else entry.is_file()):
                    found.append(folder / entry.name)
    return sorted(found)


def _only(paths: list[Path], name: str) -> Path | None:
    """The one of several paths; NotKnown for more than one."""
    if len(paths) > 1:
        raise NotKnown(
            f"{' and '.join(path.name for path in paths)} in {paths[0].parent} are both named {shown_name(name)}: "
            "delete or rename one of them"
        )
    return paths[0] if paths else None
