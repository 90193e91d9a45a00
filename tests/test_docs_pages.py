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
NUMBER = re.compile(r"(?<![\w.])[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")


def same(one: str, other: str) -> bool:
    """True for two lines whose words are the same, and whose numbers are so to 10 %, or to 0.2."""
    if NUMBER.sub("#", one).split() != NUMBER.sub("#", other).split():
        return False
    pairs = zip(map(float, NUMBER.findall(one)), map(float, NUMBER.findall(other)), strict=True)
    return all(a == b or math.isclose(a, b, rel_tol=0.1, abs_tol=0.2) or max(a, b) < 1e-3 for a, b in pairs)


def test_numbers_of_other_computers_are_the_same() -> None:
    assert same("width 14.18 um, p = 1e-36", "width 14.2 um, p = 3e-37")
    assert not same("width 14.18 um", "width 11.2 um")
    assert not same("width 14.18 um", "lag 14.18 um")


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
    page = results.PAGE.read_text()
    for command, value in results.results(tmp_path).items():
        json.dumps(value, allow_nan=False)
        section = page.split(f"## JSON of {command}\n")[1].split("\n## ")[0]
        listed = set(re.findall(r"^\| `([^`]+)` \|", section, re.MULTILINE))
        assert listed == set(results.key_table(value)), f"{command}: python docs/make/results.py renews the page"
    for command, names in results.columns(tmp_path).items():
        section = page.split(f"### {command}\n")[1].split("\n### ")[0]
        assert re.findall(r"^\| `([^`]+)` \|", section, re.MULTILINE) == names
