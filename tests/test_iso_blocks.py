"""ISO blocks: the quick way and the grammar say the same, and no character is lost."""

import re
import time
from functools import cache
from pathlib import Path

import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from support.iso_lines import blocks
from support.real_data import FREECAD

from postproc.iso.reading.blocks import plain_block
from postproc.iso.reading.grammar import parse_block
from postproc.iso.reading.lines import read_block
from postproc.text.block import Block, Refusal
from postproc.text.expressions import Constant, Operation, Variable
from postproc.text.statements import Assign, Begin, Call, End, Jump, Return, When


def both_ways(text: str) -> Block | None:
    """The block after checking that the two readers agree; None when it is refused."""
    quick = plain_block(7, text)
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
    for address, value, at, start, stop, formula, *_ in block.words:
        assert end <= at < start < stop
        assert block.text[at].upper() == address
        assert block.text[at + 1 : start].strip(" \t") == ""
        if formula is None:
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
    from postproc.text.source import ENCODING, open_source

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
        ("#1=5\n", "control", ""),
        ("F#1\n", "words", ""),
        ("X1 0.5\n", "number", "0.5"),  # LinuxCNC reads X10.5
        ("X1\x000\n", "number", "0"),  # a control that skips the NUL reads X10
    ],
)
def test_constructs(text, kind, detail):
    block = read_block(1, text)
    assert (block.kind, block.detail) == (kind, detail)


ONE, TWO, THREE = Constant(1.0), Constant(2.0), Constant(3.0)
FIRST, SECOND = Variable("#", (ONE,)), Variable("#", (TWO,))


@pytest.mark.parametrize(
    ("text", "step"),
    [
        ("#1=3\n", Assign(FIRST, THREE)),
        ("#<A b>=[#2*3]\n", Assign(Variable("#<ab>"), Operation("*", (SECOND, THREE)))),
        ("##1=[-2]**3\n", Assign(Variable("#", (FIRST,)), Operation("**", (Operation("neg", (TWO,)), THREE)))),
        ("#1=1-2-3\n", Assign(FIRST, Operation("-", (Operation("-", (ONE, TWO)), THREE)))),
        ("#1=1+2mod3\n", Assign(FIRST, Operation("+", (ONE, Operation("MOD", (TWO, THREE)))))),
        ("#1=ATAN[1]/[2]\n", Assign(FIRST, Operation("ATAN2", (ONE, TWO)))),
        ("IF[#1 LT #2] THEN #1= #2\n", When(Operation("LT", (FIRST, SECOND)), Assign(FIRST, SECOND))),
        ("IF[#1EQ2]GOTO3\n", When(Operation("EQ", (FIRST, TWO)), Jump(THREE))),
        ("WHILE[#1GT#2]DO1\n", Begin("WHILE", "DO1", Operation("GT", (FIRST, SECOND)))),
        ("END1\n", End("WHILE", "DO1")),
        ("GOTO 2\n", Jump(TWO)),
        ("o100 while [#1 lt 3]\n", Begin("WHILE", "O100", Operation("LT", (FIRST, THREE)))),
        ("o<X> call [1] [#2]\n", Call("O<x>", ((1, ONE), (2, SECOND)), begun=True)),
    ],
)
def test_statements(text, step):
    block = read_block(1, text)
    assert block.code.before == (step,)
    assert block.words == ()


@pytest.mark.parametrize(
    ("text", "words", "step"),
    [
        ("N5 M98 P2 L3\n", "N", Call(Operation("program", (TWO,)), None, THREE)),
        ("G1 X5 M98 P2\n", "GX", Call(Operation("repeated program", (TWO,)), None, Operation("repetitions", (TWO,)))),
        ("G65 P2 A1. X#1\n", "", Call(Operation("program", (TWO,)), ((1, ONE), (24, FIRST)), None)),
        ("M99\n", "", Return("M99 outside of a subprogram repeats the program without end: write M30")),
    ],
)
def test_calls(text, words, step):
    block = read_block(1, text)
    assert block.code.after == (step,)
    assert "".join(word.address for word in block.words) == words


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("#1=5 X#1\n", "variable assigned and used in the same block"),
        ("#1=5 #2=#[#3]\n", "variable assigned and used in the same block"),
        ("#1=[#2 EQ 1 AND #3 EQ 2]\n", "this condition depends on the control: write brackets"),
        ("#1=[1 LT #2 LT 3]\n", "this condition depends on the control: write brackets"),
        ("#1=[[#1 EQ 1] AND [#2 EQ 2] OR [#3 EQ 3]]\n", "this condition depends on the control: write brackets"),
        ("#1=ATAN[1]/2\n", "a division after ATAN depends on the control"),
        ("#1=5 M98 P5\n", "must be the only call, jump or loop of its block"),
        ("M98\n", "M98 needs P, the number of the program"),
        ("M99 P5 L2\n", "M99 with L or Q"),
        ("G65 P5 X1. X2.\n", "the call has two words of one address"),
        ("#5=1 GOTO 5\n", "must be the only statement of its block"),
    ],
)
def test_statements_that_controls_read_differently(text, message):
    with pytest.raises(Refusal, match=re.escape(message)):
        read_block(1, text)


@pytest.mark.parametrize("text", ["/N10 X1\n", "N10 /X1\n", "/2 X1\n", "/ X1"])
def test_skip(text):
    assert read_block(1, text).skippable


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("G1 Z-1. F200. (PLUNGE (NESTED?) )\n", "controls differ in parentheses that do not match"),
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
        ("G1 X10.,C#1\n", ",C#1 breaks the corner by a chamfer, and is corrected as a number only"),
        ("G1 X10.,A[#1+5]\n", "gives the end of the line by its angle, and is corrected as a number only"),
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
