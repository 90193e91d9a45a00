"""Turned coordinates: the axes that a turn couples are corrected, and no others; with backlash too."""

import re

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from support.backlash_paths import ARC_RADIUS_UM, BAND, HEAD, ROUNDING, TOO_SMALL, Path, largest_error, played
from support.corrected_lines import written
from support.programs import WHOLE, correct, load, model_of, random_model, read, setup_of, shifted

from kinematics.user_error import UserError
from postproc.motion.moves import Kind

GANTRY, DMU50 = load("gantry"), load("dmu50")
TURNED = {
    "iso": "G21 G90 G17\nG0 X500 Y500 Z500\nG1 Z450 F500\nG68 X500 Y500 R30\nX600 Y500\nX600 Y600\nG69\nG0 Z500\n",
    "siemens": "G17 G90 G71\nG0 X500 Y500 Z500\nG1 Z450 F500\nTRANS X500 Y500\nAROT Z60\nX50 Y0\nX60 Y0\nROT\nG0 Z500\n",
    "heidenhain": "BEGIN PGM A MM\nL X+500 Y+500 Z+500 FMAX\nL Z+450 F500\nCYCL DEF 10.0 ROTATION\n"
    "CYCL DEF 10.1 ROT+30\nL X+600 Y+500\nL X+600 Y+600\nCYCL DEF 10.0 ROTATION\nCYCL DEF 10.1 ROT+0\nL Z+500 FMAX\n",
}


@pytest.mark.parametrize("dialect", TURNED)
def test_a_turn_in_a_plane_needs_no_third_axis(dialect):
    """A machine that is off by the same everywhere: every block is corrected, by that, turned."""
    lines, _ = written(TURNED[dialect], GANTRY, shifted(GANTRY, X=100.0, Y=-200.0, Z=300.0), dialect)
    text = "\n".join(lines)
    inside = [re.findall(r"[XY]=?\+?([-\d.]+)", line) for line in text.splitlines()][4:]
    angle = np.deg2rad(60.0 if dialect == "siemens" else 30.0)
    c, s = np.cos(angle), np.sin(angle)
    wanted = np.array([[c, s], [-s, c]]) @ [-0.1, 0.2]
    found = [np.array(list(map(float, both))) for both in inside if len(both) == 2]
    assert len(found) >= 2
    for place in found[-2:]:
        assert np.abs(place - np.round(place, -1) - wanted).max() < 1e-4
    assert "Z499.7" in text.replace("+", "").splitlines()[-1]


def test_what_is_not_named_stays_where_the_control_holds_it():
    """The program gives one of two axes that the rotation couples: this one is corrected, and a note has the lines."""
    text = "G21 G90 G17\nG0 X500 Y500 Z500\nG1 Z450 F500\nG68 X500 Y500 R30\nX600\nX700\nY600\nG69\nX500\nZ440\n"
    result = correct(text, GANTRY, random_model(GANTRY, 3), **WHOLE)
    assert any(re.search(r"Y not corrected.*\(lines 5-6, 9-10\)", note) for note in result.report.notes)
    nominal, commanded = read(text, GANTRY), read(result.text, GANTRY)
    assert re.fullmatch(r"X[\d.]+ Z[\d.]+", result.text.splitlines()[5])  # Z because its correction has changed
    off = (commanded.machine_target - nominal.machine_target)[:, :3]
    along = np.array([np.cos(np.pi / 6), np.sin(np.pi / 6), 0.0])
    both = correct(text.replace("X600\n", "X600 Y500\n"), GANTRY, random_model(GANTRY, 3), **WHOLE)
    full = (read(both.text, GANTRY).machine_target - nominal.machine_target)[:, :3]
    assert off[4] @ along == pytest.approx(full[4] @ along, abs=2e-4)
    assert result.report.after.largest < 0.2


def test_a_block_that_is_not_corrected_is_not_counted():
    text = "G21 G90\nG0 X500 Y500 Z500\nG55\nG91 G1 X10 F100\nX10\nG90\n"
    result = correct(text, GANTRY, shifted(GANTRY, X=100.0))
    assert result.report.corrected == 1
    assert any("X Y Z not corrected" in note and "(lines 4-5)" in note for note in result.report.notes)


def test_a_plane_on_a_five_axis_machine():
    text = (
        "BEGIN PGM A MM\nTOOL CALL 1 Z S1000\nL X+10 Y+10 Z+150 B+0 C+0 R0 FMAX M3\n"
        "PLANE SPATIAL SPA+20 SPB+0 SPC+0 TURN FMAX SEQ+\nL X+20 Y+15 FMAX\nL Z+102 FMAX\nL Z+90 F100\n"
    )
    lines, _ = written(text, DMU50, random_model(DMU50, 1), "heidenhain", setup=setup_of(DMU50))
    assert lines[4] not in text
    assert len(re.findall(" [XYZ]", lines[5])) == 3


class FlatPath(Path):
    """With arcs in the plane of X and Y, which a rotation turns."""

    def geometry(self):
        found = super().geometry()
        while found[0] != "X":
            self.lines.pop()
            found = super().geometry()
        return found


