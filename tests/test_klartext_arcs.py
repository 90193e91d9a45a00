"""Corrected Klartext arcs by the abilities of the control: as helices, in their plane, or with a word across it."""

import re

import pytest
from support.command import succeed

import machines
from kinematics.user_error import UserError

PROGRAM = """\
BEGIN PGM A MM
TOOL CALL 1 Z S1000
L X+100 Y+100 Z+50 B+0 C+0 R0 FMAX
L X+150 Y+100 F500
CC X+150 Y+130
C X+180 Y+130 DR+
CR X+150 Y+160 R+30 DR+
CT X+120 Y+130
LP PR+40 PA+200
L X+200 Y+100
CC X+200 Y+120
CP IPA+90 DR+
CP PA+90 DR+
L X+150 Y+100 RL
CC X+150 Y+130
C X+180 Y+130 DR+
L X+100 Y+100 R0
Q1 = 150
L X+150 Y+100
CR X+180 Y+130 R+30 DR+
CR X+Q1 Y+160 R+30 DR+
M30
END PGM A MM
"""


def corrected(tmp_path, how, program=PROGRAM):
    """Lines and figures of the command's output for a DMU 50 whose machine file sets `klartext_arcs`."""
    text = (machines.FOLDER / "dmu50.toml").read_text(encoding="utf-8")
    control = "" if how is None else f'[control]\nklartext_arcs = "{how}"\n\n'
    machine, source, out = (tmp_path / name for name in ("m.toml", "a.h", "out.h"))
    machine.write_text(text.replace("[axes.X]", control + "[axes.X]"), encoding="utf-8")
    source.write_text(program, encoding="utf-8")
    calibration = machines.FOLDER / "calibrations" / "dmu50.json"
    options = [
        "--machine",
        machine,
        "--calibration",
        calibration,
        "--tool-length",
        "T1=100",
        "--work-offset",
        "0=0,0,0",
    ]
    done = succeed(source, *options, "-o", out)
    return out.read_text(encoding="utf-8").splitlines(), done.shown


def after_um(output):
    """The largest error at block ends, um."""
    found = re.search(r"error relative to the datum at block ends after\W+([\d.]+)", output)
    assert found is not None
    return float(found[1])


@pytest.mark.parametrize("how", [None, "helix"])
def test_arcs_become_helices_where_they_have_to_rise(tmp_path, how):
    lines, output = corrected(tmp_path, how)
    arcs = [line for line in lines if re.match(r"C[RTP]? ", line)]
    rising = [line for line in arcs if "Z" in line]
    assert len(rising) >= 5
    assert all(re.match(r"CP IPA[+-]\d+\.\d+ Z[+-]\d+\.\d+ DR\+", line) for line in rising)
    # a contour with radius compensation and one of parameters stay as they are, in their plane
    assert sum(line.startswith("C X") for line in arcs) == 1
    assert sum(line.startswith("CR X+QL") for line in arcs) == 1
    assert "arcs stay in their plane" in output


def test_arcs_in_their_plane(tmp_path):
    lines, output = corrected(tmp_path, "plane")
    assert not any(re.match(r"C[RTP]? .*Z", line) for line in lines)
    assert re.search(r"arcs stay in their plane: up to \d\.\d+ um", output)
    # the next line takes the rest
    assert all("Z+" in line for line in lines if line.startswith("L X"))
    assert 0.5 < after_um(output) < 5.0


def test_arcs_with_a_word_across(tmp_path):
    lines, output = corrected(tmp_path, "axes")
    assert any(re.match(r"C X\S+ Y\S+ Z", line) for line in lines)
    assert after_um(output) < 0.5
    assert after_um(corrected(tmp_path, "helix", PROGRAM.partition("L X+150 Y+100 RL")[0] + "M30\n")[1]) < 0.5


def test_a_helix_leaves_the_pole_for_what_follows(tmp_path):
    """CR becomes CP about a pole of its own: the LP behind it counts from that one."""
    program = PROGRAM.partition("CC X+200")[0] + "M30\nEND PGM A MM\n"
    _, output = corrected(tmp_path, "helix", program)
    assert after_um(output) < 0.5


def test_other_values_are_refused(tmp_path):
    with pytest.raises(UserError, match="klartext_arcs"):
        corrected(tmp_path, "cartesian")
