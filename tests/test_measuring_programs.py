"""Measuring programs for trackers in the form of each control, against texts worked by hand."""

import re
from pathlib import Path

import pytest

from calibration.on_the_fly.planning import path_search

# X of the gantry at 100 and 200, once in each direction, with an approach of 1 mm, as mm in machine coordinates
OPTIONS = (
    *("--machine", "gantry", "--strategy", "axes", "--spacing", "100", "--range", "X=100:200", "--range", "Y=5"),
    *("--range", "Z=300", "--dwell", "3", "--feed", "1500", "--target", "t1=0,0,-100", "-o", "plan.csv"),
)
LINUXCNC = """\
G21 G17 G90 G94
G40 G49 G80
M5
M0
G53 G1 X99.0000 Y5.0000 Z300.0000 F1500.0
G53 G1 X100.0000 Y5.0000 Z300.0000 F1500.0
G4 P3.0
G53 G1 X200.0000 Y5.0000 Z300.0000 F1500.0
G4 P3.0
G53 G1 X201.0000 Y5.0000 Z300.0000 F1500.0
G4 P3.0
G53 G1 X100.0000 Y5.0000 Z300.0000 F1500.0
G4 P3.0
M30
"""
FANUC = """\
G21 G17 G90 G94
G40 G49 G80
G55
M5
M0
G1 X98.0000 Y3.0000 Z297.0000 F1500.0
G1 X99.0000 Y3.0000 Z297.0000 F1500.0
G4 X3.0
G1 X199.0000 Y3.0000 Z297.0000 F1500.0
G4 X3.0
G1 X200.0000 Y3.0000 Z297.0000 F1500.0
G4 X3.0
G1 X99.0000 Y3.0000 Z297.0000 F1500.0
G4 X3.0
M30
"""
SIEMENS = """\
G71 G17 G90 G94
G40 TRAFOOF D0
M5
M0
SUPA G1 X99.0000 Y5.0000 Z300.0000 F1500
SUPA G1 X100.0000 Y5.0000 Z300.0000 F1500
G4 F3
SUPA G1 X200.0000 Y5.0000 Z300.0000 F1500
G4 F3
SUPA G1 X201.0000 Y5.0000 Z300.0000 F1500
G4 F3
SUPA G1 X100.0000 Y5.0000 Z300.0000 F1500
G4 F3
M30
"""
HEIDENHAIN = """\
BEGIN PGM PLAN MM
M5
STOP
L X+99.0000 Y+5.0000 Z+300.0000 R0 F1500 M91
L X+100.0000 Y+5.0000 Z+300.0000 R0 F1500 M91
CYCL DEF 9.0 DWELL TIME
CYCL DEF 9.1 DWELL 3.0
L X+200.0000 Y+5.0000 Z+300.0000 R0 F1500 M91
CYCL DEF 9.0 DWELL TIME
CYCL DEF 9.1 DWELL 3.0
L X+201.0000 Y+5.0000 Z+300.0000 R0 F1500 M91
CYCL DEF 9.0 DWELL TIME
CYCL DEF 9.1 DWELL 3.0
L X+100.0000 Y+5.0000 Z+300.0000 R0 F1500 M91
CYCL DEF 9.0 DWELL TIME
CYCL DEF 9.1 DWELL 3.0
M30
END PGM PLAN MM
"""
PROGRAMS = {
    "linuxcnc": (LINUXCNC, ()),
    "fanuc": (FANUC, ("--work-offset", "G55=1,2,3")),
    "siemens": (SIEMENS, ()),
    "heidenhain": (HEIDENHAIN, ()),
}


def without_remarks(text):
    """The lines without tape marks, comments and the numbers of Klartext blocks."""
    lines = (re.sub(r"^\d+ ", "", re.sub(r"\s*(;.*|\([^)]*\))$", "", line)) for line in text.splitlines())
    return "".join(f"{line}\n" for line in lines if line and not re.fullmatch(r"%|\d+", line))


@pytest.mark.parametrize("dialect", PROGRAMS)
def test_a_program_in_the_form_of_each_control(ncomp, dialect):
    expected, options = PROGRAMS[dialect]
    made = ncomp("plan", "points", *OPTIONS, "--nc", "plan.nc", "--dialect", dialect, *options)
    assert made.status == 0, made.err
    assert without_remarks(Path("plan.nc").read_text()) == expected


@pytest.mark.parametrize("dialect", PROGRAMS)
def test_ncomp_reads_the_program_without_being_told_the_dialect(ncomp, dialect):
    _, options = PROGRAMS[dialect]
    assert ncomp("plan", "points", *OPTIONS, "--nc", "plan.nc", "--dialect", dialect, *options).status == 0
    done = ncomp("plan.nc", "--machine", "gantry", "--calibration", "none", "-o", "out.nc", *options)
    assert done.status == 0, done.err
    assert "5 read" in done.err
    assert Path("out.nc").read_bytes() == Path("plan.nc").read_bytes()


def test_linuxcnc_runs_its_program(ncomp, linuxcnc):
    assert ncomp("plan", "points", *OPTIONS, "--nc", "plan.nc", "--dialect", "linuxcnc").status == 0
    ran = linuxcnc.run(Path("plan.nc").read_text(), work_offsets={"G54": (10.0, 0.0, -5.0)})
    assert (ran.exit_status, ran.message) == (0, "")
    assert [move.machine[:3] for move in ran.moves] == [(x, 5.0, 300.0) for x in (99.0, 100.0, 200.0, 201.0, 100.0)]
    assert {(move.kind, move.feed) for move in ran.moves} == {("line", 1500.0)}


def test_a_path_of_a_siemens_control(ncomp, monkeypatch):
    monkeypatch.setattr(path_search, "IMPROVEMENT_TRIES", 50)  # any path
    made = ncomp(
        *("plan", "path", "--machine", "cframe", "--target", "t=0,0,-120", "--length-m", "2", "--feed", "2500"),
        *("-o", "path.csv", "--nc", "path.mpf", "--dialect", "siemens"),
    )
    assert made.status == 0, made.err
    lines = Path("path.mpf").read_text().splitlines()
    moves = [line for line in lines if line.startswith("SUPA G1 X") and " F2500 ; " in line]
    corners = len(Path("path.csv").read_text().splitlines())
    assert 3 < len(moves) < corners
    assert [lines.index(line) for line in moves[1:]] == list(range(len(lines) - len(moves) - 1, len(lines) - 2))
    assert lines[-2:] == ["G4 F3", "M30"]
