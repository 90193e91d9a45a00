"""Codes that end or change a frame, or the meaning of the words of their block, in each dialect.

The positions are calculated by hand; every program is written as in a shop.
"""

import re

import pytest
from support.axis_positions import positions

from kinematics.user_error import UserError
from postproc.control.tool_table import ToolTable
from postproc.text.notes import Notes

TURNED = ToolTable(
    work_offsets={"3": {"X": 100.0, "Y": 200.0, "Z": 300.0}, "4": {"X": 1.0}}, turned={"3": (0.0, 0.0, 90.0)}
)
"""Preset 3 with a basic rotation of 90 degrees about Z, and preset 4 without one."""
HEAD = "BEGIN PGM T MM\nTOOL CALL 1 Z S1000\n"


def klartext(text, **options):
    return positions(HEAD + text, "heidenhain", **options)


def siemens(text, **options):
    return positions("G17 G90 G71 G94\n" + text, "siemens", **options)


def refusal(run, text, **options):
    with pytest.raises(UserError) as caught:
        run(text, **options)
    found = re.fullmatch(r"test\.\w+:(\d+): '.*?': (.*)", str(caught.value), re.DOTALL)
    assert found is not None
    return found[2]


PRESET_3 = "CYCL DEF 247 DATUM SETTING~\nQ339=+3 ;DATUM NUMBER\n"


def test_m143_ends_the_basic_rotation_of_the_preset():
    # turned: X+10 Y+0 is Y+10 of the machine; behind M143 it is X+10. The length of the tool is 100 mm.
    text = PRESET_3 + "L X+10 Y+0 Z+50 R0 FMAX\nM143\nL X+10 Y+0 Z+50\n"
    assert klartext(text, table=TURNED) == [(100.0, 210.0, 450.0), (110.0, 200.0, 450.0)]


def test_m143_holds_from_the_start_of_its_block():
    text = PRESET_3 + "L X+10 Y+0 Z+50 R0 FMAX M143\n"
    notes = Notes()
    assert klartext(text, table=TURNED, notes=notes) == [(110.0, 200.0, 450.0)]
    assert any("M143" in note for note in notes.texts())


def test_a_preset_behind_m143():
    # preset 4 has no rotation; whether preset 3 has its own again depends on the control
    text = PRESET_3 + "M143\nCYCL DEF 247 DATUM SETTING~\nQ339=+{}\nL X+10 Y+0 Z+50 R0 FMAX\n"
    assert klartext(text.format(4), table=TURNED) == [(11.0, 0.0, 150.0)]
    assert "depends on the control" in refusal(klartext, text.format(3), table=TURNED)


def test_m143_in_a_tilted_plane_is_refused():
    text = "L B+0 C+0 FMAX\nPLANE SPATIAL SPA+20 SPB+0 SPC+0 TURN FMAX SEQ+\nM143\n"
    assert "tilted plane" in refusal(klartext, text, machine="dmu50")


def test_cycle_247_ends_shift_rotation_mirror_and_scaling():
    shifted = "CYCL DEF 7.0 DATUM SHIFT\nCYCL DEF 7.1 X+5 Y+6 Z+7\nCYCL DEF 10.0 ROTATION\nCYCL DEF 10.1 ROT+90\n"
    text = shifted + "CYCL DEF 247 DATUM SETTING~\nQ339=+4\nL X+10 Y+20 Z+50 R0 FMAX\n"
    assert klartext(text, table=TURNED) == [(11.0, 20.0, 150.0)]


@pytest.mark.parametrize(
    ("cycle", "word", "reset"),
    [(8, "X", "TRANS MIRROR RESET"), (10, "ROT+90", "TRANS ROTATION RESET")],
)
def test_trans_reset_under_the_cycle_of_its_kind(cycle, word, reset):
    text = f"CYCL DEF {cycle}.0\nCYCL DEF {cycle}.1 {word}\n{reset}\nL X+10 Y+20 Z+50 R0 FMAX\n"
    assert f"ends cycle {cycle} on some controls only" in refusal(klartext, text)
    assert klartext(f"{reset}\nL X+10 Y+20 Z+50 R0 FMAX\n") == [(10.0, 20.0, 150.0)]


