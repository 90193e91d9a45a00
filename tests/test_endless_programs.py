"""Programs that never end are refused as soon as they come back to a state."""

import time

import pytest
from support.command import refusal, succeed

SETTINGS = ("--machine", "gantry", "--calibration", "none", "--set-up-zero", "--no-travel-check")
ISO, SIEMENS = "G21 G90 G54\nG0 X0. Y0. Z0.\n", "G71 G90 G54\nG0 X0 Y0 Z0\n"
KLARTEXT = "BEGIN PGM A MM\nL X+0 Y+0 Z+0 FMAX\n"
ENDLESS = {
    "a loop": ("a.nc", ISO + "#1=0\nWHILE[#1 LT 2]DO1\nX#1\nEND1\nM30\n"),
    "a loop without condition": ("a.nc", ISO + "DO1\nG91 X1.\nEND1\nM30\n"),
    "a jump": ("a.nc", ISO + "N5 X1.\nGOTO5\nM30\n"),
    "values in turns": ("a.nc", ISO + "#1=1\nN5 X#1\n#1=1-#1\nGOTO5\nM30\n"),
    "a value that is unknown anew": ("a.nc", ISO + "N5 X1.\n#2=#5041\nGOTO5\nM30\n"),
    "o-words": ("a.ngc", ISO + "#1=0\no1 while [#1 lt 2]\nX#1\no1 endwhile\nM2\n"),
    "Siemens": ("a.mpf", SIEMENS + "R1=0\nWHILE R1<2\nX=R1\nENDWHILE\nM30\n"),
    "Siemens loop": ("a.mpf", SIEMENS + "LOOP\nX1\nX2\nENDLOOP\nM30\n"),
    "Klartext": ("a.h", KLARTEXT + "Q1 = 0\nLBL 1\nL X+Q1\nFN 9: IF +Q1 EQU +0 GOTO LBL 1\nM30\nEND PGM A MM\n"),
    "late": ("a.nc", ISO + "#1=0\nN5 #1=#1+1\nIF[#1 LT 700] GOTO 5\n#1=0\nGOTO5\nM30\n"),
}  # fmt: skip


@pytest.mark.parametrize("case", ENDLESS)
def test_a_program_that_repeats_its_state_is_refused_at_once(case, tmp_path):
    name, text = ENDLESS[case]
    (tmp_path / name).write_text(text)
    begun = time.perf_counter()
    said = refusal(tmp_path / name, *SETTINGS, "-o", tmp_path / "out")
    assert "runs the same blocks with the same values for ever" in said
    assert time.perf_counter() - begun < 10.0


def test_a_long_loop_that_ends_is_run(tmp_path):
    text = ISO + "#1=0\n#2=0\nWHILE[#1 LT 5000]DO1\n#1=#1+1\n#2=1-#2\nEND1\nX#1\nM30\n"
    (tmp_path / "a.nc").write_text(text)
    succeed(tmp_path / "a.nc", *SETTINGS, "-o", tmp_path / "out.nc")
