"""JSON for people."""

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.tiers import drawn

from kinematics.error_model.layout import LINE_WIDTH, to_json

values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | st.text(),
    lambda inner: st.lists(inner, max_size=12) | st.dictionaries(st.text(max_size=12), inner, max_size=6),
)


@drawn(few=10, many=100, most=300, value=values)
def test_what_is_written_is_what_is_read(value):
    assert json.loads(to_json(value)) == value


@given(st.lists(st.floats(allow_nan=False, allow_infinity=False), max_size=200), st.integers(0, 5))
def test_numbers_fill_lines(numbers, depth):
    value = numbers
    for _ in range(depth):
        value = {"a name of some length": value}
    lines = to_json(value).splitlines()
    assert max(map(len, lines)) <= LINE_WIDTH
    assert len(lines) <= 3 + 2 * depth + len(json.dumps(numbers)) // 70


def test_what_fits_on_a_line_stands_on_one():
    value = {"short": {"a": 1, "b": [1.5, None]}, "long": [{"text": "x" * 70}, {"text": "y" * 70}], "none": []}
    assert to_json(value).splitlines() == [
        "{",
        '  "short": {"a": 1, "b": [1.5, null]},',
        '  "long": [',
        '    {"text": "' + "x" * 70 + '"},',
        '    {"text": "' + "y" * 70 + '"}',
        "  ],",
        '  "none": []',
        "}",
    ]


def test_text_is_left_whole():
    text = "a sentence, with commas - and more, " * 10
    assert json.loads(to_json([text, "ä" * 130])) == [text, "ä" * 130]
    assert "ä" in to_json(["ä"])


@pytest.mark.parametrize("number", [float("nan"), float("inf")])
def test_what_json_cannot_say_is_refused(number):
    with pytest.raises(ValueError, match="not JSON compliant"):
        to_json({"u": [1.0, number]})