def test_the_outline_of_a_cylinder_cycle_is_called():
    # cycle 39 replaces cycle 200: a call does not drill
    drill = "CYCL DEF 200 DRILLING~\nQ200=2~\nQ203=+0~\nQ204=50\n"
    text = "L X+10 Y+20 Z+50 R0 FMAX\n" + drill + "CYCL DEF 39.0 CYL. SURFACE CONTOUR\nCYCL DEF 39.1 Q1=-5\nCYCL CALL\n"
    assert "cycle 39" in refusal(klartext, text)


def test_m94_takes_whole_turns_off():
    assert klartext("L C+350 F500\nM94\nL C+10\n", machine="trunnion_ac", axes="C") == [(350.0,), (10.0,)]
    assert klartext("L C+400 F500\nM94 C\nL C+50\n", machine="trunnion_ac", axes="C") == [(400.0,), (410.0,)]


def test_m124_is_said():
    notes = Notes()
    klartext("L X+10 Y+20 Z+50 R0 F500 M124 T0.01\n", notes=notes)
    assert any("M124" in note for note in notes.texts())


# ---- cycles 7 and 10 in one another


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        # the shift is cancelled axis by axis under a rotation: the remaining rotation is about the preset
        ("7.0\n7.1 X+10 Y+5\n10.0\n10.1 ROT+90\n7.0\n7.1 X+0\n7.2 Y+0\n", (-1.0, 2.0)),
        ("7.0\n7.1 X+10\n10.0\n10.1 ROT+90\n7.0\n7.1 X+0 Y+0 Z+0\n", (-1.0, 2.0)),
        # increments count from the active values
        ("10.0\n10.1 ROT+60\n10.0\n10.1 IROT+30\n", (-1.0, 2.0)),
        ("10.0\n10.1 ROT+60\n10.0\n10.1 IROT-60\n", (2.0, 1.0)),
        ("7.0\n7.1 X+10\n7.2 IX+5\n7.3 IY-3\n", (17.0, -2.0)),
    ],
)
def test_cycles_in_one_another(text, expected):
    program = re.sub(r"^(?=\d)", "CYCL DEF ", text, flags=re.MULTILINE) + "L X+2 Y+1 Z+50 R0 FMAX\n"
    assert klartext(program, axes="XY") == [expected]


@pytest.mark.parametrize("shift", ["7.1 X+0", "7.1 X+3", "7.1 IX+3"])
def test_a_shift_left_over_under_a_rotation_is_refused(shift):
    program = (
        "CYCL DEF 7.0\nCYCL DEF 7.1 X+10 Y+5\nCYCL DEF 10.0\nCYCL DEF 10.1 ROT+90\nCYCL DEF 7.0\nCYCL DEF " + shift
    )
    assert "order" in refusal(klartext, program + "\nL X+2 Y+1 Z+50 R0 FMAX\n")


# ---- scaling

SCALED = "CYCL DEF 11.0 SCALING\nCYCL DEF 11.1 SCL 0.5\nL X+10 Y+4 Z+6 R0 FMAX\n"


@pytest.mark.parametrize(("axes", "z"), [("XYZ", 103.0), ("XY", 106.0)])
def test_cycle_11_scales_the_axes_of_the_machine_file(axes, z):
    notes = Notes()
    assert klartext(SCALED, control={"scaled_axes": axes}, notes=notes) == [(5.0, 2.0, z)]
    assert any(f"scale {' '.join(axes)}" in note for note in notes.texts())


def test_cycle_11_is_refused_where_the_machine_file_says_nothing():
    assert "scaled_axes" in refusal(klartext, SCALED, control={"scaled_axes": ""})
    neutral = SCALED.replace("0.5", "1")
    assert klartext(neutral, control={"scaled_axes": ""}) == [(10.0, 4.0, 106.0)]


