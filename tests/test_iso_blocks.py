"""ISO blocks: the quick way and the grammar say the same, and no character is lost."""

import re
import time
from functools import cache
from pathlib import Path

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from postproc.iso_blocks import _read_plain, parse_block, read_block
from postproc.program import Block, Refusal

FREECAD = Path(__file__).parent / "data" / "freecad"

blanks = st.text(" \t", max_size=2)
numbers = st.from_regex(r"[+-]?[ \t]?([0-9]{1,6}(\.[0-9]{0,6})?|\.[0-9]{1,6})", fullmatch=True)
addresses = st.sampled_from("GMXYZABCUVWIJKRFSTHDNOPQLExyzgmfijkr")
words = st.builds("".join, st.tuples(addresses, blanks, numbers))
inner = st.text("abcXYZ 0123.;-+é/*%#=[]_\t", max_size=12)
comments = st.one_of(
    st.just(""),
    inner.map(lambda text: f"({text})"),
    st.text("(abcXYZ) 012;.", max_size=12).map(lambda text: f";{text}"),
)
skips = st.sampled_from(["", "", "", "/", "/1", "/9 "])
line_ends = st.sampled_from(["\n", "\r\n", "", "\r", "\r\r\n"])
heads = st.sampled_from(["", "", "", "", "%", "\0\0%", "#1=5", "F#2", "X[1+2]", "IF[#1EQ2]GOTO3", "o100 sub"])


@st.composite
def blocks(draw):
    parts = draw(st.lists(st.one_of(words, words, words, comments.filter(lambda c: ";" not in c)), max_size=8))
    separated = "".join(part + draw(blanks) for part in parts)
    return draw(skips) + draw(blanks) + draw(heads) + separated + draw(comments) + draw(line_ends)


def both_ways(text: str) -> Block | None:
    """The block after checking that the two readers agree; None when it is refused."""
    quick = _read_plain(7, text)
    try:
        full = parse_block(7, text)
    except Refusal as refusal:
        assert quick is None, text
        assert refusal.reason
        return None
    if quick is not None:
        assert quick == full
    assert full.text == text
    check_words(full)
    return full


def check_words(block: Block) -> None:
    """The places of the words hold what the words say, in order and apart."""
    end = 0
    for address, value, at, start, stop in block.words:
        assert end <= at < start < stop
        assert block.text[at].upper() == address
        assert block.text[at + 1 : start].strip(" \t") == ""
        assert float(re.sub(r"[ \t]", "", block.text[start:stop])) == value
        end = stop


@given(blocks())
@example("N10 G1 X 10. Y-.5 (a) Z+ 3;b\n")
@example("g0x1y2")
@example("(only)\n")
@example("")
@example("\n")
@example("X1\x000\n")
@example("O100 (hi) if [#1 EQ 2]\n")
def test_quick_way_equals_the_grammar(text):
    both_ways(text)


@given(st.text("GXYZgxyz0123456789.+-() ;%/#=[]\t\rNMF", max_size=30))
def test_quick_way_equals_the_grammar_on_noise(text):
    both_ways(text)


def real_lines(folder: Path):
    for path in sorted((folder / "iso").rglob("*.*")) + sorted(FREECAD.glob("*.nc")):
        with path.open(encoding="latin-1", newline="\n") as file:
            yield from file


def test_every_line_of_real_programs(nc_data):
    lines = list(dict.fromkeys(real_lines(nc_data)))
    read = [both_ways(line) for line in lines]
    assert sum(block is not None for block in read) > 0.99 * len(lines) > 7000


@given(st.data())
def test_mutated_lines_of_real_programs(nc_data, data):
    lines = mutable_lines(nc_data)
    text = data.draw(st.sampled_from(lines))
    for _ in range(data.draw(st.integers(1, 3))):
        at = data.draw(st.integers(0, len(text)))
        cut = data.draw(st.integers(0, 2))
        text = text[:at] + data.draw(st.text("GX0123.-+()/; %#\t\r", max_size=2)) + text[at + cut :]
    both_ways(text)


@cache
def mutable_lines(folder: Path) -> list[str]:
    return sorted({line for line in real_lines(folder) if len(line) > 1})[::7]


def test_joining_the_blocks_of_a_program_gives_its_bytes(nc_data):
    from postproc.source import ENCODING, open_source

    for path in sorted((nc_data / "iso").rglob("*.*")) + sorted(FREECAD.glob("*.nc")):
        source = open_source(str(path))
        assert (source.mark + "".join(text for _, text in source.lines())).encode(ENCODING) == path.read_bytes()


