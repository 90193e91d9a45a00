"""The page of conventions: its examples are run, so that no sign on it can be other than that of the code."""

import doctest
import re
from pathlib import Path

import pytest

PAGE = Path(__file__).parents[1] / "docs" / "conventions.md"
TEXT = PAGE.read_text(encoding="utf-8")
SECTIONS = dict(re.findall(r"^## (.+)\n((?:(?!## ).*\n)*)", TEXT, re.MULTILINE))


def run(text: str, capsys: pytest.CaptureFixture[str]) -> tuple[int, str]:
    """How many examples of a page do not give what it says, and doctest's account of them."""
    test = doctest.DocTestParser().get_doctest(text, {}, PAGE.name, str(PAGE), 0)
    failed = doctest.DocTestRunner().run(test).failed
    return failed, capsys.readouterr().out


def test_every_worked_number_is_what_the_code_says(capsys):
    failed, account = run(TEXT, capsys)
    assert not failed, account


@pytest.mark.parametrize("section", SECTIONS)
def test_every_section_has_a_worked_number(section):
    examples = doctest.DocTestParser().get_examples(SECTIONS[section])
    assert any(re.search(r"\d", example.want) for example in examples)


@pytest.mark.parametrize(
    ("right", "wrong"),
    [
        ("E_B0Z [2.0, 0.0, 0.0]", "E_B0Z [-2.0, 0.0, 0.0]"),
        ("(-6.0, 6.0, -12.0)", "(-6.0, 6.0, 12.0)"),
        ("    [99.995, 0.0, 0.0]", "    [100.005, 0.0, 0.0]"),
    ],
)
def test_a_wrong_sign_on_the_page_is_found(right, wrong, capsys):
    assert TEXT.count(right) == 1
    failed, account = run(TEXT.replace(right, wrong), capsys)
    assert failed == 1
    assert right.strip() in account
