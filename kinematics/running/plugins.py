"""Effects of a user's own: Python files and installed packages, named on request, run before the effects are listed.

A file is named by its path, NAME.py; an installed package by the name of its entry point in the group `ncomp.effects`.
Child processes run the same plug-ins: their names are in the environment. No data file names one.
"""

from __future__ import annotations

import importlib.util
import os
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from kinematics.files import fingerprint, read_input
from kinematics.files.mistaken import missing
from kinematics.user_error import UserError

if TYPE_CHECKING:
    from importlib.metadata import EntryPoints

VARIABLE = "NCOMP_PLUGINS"
"""Environment variable with the paths of the files and the names of the entry points."""
GROUP = "ncomp.effects"
"""Group of the entry points of packages that have effects."""
EFFECTS = f"{(__package__ or '').removesuffix('running')}effects"
"""The package of the effects, of which the files become modules."""


class Plugin(NamedTuple):
    """A plug-in that has run."""

    name: str
    """File name, or name of the entry point."""
    version: str
    """Fingerprint of the file, or name and version of the package."""


class OtherPlugin(UserWarning):
    """A calibration was made with another version of a plug-in that gives one of its effects."""


def request(names: Iterable[str | Path]) -> None:
    """Name plug-ins whose effects ncomp shall know; UserError for one that comes too late or does not exist."""
    named = requested()
    for given in names:
        found = _found(given)
        if found in named:
            continue
        if EFFECTS in sys.modules:
            raise UserError(f"--plugin {given}: the effects are loaded already: name it before anything else")
        named.append(found)
    if named:
        os.environ[VARIABLE] = os.pathsep.join(named)


def requested() -> list[str]:
    """Paths of the files and names of the entry points that were named."""
    return list(filter(None, os.environ.get(VARIABLE, "").split(os.pathsep)))


def run() -> Iterator[Plugin]:
    """Run the plug-ins one after the other; UserError for a fault in one, with its line."""
    for name in requested():
        yield _of_file(Path(name)) if name.endswith(".py") else _of_package(name)


def _found(given: str | Path) -> str:
    """The absolute path of a file, or the name of an entry point; UserError where there is neither."""
    path = Path(given)
    if path.suffix == ".py" and path.is_file():
        return str(path.resolve())
    if str(given) in (known := _installed().names):
        return str(given)
    where = missing(path) if path.suffix == ".py" and not path.exists() else ""
    packages = f"the name of an installed plug-in (installed: {', '.join(sorted(known)) or 'none'}){where}"
    raise UserError(f"--plugin {given}: expected a Python file with the class of an effect, NAME.py, or {packages}")


def _installed() -> EntryPoints:
    from importlib.metadata import entry_points

    return entry_points(group=GROUP)


def _of_file(path: Path) -> Plugin:
    """Run a file as a module of the package of the effects."""
    name = f"{EFFECTS}.{path.stem}"
    if not path.stem.isidentifier() or importlib.util.find_spec(name) is not None:
        raise UserError(f"--plugin {path}: its name is that of a module of ncomp, or no name in Python: rename it")
    text = read_input(path, "plugin")
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None
    module = sys.modules[name] = importlib.util.module_from_spec(spec)
    with _faults_of(path):
        exec(compile(text, str(path), "exec"), vars(module))
    return Plugin(path.name, fingerprint(text))


def _of_package(name: str) -> Plugin:
    """Import the module or the class of an entry point."""
    entry = next(iter(_installed().select(name=name)))
    with _faults_of(Path(name)):
        entry.load()
    assert entry.dist is not None
    return Plugin(name, f"{entry.dist.name} {entry.dist.version}")


@contextmanager
def _faults_of(plugin: Path) -> Iterator[None]:
    """UserError for a fault of a plug-in, with the line if the plug-in is one file."""
    try:
        yield
    except Exception as fault:
        import traceback

        own = [each.lineno for each in traceback.extract_tb(fault.__traceback__) if each.filename == str(plugin)]
        line, said = (fault.lineno, fault.msg) if isinstance(fault, SyntaxError) else (own[-1] if own else "", fault)
        where = f"{plugin}:{line}" if plugin.suffix == ".py" else plugin
        raise UserError(f"--plugin {where}: {type(fault).__name__}: {said}") from None