def test_an_arc_across_the_scaled_plane_is_refused():
    arc = "L Z+0 Y+10\nCC Y+10 Z+10\nC Y+20 Z+10 DR+\n"
    assert "different factors" in refusal(klartext, SCALED + arc, control={"scaled_axes": "XY"})
    assert klartext(SCALED + arc, control={"scaled_axes": "XYZ"})[-1] == (5.0, 10.0, 105.0)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("26.0\n26.1 X0.5 Y2\n", (1.0, 2.0, 106.0)),
        # each axis has a factor of its own, until it is given another
        ("26.0\n26.1 X0.5 Y2\n26.0\n26.1 X1\n", (2.0, 2.0, 106.0)),
        # about the shifted datum
        ("7.0\n7.1 X+10\n26.0\n26.1 X2 Z3\n", (14.0, 1.0, 118.0)),
    ],
)
def test_cycle_26(text, expected):
    program = re.sub(r"^(?=\d)", "CYCL DEF ", text, flags=re.MULTILINE) + "L X+2 Y+1 Z+6 R0 FMAX\n"
    assert klartext(program) == [expected]


# ---- Siemens


@pytest.mark.parametrize("code", ["G25", "G26"])
def test_limits_of_the_working_area_move_nothing(code):
    text = f"G0 X100 Y100 Z50\n{code} X10 Y20 Z5\nG1 Y5 F500\nM30\n"
    assert siemens(text) == [(100.0, 100.0, 50.0), (100.0, 5.0, 50.0)]


def test_a_dwell_takes_no_coordinate():
    assert "G4" in refusal(siemens, "G0 X100 Y100 Z50\nG4 X3\nM30\n")


def test_traori_by_number():
    text = "G0 X100 Y0 Z50 B0 C90\n{}\nG1 X100 Y0 Z50 C90 F500\nM30\n"
    made = [siemens(text.format(name), machine="dmu50", axes="XYZC") for name in ("TRAORI", "TRAORI(1)", "TRAORI()")]
    assert made[0] == made[1] == made[2]
    assert "first" in refusal(siemens, text.format("TRAORI(2)"), machine="dmu50")
    assert "first" in refusal(siemens, text.format("TRAORI(1,0,0,1)"), machine="dmu50")


@pytest.mark.parametrize("mode", ["_ROUGH", "_SEMIFIN", "_FINISH", "_OFF", "_ORI_FINISH", "_TOP_SURFACE_SMOOTH_ON+_FINISH",
                                  "11", "2000001", "1000013"])  # fmt: skip
@pytest.mark.parametrize("transformation", ["", "TRAORI\n"])
def test_the_tolerance_cycle_by_names_and_with_top_surface_switches_nothing(mode, transformation):
    """SINUMERIK ONE, NC programming 12/2019, p. 1108: tens for the orientation tolerance, millions for Top Surface."""
    text = f"G0 X100 Y0 Z50 B0 C90\n{transformation}CYCLE832(0.01,{mode},0.5)\nG1 X100 Y0 Z50 C90 F500\nM30\n"
    assert len(siemens(text, machine="dmu50")) == 2


def test_a_declared_variable_has_its_own_value():
    text = "DEF INT _ROUGH=112111\nCYCLE832(0.01,_ROUGH)\nG0 X1\nM30\n"
    assert "TRAORI" in refusal(siemens, text, machine="dmu50")


@pytest.mark.parametrize("name", ["TOROTOF", "PAROTOF", "TOFRAMEOF"])
def test_ends_of_rotations_in_a_plane(name):
    plane = 'G0 X0 Y0 Z300\nCYCLE800(1,"",0,57,0,0,0,20,0,0,0,0,0,-1)\n'
    assert "CYCLE800" in refusal(siemens, f"{plane}{name}\nM30\n", machine="trunnion_ac")
    assert siemens(f"G0 X0 Y0 Z300\n{name}\nM30\n") == [(0.0, 0.0, 300.0)]


def test_the_tolerance_cycle_switches_the_transformation():
    text = "G0 X100 Y0 Z50 B0 C90\n{}\nG1 X100 Y0 Z50 C90 F500\nM30\n"
    assert "TRAORI" in refusal(siemens, text.format("CYCLE832(0.01,112111)"), machine="dmu50")
    assert "TRAORI" in refusal(siemens, text.format("TRAORI\nCYCLE832(0.01,112101)"), machine="dmu50")
    for accepted in ("CYCLE832(0.01,112101)", "TRAORI\nCYCLE832(0.01,112111)", "CYCLE832(0.01,3,1)", "CYCLE832()"):
        assert len(siemens(text.format(accepted), machine="dmu50")) == 2


