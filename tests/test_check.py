"""`ncomp check`: what would be corrected, what passes, what is refused, with lines; nothing is written."""

import json

import pytest

from postproc.text.line_numbers import ranges

GOOD = """G21 G90 G54
G0 X1. Y1.
Z5.
G53 G0 Z300.
#1=0
N10 G1 Z4. X[#1] F100
#1=#1+1
IF[#1 LT 3] GOTO 10
GOTO 20
X99.
N20 X5.
M30
X7.
"""
BAD = """G0 X1. Y1. Z1.
G31 F10 X5.
X2. Y2. Z2.
X3. (a (b))
G91 X1.
G999
"""


def test_a_program_with_jumps(command, tmp_path):
    (tmp_path / "a.nc").write_text(GOOD)
    done = command("check", "a.nc", "--machine", "gantry", "--set-up-zero")
    assert done.status == 0
    assert [line.split() for line in done.out.decode().splitlines() if not line.startswith("note")] == [
        ["a.nc:", "Accepted."],
        ["program", "a.nc", "(iso,", "13", "blocks,", "7", "moves)"],
        ["corrected", "5:", "lines", "3,", "6,", "11"],
        ["not", "complete", "1:", "line", "2"],
        ["machine", "1:", "line", "4"],
        ["repeated", "1:", "line", "6"],
        ["not", "run", "2:", "lines", "10,", "13"],
    ]


def test_every_line_that_is_refused(command, tmp_path):
    (tmp_path / "a.nc").write_text(BAD)
    done = command("check", "a.nc", "--machine", "gantry", "--json", "out.json")
    assert done.status == 2
    refused = json.loads((tmp_path / "out.json").read_text())["refused"]
    assert [(found["line"], found["text"]) for found in refused] == [
        (2, "G31 F10 X5."), (4, "X3. (a (b))"), (6, "G999"),
    ]  # fmt: skip
    assert b"refused      line 2: 'G31 F10 X5.': G31 is a probing move" in done.out


def test_lines_that_are_refused_for_one_reason_are_listed_once(command, tmp_path):
    (tmp_path / "a.nc").write_text("G21 G90\nG0 X1. Y1. Z1.\nG1 X9999. F500\nY2.\nY3.\nX5.\nG999\n")
    done = command("check", "a.nc", "--machine", "gantry", "--json", "out.json")
    assert len(json.loads((tmp_path / "out.json").read_text())["refused"]) == 4
    shown = [line for line in done.out.decode().splitlines() if line.startswith("refused")]
    assert len(shown) == 2
    assert "line 3: 'G1 X9999. F500': X would go to 12499" in shown[0]
    assert shown[0].endswith("(the same in lines 4-5)")


def test_the_travel_needs_the_set_up(command, tmp_path):
    (tmp_path / "mill.toml").write_text(
        'name = "mill"\nchain = "w X Y b Z t"\n[axes.X]\ntravel = [0, 500]\n[axes.Y]\ntravel = [0, 400]\n'
        "[axes.Z]\ntravel = [-300, 0]\n"
    )
    (tmp_path / "a.nc").write_text("G21 G90 G54\nT1 M6\nG0 X10. Y10. Z100.\nX20.\nG55 X900.\nG54 X5.\n")
    options = ("check", "a.nc", "--machine", "mill.toml", "--json", "-", "--work-offset", "G55=0,0,-300")
    found = json.loads(command(*options).out)
    assert [each["line"] for each in found["refused"]] == [3, 5]  # work offset, tool, and nothing that follows
    assert all("is not given" in each["reason"] for each in found["refused"])
    assert any("the travel is not checked before" in note and "line 3" in note for note in found["notes"])
    found = json.loads(command(*options, "--tool-length", "T1=50", "--work-offset", "G54=0,0,-300").out)
    assert [(each["line"], each["reason"][:17]) for each in found["refused"]] == [(5, "X would go to 900")]


def test_json_alone_on_standard_output(command, tmp_path):
    (tmp_path / "a.h").write_text("BEGIN PGM A MM\nQ1 = 5\nL X+Q1 Y+0 Z+5 FMAX\nEND PGM A MM\n")
    done = command("check", "a.h", "--machine", "gantry", "--json", "-")
    assert done.status == 0
    found = json.loads(done.out)
    assert (found["dialect"], found["moves"], found["corrected_lines"], found["refused"]) == ("heidenhain", 1, "3", [])


@pytest.mark.parametrize(
    ("lines", "text"), [([], ""), ([3], "3"), ([5, 3, 4, 4, 9], "3-5, 9"), ([1, 2, 4, 5], "1-2, 4-5")]
)
def test_ranges(lines, text):
    assert ranges(lines) == text


@pytest.mark.statistical
def test_check_and_correct_agree(command, nc_data):
    """What one accepts the other does, for real programs of all dialects."""
    agreed = 0
    for path in sorted(nc_data.rglob("*.*")):
        if path.stat().st_size > 100_000 or path.name == "Krivka.klartext":
            continue
        checked = command("check", path, "--machine", "dmu50", "--no-travel-check").status
        corrected = command(
            path, "--machine", "dmu50", "--calibration", "none", "--no-travel-check", "-o", "out.nc"
        ).status
        assert checked == corrected, path
        agreed += 1
    assert agreed > 70
