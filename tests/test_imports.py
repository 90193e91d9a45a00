"""Imports run down: each folder imports folders below it only, and no module imports itself by a detour."""

from __future__ import annotations

import ast
import graphlib
import importlib
import pkgutil
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest
from support.source import statements

ROOT = Path(__file__).parents[1]
PACKAGES = ("grammars", "kinematics", "machines", "rendering", "calibration", "history", "postproc")

KINEMATICS = ("grammars", "kinematics", "machines", "rendering")
CALIBRATION = (
    "calibration.cores",
    "calibration.registration",
    "calibration.instruments",
    "calibration.measurement",
    "calibration.observation",
    "calibration.plausibility",
    "calibration.follow_up",
    "calibration.gaussian_terms",
    "calibration.fit",
    "calibration.single_axis",
    "calibration.environment",
    "calibration.evaluation",
    "calibration.planning",
    "calibration.simulation",
    "calibration.design",
    "calibration.optimal",
    "calibration.probing",
    "calibration.on_the_fly",
    "calibration.continuous",
    "calibration.diagnosis",
    "calibration.circles",
    "calibration.following",
    "calibration.study",
    "calibration.reports",
    "calibration.interface",
)
"""From the bottom up: a folder may import those before it."""
HISTORY = ("history",)
POSTPROC = (
    "postproc.text",
    "postproc.motion",
    "postproc.control",
    "postproc.iso",
    "postproc.siemens",
    "postproc.heidenhain",
    "postproc.control_data.tool_tables",
    "postproc.dialects",
    "postproc.compensation",
    "postproc.write",
    "postproc.read_ahead",
    "postproc.program_lines",
    "postproc.program_set",
    "postproc.execution",
    "postproc.program_path",
    "postproc.generate",
    "postproc.probing",
    "postproc.evaluation",
    "postproc.correct",
    "postproc.code_tables",
    "postproc.verification",
    "postproc.control_data",
    "postproc.hooks",
    "postproc.folders",
    "postproc.interface",
)
TOP = ("ncomp", "postproc.commands", "postproc.command_line", "postproc.cli")
BOTH_SIDES = ("ncomp", "postproc.commands")
"""The only modules where NC programs and calibrations meet."""
BESIDE_EACH_OTHER = ("postproc.iso", "postproc.siemens", "postproc.heidenhain")
"""The dialects do not import one another."""
LARGEST_FOLDER = 18


def module_name(path: Path) -> str:
    """The dotted name of the module in a file."""
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


FILES = {module_name(path): path for package in PACKAGES for path in sorted((ROOT / package).rglob("*.py"))}
FILES["ncomp"] = ROOT / "ncomp.py"


def imported(path: Path) -> set[str]:
    """The modules of the project that a file imports, also inside functions.

    Those for annotations only, and of a file that is run as a script, do not count.
    """
    found = set()
    for node in loaded(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and node.module:
            names = [f"{node.module}.{alias.name}" for alias in node.names]
            found |= {name if name in FILES else node.module for name in names}
        elif isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
    return found & FILES.keys()


def loaded(node: ast.AST) -> Iterator[ast.AST]:
    """The statements in a piece of code, without those for annotations only and of a file that is run as a script."""
    for inner in statements(node):
        if not (isinstance(inner, ast.If) and first_name(inner.test) in ("TYPE_CHECKING", "__name__")):
            yield inner
            yield from loaded(inner)


def first_name(test: ast.expr) -> str:
    """The name that a condition is about; empty where it begins with none."""
    name = test.left if isinstance(test, ast.Compare) else test
    return name.id if isinstance(name, ast.Name) else ""


@cache
def imports() -> dict[str, set[str]]:
    """The modules of the project that each of its modules imports."""
    return {name: imported(path) - {name} for name, path in FILES.items()}


def floor(name: str, floors: tuple[str, ...]) -> int | None:
    """The place of a module among floors, -1 for the packages' own __init__; None for a module of another house."""
    if name in PACKAGES and name not in floors:
        return -1
    return next((n for n, folder in enumerate(floors) if name == folder or name.startswith(f"{folder}.")), None)


def rising(modules: dict[str, set[str]], floors: tuple[str, ...]) -> list[str]:
    """The imports that run up among these floors, or to a dialect beside."""
    wrong = []
    for name, others in modules.items():
        here = floor(name, floors)
        for other in sorted(others):
            there = floor(other, floors)
            if here is not None and there is not None and there > here >= 0:
                wrong.append(f"{name} imports {other}")
    return wrong


@pytest.mark.parametrize("floors", [(*KINEMATICS, *CALIBRATION, *HISTORY, *TOP), (*KINEMATICS, *POSTPROC, *TOP)])
def test_imports_run_down(floors: tuple[str, ...]) -> None:
    assert rising(imports(), floors) == []


def test_every_module_has_a_floor() -> None:
    floors = (*KINEMATICS, *CALIBRATION, *HISTORY, *POSTPROC, *TOP)
    assert [name for name in FILES if floor(name, floors) is None] == []


def test_a_turned_import_is_found() -> None:
    turned = {"postproc.text.block": {"postproc.motion.motions"}, "postproc.motion.motions": {"postproc.text.block"}}
    assert rising(turned, POSTPROC) == ["postproc.text.block imports postproc.motion.motions"]


def test_programs_and_calibrations_meet_in_the_commands_only() -> None:
    assert [
        f"{name} imports {other}"
        for name, others in imports().items()
        for other in sorted(others)
        if {name.split(".")[0], other.split(".")[0]} == {"postproc", "calibration"} and not name.startswith(BOTH_SIDES)
    ] == []


def test_dialects_do_not_import_one_another() -> None:
    assert [
        f"{name} imports {other}"
        for name, others in imports().items()
        for other in sorted(others)
        for mine in BESIDE_EACH_OTHER
        if name.startswith(f"{mine}.") and other.startswith(BESIDE_EACH_OTHER) and not other.startswith(f"{mine}.")
    ] == []


def test_no_module_imports_itself_by_a_detour() -> None:
    graphlib.TopologicalSorter(imports()).prepare()


def test_no_folder_is_too_large_to_read() -> None:
    folders = [folder for package in PACKAGES for folder in (ROOT / package, *(ROOT / package).rglob("*"))]
    sizes = {folder: len(list(folder.glob("*.py"))) for folder in folders}
    assert {str(folder): size for folder, size in sizes.items() if size > LARGEST_FOLDER} == {}


TEST_MODULES = {path.stem: path for path in (ROOT / "tests").glob("test_*.py")}


def modules_named(path: Path) -> set[str]:
    """The modules that a file imports, also by a call with its name (importlib)."""
    found: set[str] = set()
    text = path.read_text()
    if not any(name in text for name in (*TEST_MODULES, "conftest")):
        return found
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.ImportFrom) and node.module:
            found |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
        elif isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.Call):
            found |= {
                each.value for each in node.args if isinstance(each, ast.Constant) and isinstance(each.value, str)
            }
    return {name.removeprefix("tests.").split(".")[0] for name in found}


