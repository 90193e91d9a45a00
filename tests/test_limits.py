"""The limits of the product's source: a module has 400 lines at most, a function 40, a folder 15 files.

What is larger is listed here with its present size. It may shrink, and leaves the list when it is within the limit.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest
from support.source import statements

ROOT = Path(__file__).parents[1]
PACKAGES = ("calibration", "grammars", "history", "kinematics", "machines", "postproc", "rendering")
DERIVED = "kinematics/derived/"
"""Written by sympy, not by hand."""
MODULE, FUNCTION, FOLDER = 400, 40, 15

EXCEPTIONS = {
    "calibration/reports/": 18,
    "kinematics/": 18,
    "postproc/correct/": 17,
    "postproc/motion/": 17,
    "postproc/text/": 18,
    "postproc/write/": 18,
    "calibration/continuous/fusion.py:fused": 49,
    "calibration/fit/calibrate.py:calibrate": 56,
    "calibration/fit/set_up/target_positions.py:target_positions": 43,
    "calibration/fit/together.py:calibrate_together": 48,
    "calibration/interface/calibrations.py:fit": 43,
    "calibration/interface/measurements.py:predict": 48,
    "calibration/interface/virtual_laser.py:simulate_continuous": 51,
    "kinematics/correction.py:_beside_jumps": 41,
    "kinematics/correction.py:correct_position": 55,
    "postproc/commands/calibrations/continuous.py:continuous": 52,
    "postproc/commands/controls/export.py:export": 41,
    "postproc/commands/measurements/simulate.py:simulate": 54,
    "postproc/commands/measurements/simulate_on_the_fly.py:simulate_on_path": 48,
    "postproc/commands/measurements/study.py:study": 42,
    "postproc/commands/programs/correct.py:correct": 43,
    "postproc/commands/programs/watch.py:watch": 50,
    "postproc/commands/workplace/init.py:init": 43,
    "postproc/interface/folders.py:batch": 45,
    "postproc/interface/programs.py:correct": 87,
    "postproc/interface/programs.py:verify": 49,
    "postproc/verification/verify_programs.py:verify_programs": 52,
    "postproc/write/arcs.py:CircleWriter.write": 51,
    "postproc/write/writer.py:Writer.write": 42,
}
"""Lines of a module (`fit.py`) and of a function (`fit.py:name`), and Python files in a folder (`fit/`)."""


def functions(node: ast.AST, outer: str = "") -> Iterator[tuple[str, int]]:
    """The functions and methods below a node: their names behind those of their classes, and their lines."""
    for inner in statements(node):
        if isinstance(inner, (ast.FunctionDef, ast.AsyncFunctionDef)):
            yield f"{outer}{inner.name}", (inner.end_lineno or inner.lineno) - inner.lineno + 1
        named = isinstance(inner, (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef))
        yield from functions(inner, f"{outer}{inner.name}." if named else outer)


def too_large(root: Path, packages: tuple[str, ...] = PACKAGES) -> dict[str, int]:
    """What is above its limit in the packages and modules of a folder, and its size."""
    files = [*root.glob("*.py"), *(path for name in packages for path in (root / name).rglob("*.py"))]
    sizes: dict[str, int] = {}
    folders: dict[str, int] = {}
    named = {path.relative_to(root).as_posix(): path for path in files}
    for name, path in ((name, path) for name, path in named.items() if not name.startswith(DERIVED)):
        text = path.read_text(encoding="utf-8")
        sizes[name] = len(text.splitlines()) - MODULE
        for function, lines in functions(ast.parse(text)):
            sizes[f"{name}:{function}"] = lines - FUNCTION
        folder = f"{path.parent.relative_to(root).as_posix()}/"
        folders[folder] = folders.get(folder, -FOLDER) + 1
    limit = {True: FOLDER, False: MODULE}
    above = {name: size for name, size in {**sizes, **folders}.items() if size > 0}
    return {name: size + (FUNCTION if ":" in name else limit[name.endswith("/")]) for name, size in above.items()}


def differences(found: dict[str, int], listed: dict[str, int]) -> list[str]:
    """What is new above its limit, what has grown, and what is within its limit and still listed."""
    grown = [
        f"{name} has grown from {listed.get(name, 'within the limit')} to {size}"
        for name, size in found.items()
        if size > listed.get(name, 0)
    ]
    return [*grown, *(f"{name} is within the limit: remove it from the list" for name in listed if name not in found)]


def test_nothing_grows_above_its_limit() -> None:
    found = differences(too_large(ROOT), EXCEPTIONS)
    assert not found, "\n".join(found)


@pytest.mark.parametrize(
    ("listed", "expected"),
    [
        ({"a/m.py": 401, "a/m.py:C.f": 41, "a/": 16}, []),
        ({"a/m.py": 500, "a/m.py:C.f": 41, "a/": 16}, []),
        ({"a/m.py": 401, "a/m.py:C.f": 41}, ["a/ has grown from within the limit to 16"]),
        ({"a/m.py": 401, "a/m.py:C.f": 41, "a/": 16, "a/m.py:g": 42}, ["a/m.py:g is within the limit: remove it from the list"]),
    ],
)  # fmt: skip
def test_what_is_too_large_is_found(tmp_path: Path, listed: dict[str, int], expected: list[str]) -> None:
    folder = tmp_path / "a"
    folder.mkdir()
    for number in range(15):
        (folder / f"n{number}.py").write_text("x = 1\n" * 400)
    method = "class C:\n    def f(self):\n" + "        x = 1\n" * 40
    (folder / "m.py").write_text(method + "def g():\n" + "    x = 1\n" * 39 + "x = 1\n" * (401 - 42 - 40))
    assert differences(too_large(tmp_path, ("a",)), listed) == expected
