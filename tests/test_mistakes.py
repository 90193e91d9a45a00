"""Mistakes on purpose: each ends with one line of place, cause and cure, exit status 2, and no output."""

from pathlib import Path

import pytest

from tests.mistakes.workshop import all_mistakes, end_of, furnish

MISTAKES = list(all_mistakes())


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of files without mistakes."""
    folder = tmp_path_factory.mktemp("good")
    furnish(folder)
    return folder


def test_there_are_a_hundred_different_ones():
    assert len({(mistake.command, mistake.made, mistake.cause) for _, mistake in MISTAKES}) == len(MISTAKES) >= 100


def test_the_readme_states_their_number():
    assert f"makes {len(MISTAKES)} mistakes" in (Path(__file__).parents[1] / "README.md").read_text()


@pytest.mark.parametrize("mistake", [mistake for _, mistake in MISTAKES], ids=[f"{k}: {m.made}" for k, m in MISTAKES])
def test_a_mistake_ends_with_place_cause_and_cure(good, tmp_path, mistake):
    end = end_of(mistake, good, tmp_path / "folder")
    assert end.faults == (), end.message