def said(text: str) -> list[tuple[str, float | None]]:
    return [(word.address, word.value) for word in read_block(1, text).words]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("G1 X10 F100 (comment) Y20\n", [("G", 1), ("X", 10), ("F", 100), ("Y", 20)]),
        ("g1x-.5y+.5z10.\n", [("G", 1), ("X", -0.5), ("Y", 0.5), ("Z", 10)]),
        ("X  0.0238 Y - 0.09\n", [("X", 0.0238), ("Y", -0.09)]),
        ("N30G43Z25.H1M8", [("N", 30), ("G", 43), ("Z", 25), ("H", 1), ("M", 8)]),
        ("(G00 Z3) ( tool change height )\n", []),
        ("X1 ;Y2 (Z3)\n", [("X", 1)]),
        ("X-.0 Y+0.\n", [("X", 0), ("Y", 0)]),
        ("N123456 X1\n", [("N", 123456), ("X", 1)]),
        ("G54.1P48\n", [("G", 54.1), ("P", 48)]),
        ("\tX1\t\n", [("X", 1)]),
    ],
)
def test_words(text, expected):
    assert said(text) == expected


@pytest.mark.parametrize(
    ("text", "kind", "detail"),
    [
        ("%\n", "tape_mark", "%"),
        ("\0\0%O12\n", "tape_mark", "%O12"),
        ("#1=5\n", "assignment", "#1=5"),
        ("#<name>=[#2*3]\n", "assignment", "#<name>=[#2*3]"),
        ("F#1\n", "computed", "F#1"),
        ("G1 X[#1+2]\n", "computed", "X[#1+2]"),
        ("IF[#1 LT #2] THEN #1= #2\n", "keyword", "IF"),
        ("WHILE[#1GT#2]DO1\n", "keyword", "WHILE"),
        ("GOTO 10\n", "keyword", "GOTO"),
        ("o100 while [#1 lt 3]\n", "subroutine", "o100 while"),
        ("o<x> call [1]\n", "subroutine", "o<x> call"),
        ("X1 0.5\n", "number", "0.5"),  # LinuxCNC reads X10.5
        ("X1\x000\n", "number", "0"),  # a control that skips the NUL reads X10
        # one harmless value to compute must not hide another
        ("F#1 X#2\n", "compound", "F#1 X#2"),
        ("#1=5 #5221=10\n", "compound", "#1=5 #5221=10"),
        ("#1=5 X#1\n", "compound", "#1=5 X#1"),
    ],
)
def test_constructs(text, kind, detail):
    block = read_block(1, text)
    assert (block.kind, block.detail) == (kind, detail)


@pytest.mark.parametrize("text", ["/N10 X1\n", "N10 /X1\n", "/2 X1\n", "/ X1"])
def test_skip(text):
    assert read_block(1, text).skippable


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("G1 Z-1. F200. (PLUNGE (NESTED?) )\n", "parentheses that do not match, or one inside another"),
        ("X10. (UNCLOSED\n", "parentheses that do not match"),
        ("X10.) Y5\n", "parentheses that do not match"),
        ("(a(b\n", "parentheses that do not match"),
        ("G1 X10 *5\n", "column 8: '*5' is not understood"),
        ("X\n", "is not understood"),
        ("X.\n", "is not understood"),
        ("X10 Y\n", "is not understood"),
        ("G1 X=10\n", "is not understood"),
        ("TRAORI\n", "is not understood"),
        ("fanuc.nc (FREECAD-FILENAME)\n", "is not understood"),
        ("X1,5\n", "column 3: ',5' is not understood"),
        ("G1 X10 ,R2\n", "',R2' is not understood"),
        ("X1\xa0Y2\n", "is not understood"),
        ("X\xb2\n", "is not understood"),
        # a line end that only some controls see would hide the words behind it in a comment
        ("G1 X1 ; a\rG1 X2\n", "is not understood"),
        ("G1 X1 (a\rX2)\n", "parentheses that do not match"),
        ("G1 X1\rX2\n", "is not understood"),
        ("%\rX2\n", "is not understood"),
    ],
)
def test_refusals(text, message):
    with pytest.raises(Refusal, match=re.escape(message)) as caught:
        read_block(3, text)
    assert caught.value.line == 3


def test_long_blocks_take_no_longer_than_their_length():
    digits = " ".join(f"{letter}{'1' * 12}" for letter in "GXYZABCIJKRFSTHDNOPQLE")
    padded = "".join(f"{letter}{' ' * 12}1" for letter in "GXYZABCIJKRFSTHDNOPQLE")
    start = time.perf_counter()
    for text in (digits, padded):
        assert len(read_block(1, text).words) == 22
        with pytest.raises(Refusal):
            read_block(1, text + " (a(b))")
    assert time.perf_counter() - start < 1.0


def test_a_very_long_line():
    text = "X1 " * 100_000 + "(" + "a" * 100_000 + ")\n"
    assert len(read_block(1, text).words) == 100_000
