"""HEIDENHAIN Klartext: blocks as the grammar and the quick way read them, and what they do to the axes."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from support.klartext_run import Run, blocks_of, numbered_lines
from support.thesis_kinematics import thesis_forward
from support.tiers import quick

import machines
from postproc.control.setup import make_setup
from postproc.heidenhain.blocks import _read_plain, join_lines, parse_block, read_block
from postproc.heidenhain.interpreter import HeidenhainInterpreter
from postproc.motion.moves import Kind, Known
from postproc.text.block import Refusal
from postproc.text.notes import Notes

FREECAD = Path(__file__).parents[2] / "shared" / "reference" / "freecad" / "samples" / "box_heidenhain.h"


def real_files(nc_data):
    files = sorted(path for path in (nc_data / "heidenhain").rglob("*") if path.is_file())
    assert len(files) == 12
    return files


def text_of(path):
    return path.read_bytes().decode("latin-1")


@pytest.fixture(scope="session")
def klartext_lines(nc_data):
    """Every distinct joined block of the real programs."""
    return sorted({part for path in real_files(nc_data) for _, part in join_lines(numbered_lines(text_of(path)))})


HEAD = "0 BEGIN PGM T MM\n1 TOOL CALL 1 Z S1000\n2 L X+10 Y+20 Z+50 R0 FMAX M3\n"


def run(text, **options):
    return Run(HEAD + text, **options)


# ---- blocks


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("L X+1\nL X+2\n", [(1, "L X+1\n"), (2, "L X+2\n")]),
        ("CYCL DEF 247 X~\r\nQ339=1; N\r\nM5\r\n", [(1, "CYCL DEF 247 X~\r\nQ339=1; N\r\n"), (3, "M5\r\n")]),
        ("7 A ~ \t\n Q1=1 ;B ~\n Q2=2 ;C\n8 M5", [(1, "7 A ~ \t\n Q1=1 ;B ~\n Q2=2 ;C\n"), (4, "8 M5")]),
        ("; a ~ b\nM5 ~", [(1, "; a ~ b\n"), (2, "M5 ~")]),
        ("\n\nM5~\n", [(1, "\n"), (2, "\n"), (3, "M5~\n")]),
        ("", []),
    ],
)
def test_lines_join_behind_a_tilde(text, expected):
    assert list(join_lines(numbered_lines(text))) == expected


def test_joining_is_lossless_on_real_programs(nc_data):
    for path in real_files(nc_data):
        text = text_of(path)
        joined = list(join_lines(numbered_lines(text)))
        assert "".join(part for _, part in joined) == text
        starts = np.cumsum([1, *(part.count("\n") for _, part in joined[:-1])])
        assert [line for line, _ in joined] == starts.tolist()


GOLDEN = [
    ("", "blank", [], ""),
    ("12\n", "blank", [], ""),
    ("4 ;(D=6.00 R=0.00)\r\n", "blank", [], ""),
    ("5 * - ROUGHING\n", "blank", [], ""),
    ("11 L X-65.628 Y-7. FMAX M3\n", "line", "X=-65.628 Y=-7. FMAX M=3", ""),
    ("L IZ-2,5 F100 ; down\n", "line", "IZ=-2,5 F=100", ""),
    ("L X + 0 Y-.5 R F M\n", "line", "X=+ 0 Y=-.5 R F M", ""),
    ("l x3 rl f max\n", "line", "X=3 RL FMAX", ""),
    ("LX+1Y+2R0FMAXM91", "line", "X=+1 Y=+2 R0 FMAX M=91", ""),
    ("7 L X-Q1 IY+QL12 FQ3 M8 S6000", "line", "X=-Q1 IY=+QL12 F=Q3 M=8 S=6000", ""),
    ("L Z+5 F AUTO", "line", "Z=+5 FAUTO", ""),
    ("L X+1 FU0.1 M140 MB 50 M120 LA5 M124 T0,01", "line", "X=+1 FU=0.1 M=140 MB=50 M=120 LA=5 M=124 T=0,01", ""),
    ("L X+1 ; first ~\r\n Y+2 ~\r\n FMAX\r\n", "line", "X=+1 Y=+2 FMAX", ""),
    ("0140 B74.995 C270. M91", "line", "B=74.995 C=270. M=91", ""),
    ("X+46 R+ F100", "line", "X=+46 R+ F=100", ""),
    ("M140 MB MAX\r\n", "miscellaneous", "M=140 MBMAX", ""),
    ("M94 C", "miscellaneous", "M=94 C", ""),
    ("13 STOP M0", "stop", "M=0", "STOP"),
    ("7 CC X60.000 IY+0", "centre", "X=60.000 IY=+0", "CC"),
    ("CC", "centre", [], "CC"),
    ("8 C X62.500 Y40.000 DR- R0 F10 M", "circle", "X=62.500 Y=40.000 DR- R0 F=10 M", "C"),
    ("98 CR X+37,5 Y-20,876 R+2,5 DR- F500", "circle_radius", "X=+37,5 Y=-20,876 R=+2,5 DR- F=500", "CR"),
    ("CR X1 Y2 R0.5 DR+ R0", "circle_radius", "X=1 Y=2 R=0.5 DR+ R0", "CR"),
    ("CR X+Q1 R+Q62 DR+", "circle_radius", "X=+Q1 R=+Q62 DR+", "CR"),
    ("LN X1 NX0,5 TZ1", "normal_line", "X=1 NX=0,5 TZ=1", "LN"),
    ("LP PR+5 PA+Q7", "polar_line", "PR=+5 PA=+Q7", "LP"),
    ("24 CP IPA-360 IZ+2 DR- FQ14", "polar_circle", "IPA=-360 IZ=+2 DR- F=Q14", "CP"),
    ("CT X+1 Y+2", "tangent", "X=+1 Y=+2", "CT"),
    ("CTP PR5 PA+3", "polar_tangent", "PR=5 PA=+3", "CTP"),
    ("96 RND R0,5", "rounding", [], "RND R0,5"),
    ("CHF 2", "chamfer", [], "CHF 2"),
    ("APPR LT X+Q11 IZ - 2.5 LEN10 RR", "approach", "X=+Q11 IZ=- 2.5 LEN=10 RR", "APPR LT"),
    ("DEP LCT X+1 R5 F9", "departure", "X=+1 R=5 F=9", "DEP LCT"),
    ("FL AN+40", "free_contour", [], "FL AN+40"),
    ("0 BEGIN PGM  XG MM \r\n", "begin_pgm", [], "BEGIN PGM XG MM"),
    ("267 END PGM 100 INCH", "end_pgm", [], "END PGM 100 INCH"),
    ("BLK FORM 0.1 Z X+0 Y-Q2 Z-5", "blank_form", [], "BLK FORM 0.1 Z X+0 Y-Q2 Z-5"),
    ("5 TOOL CALL  5 Z S4500 F10 DL+0,2 DR2-0.1", "tool_call", "T=5 Z S=4500 F=10 DL=+0,2 DR2=-0.1", "TOOL CALL"),
    ("TOOL CALL  DL-Q108", "tool_call", "DL=-Q108", "TOOL CALL"),
    ('TOOL CALL "MILL 5" Z S1', "tool_call", 'T="MILL 5" Z S=1', "TOOL CALL"),
    ("TOOL CALL Q11 Z DL2.5", "tool_call", "T=Q11 Z DL=2.5", "TOOL CALL"),
    ("TOOL DEF 1 L+100 R+5", "tool_def", "T=1 L=+100 R=+5", "TOOL DEF"),
    ("CYCL DEF 7.0 NULLPUNKT", "cycle_def", [], "CYCL DEF 7.0 NULLPUNKT"),
    ("CYCL DEF 7.1 X+0 IY-1", "cycle_def", "X=+0 IY=-1", "CYCL DEF 7.1"),
    ("CYCL DEF 7.1 #5", "cycle_def", "#5", "CYCL DEF 7.1"),
    ("CYCL DEF 8.1 X Y", "cycle_def", "X Y", "CYCL DEF 8.1"),
    ("CYCL DEF 10.1 IROT+30", "cycle_def", "IROT=+30", "CYCL DEF 10.1"),
    ("CYCL DEF 5.2 DEPTH -5,900", "cycle_def", [], "CYCL DEF 5.2 DEPTH -5,900"),
    ("CYCL DEF 247 SET~\r\nQ339=1; NO\r\n", "cycle_def", "Q339=1", "CYCL DEF 247 SET"),
    ("CYCL DEF 20 A ~\n Q1=-15 ;D ~\n Q2=+Q9 ;E\n", "cycle_def", "Q1=-15 Q2=+Q9", "CYCL DEF 20 A"),
    ("CYCL DEF 200 A Q200=2 Q201=-.5", "cycle_def", "Q200=2 Q201=-.5", "CYCL DEF 200 A"),
    ("CYCL CALL POS X+1 FMAX", "cycle_position", "X=+1 FMAX", "CYCL CALL POS"),
    ("CYCL CALL PAT FMAX M3", "cycle_call", [], "CYCL CALL PAT FMAX M3"),
    ("Q2 = COS ( Q1 * ~\n 2 ) + 5 ; c", "control", [], ""),
    ("FN 12: IF +Q4 LT +18,85 GOTO LBL 2", "control", [], ""),
    ("FN18: SYSREAD Q32 = ID270", "fn", [], "FN18: SYSREAD Q32 = ID270"),
    ("LBL 1 ;contour", "control", [], ""),
    ("CALL LBL 1 REP 25/25", "control", [], ""),
    ("CALL PGM TNC:\\a.h", "program_call", [], "CALL PGM TNC:\\a.h"),
    ('SEL TABLE ~\n "a.d"', "selection", [], 'SEL TABLE "a.d"'),
    ("PLANE RESET STAY", "plane", [], "PLANE RESET STAY"),
    ("PLANE SPATIAL SPA+0 SPB-Q1 TURN F MAX SEQ-", "plane", "SPA=+0 SPB=-Q1", "PLANE SPATIAL TURN F MAX SEQ-"),
    ("PLANE POINTS P1X+1,5 P3Z-2 MOVE DIST50 F9", "plane", "P1X=+1,5 P3Z=-2 DIST=50 F=9", "PLANE POINTS MOVE"),
    ("FUNCTION TCPM F TCP AXIS POS", "function", [], "FUNCTION TCPM F TCP AXIS POS"),
    ("TCH PROBE 412 IN ~\n Q321=0 ;C\n", "probe", [], "TCH PROBE 412 IN Q321=0"),
    ("PATTERN DEF POS1 (X+1 Y+2 Z+0)", "definition", [], "PATTERN DEF POS1 (X+1 Y+2 Z+0)"),
    ("TRANS DATUM AXIS X+1", "transformation", "X=+1", "TRANS DATUM AXIS"),
    ("TRANS MIRROR AXIS X", "transformation", [], "TRANS MIRROR AXIS X"),
]


def shown(block):
    """The words of a block as in the table above, each from its span."""
    texts = []
    for word in block.words:
        number = block.text[word.start : word.end]
        texts.append(word.address + ("=" + number if number and word.address[0] != "#" else ""))
    return " ".join(texts)


@pytest.mark.parametrize(("text", "kind", "words", "detail"), GOLDEN)
def test_blocks(text, kind, words, detail):
    block = read_block(1, text)
    assert (block.kind, shown(block), block.detail) == (kind, words or "", detail)
    assert block.text == text
    assert not block.skippable


def test_words_say_the_numbers_that_stand_in_their_spans(klartext_lines):
    for text in klartext_lines:
        for word in read_block(1, text).words:
            number = text[word.start : word.end]
            assert 0 <= word.at <= word.start <= word.end <= len(text)
            if word.value is not None:
                assert float("".join(number.replace(",", ".").split())) == word.value
            elif number:
                assert "Q" in number


@pytest.mark.parametrize("text", ["/ L X+1", "15 / L X+1", "15 /15 L X+1", "/"])
def test_block_skip(text):
    assert read_block(1, text).skippable


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("L X+10 H5", "column 8: 'H5' is not understood"),
        ("N10 G1 X5", "column 1: 'N10 G1 X5' is not understood"),
        ("L X+10..5", "column 8: '.5' is not understood"),
        ("CR X+1 Y+2 R+nan DR+", "column 14: 'nan DR+' is not understood"),
        ("CYCL DEF", "the block is not complete"),
        ("; comment ~\nL X+10", "line 2 of this comment, 'L X+10', may be a block that the control does not run"),
        ("L X+10 ~", "column 8: '~' is not understood"),
        ("L X+1\rL X+2", "column 6: 'L X+2' is not understood"),
        ("IF Q1 = 3 THEN", "column 1: 'IF Q1 = 3 THEN' is not understood"),
        ("TOOL CALL 5 Z S(VC=100)", "column 15: 'S(VC=100)' is not understood"),
    ],
)
def test_what_is_not_klartext_is_refused_with_its_column(text, reason):
    with pytest.raises(Refusal) as fault:
        read_block(7, text)
    assert (fault.value.line, fault.value.reason.rpartition(":")[0]) == (7, reason)


# ---- the quick way

PIECES = (
    *(
        "L",
        "X",
        "IY",
        "z",
        "B",
        "C",
        "I",
        "F",
        "FMAX",
        "F MAX",
        "FU",
        "FZ",
        "R",
        "R0",
        "RL",
        "RR",
        "R+",
        "M",
        "MB",
        "S",
    ),
    *("Q1", "DR+", "LA", "T", "+", "-", " ", "  ", "\t", "0", "10", "2.5", "2,5", ".5", "7.", ";a", "; b ~", "~", "\n"),
    *("\r\n", "/", "*", "CC", "\r"),
)


def agree(text):
    """The quick way reads nothing that the grammar does not, and nothing otherwise."""
    plain = _read_plain(3, text)
    if plain is not None:
        assert plain == parse_block(3, text)
    return plain


@given(st.lists(st.sampled_from(PIECES), max_size=12))
@example([";a", "\n", "X"])
@example([";a", "\n", "L"])
def test_quick_way_equals_the_grammar_on_generated_blocks(pieces):
    agree("".join(pieces))
    agree("5 L" + " ".join(pieces))


@given(st.data())
def test_quick_way_equals_the_grammar_on_mutated_real_blocks(klartext_lines, data):
    text = data.draw(st.sampled_from(klartext_lines))
    for _ in range(data.draw(st.integers(1, 3))):
        i = data.draw(st.integers(0, len(text)))
        j = data.draw(st.integers(i, min(len(text), i + 3)))
        text = text[:i] + data.draw(st.sampled_from(["", *PIECES])) + text[j:]
    agree(text)


@pytest.mark.parametrize(
    "text", ["RR0", "RRL", "R0.5", "FU0.1", "FZ2 Z1", "M140 MB 50", "MB5", "FMAX5", "M 3 4", "R 0"]
)
def test_quick_way_leaves_near_misses_to_the_grammar(text):
    assert agree("L X+1 " + text) is None


def test_quick_way_equals_the_grammar_on_real_programs(klartext_lines):
    plain = sum(agree(text) is not None for text in klartext_lines)
    assert plain > 0.9 * len(klartext_lines)


# ---- moves


def test_absolute_and_incremental_moves():
    program = run("L IX+2,5 Y-7.\nL IZ-10 IX-0.5 F100\nZ+1 FMAX\n")
    assert program.program().tolist() == [[10, 20, 50], [12.5, -7, 50], [12, -7, 40], [12, -7, 1]]
    assert program.axes()[:, 2].tolist() == [150, 150, 140, 101]  # tool length 100
    assert program.motions.kind.tolist() == [Kind.RAPID, Kind.LINE, Kind.LINE, Kind.RAPID]
    assert [[word[1:] for word in words] for words in program.motions.words[1:]] == [
        [(0, True), (1, False)],
        [(0, True), (1, True)],
        [(0, False)],
    ]
    assert not program.notes.texts()


def test_inch_programs_have_rotary_axes_in_degrees():
    program = Run("BEGIN PGM T INCH\nTOOL DEF 7 L+2\nTOOL CALL 7 Z DL-0,5\nL X+1 Z+2 B+30\n", lengths=())
    assert program.program("XZB").tolist() == [[25.4, 50.8, 30]]
    assert np.allclose(program.axes("XZB"), [[25.4, 3.5 * 25.4, 30]], rtol=0, atol=1e-9)
    assert program.motions.unit.tolist() == [25.4]


@pytest.mark.parametrize("head", ["BEGIN PGM MM\n", "BEGIN PGM X\n", "BEGIN PGM\n", ""])
def test_a_missing_unit_is_mm(head):
    program = Run(head + "L X+1\n")
    assert program.program("X").tolist() == [[1]]
    assert bool(program.notes.texts()) == (head != "BEGIN PGM MM\n")


def test_presets_are_work_offsets_by_number():
    offsets = ("0=1,2,3", "12=10,20,-5,C=30")
    program = run("CYCL DEF 247 DATUM ~\n Q339=+12 ;NO\nL X+0 Y+0 Z+0 C+5\n", offsets=offsets)
    assert program.axes("XYZC").tolist() == [[11, 22, 153, 0], [10, 20, 95, 35]]
    assert program.interpreter.control_state.used_offsets == {"0": "X 1, Y 2, Z 3", "12": "X 10, Y 20, Z -5, C 30"}


def test_machine_coordinates_last_one_block():
    program = run("L Z+399 FMAX M91\nL X+1\n", offsets=("0=5,0,0",))
    assert program.axes().tolist() == [[15, 20, 150], [15, 20, 399], [6, 20, 399]]
    assert program.motions.kind.tolist() == [Kind.RAPID, Kind.MACHINE, Kind.LINE]
    assert program.known("Z") == Known.MACHINE


def test_tool_calls_change_the_length():
    text = "L Z+0\nTOOL CALL DL+0,25\nL Z+0\nTOOL CALL 2 Z\nL Z+0\nTOOL CALL 0\nL Z+200\n"
    program = run(text, lengths=("T1=100", "T2=50.5"))
    assert program.axes("Z")[1:].tolist() == [[100], [100.25], [50.5], [200]]
    assert [frame.tool_length for frame in program.motions.frames] == [0, 100, 100.25, 50.5, 0]


def test_speed_alone_keeps_tool_and_position():
    program = run("TOOL CALL S6000 F100\nTOOL DEF 5\nL IZ-1\n")
    assert program.program()[-1].tolist() == [10, 20, 49]


@pytest.mark.parametrize("change", ["TOOL CALL 2 Z S1", "L M6", "M140 MB MAX", "M140 MB 50"])
def test_what_leaves_the_tool_axis_elsewhere_forgets_it(change):
    program = run(f"{change}\nL X+0\n")
    assert program.known("Z") == Known.ASSUMED
    assert program.known("X") == Known.PROGRAM
    assert program.axes("Z")[-1] == 400  # home


def test_retraction_along_a_swivelled_tool_forgets_all_linear_axes():
    assert run("M140 MB MAX\n", machine="head_head").known("X") == Known.ASSUMED
    assert run("M128\nM140 MB MAX\n").known("X") == Known.ASSUMED


def test_tool_change_by_m6_comes_behind_the_move():
    program = run("L Z+90 M6\n")
    assert program.program("Z")[-1] == 90
    assert program.known("Z") == Known.ASSUMED


def test_m128_by_hand_with_a_turned_table():
    # C = 90 turns the workpiece frame: the point (10, 20) of the workpiece lies at (20, -10) of the machine
    program = run("L C+90 R0 FMAX\nL X+10 Y+20 Z+30 F500 M128\nL X+12\nL Y+0 M129\nL X+1\n")
    expected = [[10, 20, 150], [10, 20, 150], [20, -10, 130], [20, -12, 130], [0, -12, 130], [1, -12, 130]]
    assert np.allclose(program.axes(), expected, rtol=0, atol=1e-9)
    assert [frame.tcp for frame in program.motions.frames] == [False, False, True, False]
    assert program.notes.count.keys() == {
        "M128: X Y Z are taken as the tool point in the workpiece frame, which turns with a table"
    }


@pytest.mark.parametrize(
    ("on", "off"),
    [("M128", "M129"), ("M128 F1000", "L M129"), ("FUNCTION TCPM F TCP AXIS POS PATHCTRL AXIS", "FUNCTION RESET TCPM")],
)
def test_m128_follows_the_kinematics(on, off):
    program = run(f"{on}\nL X+10 Y+20 Z+30 B+25 C+40\nL IX+1 IZ-2 IB+5 IC-3\n{off}\nL IX+1\n", offsets=("0=3,-4,7",))
    X, Y, Z, B, C = program.axes("XYZBC")[1:3].T
    tip, axis = thesis_forward(X, Y, Z, np.radians(B), np.radians(C))
    tip -= 100 * axis
    assert np.allclose(tip, [[13, 16, 37], [14, 16, 35]], rtol=0, atol=1e-9)
    assert np.allclose([B, C], [[25, 30], [40, 37]], rtol=0, atol=1e-12)
    assert np.allclose(program.axes("XYZ")[3] - program.axes("XYZ")[2], [1, 0, 0], rtol=0, atol=1e-9)


def test_blocks_behind_the_end_do_not_run():
    program = run("L Z+100 M30\nL X+5 RR\nL X+9\nEND PGM T MM\n")
    assert len(program.motions) == 2
    assert program.notes.texts() == [
        "blocks after the end of the program do not run and stay as programmed (line 5, 2 times)"
    ]


def test_unknown_functions_are_noted():
    program = run("L X+1 M77\nM77\nFN 19: PLC =+1\n")
    assert program.notes.texts() == [
        "M77 is not known to ncomp and is taken to move nothing and to set no variable (line 4, 2 times)",
        "FN 19 passes values to the PLC and is taken to move nothing (line 6)",
    ]


# ---- arcs

TO_ARC = "L X+20 Y+0\n"


def test_arc_about_a_pole():
    program = run(TO_ARC + "CC X+0 Y+0\nC X+0 Y+20 Z+40 DR+ R0 F100\nC Y+20 DR-\nCC\nCC IX-5\nC X+0 Y+20 DR+\n")
    assert program.motions.kind.tolist()[2:] == [Kind.ARC] * 3
    first, full, relative = program.motions.arcs.values()
    x, y, z = (program.machine.index(name) for name in "XYZ")
    assert first == ((x, y, z), 1, (0, 0), False, "pole", (0, 1), 4, 0, 1)
    assert program.program()[2].tolist() == [0, 20, 40]
    assert (full.sense, full.full) == (-1, True)
    # the pole of the last arc: 5 to the left of where the tool stands, at its height; an increment is no place to edit
    assert (relative.centre, relative.words, relative.pole_block) == ((-5, 20), (None, None), 8)


def test_a_partial_pole_keeps_the_other_coordinate():
    program = run(TO_ARC + "CC X+0 Y+0\nCC X+30\nC X+40 Y+0 DR+\n")
    (arc,) = program.motions.arcs.values()
    assert (arc.centre, arc.words, arc.pole_block) == ((30, 0), (0, None), 5)


def test_the_pole_of_an_earlier_chunk_has_no_place():
    program = run(TO_ARC + "CC X+0 Y+0\n")
    motions = program.interpreter.read(blocks_of("C X+0 Y+20 DR+\n"))
    assert motions.arcs[0][2:7] == ((0, 0), False, "pole", (None, None), -1)
    assert motions.start[0].tolist() == program.motions.target[-1].tolist()


@pytest.mark.parametrize(
    ("words", "sense", "centre"),
    [
        ("R+10 DR+", 1, (10, 0)),
        ("R+10 DR-", -1, (20, 10)),
        ("R-10 DR+", 1, (20, 10)),
        ("R-10 DR- R0", -1, (10, 0)),
        ("DR+ R10,0 R F100 M", 1, (10, 0)),
    ],
)
def test_arc_by_radius(words, sense, centre):
    program = run(TO_ARC + f"CR X+10 Y+10 {words}\n")
    (arc,) = program.motions.arcs.values()
    assert (arc.sense, arc.full, arc.form) == (sense, False, "radius")
    assert np.allclose(arc.centre, centre, rtol=0, atol=1e-9)
    block = program.motions.blocks[-1]
    word = block.words[arc.words[0]]
    assert (word.address, abs(word.value)) == ("R", 10)


def test_inch_arcs():
    text = "BEGIN PGM T INCH\nL X+1 Y+0\nCC X+0 Y+0\nC X+0 Y+1 DR+\nCR X-1 Y+0 R+1 DR+\n"
    arcs = list(Run(text).motions.arcs.values())
    assert np.allclose([arc.centre for arc in arcs], 0, rtol=0, atol=1e-9)


# ---- what is refused, and what is not

REFUSED = [
    ("L X+Q1", "X+Q1: Q1 is not set by the program"),
    ("L IY-QL3", "IY-QL3: QL3 is not set by the program"),
    ("L X+1 R+", "R+: radius compensation of single axes"),
    ("M128\nL X+1 RR", "tool radius compensation under TCP is not corrected"),
    ("X+46 R+", "R+: radius compensation"),
    ("L A+5", "machine dmu50 (w C B b X Y Z t) has no axis A"),
    ("L X+1 IX+2", "two X words"),
    ("L X", "the axis X has no coordinate"),
    ("M3 X+5", "coordinates and no path function"),
    ("L IC+5", "an increment of C needs a known start"),
    ("TOOL CALL 2 Z\nL IZ+1", "an increment of Z needs a known start"),
    ("/L X+1", "the block-skip switch decides whether this block runs"),
    ("/M6", "the block-skip switch decides whether this block runs"),
    ("/TOOL CALL 2", "the block-skip switch decides whether this block runs"),
    ("L IX+1 M91", "an increment in machine coordinates"),
    ("CR X+1 R+5 DR+ M91", "M91 needs a straight line"),
    ("M128\nL Z+0 M91", "M91 while M128 is on"),
    ("M128\nTOOL CALL 2 Z", "a tool is called while M128 is on"),
    *((f"L X+1 M{code}", f"M{code} ") for code in (97, 98, 101, 104, 112, 114, 130, 142, 144, 150, 200)),
    ("L X+1 M118 Z1", "M118 superimposes moves of the handwheel, which are not known"),
    ("M138 C", "M138 selects the axes that M128 compensates, which is not followed"),
    ("C X+10 Y+20 DR+", "the block has no pole in the present frame"),
    ("CC X+0 Y+0\nC X+10 Y+0 DR+", "the arc is no circle: its radius is"),
    ("CC X+0 Y+0\nC X-10 Y-20", "the arc has no single sense of rotation"),
    ("CC X+0 Y+0\nC DR+", "the arc has no end point"),
    ("CC X+0", "has one coordinate, and no earlier pole gives the other"),
    ("CC X+0 X+1", "has one coordinate twice"),
    ("CC X+0 B+0", "the coordinates of the pole (CC) are in no plane"),
    ("CC X+Q1 Y+0", "X+Q1: Q1 is not set by the program"),
    ("CC X+0 Y+0\nM128\nC X-10 Y-20 DR+", "the block has no pole in the present frame"),
    ("CC X+0 Y+0\nCYCL DEF 247 A Q339=1\nC X-10 Y-20 DR+", "the block has no pole in the present frame"),
    ("CR X+0 Y+0 DR+", "CR has no radius"),
    ("CR X+0 Y+0 R DR+", "CR has no radius"),
    ("CR X+0 Y+0 R+5 DR+", "no circle of this radius joins start and end"),
    ("CR X+0 Y+0 R+Q5 DR+", "R+Q5: Q5 is not set by the program"),
    ("CR X+0 Y+0 R+50", "the arc has no single sense of rotation"),
    ("LP PR+1", "the block has no pole in the present frame"),
    ("CC X+0 Y+0\nLP", "no polar coordinates"),
    ("CC X+0 Y+0\nLP PR+1 IPR+2", "two PR words"),
    ("CC X+0 Y+0\nLP IPR-50", "the polar radius PR is not above 0"),
    ("CC X+0 Y+0\nLP PR+1 X+2", "Cartesian and polar coordinates are mixed in the plane of the pole"),
    ("CC X+0 Y+0\nCP IPA-90 DR+", "IPA and DR have different signs"),
    ("CC X+0 Y+0\nCP PA+90", "the arc has no single sense of rotation"),
    ("CC X+0 Y+0\nCP IZ+1 DR+", "no polar coordinates"),
    ("CC X+10 Y+0\nCP PA+90 DR+", "CP ends at the angle at which it starts"),
    ("CC X+0 Y+0\nCP PR+5 PA+90 DR+", "CP takes no radius PR"),
    ("CP IPA+90 DR+", "the block has no pole in the present frame"),
    ("M140 MB MAX\nCT X+1", "a tangential arc needs a move in its plane directly before it"),
    ("L X+20\nRND R1\nCT X+1", "directly after RND or CHF"),
    ("L X+20\nCT X+30", "the tangential arc is a straight line"),
    ("APPR LT LEN5 RL", "needs the first point of the contour"),
    ("APPR PLT PR+1 PA+2 LEN5", "an approach in polar coordinates"),
    ("DEP LT LEN1\nL IX+5", "an increment of X needs a known start"),
    ("FL X+1", "free contours (FK) are not corrected"),
    ("CYCL CALL M3", "M99 or CYCL CALL has no cycle to run"),
    ("CYCL CALL POS X+5", "CYCL CALL POS needs an absolute position"),
    ("CYCL CALL POS X+5 Y+5 Z+0", "M99 or CYCL CALL has no cycle to run"),
    ("CYCL CALL PAT", "CYCL CALL PAT runs the cycle at positions that are not known"),
    ("CYCL DEF 270 DATA Q1=1\nCYCL CALL", "cycle 270 runs at positions that are not known to ncomp"),
    ("CALL LBL 1", "the file has no subprogram LBL 1"),
    ("LBL 2\nCALL LBL 1 REP 2", "the repetition needs exactly one label LBL 1 before it"),
    ("LBL 1\nCALL LBL 1", "the subprograms call each other more than 100 deep"),
    ("Q1 = 1 / 0\nL X+Q1", "Q1 is not known: / has no value for 1, 0"),
    ("FN18: SYSREAD Q1 = ID270\nL X+Q1", "Q1 is not known"),
    ("Q20 = 5\nFN 23: Q20 = CDATA Q30\nL X+Q20", "Q20 is not known"),
    ("L X+Q108", "X+Q108: Q108 is not known: no tool table (--tool-table) gives the radius of tool 1"),
    ("L X+Q110", "X+Q110: the control sets Q110, and its value is not known to ncomp"),
    ("Q1 = SGN 0\nL X+Q1", "SGN of 0 depends on the control"),
    ("CALL PGM A.H", "its file is not in the folder of the program"),
    ("SEL TABLE A", "SEL TABLE A: ncomp does not read the file that SEL selects"),
    ("TCH PROBE 0.0", "TCH PROBE 0.0: the end of a probing move is not known"),
    ("CYCL DEF 7.1 X+Q1", "Q1 is not set by the program"),
    ("CYCL DEF 7.1 C+5", "cycle 7 shifts the datum by C"),
    (
        "CYCL DEF 10.1 ROT+30\nCYCL DEF 8.1 X",
        "cycle 8 together with another coordinate transformation is not followed in this order: reset the other one first",
    ),
    ("CYCL DEF 7.1 #0", "datum #0 is in no datum table"),
    ("CYCL DEF 7 SHIFT", "cycle 7 shifts the datum"),
    ("CYCL DEF 7.0 SHIFT X+1", "cycle 7 shifts the datum"),
    ("CYCL DEF 8.1 C", "cycle 8 mirrors a rotary or auxiliary axis, which is not followed"),
    ("CYCL DEF 11.1 SCL 0", "cycle 11 has no factor above 0"),
    ("CYCL DEF 26.1 X1 Y1,01\nCC X+0 Y+0\nC X-10 Y-20 DR+", "scaled by different factors"),
    ("CYCL DEF 26.1 X1 CCX+5", "cycle 26 takes factors above 0 for X, Y and Z; a centre is not followed"),
    (
        "CYCL DEF 19.1 B+45",
        "the angles of cycle 19 are spatial angles or axis angles by a setting of the control, and these differ here",
    ),
    ("CYCL DEF 19.1 B+0 F1000", "cycle 19 with other words than A, B and C is not followed"),
    (
        "CYCL DEF 19.1 A+0 B+0 C+0\nL C+5",
        "a rotary axis is not at 0 while cycle 19 is on: the control may rotate the coordinates",
    ),
    ("CYCL DEF 12.0 PGM CALL", "cycle 12 calls a program whose file is not known: write its blocks"),
    ("CYCL DEF 221 PATTERN", "cycle 221 has no cycle to repeat"),
    (
        "CYCL DEF 200 A\nCYCL DEF 221 PATTERN",
        "cycle 221 has no Q200, Q203, Q204, Q224, Q225, Q226, Q237, Q238, Q242, Q243",
    ),
    ("CYCL DEF 999 X", "cycle 999 is not known"),
    ("CYCL DEF 247 DATUM", "cycle 247 has no whole preset number"),
    ("CYCL DEF 247 DATUM Q339=Q1", "Q1 is not set by the program"),
    ("PLANE PROJECTED PROPR1 PROMIN2 PROROT3 STAY", "the signs of PLANE PROJECTED are not documented"),
    ("PLANE SPATIAL SPA+0 SPB+0 STAY", "PLANE SPATIAL has missing or additional words"),
    ("PLANE SPATIAL SPA+0 SPB+0 SPC+0", "PLANE has none or several of STAY, TURN and MOVE"),
    ("PLANE VECTOR BX0 BY0 BZ1 NX0 NY0 NZ1 STAY", "the directions or points of PLANE VECTOR span no plane"),
    ("PLANE SPATIAL SPA+0 SPB+30 SPC+0 STAY\nL X+1 Y+1 Z+1", "the tool is not perpendicular to the tilted plane"),
    ("PLANE NONSENSE", "PLANE has none or several of STAY, TURN and MOVE"),
    ("FUNCTION TCPM F TCP AXIS SPAT PATHCTRL AXIS", "is not known"),
    ("FUNCTION TCPM F TCP AXIS POS REFPNT CENTER-CENTER", "is not known"),
    ("FUNCTION MODE TURN", "is not known"),
    ("TRANS MIRROR AXIS X", "TRANS MIRROR AXIS X transforms the coordinates in a form that is not followed"),
    ("FN 9: IF +Q1 EQU +1 GOTO LBL 5", "Q1 is not set by the program"),
    ("FN 9: IF +1 EQU +1 GOTO LBL 5", "the program has no block with the label LBL 5"),
    ("FN 17: SYSWRITE ID1", "FN 17 sets data of the control, whose effect is not known to ncomp"),
    ("FN 25: PRESET", "FN 25 sets a preset while the program runs, which is not followed"),
    ("FN 99: X", "FN 99 is not known"),
    ("TOOL CALL Q1 Z", "Q1: Q1 is not set by the program"),
    ("TOOL CALL 5 Y", "the tool axis is Y: only tools along Z are corrected"),
    ("TOOL CALL DL-Q108", "DL-Q108: Q108 is not known: no tool table (--tool-table) gives the radius of tool 1"),
    ("TOOL CALL 1 Z DL+1\nTOOL CALL S500", "TOOL CALL without a tool ends DL on some controls only"),
    ("TOOL DEF 1 L+Q1", "L+Q1: Q1 is not set by the program"),
    ("TOOL DEF L+5", "TOOL DEF has a length or radius, but no tool"),
    ("BEGIN PGM B MM", "the file has a second BEGIN PGM"),
]


@pytest.mark.parametrize(("text", "reason"), REFUSED)
def test_refused(text, reason):
    with pytest.raises(Refusal) as fault:
        run(text + "\n")
    assert reason in fault.value.reason
    assert fault.value.line == 4 + text.count("\n")


@pytest.mark.parametrize(
    "text",
    [
        *("", "; comment", "* - part", "LBL 1", 'LBL "A"', "/ ; comment", "RND R5", "CHF 2", "LBL 0", "Q1 = 5", "FN 0: Q2 =+5", "STOP", "STOP M1", "L", "L R0 F99"),
        *(f"M{code}" for code in (0, 1, 4, 5, 8, 9, 13, 19, 90, 103, 107, 109, 115, 116, 117, 118, 120, 126, 127)),
        *("M129", "M136", "M137", "M141", "M143", "M145", "M148", "M149", "M94 C", "L M120 LA5", "M103 F20", "M134"),
        *("BLK FORM 0.1 Z X+0 Y+0 Z-5", "Q1 = Q2 + 5", "QS1 = \"A\"", "FN 0: Q1 =+50", "FN 18: SYSREAD Q1 = ID1"),
        *("FN 14: ERROR = 1000", "FN 16: F-PRINT A", "FN 26: TABOPEN A", "PLANE RESET STAY", "PLANE RESET"),
        *("CYCL DEF 7.0 SHIFT", "CYCL DEF 7.1 X+0", "CYCL DEF 7.1 IX+0 Y0,0", "CYCL DEF 8.1", "CYCL DEF 10.1 ROT+0"),
        *("CYCL DEF 11.1 SCL 1", "CYCL DEF 26.1 X1 Y1.0", "CYCL DEF 19.0 PLANE", "CYCL DEF 19.1", "CYCL DEF 19.1 B+0"),
        *("CYCL DEF 1.2 DEPTH-21", "CYCL DEF 200 DRILL Q200=2", "CYCL DEF 14.1 LABEL1 /2", "CYCL DEF 32.1 T0,01", "CYCL DEF 392 ATC Q240=0"),
        *("CYCL DEF 9.1 DWELL 1", "CYCL DEF 13.1 ANGLE 0", "FUNCTION MODE MILL", "FUNCTION FEED DWELL D-TIME1"),
        *("FUNCTION RESET TCPM", "TRANS DATUM RESET", "PATTERN DEF POS1 (X+1 Y+2 Z+0)", "TOOL DEF 7", "TOOL CALL S100"),
    ],
)  # fmt: skip
def test_harmless(text):
    program = run(text + "\nL IX+1 IY+1 IZ+1 FMAX\n")
    assert program.program()[1:].tolist() == [[11, 21, 51]]
    assert not program.notes.texts()


# ---- real programs


def outcome(text):
    try:
        program = Run(text, lengths=())
    except Refusal as refusal:
        return refusal.line, refusal.reason
    return len(program.motions), len(program.motions.arcs)


NOT_FOLLOWED = (
    "its file is not in the folder of the program: write it there, or give its folder by --subprograms; if it leaves "
    "tool, frames and modes unchanged, write calls_leave_state = true in the machine file"
)


OUTCOMES = {
    "xg_model3.h": (7854, 0),
    "YL-01.h": (7854, 0),
    "3170_de.klartext": (22, f"CALL PGM 31701_de.h: {NOT_FOLLOWED}"),
    "668.klartext": (9, 0),
    "700.klartext": (32, 0),
    "7025.klartext": (
        15,
        "DL-Q108: Q108 is not known: no tool table (--tool-table) gives the radius of tool 155",
    ),
    "9030_de.klartext": (62, f"CALL PGM 90301_de.h: {NOT_FOLLOWED}"),
    "BewegBlv.klartext": (120, "the file has no subprogram LBL 3: write it into the file once"),
    "Krivka.klartext": (3 + 4 * 18851 + 2, 0),
    "SLII001.klartext": (3, 0),
    "VESELYparametr.klartext": (7, 0),
    "programm-zirkularnut-fraesen.klartext": (
        28,
        "IX+Q2: Q2 is not known: Q10 is not known: no tool table (--tool-table) gives the radius of tool 32",
    ),
}


@pytest.mark.parametrize("name", quick(OUTCOMES, [name for name in OUTCOMES if name != "Krivka.klartext"]))
def test_real_programs(nc_data, name):
    (path,) = [path for path in real_files(nc_data) if path.name == name]
    assert outcome(text_of(path)) == OUTCOMES[name]


def test_every_real_program_has_an_outcome(nc_data):
    assert {path.name for path in real_files(nc_data)} == set(OUTCOMES)


def test_a_freecad_program():
    if not FREECAD.is_file():
        pytest.skip("FreeCAD's programs (../shared/reference) are not beside this repository")
    assert outcome(text_of(FREECAD)) == (70, 27)


def test_chunks_carry_the_state_over(nc_data):
    blocks = blocks_of(text_of(nc_data / "heidenhain" / "five_axis_bc" / "xg_model3.h"))
    machine = machines.load("dmu50")
    whole = HeidenhainInterpreter(machine, make_setup(machine, zero=True), Notes()).read(blocks)
    interpreter = HeidenhainInterpreter(machine, make_setup(machine, zero=True), Notes())
    parts = [interpreter.read(blocks[i : i + 1000]) for i in range(0, len(blocks), 1000)]
    assert np.array_equal(np.concatenate([part.target for part in parts]), whole.target)
    assert np.array_equal(np.concatenate([part.machine_target for part in parts]), whole.machine_target)


@pytest.mark.parametrize(
    ("change", "left"),
    [
        ("CYCL DEF 247 DATUM SETTING~\nQ339=2\n", {"Z"}),
        ("M128\n", {"Z"}),
        ("TOOL CALL 2 Z S1000\n", {"Z"}),
        ("M77\n", {"Z"}),
        ("M8\n", {"X", "Y", "Z"}),
    ],
)
def test_only_what_is_said_in_the_new_frame_counts_as_said(change, left):
    """Offsets that nobody entered are all zero here and differ on the machine."""
    program = run(f"TOOL CALL 1 Z S1000\nL X10 Y20 Z300 F500\n{change}L Z310\n")
    known = zip(program.machine.names, program.motions.known[-1], strict=True)
    assert {name for name, state in known if state == Known.PROGRAM} == left
