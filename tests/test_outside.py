"""Moves outside the range of a calibration: the program is refused, or they stay as programmed and are listed."""

import json
from pathlib import Path

import pytest
from support.programs import load

from kinematics.basis import Legendre
from kinematics.effects import ErrorMotion
from kinematics.error_model.model import encode_model, no_errors
from postproc.correct.splitting import NOT_CORRECTED

GANTRY = load("gantry")
RANGE = (2000.0, 3000.0)
"""Calibrated range of X, mm; the part's zero is at X 2000, Y 1500."""
HOLES = [(100.0 * i, 40.0 * i) for i in range(8)] + [(1020.0, 100.0), (1050.0, 120.0), (-30.0, 60.0)]
SET_UP = ("--machine", "gantry", "-c", "cal.json", "--work-offset", "G54=2000,1500,200", "--tool-length", "T1=100")


@pytest.fixture
def calibration():
    """A calibration of X over a part of its travel, with its bytes."""
    effects = (
        ErrorMotion("X", "X", Legendre(RANGE, 1), (5.0, 30.0), u=(0.1, 0.1)),
        ErrorMotion("Y", "X", Legendre(RANGE, 2), (0.0, 10.0, 20.0), u=(0.1, 0.1, 0.1)),
    )
    model = no_errors(GANTRY)
    return encode_model(type(model)(machine=model.machine, provenance=model.provenance, effects=effects))


def drilled():
    """A drilling program with three of its holes outside."""
    holes = "\n".join(f"G0 X{x:.3f} Y{y:.3f}\nG1 Z-2. F100\nG0 Z5." for x, y in HOLES)
    Path("part.nc").write_text(f"G21 G90 G17\nT1 M6\nG54 G43 H1\nG0 X500. Y500. Z5.\n{holes}\nM30\n")


def lines_of(name):
    return [line.split("(")[0].strip() for line in Path(name).read_text().splitlines() if "NCOMP" not in line]


def test_the_program_is_refused_and_the_message_names_both_ways(command, calibration):
    Path("cal.json").write_bytes(calibration)
    drilled()
    done = command("part.nc", *SET_UP, "-o", "out.nc")
    assert done.status == 2
    assert "--outside leave" in done.err
    assert "--accept outside" in done.err
    assert not Path("out.nc").exists()


def test_moves_outside_stay_as_programmed_and_are_listed(command, calibration):
    Path("cal.json").write_bytes(calibration)
    drilled()
    done = command("part.nc", *SET_UP, "--outside", "leave", "-o", "out.nc", "--json", "r.json")
    assert done.status == 0, done.err
    before, after = lines_of("part.nc"), lines_of("out.nc")
    assert len(before) == len(after)
    first = next(i for i, line in enumerate(before) if line.startswith(f"G0 X{HOLES[8][0]:.3f}"))
    for old, new in zip(before[first:-1], after[first:-1], strict=True):
        words = {word[0]: float(word[1:]) for word in new.split() if word[0] in "XYZ"}
        wanted = {word[0]: float(word[1:]) for word in old.split() if word[0] in "XYZ"}
        assert wanted == pytest.approx({axis: words[axis] for axis in wanted}, abs=1e-9)
    assert all(a != b for a, b in zip(before[7:first:3], after[7:first:3], strict=True))
    found = json.loads(Path("r.json").read_text())
    assert found["left_outside"]["moves"] == 9
    assert found["left_outside"]["lines"] == "29-37"
    assert any("9 moves are not corrected" in note and "29-37" in note for note in found["notes"])
    assert not any("end value is held" in note for note in found["notes"])
    assert "outside" not in found["accepted"]


def test_a_contour_leads_out_and_back(command, calibration):
    """A line to the outside stays one block; an arc whose ends are inside, and whose middle is not, stays too."""
    Path("cal.json").write_bytes(calibration)
    Path("part.nc").write_text(
        "G21 G90 G17\nT1 M6\nG54 G43 H1\nG0 X500. Y500. Z5.\nG1 Z-2. F200\nX1300. Y400.\nX900. Y300.\n"
        "X980. Y200.\nG2 X980. Y100. I0. J-50.\nG1 X200. Y100.\nG0 Z5.\nM30\n"
    )
    done = command("part.nc", *SET_UP, "--outside", "leave", "-o", "out.nc", "--json", "r.json")
    assert done.status == 0, done.err
    text = Path("out.nc").read_text()
    found = json.loads(Path("r.json").read_text())
    assert found["left_outside"]["lines"] == "6, 9"
    assert "X1300" in text
    (arc,) = [line.split() for line in text.splitlines() if line.startswith("G2 ")]
    assert arc[:3] == ["G2", "X980.", "Y100."]
    assert [each["reason"] for each in found["not_split"]] == [NOT_CORRECTED]
    assert found["predicted_error_um"]["before"]["max"] > 20.0


def test_nothing_changes_where_nothing_is_outside(command, calibration):
    Path("cal.json").write_bytes(calibration)
    Path("part.nc").write_text("G21 G90 G17\nT1 M6\nG54 G43 H1\nG0 X500. Y500. Z5.\nG1 X600. F200\nM30\n")
    for how in ("leave", "refuse"):
        assert command("part.nc", *SET_UP, "--outside", how, "-o", f"{how}.nc").status == 0
    assert lines_of("leave.nc") == lines_of("refuse.nc")
