"""Tables of tools, presets and datums as controls write them."""

import re

import pytest
from support.file_examples import PRESETS, TNC410
from support.programs import load

from kinematics.user_error import UserError
from postproc.control.setup import Origin, make_setup
from postproc.control_data.tool_tables import read_tool_table, read_tool_tables

# Layout of a TNC 410's own table (names cut at 16 characters, decimal comma), as kept in the public repository
# aamorim1913/AptPostProcessor, machine-code/TOOL.T; the values are made up.
# That of an iTNC 530: more columns, indexed tools, a name with blanks, an end.
ITNC530 = """\
BEGIN TOOL     .T     MM
T    NAME             L           R           R2          DL      TL RT  TIME1 CUR.TIME DOC
0    NULLWERKZEUG     +0          +0          +0          +0             0     0        Nullwerkzeug
5    BOHRER D8,5      +120.25     +4.25       +0          +0.1           60    12       K\xfchlung innen
5.1  BOHRER SCHWESTER +119        +4.25       +0          +0             60    0
7    MILL             +50         +3          +0          +0             0     0
8    MILL             +60         +3          +0          +0             0     0
[END]
what stands behind it does not count
"""


@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_tnc410(tmp_path, end):
    path = tmp_path / "TOOL.T"
    path.write_bytes(TNC410.replace("\n", end).encode("latin-1"))
    table = read_tool_table(path)
    numbered = {name: length for name, length in table.tools.items() if name.isdecimal()}
    assert numbered == pytest.approx({"0": 0.0, "1": 95.1, "5": -4.666, "12": 18.892})
    assert table.radii["5"] == pytest.approx(6.575)
    setup = make_setup(load("gantry"), [], ["T12=3"], table, zero=True)
    assert setup.tool_length(12) == (3.0, Origin.GIVEN)
    assert setup.tool_length("14mm_crb_4fl_32_") == (pytest.approx(95.1), Origin.GIVEN)
    assert setup.tool_radius("12") == 3.0
    assert setup.tool_radius(99) is None


def test_itnc530(tmp_path):
    path = tmp_path / "tool.t"
    path.write_bytes(ITNC530.encode("latin-1"))
    table = read_tool_table(path)
    assert table.tools["5"] == pytest.approx(120.35)
    assert table.tools["5.1"] == 119.0
    assert table.tools["BOHRER D8,5"] == pytest.approx(120.35)
    assert "MILL" not in table.tools, "two tools of that name, of different lengths"


def test_inches(tmp_path):
    path = tmp_path / "tool.t"
    path.write_text("BEGIN TOOL .T INCH\nT  NAME  L    R\n1  A     +2   +0.5\n[END]\n")
    table = read_tool_table(path)
    assert table.tools == {"1": 50.8, "A": 50.8}
    assert table.radii["1"] == 12.7


def test_presets(tmp_path):
    path = tmp_path / "PRESET.PR"
    path.write_text(PRESETS)
    table = read_tool_table(path)
    assert table.work_offsets["1"] == {"X": 12.5, "Y": -80.0, "Z": 210.25, "B": 0.0, "C": 30.0}
    assert table.work_offsets["2"] == {"X": 1.0, "Y": 2.0, "Z": 3.0}
    assert table.turned == {"1": (0.0, 0.0, 2.5)}


def test_datums(tmp_path):
    path = tmp_path / "ZERO.D"
    path.write_text(
        "BEGIN NULLTAB .D MM\nD    X        Y        Z\n0    +0       +0       +0\n3    +5,5     -1       +0\n[END]\n"
    )
    assert read_tool_table(path).datums["3"] == {"X": 5.5, "Y": -1.0, "Z": 0.0}


def test_several(tmp_path):
    (tmp_path / "TOOL.T").write_text(TNC410)
    (tmp_path / "PRESET.PR").write_text(PRESETS)
    table = read_tool_tables([tmp_path / "TOOL.T", tmp_path / "PRESET.PR"])
    assert table.tools["12"] == pytest.approx(18.892)
    assert table.work_offsets["2"]["Z"] == 3.0
    (tmp_path / "more.json").write_text('{"12": 4}')
    with pytest.raises(UserError, match=r"tool table .*more.json: tools: 12 is in another table too"):
        read_tool_tables([tmp_path / "TOOL.T", tmp_path / "more.json"])


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        ("", "expected a line with the names of the columns"),
        ("T  NAME  L\nX  A     +1\n", "'X' in column T is not the number of a line"),
        ("T  NAME  L\n1  A     +1\n1  A     +1\n", "1 is in the table twice: delete one line"),
        ("T  NAME  L\n1  A     one\n", "L: 'one' is not a number"),
        ("T  NAME  L\n1  A     nan\n", "nan is not a finite number"),
    ],
)
def test_bad_tables_of_heidenhain(tmp_path, lines, words):
    path = tmp_path / "TOOL.T"
    path.write_text("BEGIN TOOL .T MM\n" + lines)
    with pytest.raises(UserError, match=re.escape(words)):
        read_tool_table(path)


