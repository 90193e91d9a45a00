"""Finds the tests that call functions of the diagnosis by which it works, and not only those that users call."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

INSIDE = ("calibration.diagnosis", "calibration.fit.curves", "calibration.fit.bases")
"""Rooms whose modules are private, and so are the names with _ of all of calibration."""
ENTRANCES = {("calibration.diagnosis.diagnose", "diagnose"), ("calibration.diagnosis.diagnose", "Diagnosis")}
"""Names in them by which others enter."""
SUPPORT = Path(__file__).parent
IMPORT = re.compile(r"^\s*from ([\w.]+) import (\([^)]*\)|.*)", re.M)


def calls_inside(path: Path, test: str) -> bool:
    """Whether a test function of a file uses a private name, also by functions and tables of its file or of support."""
    return test in _private_names(path)


@cache
def _private_names(path: Path) -> frozenset[str]:
    """The names at the top of a file that are private ones of the diagnosis, or use them."""
    text = path.read_text(encoding="utf-8")
    private = {alias for alias, module, name in _imported(text) if _is_inside(module, name)}
    if not private:
        return frozenset()
    tree = ast.parse(text)
    uses = {name: used for node in tree.body for name, used in _defined(node)}
    while more := {name for name, used in uses.items() if used & private} - private:
        private |= more
    return frozenset(private)


def _imported(text: str) -> Iterator[tuple[str, str, str]]:
    """Each import from a module, also inside functions: the name in the file, the module, and the name there."""
    for module, names in IMPORT.findall(text):
        for name, alias in re.findall(r"(\w+)(?: as (\w+))?", re.sub(r"#.*", "", names)):
            yield alias or name, module, name


def _is_inside(module: str, name: str) -> bool:
    if module.startswith(("support.", "tests.support.")):
        file = SUPPORT / f"{module.rpartition('.')[2]}.py"
        return file.is_file() and name in _private_names(file)
    of_room = f"{module}.{name}".startswith(INSIDE) and (module, name) not in ENTRANCES
    return of_room or (module.startswith("calibration.") and name.startswith("_"))


def _defined(node: ast.stmt) -> Iterator[tuple[str, set[str]]]:
    """What a statement defines, and the names that it uses."""
    used = {inner.id for inner in ast.walk(node) if isinstance(inner, ast.Name)}
    if isinstance(node, (ast.FunctionDef, ast.ClassDef)):
        fixtures = {argument.arg for argument in node.args.args} if isinstance(node, ast.FunctionDef) else set()
        yield node.name, used | fixtures
    elif isinstance(node, (ast.Assign, ast.AnnAssign)):
        targets = node.targets if isinstance(node, ast.Assign) else [node.target]
        for target in targets:
            for inner in ast.walk(target):
                if isinstance(inner, ast.Name):
                    yield inner.id, used - {inner.id}
