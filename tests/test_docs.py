"""The pages name files, folders and modules that exist."""

from __future__ import annotations

import json
import re
import shlex
import shutil
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
PAGES = (ROOT / "README.md", *sorted(DOCS.rglob("*.md")))
PACKAGES = "benchmarks|calibration|examples|grammars|history|kinematics|machines|postproc|tests"
NAMES = {path.name for folder in PACKAGES.split("|") for path in (ROOT / folder).rglob("*.py")}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_files_and_folders_exist(page: Path) -> None:
    named = re.findall(rf"\b(?:{PACKAGES})/[\w/.-]*", page.read_text())
    assert [name for name in named if not (ROOT / name.rstrip(".")).exists()] == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_modules_exist(page: Path) -> None:
    assert set(re.findall(r"`([a-z]\w*\.py)`", page.read_text())) - NAMES == set()


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_to_pages(page: Path) -> None:
    linked = re.findall(r"\]\(([\w/.]+\.(?:md|svg))", page.read_text())
    assert [link for link in linked if not (page.parent / link).exists()] == []


def anchors(page: Path) -> set[str]:
    """The anchors of the headings of a page, as GitHub makes them."""
    headings = re.findall(r"^#+ (.*)$", page.read_text(), re.MULTILINE)
    return {re.sub(r"[^\w -]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_to_headings(page: Path) -> None:
    linked = re.findall(r"\]\(([\w/.]*)#([\w-]+)\)", page.read_text())
    targets = [(page.parent / link if link else page, anchor) for link, anchor in linked]
    assert [anchor for target, anchor in targets if anchor not in anchors(target)] == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_lines_are_short(page: Path) -> None:
    lines = page.read_text().splitlines()
    assert [line for line in lines if len(line) > 120 and not line.startswith(("|", "    "))] == []


def test_every_page_is_in_the_navigation() -> None:
    named = set(re.findall(r"[\w/]+\.md", (ROOT / "mkdocs.yml").read_text()))
    assert {page.relative_to(DOCS).as_posix() for page in DOCS.rglob("*.md")} == named


@pytest.mark.statistical
def test_the_tour_lists_every_folder() -> None:
    folders = (DOCS / "tour.md").read_text().partition("## The folders")[2].partition("\n## ")[0]
    inner = [path for top in ("kinematics", "calibration", "postproc") for path in (ROOT / top).glob("*/__init__.py")]
    assert [
        path.parent.name for path in inner if f"`{path.parent.name}/`" not in folders.replace("kinematics/", "")
    ] == []


def test_the_readme_links_every_page() -> None:
    readme = (ROOT / "README.md").read_text()
    pages = [path.relative_to(ROOT).as_posix() for path in DOCS.rglob("*.md")]
    assert [page for page in pages if f"]({page})" not in readme] == []


@pytest.mark.statistical
def test_commands_of_the_evening_with_one_sphere(ncomp) -> None:
    """The errors that the simulated machine has are within U of those that the page's commands find."""
    shutil.copytree(ROOT / "examples", "examples")
    commands = re.findall(r"^    ncomp (.*)$", (ROOT / "docs" / "spheres.md").read_text(), re.MULTILINE)
    assert [command.split()[0] for command in commands] == ["plan", "touches", "fit", "export"]
    for command in commands:
        done = ncomp(*shlex.split(command))
        assert done.status == 0, done.err
    real, found = (
        {
            f"{e['component']}0{e['axis']}": e
            for e in json.loads(Path(name).read_text())["effects"]
            if e["kind"] == "location"
        }
        for name in ("examples/spheres/machine.json", "cal.json")
    )
    assert len(real) == 8
    assert all(abs(real[name]["value"] - found[name]["value"]) < 2.0 * found[name]["u"][0] for name in real)