def test_no_module_imports_a_test_module() -> None:
    assert [
        f"{path.relative_to(ROOT)} imports {name}"
        for folder in ("tests", "benchmarks")
        for path in sorted((ROOT / folder).rglob("*.py"))
        for name in sorted(modules_named(path) & {*TEST_MODULES, "conftest"})
    ] == []


NOT_ON_THE_MAIN_ROAD = {
    *("typer", "click", "pydantic", "rich", "lark", "jinja2", "plotly", "scipy", "sympy", "threadpoolctl"),
    *("sqlalchemy", "alembic", "history"),
    *(
        "numpy.ma",
        "numpy.polynomial",
        "platformdirs",
        "importlib.metadata",
        "importlib.resources",
        "csv",
        "multiprocessing",
        "asyncio",
        "logging",
    ),
    *("calibration", "grammars", "postproc.heidenhain", "postproc.siemens.interpreter", "postproc.siemens.variables"),
    *("postproc.control_data.tables", "postproc.control_data.formats", "postproc.control_data.readers"),
    *("postproc.control_data.tool_tables.siemens_tool_table", "postproc.verification", "postproc.commands.tree"),
    *("postproc.correct.report_figures", "postproc.correct.unroll", "rendering.page"),
}
"""Modules that take longer to load than a short program to correct, or that only other jobs need."""
SHORT_PROGRAM = "%\nO0001 (SHORT)\nG21 G17 G90 G54\nT1 M6\nG0 X60. Y0. Z200. B20. C180.\nG1 X61. F500\nM30\n%\n"


def test_a_short_program_is_corrected_without_what_it_does_not_need(tmp_path: Path) -> None:
    (tmp_path / "in.nc").write_text(SHORT_PROGRAM)
    arguments = ["ncomp", "in.nc", "--machine", "dmu50", "-o", "out.nc", "--set-up-zero"]
    code = (
        f"import sys; sys.argv = {arguments}\nfrom postproc.cli import run\nrun()\n"
        "import io; open('modules', 'w').write(' '.join(sys.modules))"
    )
    subprocess.run(
        [sys.executable, "-c", code], check=True, cwd=tmp_path, capture_output=True, env={"PYTHONPATH": str(ROOT)}
    )
    assert (tmp_path / "out.nc").is_file()
    loaded = (tmp_path / "modules").read_text().split()
    assert [name for name in loaded if name in NOT_ON_THE_MAIN_ROAD] == []


@pytest.mark.parametrize("path", sorted((ROOT / "benchmarks").glob("*.py")), ids=lambda path: path.stem)
def test_benchmarks_import_names_that_there_are(path):
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and node.module and (ROOT / node.module.partition(".")[0]).is_dir():
            module = importlib.import_module(node.module)
            there = {*vars(module), *(each.name for each in pkgutil.iter_modules(getattr(module, "__path__", [])))}
            assert {each.name for each in node.names} <= there