@pytest.mark.parametrize(("value", "end"), [(1, 1.0), (2, 2.0), (3, 3.0)])
def test_two_conditional_jumps_in_one_block(value, end):
    text = f"R1={value}\nIF R1==1 GOTOF AA IF R1==2 GOTOF BB\nG0 X3\nGOTOF EE\nAA: X1\nGOTOF EE\nBB: X2\nEE: M30\n"
    assert siemens(text, axes="X") == [(end,)]


# ---- formulas that controls read differently


@pytest.mark.parametrize("formula", ["- 2 ^ 2", "2 ^ 3 ^ 2", "SIN Q1 ^ 2", "3 + -Q1 ^ 2"])
def test_klartext_powers_without_brackets(formula):
    assert "brackets" in refusal(klartext, f"Q1 = 30\nQ2 = {formula}\nL X+Q2 FMAX\n")


@pytest.mark.parametrize(
    ("formula", "value"),
    [
        ("( - 2 ) ^ 2", 4.0),
        ("- ( 2 ^ 2 )", -4.0),
        ("2 ^ ( 3 ^ 2 )", 512.0),
        ("2 * 3 ^ 2 - 4", 14.0),
        ("SQ 10 - 3 ^ 3", 73.0),
    ],
)
def test_klartext_powers_with_brackets(formula, value):
    assert klartext(f"Q2 = {formula}\nL X+Q2 FMAX\n", axes="X") == [(value,)]


@pytest.mark.parametrize("power", ["-2**2", "2**3**2", "-#1**2"])
def test_iso_powers_without_brackets(power):
    with pytest.raises(UserError, match="power"):
        positions(f"G21 G90 G54\n#1=3\nG0 X[{power}]\nM30\n", "iso")


@pytest.mark.parametrize("condition", ["NOT R1==1", "1<R1<3"])
def test_siemens_conditions_without_brackets(condition):
    assert "brackets" in refusal(siemens, f"R1=1\nIF {condition} GOTOF AA\nG0 X1\nAA: M30\n")


# ---- a number of repeats that is not whole

REPEATS = "L X+0 Y+0 Z+0 R0 FMAX\nQ9 = {}\nLBL 1\nL IX+1\nCALL LBL 1 REP Q9\n"


@pytest.mark.parametrize(
    ("repeats", "value", "runs"),
    [("truncate", "7 / 2", 4), ("round", "7 / 2", 5), ("truncate", "14 / 4", 4), ("round", "2.4", 3), ("round", "0.4", 1),
     ("", "4 / 2", 3), ("truncate", "4 / 2", 3)],
)  # fmt: skip
def test_repeats_that_are_not_whole_are_counted_as_the_machine_file_has_it(repeats, value, runs):
    text, notes = REPEATS.format(value), Notes()
    assert klartext(text, control={"repeats": repeats}, notes=notes)[-1][0] == runs


@pytest.mark.parametrize(
    ("repeats", "value", "reason"),
    [("", "7 / 2", 'repeats = "truncate"'), ("truncate", "0.3 / 0.1", "rounding"), ("round", "0.35 / 0.1", "rounding")],
)
def test_repeats_that_the_machine_file_does_not_settle_are_refused(repeats, value, reason):
    assert reason in refusal(klartext, REPEATS.format(value), control={"repeats": repeats})


# ---- the tool length in other planes; transition circles


def test_a_tool_length_in_another_plane_is_noted():
    """SINUMERIK ONE, NC programming 12/2019, p. 750: with SD42940 = 0 the length goes with the plane."""
    text, notes = "T1 M6 D1\nG0 X0 Y0 Z10\nG18 G2 X20 Z10 I10 K0 F500\nG17\nG0 Z20\nM30\n", Notes()
    assert siemens(text, notes=notes)[-1] == (20.0, 0.0, 120.0)
    (found,) = [note for note in notes.texts() if "SD42940" in note]
    assert "line 4" in found
    siemens(text, notes=(none := Notes()), tools=["T1=0"])
    assert not any("SD42940" in note for note in none.texts())


def test_disc_moves_no_point_of_the_contour():
    contour = "T1 M6 D1\nG0 X0 Y0 Z10\nG41 G450 DISC=50 G1 X10 Y0 F500\nY50\nG40 X0\nM30\n"
    assert siemens(contour) == siemens(contour.replace("DISC=50 ", ""))
