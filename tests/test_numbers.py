"""Numbers keep the style they are written in, and say what they should."""

import re

import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st

from postproc.iso.reading.lines import read_block
from postproc.text.block import edited
from postproc.text.editing import Layout, WordEditor
from postproc.text.number_style import NumberStyle, decimals_for, decimals_holding, decimals_of

PLAIN = NumberStyle()


@pytest.mark.parametrize(
    ("resolution", "decimals"),
    [(1e-4, 4), (1e-3, 3), (1e-4 / 25.4, 6), (1e-3 / 25.4, 5), (0.01, 2), (0.5, 1), (1.0, 0), (10.0, 0), (2e-4, 4)],
)
def test_decimals_for_a_resolution(resolution, decimals):
    assert decimals_for(resolution) == decimals


@pytest.mark.parametrize(
    ("text", "decimals"), [("10", 0), ("10.", 0), ("-.5", 1), ("+ 1.250", 3), ("0,5", 1), ("", 0), ("FMAX", 0)]
)
def test_decimals_of_a_number(text, decimals):
    assert decimals_of(text) == decimals


@pytest.mark.parametrize(
    ("value", "decimals"), [(0.0, 0), (10.0, 0), (0.5, 1), (-1.0625, 4), (1.123456, 6), (0.1 + 0.2, 1), (1 / 3, 9)]
)
def test_decimals_that_hold_a_value(value, decimals):
    assert decimals_holding(value) == decimals


@pytest.mark.parametrize(
    ("original", "value", "written"),
    [
        ("10", 10.0123, "10.0123"),
        ("10.", 10.0123, "10.0123"),
        ("10.000", -0.0004, "-0.0004"),
        ("+10", 10.5, "+10.5000"),
        ("+10.25", -10.5, "-10.5000"),
        ("-10", 0.5, "0.5000"),
        (".5", 0.25, ".2500"),
        ("-.5", -0.25, "-.2500"),
        ("+.5", 0.25, "+.2500"),
        (".5", 10.25, "10.2500"),
        ("0.5", 0.25, "0.2500"),
        ("X-.0"[1:], 0.0123, ".0123"),
        ("+0.", 0.0123, "+0.0123"),
        ("0,5", 1.25, "1,2500"),
        ("-,5", -0.25, "-,2500"),
        ("1.123456", 1.2, "1.200000"),
        ("- 10", -10.5, "-10.5000"),
        ("0", -0.00001, "0.0000"),
        ("+0", -0.00001, "+0.0000"),
        (".0", -0.00001, ".0000"),
    ],
)
def test_style_is_kept(original, value, written):
    style = NumberStyle.of(original, PLAIN)
    assert style.write(value, max(4, decimals_of(original))) == written


def test_what_a_number_does_not_show_is_taken_from_the_program():
    signed_short = NumberStyle(plus=True, mark=",", leading_zero=False)
    assert NumberStyle.of("-10", signed_short).write(0.5, 1) == "+,5"
    assert NumberStyle.of("10", signed_short).write(0.5, 1) == ",5"
    assert NumberStyle.of("10.0", signed_short).write(0.5, 1) == ".5"
    assert NumberStyle.of("", signed_short) is signed_short


styles = st.builds(NumberStyle, st.booleans(), st.sampled_from(".,"), st.booleans())
values = st.one_of(
    st.floats(-1e6, 1e6), st.floats(-1e-3, 1e-3), st.integers(-100_000, 100_000).map(lambda n: n / 1000), st.just(-0.0)
)


@given(styles, values, st.integers(0, 8))
@example(NumberStyle(leading_zero=False), 0.4, 0)
@example(NumberStyle(leading_zero=False), -0.0, 3)
def test_a_written_number_reads_back(style, value, decimals):
    text = style.write(value, decimals)
    assert abs(float(text.replace(",", ".")) - value) <= 0.5 * 10.0**-decimals * (1 + 1e-9) + 1e-9 * abs(value)
    assert re.fullmatch(r"[+-]?\d*([.,]\d+)?", text)
    assert re.search(r"\d", text)
    assert not re.fullmatch(r"-[0.,]+", text)
    assert decimals_of(text) == decimals
    assert NumberStyle.of(text, style).mark == style.mark


texts = st.from_regex(r"[+-]?([0-9]{1,4}(\.[0-9]{0,6})?|\.[0-9]{1,6})", fullmatch=True)


@given(texts, st.floats(-0.2, 0.2), st.sampled_from([3, 4, 6]))
@example("-.0", 0.0, 4)
@example("5", 0.00005, 4)
def test_a_word_set_to_a_value(text, change, decimals):
    block = read_block(1, f"G1 X{text} (a) F100\n")
    word = block.words[1]
    editor = WordEditor(block, Layout())
    wanted = word.value + change
    said = editor.set(1, wanted, decimals)
    new = read_block(1, edited(block.text, editor.edits))
    kept = max(decimals, decimals_of(text))
    assert [w.address for w in new.words] == ["G", "X", "F"]
    assert new.words[1].value == pytest.approx(said, abs=1e-12)
    assert abs(said - wanted) <= 0.5 * 10.0**-kept + 1e-12
    written = new.text[new.words[1].start : new.words[1].end]
    assert decimals_of(written) in (kept, decimals_of(text))
    assert new.text.split(" (a)")[1] == " F100\n"
    if written != text:
        assert not re.fullmatch(r"-[0.]+", written)
        assert said != word.value
    if abs(change) < 0.49 * 10.0**-kept:
        assert new.text == block.text


@given(st.sampled_from("XYZ"), texts, st.floats(-50, 50), st.booleans(), st.booleans())
def test_an_inserted_word(address, text, value, lower, blank):
    others = [a for a in "XYZ" if a != address]
    separator = " " if blank else ""
    line = separator.join(["N5", "G1", others[0] + text, others[1] + "1.5", "F100"])
    line = line.lower() if lower else line
    block = read_block(1, line + "\n")
    editor = WordEditor(block, Layout().after(block))
    editor.insert(address, round(value, 4), 4)
    new = read_block(1, edited(block.text, editor.edits))
    order = ["N", "G", *sorted([address, *others]), "F"]
    assert [w.address for w in new.words] == order
    assume("+" not in text)
    number = new.words[order.index(address)]
    assert number.value == pytest.approx(round(value, 4))
    assert new.text.islower() == lower
    assert (" " in new.text) == blank