@settings(max_examples=15)
@given(
    seed=st.integers(0, 2**32 - 1),
    blocks=st.integers(1, 15),
    angle=st.integers(-180, 180),
    widths=st.tuples(*[st.sampled_from((0.0, 20.0, 45.0))] * 3),
    mirror=st.sampled_from(["", "Z", "X"]),
)
def test_play_in_turned_coordinates(seed, blocks, angle, widths, mirror):
    turned = f"G51.1 {mirror}110" if mirror else f"G68 X110 Y110 R{angle}"
    body = FlatPath(seed).text(blocks).removeprefix(HEAD)
    text = f"{HEAD}X112 Y112 Z112\n{turned}\nG0 X110 Y110 Z110\n{body}"
    widths = dict(zip("XYZ", widths, strict=True))
    try:
        result = correct(text, GANTRY, played(GANTRY, **widths), travel_check=False)
    except UserError as refusal:  # an arc of 10 um with a backlash of 20 um
        assume(not TOO_SMALL.search(str(refusal)))
        raise
    ends, along = largest_error(text, result.text, GANTRY, widths)
    assert ends <= ROUNDING + 3 * BAND
    assert along <= ROUNDING + 3 * BAND + ARC_RADIUS_UM


def test_take_ups_and_arcs_in_turned_coordinates():
    text = (
        "G21 G90 G17 F500\nG0 X500 Y500 Z500\nX510 Y510 Z490\nG68 X510 Y510 R90\nG1 X510 Y510 Z490\nX520\nX510\nG3 I5\n"
    )
    result = correct(text, GANTRY, played(GANTRY, X=20.0, Y=40.0), **{"tolerance_um": 1.0})
    moved = [line for line in result.text.splitlines() if "TAKE-UP" in line]
    assert moved[0] == "G1 X519.9800 (NCOMP TAKE-UP)"  # programmed X moves Y: by half of its backlash, 20 um
    assert result.text.count("NCOMP ARC") == 3


UNMOVED = {
    "G92": ("G0 X14 Y64 Z93\nX20 Y36 Z23\nG92 Z-25\nG1 X86 Y20 F100\nX90\n", "G92 Z-24.9"),
    "G53": ("G0 X14 Y64 Z93\nX20 Y36 Z23\nG53 G0 Z100\nG1 X86 Y20 F100\nX90\n", "G53"),
    "G10": ("G0 X14 Y64 Z93\nX20 Y36 Z23\nG10 L20 P1 Z-25\nG1 X86 Y20 F100\nX90\n", "G10"),
}


@pytest.mark.parametrize("name", ["G92", "G53"])
def test_axes_that_stand_keep_their_direction(name):
    """A constant error beside the backlash: its correction is no move of an axis that a block does not contain."""
    machine, widths = GANTRY, {"X": 15.0, "Y": 15.0, "Z": 15.0}
    errors = shifted(machine, X=90.0, Y=-80.0, Z=70.0), played(machine, **widths)
    model = model_of(machine, *(effect for part in errors for effect in part.effects))
    text = "G21 G90 G17\nG0 X10 Y60 Z90\nX12 Y62 Z92\n" + UNMOVED[name][0]
    result = correct(text, machine, model)
    assert "TAKE-UP" not in result.text
    rows = read(result.text, machine)
    nominal = read(text, machine)
    off = (rows.machine_target - nominal.machine_target)[nominal.kind == Kind.LINE] * 1e3
    assert off[:, 0] == pytest.approx(-90.0 + 7.5, abs=0.2)
    assert off[:, 1] == pytest.approx(80.0 - 7.5, abs=0.2)


def test_the_first_feed_move_behind_an_unknown_m_function_is_noted():
    text = "G21 G90\nG0 X1000 Y1000 Z500\nG1 X1010 F500\nM100\nX1800 Y1400 Z460\n"
    result = correct(text, GANTRY, random_model(GANTRY, 2, 200.0))
    noted = [note for note in result.report.notes if "not split" in note and "the positions of all its axes" in note]
    assert len(noted) == 1
    assert "(lines 5)" in noted[0]


CONTOURS = {
    "iso": "G21 G90 G17\nG0 X100 Y100 Z50\nX120 Y120 Z45\nG41 D1 G1 X140 Y140 F200\nY180\nX120\nY110\nG40 X200 Y100\n",
    "siemens": "G17 G90 G71\nG0 X100 Y100 Z50\nX120 Y120 Z45\nG41 D1 G1 X140 Y140 F200\nY180\nX120\nY110\nG40 X200 Y100\n",
    "heidenhain": "BEGIN PGM A MM\nL X+100 Y+100 Z+50 R0 FMAX\nL X+120 Y+120 Z+45 FMAX\nL X+140 Y+140 RL F200\nL Y+180\n"
    "RND R2\nL X+120\nCHF 1\nL Y+110\nL X+200 Y+100 R0\n",
}


@pytest.mark.parametrize("dialect", CONTOURS)
def test_contours_on_a_machine_with_play_are_corrected_without_blocks_of_our_own(dialect):
    lines, notes = written(CONTOURS[dialect], GANTRY, played(GANTRY, X=15.0, Y=15.0, Z=15.0), dialect)
    assert not [line for line in lines if "NCOMP" in line]
    assert any("119.9925" in line for line in lines)
    assert len([note for note in notes if "the backlash of" in note]) == 2 or "deviates by" in " ".join(notes)
