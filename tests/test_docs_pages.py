"""Pages that scripts write: the tutorial, the refusals and the keys of results are those of the present program."""

from __future__ import annotations

import difflib
import json
import math
import re
from pathlib import Path

import pytest
from support.docs_make import MAKE, script

refusals, results, tutorial = script(MAKE / "refusals.py"), script(MAKE / "results.py"), script(MAKE / "tutorial.py")
session = script(MAKE / "session.py")
NUMBER = re.compile(r"(?<![\w.])[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")


def same(one: str, other: str) -> bool:
    """True for two lines whose words are the same, and whose numbers are so to 0.3 %, or to 0.011.

    Two processors differ in the last digit that is shown; other figures are those of another program.
    """
    if NUMBER.sub("#", one).split() != NUMBER.sub("#", other).split():
        return False
    pairs = zip(map(float, NUMBER.findall(one)), map(float, NUMBER.findall(other)), strict=True)
    return all(a == b or math.isclose(a, b, rel_tol=3e-3, abs_tol=0.011) or max(a, b) < 1e-3 for a, b in pairs)


def test_numbers_of_other_computers_are_the_same() -> None:
    assert same("width 14.18 um, p = 1e-36", "width 14.19 um, p = 3e-37")
    assert not same("width 14.18 um", "width 14.31 um")
    assert not same("width 14.18 um", "lag 14.18 um")


@pytest.mark.parametrize("name", tutorial.PICTURES)
def test_the_pictures_of_the_tutorial_have_the_figures_of_its_page(name: str) -> None:
    verdict = text_in((tutorial.PAGE.parent / "pictures" / f"{name}.png").read_bytes())
    figures = set(re.findall(r"\d+\.\d+", verdict))
    listed = set(re.findall(r"\d+\.\d+", tutorial.PAGE.read_text()))
    assert len(figures) >= 4
    assert figures <= listed, "python docs/make/tutorial.py --pictures renews page and pictures"


def text_in(png: bytes) -> str:
    """The text that `docs/make/tutorial.py` has put into a picture."""
    begin = png.index(b"iTXt" + tutorial.VERDICT.encode() + bytes(5))
    size = int.from_bytes(png[begin - 4 : begin])
    return png[begin + 4 + len(tutorial.VERDICT) + 5 : begin + 4 + size].decode()


@pytest.mark.statistical
def test_the_outputs_of_the_tutorial_are_those_of_its_commands(tmp_path: Path) -> None:
    old = tutorial.PAGE.read_text()
    new = tutorial.renewed(old, tmp_path)
    lines = [line for line in zip(old.splitlines(), new.splitlines(), strict=True) if not same(*line)]
    assert lines == [], "python docs/make/tutorial.py renews the page"


def test_the_reasons_of_refusals_are_listed() -> None:
    listed = refusals.PAGE.read_text()
    every = [reason for folders in refusals.FOLDERS.values() for reason in refusals.reasons(folders)]
    missing = [reason for reason in every if f"| {refusals.in_table(reason)} |" not in listed]
    assert len(every) > 350
    assert len(missing) <= 0.03 * len(every), f"python docs/make/refusals.py renews the page; missing: {missing}"


@pytest.mark.statistical
@pytest.mark.parametrize("example", refusals.EXAMPLES, ids=lambda example: example.heading)
def test_the_example_of_a_refusal_is_refused_with_this_message(example: object) -> None:
    message = refusals.shown(example)
    listed = refusals.PAGE.read_text().split(f"## {example.heading}\n\n    ")[1].split("\n")[0]  # type: ignore[attr-defined]
    assert difflib.SequenceMatcher(None, message, listed).ratio() > 0.8


@pytest.mark.statistical
def test_the_keys_of_results_are_those_of_the_page(tmp_path: Path) -> None:
    results.prepare(tmp_path)
    pages = {command: subject for subject, (_, commands) in results.SUBJECTS.items() for command in commands}
    for command, value in results.results(tmp_path).items():
        json.dumps(value, allow_nan=False)
        page = (results.PAGES / f"{pages[command]}.md").read_text()
        section = page.split(f"## JSON of {command}\n")[1].split("\n## ")[0]
        listed = set(re.findall(r"^\| `([^`]+)` \|", section, re.MULTILINE))
        assert listed == set(results.key_table(value, command)), (
            f"{command}: python docs/make/results.py renews the page"
        )
    page = (results.PAGES / f"{results.COLUMNS}.md").read_text()
    for command, names in results.columns(tmp_path).items():
        section = page.split(f"## {command}\n")[1].split("\n## ")[0]
        assert re.findall(r"^\| `([^`]+)` \|", section, re.MULTILINE) == names


def shown(notebook: str) -> list[str]:
    """The lines that a notebook shows: its cells, and their outputs without the tags of HTML."""
    cells = json.loads(notebook)["cells"]
    texts = ["".join(cell["source"]) for cell in cells]
    for output in (each for cell in cells for each in cell.get("outputs", ())):
        texts += ["".join(text) for text in output.get("data", {"text": output.get("text")}).values()]
    return [line for text in texts for line in re.sub("<[^>]+>", "\n", text).splitlines() if line.strip()]


@pytest.mark.statistical
def test_the_outputs_of_the_notebook_are_those_of_its_cells() -> None:
    old = session.PAGE.read_text(encoding="utf-8")
    lines = zip(shown(old), shown(session.renewed(old)), strict=True)
    assert [pair for pair in lines if not same(*pair)] == [], "python docs/make/session.py renews the notebook"


def test_the_notebook_is_of_the_format_of_jupyter() -> None:
    notebook = json.loads(session.PAGE.read_text(encoding="utf-8"))
    assert (notebook["nbformat"], notebook["nbformat_minor"]) == (4, 5)
    for cell in notebook["cells"]:
        needed = {"cell_type", "id", "metadata", "source"}
        assert set(cell) == needed | ({"execution_count", "outputs"} if cell["cell_type"] == "code" else set())
    assert len({cell["id"] for cell in notebook["cells"]}) == len(notebook["cells"])


def test_the_page_of_the_router_shows_what_its_commands_give(tmp_path: Path) -> None:
    """Outputs, the lines of the corrected program, and the pictures."""
    router = script(MAKE / "router.py")
    page = router.PAGE.read_text()
    assert router.renewed(page, tmp_path) == page, "python docs/make/router.py renews the page"
    assert router.block(page, "X298.4099").rstrip() in (tmp_path / "sign_c.nc").read_text()
    for name, drawing in router.pictures(tmp_path).items():
        assert (router.PICTURES / name).read_text() == drawing, "python docs/make/router.py renews the pictures"
