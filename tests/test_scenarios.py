"""Each scenario of tests/scenarios.py is diagnosed as it has to be: its causes, their sizes, ties and notes."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from support.tiers import EXAM, STATISTICAL

from tests.scenarios import SCENARIOS, Scenario
from tests.support.scenario_answers import answer

INSIDE = 3.0
"""Standard uncertainties."""
OFTEN = {
    "backlash, tracker", "nothing wrong, tracker", "outliers, tracker", "servo mismatch", "nothing wrong, ballbar",
}  # fmt: skip
"""Scenarios of the statistical tier: of each instrument, of the machine and of the readings; other heavy ones are exams."""


FEW = {"nothing wrong, interferometer", "backlash", "cyclic", "growth with a temperature", "squareness of a part"}
"""Scenarios of the default tiers."""


def tier(scenario: Scenario) -> list[pytest.MarkDecorator]:
    """The mark of a scenario that is in no default tier."""
    if scenario.name in FEW:
        return []
    return [STATISTICAL if scenario.name in OFTEN or not scenario.heavy else EXAM]


def each(*, failing: bool = False) -> pytest.MarkDecorator:
    """All scenarios; where the present answer is wrong the test has to fail if it is one of the causes."""
    return pytest.mark.parametrize(
        "scenario",
        [
            pytest.param(
                scenario,
                id=scenario.name,
                marks=[
                    *tier(scenario),
                    *[pytest.mark.xfail(strict=True, raises=AssertionError, reason=scenario.fails)]
                    * bool(scenario.fails),
                ],
            )
            for scenario in SCENARIOS
            if failing or not scenario.fails
        ],
    )


@pytest.fixture
def said(scenario: Scenario, pytestconfig: pytest.Config) -> dict[str, Any]:
    """The answer, from the folder of pytest's cache where it is there."""
    return answer(scenario, Path(pytestconfig.rootpath) / ".cache" / "scenarios")


def name_of(effect: dict[str, Any]) -> str:
    """The kind of a cause, and where it acts."""
    place = next((effect[key] for key in ("axis", "station", "circle", "target", "component") if effect.get(key)), None)
    return effect["kind"] if place is None else f"{effect['kind']} {place}"


def outside(size: object, u: object, truth: float) -> bool:
    """Whether a size, or its first value, is farther from the truth than its uncertainty allows."""
    value, spread = (each[0] if isinstance(each, list) else each for each in (size, u))
    return not abs(float(value) - truth) <= INSIDE * float(spread)


@each(failing=True)
def test_the_causes_are_named_and_no_others(scenario: Scenario, said: dict[str, Any]) -> None:
    named = sorted(name_of(effect) for effect in said["effects"])
    assert named == sorted([*scenario.causes, *scenario.ties])
    strong = {name_of(effect) for effect in said["effects"] if effect["verdict"] != "tied"}
    assert strong == set(scenario.causes)


@each()
def test_the_sizes_are_those_of_the_recipe(scenario: Scenario, said: dict[str, Any]) -> None:
    found = {name_of(effect): effect for effect in said["effects"]}
    assert [
        f"{name} {key}: {found[name]['parameters'][key]} instead of {truth}"
        for name, sizes in scenario.causes.items()
        for key, truth in sizes.items()
        if outside(found[name]["parameters"][key], found[name]["u"][key], truth)
    ] == []


def alternatives(said: dict[str, Any], name: str) -> Iterator[str]:
    for effect in said["effects"]:
        if name_of(effect) == name:
            yield from (other["name"] for other in effect["alternatives"])


@each()
def test_ties_and_notes_are_said(scenario: Scenario, said: dict[str, Any]) -> None:
    assert {name: other for name, other in scenario.ties.items() if other not in alternatives(said, name)} == {}
    everything = json.dumps(said, ensure_ascii=False)
    assert [note for note in scenario.notes if note not in everything] == []


@pytest.mark.usefixtures("scenario")
@each()
def test_a_cause_that_the_data_do_not_show_has_no_size_from_which_they_show_it(said: dict[str, Any]) -> None:
    assert not {one["name"] for one in said["would_show_from"]} & set(said["not_visible"])