@pytest.mark.parametrize(
    ("name", "text", "tools"),
    [
        (
            "tool.tbl",
            "; table\nT1 P1 D10 Z120.5 ;mill\n\nt02 p2 z+.5\nT3 P3 X0 Y+0.0 Z-5",
            {"1": 120.5, "2": 0.5, "3": -5},
        ),
        ("t.json", '{"1": 120.5, "02": 3}', {"1": 120.5, "2": 3}),
        ("t.json", '{"tools": {"7": 1}, "work_offsets": {"g54.1 p2": {"X": 1}}}', {"7": 1}),
    ],
)
def test_tool_table(tmp_path, name, text, tools):
    (tmp_path / name).write_text(text)
    table = read_tool_table(tmp_path / name)
    assert table.tools == tools
    assert set(table.work_offsets) <= {"G54.1P2"}


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("tool.tbl", "P1 D10 Z30\n"),
        ("tool.tbl", "nonsense\n"),
        ("tool.tbl", "T1 Z120.5\nT2 X5 Z3\n"),
        ("tool.tbl", f"T1 Z{'9' * 400}\n"),
        ("t.json", '{"T1": 120.5}'),
        ("t.json", '{"1": "long"}'),
        ("t.json", '{"1": null}'),
        ("t.json", "[1]"),
        ("t.json", ""),
        ("t.json", '{"1": 1e999}'),
        ("t.json", '{"tools": {}, "offsets": {}}'),
    ],
)
def test_bad_tool_table(tmp_path, name, text):
    (tmp_path / name).write_text(text)
    with pytest.raises(UserError, match=f"^tool table .*{name}"):
        read_tool_table(tmp_path / name)


FANUC = {
    "G10": (
        "%\nO9999 (OFFSETS)\nG90 G21\nN1 G10 L2 P1 X10. Y-20. Z-300.5 C30.\nG10 L20 P7 X5.\nG10 L10 P1 R120.5\n"
        "G10 L11 P1 R-.02 (WEAR)\nG10L12P1R5.\nG10 L13 P1 R.01\nG11\nM30\n%\n",
        {"1": 120.48}, {"1": 5.01}, {"G54": {"X": 10, "Y": -20, "Z": -300.5, "C": 30}, "G54.1P7": {"X": 5}},
    ),
    "inches": ("G21 G10 L10 P2 R10.\nG20 G10 L10 P1 R1.5\nG10 L2 P6 X1.\n", {"2": 10, "1": 38.1}, {}, {"G59": {"X": 25.4}}),
    "a list": ("(length wear)\nH1 120.5 -0.02\nH02 98.25\nD1 5.0 ; radius\nd2 .5 .1\n", {"1": 120.48, "2": 98.25}, {"1": 5, "2": 0.6}, {}),
}  # fmt: skip


@pytest.mark.parametrize("name", FANUC)
@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_fanuc(tmp_path, name, end):
    text, lengths, radii, offsets = FANUC[name]
    path = tmp_path / "OFFSETS.NC"
    path.write_bytes(text.replace("\n", end).encode())
    table = read_tool_table(path)
    assert table.tools == pytest.approx(lengths)
    assert table.radii == pytest.approx(radii)
    assert table.work_offsets == offsets


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        ("G10 L10 P1 R1. X5.", "this kind of data is unknown"),
        ("G10 L2 P0 X1.", "this kind of data is unknown"),
        ("G10 L2 P1 R5.", "this kind of data is unknown"),
        ("G10 L10 R5.", "G10 needs L and P"),
        ("G10 L50 P1 R5.", "this kind of data is unknown"),
        ("G0 X5.", "G0 may not be in a list of offsets"),
        ("X5.", "expected G10"),
        ("H1 twelve", "expected FANUC's offsets"),
        ("G10 L10 P1 P2 R5.", "an address is given twice"),
        ("H1 5.", "1 is given twice"),
        ("G20 G10 L10 P2 R5.", "G20 follows lengths without a unit: write it before the first line of data"),
    ],
)
def test_fanuc_lines_that_are_refused(tmp_path, line, reason):
    path = tmp_path / "OFFSETS.NC"
    path.write_text(f"H1 5.\n{line}\n")
    with pytest.raises(UserError, match=f"OFFSETS.NC:2: .*{re.escape(reason)}"):
        read_tool_table(path)
