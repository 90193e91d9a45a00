"""The reported corrections of a run: only those of positions that the program has given, with the right reason."""

from __future__ import annotations

import json
import re
from pathlib import Path

from support.command import succeed
from support.programs import load, shifted

from kinematics.error_model.model import encode_model

DRILLING = """\
BEGIN PGM DRILLING MM
TOOL CALL 1 Z S1000
L X+0 Y+0 Z+15 R0 FMAX
CYCL DEF 200 DRILLING Q200=2 Q201=-20 Q206=150 Q202=5 Q210=0 Q203=+0 Q204=50 Q211=0
L X+10 Y+10 R0 FMAX M99
L X-10 R0 FMAX M99
L Z+60 R0 FMAX
END PGM DRILLING MM
"""
TURNING_UNDER_TCP = """\
G21 G90 G17 G54
T1 M6
G0 B0 C0
G43.4 H1 X60 Y30 Z60
G1 X20 Y10 Z30 B20 F1000
C60
M30
"""


def run(folder: Path, machine: str, name: str, program: str, *options: str, datum: str = "true") -> str:
    """Screen of a run that has to succeed, for a machine whose X Y Z stand 100, -200, 300 um off."""
    (folder / name).write_text(program)
    (folder / "cal.json").write_bytes(encode_model(shifted(load(machine), X=100.0, Y=-200.0, Z=300.0)))
    datums = ("--datum", f"0={datum}", "--datum", f"G54={datum}")
    given = ("-m", machine, "-c", str(folder / "cal.json"), *datums, "-o", str(folder / "out"), *options)
    return succeed("correct", folder / name, *given).shown


def test_where_a_drilling_cycle_leaves_z_is_no_correction(tmp_path: Path) -> None:
    run(tmp_path, "gantry", "drilling.h", DRILLING, "--json", str(tmp_path / "run.json"))
    correction = json.loads((tmp_path / "run.json").read_text())["correction_um"]
    assert correction["X"]["max"] == 100.0
    assert correction["Z"] == {"max": 300.0, "rms": 300.0, "count": 3}


def test_a_page_of_a_drilling_cycle_can_be_made(tmp_path: Path) -> None:
    run(tmp_path, "gantry", "drilling.h", DRILLING, "--report", str(tmp_path / "page.html"))
    assert "35300" not in (tmp_path / "page.html").read_text()


def test_a_turn_under_tcp_is_named_as_the_reason_why_the_tool_point_strays(tmp_path: Path) -> None:
    screen = run(tmp_path, "head_table", "turning.nc", TURNING_UNDER_TCP, "--accept", "worse")
    not_split = screen[screen.index("Moves that were not split") :]
    assert re.search(r"a feed move of rotary axes only keeps its linear axes, because F +171\.14 +6\b", not_split)
    assert "its error jumps" not in screen


def test_a_tool_axis_is_among_the_reasons_why_a_move_is_not_split(tmp_path: Path) -> None:
    moves = ("G1 X60 Y30 Z60 A3=0.2 C3=0.97979590 F1000", "G1 X0 Y0 Z60 A3=0.4 B3=0.3 C3=0.8660254")
    program = "\n".join(("G17 G90 G71 G54", "T1 D1 M6", "TRAORI", "G0 X0 Y0 Z60 A3=0 B3=0 C3=1", *moves, "M30", ""))
    screen = run(tmp_path, "head_table", "vectors.mpf", program, "--accept", "worse")
    not_split = screen[screen.index("Moves that were not split") :]
    assert "no block can be added beside it" in not_split
    assert "or tool vector)" in not_split


POLAR = """\
BEGIN PGM POLAR MM
TOOL CALL 1 Z S1000
L X+0 Y+0 Z+20 R0 FMAX
CC X+0 Y+0
LP PR+2 PA+45 F500
CP PA+90 DR+
CP IPA+360 IZ-1 DR+
LP PR+5
END PGM POLAR MM
"""


def test_a_part_that_only_goes_with_its_datum_keeps_its_text(tmp_path: Path) -> None:
    run(tmp_path, "gantry", "polar.h", POLAR, "--accept", "insignificant", datum="probed")
    lines = (tmp_path / "out").read_text().splitlines(keepends=True)
    assert "".join(line for line in lines if not line.startswith("; NCOMP")) == POLAR
