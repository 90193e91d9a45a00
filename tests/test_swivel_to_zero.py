"""CYCLE800 with all angles 0, by which Siemens programs take a plane back before rotary axes are programmed."""

from __future__ import annotations

from pathlib import Path

import pytest
from support.command import run_command, succeed

TO_ZERO = 'CYCLE800(0,"TC1",200000,57,0,0,0,0,0,0,0,0,0,-1,,0)\n'
HEAD = "G17 G90 G94 G71 G54\nT1 D1 M6\nG0 X0 Y0 Z150 B0 C0\n"
BEHIND = {
    "rotary words": "G0 B30 C20\nG0 X0 Y0 Z150\nG1 X10 Y5 Z90 F500\nM30\n",
    "TRAORI": "TRAORI\nG0 X0 Y0 Z60 B0 C0\nG1 X10 Y5 Z20 B10 C20 F500\nTRAFOOF\nM30\n",
    "another offset": "G55\nG0 X0 Y0 Z150\nG1 X10 Y5 Z90 F500\nM30\n",
}


@pytest.fixture
def corrected(tmp_path: Path):
    def correct(program: str) -> list[str]:
        """Lines of the corrected program without ncomp's mark; an error for a refusal."""
        source, out = tmp_path / "part.mpf", tmp_path / "out.mpf"
        source.write_text(program)
        succeed("correct", source, "-m", "dmu50", "-o", out)
        return [line for line in out.read_text().splitlines() if "NCOMP 0" not in line]

    return correct


@pytest.mark.parametrize("case", BEHIND)
def test_a_plane_without_a_tilt_is_none(corrected, case: str) -> None:
    lines = corrected(HEAD + TO_ZERO + BEHIND[case])
    assert lines[3] + "\n" == TO_ZERO
    assert lines[5:] == corrected(HEAD + BEHIND[case])[4:]  # X Y Z are not known before G0 X0 Y0 Z150


def test_a_plane_is_taken_back_by_one_without_a_tilt(corrected) -> None:
    tilted = TO_ZERO.replace("57,0,0,0,0,0", "57,0,0,0,0,30")
    assert tilted != TO_ZERO
    inside = "G0 X0 Y0 Z60\nG1 Z20 F500\nG0 Z60\n"
    lines = corrected(HEAD + tilted + inside + TO_ZERO + BEHIND["rotary words"])
    assert lines[9:] == corrected(HEAD + BEHIND["rotary words"])[4:]


@pytest.mark.parametrize("shift", ["1,0,0", "0,0,5"])
def test_a_shifted_plane_stays_one(tmp_path: Path, shift: str) -> None:
    program = HEAD + TO_ZERO.replace("57,0,0,0", f"57,{shift}") + BEHIND["rotary words"]
    (tmp_path / "part.mpf").write_text(program)
    done = run_command("check", tmp_path / "part.mpf", "-m", "dmu50")
    assert "a rotary axis moves in a tilted plane of CYCLE800" in done.shown
