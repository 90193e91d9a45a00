"""Blocks that are added to a numbered program, and poles that are written once."""

import re

import pytest
from hypothesis import strategies as st
from support.backlash_paths import played
from support.corrected_lines import written
from support.programs import correct, load, random_model, setup_of, shifted
from support.tiers import drawn

from postproc.write import block_numbers
from postproc.write.block_numbers import BlockNumbers

GANTRY = load("gantry")
SETUP = setup_of(GANTRY, ["0=0,0,0"], ["T1=0"])
PROGRAM = """0 BEGIN PGM A MM
1 TOOL CALL 1 Z S1000
2 L X+1000 Y+1000 Z+500 R0 FMAX
3 L X+1010 Y+1010 Z+490 FMAX
4 ; a comment

5 L X+1800 F500
6 CC X+1810 Y+1010
7 C X+1820 Y+1010 DR+
8 C X+1800 Y+1010 DR+
9 C X+1820 Y+1010 DR-
10 CYCL DEF 32.0 TOLERANCE
11 LBL 10
12 L X+1000
13 L Z+600 FMAX M30
14 END PGM A MM
"""


def corrected(text, model, chunk=4096):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("postproc.execution.CHUNK_BLOCKS", chunk)
        lines, _ = written(text, GANTRY, model, "heidenhain", setup=SETUP)
    return lines


@pytest.mark.parametrize("model", [random_model(GANTRY, 3), played(GANTRY, X=15.0, Y=15.0)], ids=["smooth", "play"])
@pytest.mark.parametrize("chunk", [1, 4096])
def test_numbers_of_klartext_blocks_count_on(model, chunk):
    text = PROGRAM.replace("10 CYCL DEF 32.0 TOLERANCE\n", "10 STOP\n")
    lines = [line for line in corrected(text, model, chunk) if line]
    assert len(lines) > len(text.splitlines()) + 1
    numbers = [int(line.split()[0]) for line in lines]
    assert numbers == [0, *range(2, len(numbers) + 1)]  # 1 is the mark's, which the test leaves out
    assert "LBL 10" in lines[[" LBL " in line for line in lines].index(True)]


def test_steps_of_numbers_and_programs_without_them():
    stepped = re.sub(
        r"(?m)^(\d+) ", lambda match: f"{10 * int(match[1])} ", PROGRAM.replace("CYCL DEF 32.0 TOLERANCE", "STOP")
    )
    numbers = [int(line.split()[0]) for line in corrected(stepped, random_model(GANTRY, 3)) if line]
    assert sorted(set(numbers)) == numbers
    bare = re.sub(r"(?m)^\d+ ", "", PROGRAM.replace("CYCL DEF 32.0 TOLERANCE", "STOP"))
    assert not [line for line in corrected(bare, random_model(GANTRY, 3)) if re.match(r"\d", line)]


def test_numbers_of_iso_blocks_stay():
    text = "N10 G21 G90\nN20 G0 X1000 Y1000 Z500\nN30 G1 X2000 F500\nN40 X1000\nN50 M30\n"
    result = correct(text, GANTRY, random_model(GANTRY, 3))
    assert re.findall(r"(?m)^N(\d+)", result.text) == ["10", "20", "30", "40", "50"]
    assert result.report.added_blocks > 0


def test_a_pole_is_said_once():
    """A constant error moves the pole; arcs round it find it where the first has put it."""
    text = PROGRAM.replace("10 CYCL DEF 32.0 TOLERANCE\n", "10 STOP\n")
    lines = corrected(text, shifted(GANTRY, X=100.0, Y=-200.0))
    assert [line for line in lines if " CC " in line] == ["7 CC X+1809.9000 Y+1010.2000"]
    assert "9 C X+1799.9000 Y+1010.2000 DR+" in lines


NUMBERS = st.one_of(
    st.integers(0, 10**4).map(str),
    st.sampled_from(["0", "9", "99", "999", "0998", "007", "10" * 8, "10" * 9, "9" * 20, ""]),
)
LINE = st.builds(
    "{}{}{}{}".format,
    st.sampled_from(["", "", "", " ", "\t ", "   "]),
    NUMBERS,
    st.sampled_from([" L X+1", " ", "\t", "", "L X1", "\r", " L X+10 \r", " 12 13"]),
    st.sampled_from(["", " F500", " ; 7 8"]),
)


@drawn(100, 1000, 3000, lines=st.lists(LINE, max_size=12), added=st.integers(0, 1200), ended=st.booleans())
def test_numbers_of_many_lines_are_raised_as_each_by_itself(lines, added, ended):
    data = ("\n".join(lines) + "\n" * ended).encode()
    numbers = BlockNumbers(klartext=True)
    numbers._added = added
    each = re.sub(rb"(?m)^([ \t]*)(\d+)(?=[ \t])", lambda n: n[1] + b"%d" % (int(n[2]) + added), data)
    assert numbers.renumbered_lines(data) == (each if added else data)


@pytest.mark.parametrize(
    "data",
    [b"1 L X+1\n", b"10 L X+1\n  11 L X+2\n", b"8 L\n9 L\n", b"L X+1\n5 L X+2\n"],
    ids=["one", "two", "longer", "none"],
)
def test_numbers_that_keep_their_lengths_need_no_pattern(data, monkeypatch):
    numbers = BlockNumbers(klartext=True)
    numbers._added, expected = 1, re.sub(rb"(?m)\d+(?= L)", lambda n: b"%d" % (int(n[0]) + 1), data)
    if b"9 L" not in data:
        monkeypatch.setattr(block_numbers, "_NUMBER_IN_BYTES", _Once())
    assert numbers.renumbered_lines(data) == expected


class _Once:
    """A pattern for the last line alone."""

    def match(self, *_):
        return None
