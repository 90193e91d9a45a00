"""The wheel: one package of the name `ncomp`, which works without the repository."""

from __future__ import annotations

import ast
import importlib.util
import os
import re
import shutil
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import hatchling.build
import numpy as np
import pytest
from support.file_examples import PROGRAM

import ncomp

pytestmark = pytest.mark.statistical

ROOT = Path(__file__).parents[1]
SPEC = importlib.util.spec_from_file_location("hatch_build", ROOT / "hatch_build.py")
assert SPEC is not None
assert SPEC.loader is not None
hatch_build = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(hatch_build)
LIBRARIES = Path(np.__file__).parents[1]


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the content of the wheel, which was built from the source distribution."""
    folder, here = tmp_path_factory.mktemp("wheel"), Path.cwd()
    try:
        os.chdir(ROOT)
        sdist = hatchling.build.build_sdist(str(folder))
        with tarfile.open(folder / sdist) as archive:
            archive.extractall(folder, filter="data")
        os.chdir(folder / sdist.removesuffix(".tar.gz"))
        wheel = hatchling.build.build_wheel(str(folder))
    finally:
        os.chdir(here)
    with zipfile.ZipFile(folder / wheel) as archive:
        archive.extractall(folder / "installed")
    return folder / "installed"


def run(installed: Path, code: str, *arguments: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    """Run Python code with the wheel and the libraries, without the folders of an editable installation."""
    path = f"import sys; sys.path[:0] = {[str(installed), str(LIBRARIES)]}; sys.argv[0] = 'ncomp'\n"
    command = [sys.executable, "-I", "-S", "-c", path + code, *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=False, timeout=120, cwd=cwd)


COMMAND = "from ncomp.postproc.cli import run; run()"


def test_only_one_name_is_installed(installed):
    names = {path.name for path in installed.iterdir()}
    (information,) = {name for name in names if name.endswith(".dist-info")}
    assert names == {"ncomp", information}
    text = (installed / information / "entry_points.txt").read_text()
    assert text.split() == ["[console_scripts]", "ncomp", "=", "ncomp.postproc.cli:run"]
    assert (installed / information / "licenses" / "LICENSE").is_file()


def test_every_file_of_the_packages_is_in_the_wheel(installed):
    wanted = {
        path.relative_to(ROOT).as_posix()
        for package in hatch_build.PACKAGES
        for path in (ROOT / package).rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    }
    found = {path.relative_to(installed / "ncomp").as_posix() for path in (installed / "ncomp").rglob("*.*")}
    assert wanted <= found


def test_every_module_is_imported_below_ncomp_only(installed, tmp_path):
    code = (
        "import importlib, pkgutil, ncomp\n"
        "names = [each.name for each in pkgutil.walk_packages(ncomp.__path__, 'ncomp.')]\n"
        "names = [name for name in names if not name.endswith('__main__')]\n"
        "for name in names:\n    importlib.import_module(name)\n"
        f"print(len(names), [name for name in {hatch_build.PACKAGES} if name in sys.modules])"
    )
    done = run(installed, code, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    count, others = done.stdout.split(maxsplit=1)
    assert int(count) > 400
    assert others.strip() == "[]"


def test_a_folder_is_corrected_by_processes_with_the_same_bytes(installed, tmp_path):
    (tmp_path / "in").mkdir()
    for name in ("a.nc", "b.nc"):
        (tmp_path / "in" / name).write_text(PROGRAM)
    options = ("--machine", "dmu50", "--set-up-zero", "--no-travel-check")
    done = run(installed, COMMAND, "batch", "in", "out", *options, "--jobs", "2", "--report", "page.html", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    setup = ncomp.set_up("dmu50", zero=True)
    expected = ncomp.correct(tmp_path / "in" / "a.nc", "dmu50", setup=setup, travel_check=False).text
    assert [(tmp_path / "out" / name).read_text() for name in ("a.nc", "b.nc")] == [expected] * 2
    assert (tmp_path / "page.html").stat().st_size > 1000


def test_python_m_ncomp(tmp_path, installed):
    runpy = "import runpy; runpy.run_module('ncomp', run_name='__main__', alter_sys=True)"
    shown = run(installed, runpy, "machines", "gantry", cwd=tmp_path)
    assert "w b X Y Z t" in shown.stdout, shown.stderr
    checkout = [sys.executable, "-m", "ncomp", "machines", "gantry"]
    here = subprocess.run(checkout, capture_output=True, text=True, check=True, cwd=ROOT).stdout
    ours, theirs = (re.sub(r"^file .*\n", "", text, flags=re.MULTILINE) for text in (here, shown.stdout))
    assert ours == theirs


@pytest.mark.parametrize(
    ("source", "wheel"),
    [
        ("from kinematics.files import a, b", "from ncomp.kinematics.files import a, b"),
        ("from kinematics import (\n    a,\n)\n", "from ncomp.kinematics import (\n    a,\n)\n"),
        ("import machines  # why", "from ncomp import machines  # why"),
        ("import machines as shipped, os", "import ncomp.machines as shipped; import os"),
        ("import rendering.terminal", "from ncomp import rendering; import ncomp.rendering.terminal"),
        ("def f():\n    'ä'; import machines; return 1\n", "def f():\n    'ä'; from ncomp import machines; return 1\n"),
        ("if x: from postproc import cli\n", "if x: from ncomp.postproc import cli\n"),
        ("import ncomp\nfrom ncomp import fit\n", "import ncomp\nfrom ncomp import fit\n"),
        ("import kinematics_other\n", "import kinematics_other\n"),
        ("from . import kinematics\n", "from . import kinematics\n"),
        ("x = 'import machines'\n# from machines import a\n", "x = 'import machines'\n# from machines import a\n"),
        ("from machines import a\r\nimport machines\r\n", "from ncomp.machines import a\r\nfrom ncomp import machines\r\n"),
    ],
)  # fmt: skip
def test_imports_are_renamed(source, wheel):
    assert hatch_build.renamed(source.encode()).decode() == wheel
    ast.parse(wheel)


def test_an_import_that_is_not_understood_stops_the_build():
    with pytest.raises(ValueError, match="line 1"):
        hatch_build.renamed(b"import os, \\\n machines\n")


def test_no_module_is_named_in_a_text():
    """Imports in texts (`import_module("kinematics.files")`) would not be renamed."""
    modules = {
        ".".join(path.relative_to(ROOT).with_suffix("").parts)
        for package in hatch_build.PACKAGES
        for path in (ROOT / package).rglob("*.py")
    }
    found = [
        (path.name, node.value)
        for package in hatch_build.PACKAGES
        for path in (ROOT / package).rglob("*.py")
        if any(f'"{name}.' in path.read_text() for name in hatch_build.PACKAGES)
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and node.value in modules
    ]
    assert found == [("dmu50_demonstration.py", "machines.calibrations.dmu50_demonstration")]  # the maker's name


@pytest.mark.parametrize(
    ("remote", "home"),
    [
        ("git@github.com:maker/ncomp.git\n", "https://github.com/maker/ncomp"),
        ("https://github.com/maker/ncomp", "https://github.com/maker/ncomp"),
        ("https://name:secret@gitlab.example.org/shop/tools/ncomp.git/", "https://gitlab.example.org/shop/tools/ncomp"),
        ("ssh://git@codeberg.org:2222/maker/ncomp.git", "https://codeberg.org/maker/ncomp"),
        ("https://git.example.org:8443/ncomp", "https://git.example.org:8443/ncomp"),
        ("/home/maker/ncomp", ""),
        ("../ncomp", ""),
        ("file:///srv/git/ncomp.git", ""),
        ("git@server:ncomp.git", ""),
        ("C:/cnc/ncomp", ""),
        ("", ""),
    ],
)
def test_addresses_of_the_project_are_public(remote, home):
    found = hatch_build.addresses(remote)
    assert found == ({"Homepage": home, "Source": home, "Issues": f"{home}/issues"} if home else {})


@pytest.mark.parametrize("remote", ["git@git.example.org:maker/ncomp.git", ""])
def test_the_package_has_the_addresses_of_its_repository(remote, tmp_path):
    """The wheel is built from the source distribution, which is no checkout."""
    project, built = tmp_path / "project", tmp_path / "built"
    project.mkdir()
    for name in ("pyproject.toml", "hatch_build.py", "README.md", "LICENSE", "ncomp.py"):
        shutil.copy(ROOT / name, project)
    for package in hatch_build.PACKAGES:
        (project / package).mkdir()
        (project / package / "__init__.py").touch()
    shutil.copy(ROOT / "kinematics" / "version.py", project / "kinematics")
    subprocess.run(["git", "init", "-q", project], check=True)
    if remote:
        subprocess.run(["git", "-C", project, "remote", "add", "origin", remote], check=True)

    def build(folder: Path, kind: str) -> Path:
        code = f"import hatchling.build as b, sys; print(b.build_{kind}(sys.argv[1]))"
        done = subprocess.run(
            [sys.executable, "-c", code, built], cwd=folder, capture_output=True, text=True, check=True
        )
        return built / done.stdout.split()[-1]

    with tarfile.open(build(project, "sdist")) as archive:
        archive.extractall(tmp_path, filter="data")
        (unpacked,) = {tmp_path / Path(name).parts[0] for name in archive.getnames()}
    with zipfile.ZipFile(build(unpacked, "wheel")) as archive:
        (metadata,) = (archive.read(name).decode() for name in archive.namelist() if name.endswith("/METADATA"))
    found = dict(hatch_build.PROJECT_URL.findall(metadata))
    assert found == hatch_build.addresses(remote)
    assert bool(found) == bool(remote)


def test_the_page_of_conventions_runs_with_the_wheel(installed: Path, tmp_path: Path) -> None:
    page = ROOT / "docs" / "conventions.md"
    code = f"import doctest; print(doctest.testfile({str(page)!r}, module_relative=False))"
    done = run(installed, code, cwd=tmp_path)
    assert re.search(r"TestResults\(failed=0, attempted=\d\d", done.stdout), done.stdout + done.stderr


def test_the_repository_has_the_names_of_the_wheel() -> None:
    from ncomp.kinematics.state import State as OfTheWheel  # type: ignore[import-untyped]

    from kinematics.state import State

    assert OfTheWheel is State
    with pytest.raises(ModuleNotFoundError):
        importlib.import_module("ncomp.nothing")


def test_a_module_that_lacks_a_library_names_the_library(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "needs_a_library.py").write_text("import library_that_nobody_has\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    with pytest.raises(ModuleNotFoundError, match="'library_that_nobody_has'"):
        importlib.import_module("ncomp.needs_a_library")


def test_the_same_source_makes_the_same_bytes(tmp_path: Path) -> None:
    """In another folder, with other times and permissions of the files, and another order of hashes."""
    built = []
    for number, name in enumerate(("here", "elsewhere")):
        project = tmp_path / name / "project"
        project.mkdir(parents=True)
        for part in ("pyproject.toml", "hatch_build.py", "README.md", "LICENSE", "ncomp.py"):
            shutil.copyfile(ROOT / part, project / part)
        for package in hatch_build.PACKAGES:
            shutil.copytree(ROOT / package, project / package, ignore=shutil.ignore_patterns("__pycache__"))
        for path in project.rglob("*") if number else ():
            os.utime(path, (1e9, 1e9))
            path.chmod((path.stat().st_mode & 0o100) | (0o600 if path.is_file() else 0o700))
        code = "import hatchling.build as b; print(b.build_wheel('dist'), b.build_sdist('dist'))"
        environment = os.environ | {"PYTHONHASHSEED": str(number)}
        subprocess.run([sys.executable, "-c", code], cwd=project, check=True, capture_output=True, env=environment)
        built.append({path.name: path.read_bytes() for path in (project / "dist").iterdir()})
    assert len(built[0]) == 2
    assert built[0] == built[1]
