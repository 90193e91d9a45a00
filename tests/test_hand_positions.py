"""Small programs as in a shop, and the positions of the tool, calculated by hand from the controls' manuals.

One line a case: blocks between bars, and the last position along X, Y, Z of the gantry, mm. The cosines and sines are
all that is worked out here; nothing of ncomp is used for it.
"""

import math

import pytest
from support.axis_positions import positions

C30, S30 = math.cos(math.radians(30.0)), 0.5
C20, S20 = math.cos(math.radians(20.0)), math.sin(math.radians(20.0))
HALF = math.sqrt(0.5)
ORIGIN = "L X+0 Y+0 Z+0|"
AT_50 = "L X+50 Y+0 Z+0|CC X+0 Y+0|"
DRILL = "CYCL DEF 200 DRILLING~|Q200=2~|Q201=-20~|Q206=250~|Q202=5~|Q210=0~|Q203=+3~|Q204=40~|Q211=0|"


def frame(cycle, *words):
    """The blocks of a datum cycle."""
    return "".join(f"CYCL DEF {cycle}.{i} {word}|" for i, word in enumerate(("NAME", *words)))


SHIFTED = frame(7, "X+10 Y+5")
TURNED = frame(10, "ROT+30")

KLARTEXT = {
    # positions, absolute and by increments
    "L X+10 Y+20 Z+30": (10, 20, 30),
    "L X+10 Y+20 Z+30|L IX+5 IY-2,5 IZ+.5": (15, 17.5, 30.5),
    "L X+10 Y+20 Z+30|L IX+5 Y+1|L Z-3 FMAX": (15, 1, -3),
    "10 L X+10 Y+20 Z+30 R0 FMAX M3|20 L X-10": (-10, 20, 30),
    "L X 10 Y -20 Z + 30": (10, -20, 30),
    "L Z+50 FMAX|L X+1 Y+2|L Z+5 M91": (1, 2, 5),
    SHIFTED + ORIGIN + "L X+3 Y+4 Z+5 M91": (3, 4, 5),
    # polar coordinates
    ORIGIN + "CC X+10 Y+20|LP PR+5 PA+30": (10 + 5 * C30, 22.5, 0),
    ORIGIN + "CC X+10 Y+20|LP PR+5 PA+30|LP IPA+60": (10, 25, 0),
    ORIGIN + "CC X+10 Y+20|LP PR+5 PA+30|LP IPR+3": (10 + 8 * C30, 24, 0),
    ORIGIN + "CC X+10 Y+20|LP PR+5 PA+30|LP PA-90 IZ+2": (10, 15, 2),
    "L X+7 Y+8 Z+1|CC|LP PR+2 PA+180": (5, 8, 1),
    "L X+7 Y+8 Z+1|CC IX+3 IY-1|LP PR+2 PA+0": (12, 7, 1),
    ORIGIN + "CC X+10 Y+20|CC Y+5|LP PR+2 PA+90": (10, 7, 0),
    ORIGIN + "CC Z+10 X+20|LP PR+5 PA+0": (20, 0, 15),
    ORIGIN + "CC Y+10 Z+20|LP PR+5 PA+90": (0, 10, 25),
    # arcs
    AT_50 + "C X+0 Y+50 DR+": (0, 50, 0),
    AT_50 + "C X+0 Y+50 DR-|L IX+1": (1, 50, 0),
    AT_50 + "C IX-50 IY-50 DR-": (0, -50, 0),
    AT_50 + "CP IPA+90 DR+": (0, 50, 0),
    AT_50 + "CP IPA-450 IZ-9 DR-": (0, -50, -9),
    AT_50 + "CP IPA+720 Z-12 DR+": (50, 0, -12),
    AT_50 + "CP PA+180 DR-": (-50, 0, 0),
    AT_50 + "CP PA+60 DR+|CP IPA+30 DR+": (0, 50, 0),
    AT_50 + "CP PA+90 DR+|LP PR+60": (0, 60, 0),
    "L X+50 Y+0 Z+0|CR X+50 Y+50 R+25 DR+": (50, 50, 0),
    "L X+50 Y+0 Z+0|CR X+50 Y+50 R-40 DR-|CT X+90 Y+60": (90, 60, 0),
    AT_50 + "L Y+10|CTP PR+60 PA+90": (0, 60, 0),
    # in the plane of Z and X angles count from Z towards X
    "L X+158 Y+2 Z-21|CC X+156 Z-21|CP IPA+90 DR+": (156, 2, -23),
    "L X+156 Y-82 Z-23|CC X+156 Z-21|CP IPA-90 DR-|L IX+1": (159, -82, -21),
    # a chamfer and a rounding leave the corner points
    "L X+0 Y+0 Z+0|L X+20|CHF 2|L Y+20|RND R5|L X+0": (0, 20, 0),
    # labels
    ORIGIN + "LBL 1|L IX+10|CALL LBL 1 REP3": (40, 0, 0),
    ORIGIN + "LBL 1|L IX+10|LBL 2|L IY+1|CALL LBL 2 REP2|CALL LBL 1 REP1": (20, 6, 0),
    ORIGIN + "CALL LBL 2|CALL LBL 2|L IZ+1|M30|LBL 2|L IX+5|CALL LBL 3|LBL 0|LBL 3|L IY+1|LBL 0": (10, 2, 1),
    ORIGIN + 'CALL LBL "PART"|L IZ+1|M30|LBL "PART"|L IX+5|LBL 0': (5, 0, 1),
    ORIGIN + "Q1 = 0|LBL 1|Q1 = Q1 + 1|L X+Q1|FN 12: IF +Q1 LT +4 GOTO LBL 1": (4, 0, 0),
    ORIGIN + "Q1 = 5|FN 9: IF +Q1 EQU +5 GOTO LBL 9|L X+1|LBL 9|L Y+1": (0, 1, 0),
    ORIGIN + "Q1 = 5|FN 10: IF +Q1 NE +5 GOTO LBL 9|L X+1|LBL 9|L Y+1": (1, 1, 0),
    ORIGIN + "Q1 = 5|FN 11: IF +Q1 GT +4,9 GOTO LBL 9|L X+1|LBL 9|L Y+1": (0, 1, 0),
    # formulas
    ORIGIN + "Q1 = 5|Q2 = Q1 * 2 + 1|L X+Q2 Y-Q1": (11, -5, 0),
    ORIGIN + "Q1 = 30|Q3 = 10 * SIN Q1|L X+Q3 IY+Q3": (5, 5, 0),
    ORIGIN + "QL1 = 3|QR2 = QL1 / 2|L X+QL1 Y+QR2": (3, 1.5, 0),
    ORIGIN + "FN 0: Q1 =+5|FN 1: Q2 =+Q1 + +7|FN 2: Q3 =+Q2 - +2|FN 3: Q4 =+Q3 * +3|FN 4: Q5 =+Q4 DIV +4|L X+Q5": (7.5, 0, 0),
    ORIGIN + "FN 5: Q1 = SQRT +16|FN 6: Q2 = SIN +30|FN 7: Q3 = COS +60|L X+Q1 Y+Q2 Z+Q3": (4, 0.5, 0.5),
    ORIGIN + "FN 8: Q10 = +3 LEN +4|L X+Q10": (5, 0, 0),
    ORIGIN + "FN 13: Q20 = +1 ANG +1|FN 13: Q21 = +1 ANG -1|FN 13: Q22 = -1 ANG -1|L X+Q20 Y+Q21 Z+Q22": (45, 135, 225),
    ORIGIN + "Q1 = 400 % 360|Q2 = INT 3.7 + FRAC 2.25|Q3 = INT -3.7|L X+Q1 Y+Q2 Z+Q3": (40, 3.25, -3),
    ORIGIN + "Q1 = ATAN 1|Q2 = ACOS 0.5|Q3 = ASIN 0.5|L X+Q1 Y+Q2 Z+Q3": (45, 60, 30),
    ORIGIN + "Q1 = SGN -3 * ABS -2|Q2 = NEG 3|Q3 = SQ 4 - 1|L X+Q1 Y+Q2 Z+Q3": (-2, -3, 15),
    ORIGIN + "Q1 = ( 2 + 3 ) * 4 - 6 / 3|Q2 = 2 - 3 - 4|Q3 = 12 / 3 / 2|L X+Q1 Y+Q2 Z+Q3": (18, -5, 2),
    ORIGIN + "Q1 = LOG 1000 + LN ( EXP 2 )|Q2 = 2 * PI|L X+Q1 Y+Q2": (5, 2 * math.pi, 0),
    ORIGIN + "Q1 = 2 ^ 3 * 2|Q2 = TAN 45|L X+Q1 Y+Q2": (16, 1, 0),
    # datum shift, mirror, rotation
    SHIFTED + "L X+1 Y+2 Z+3": (11, 7, 3),
    SHIFTED + ORIGIN + "L IX+1": (11, 5, 0),
    SHIFTED + frame(7, "IX+3") + "L X+1 Y+2 Z+3": (14, 7, 3),
    SHIFTED + frame(7, "X+0 Y+0") + "L X+1 Y+2 Z+3": (1, 2, 3),
    "TRANS DATUM AXIS X+10 Y-5 Z+2|L X+1 Y+2 Z+3": (11, -3, 5),
    "TRANS DATUM AXIS X+10 Y-5 Z+2|TRANS DATUM RESET|L X+1 Y+2 Z+3": (1, 2, 3),
    frame(8, "X") + "L X+3 Y+4 Z+5": (-3, 4, 5),
    SHIFTED + frame(8, "X Y") + "L X+3 Y+4 Z+5": (7, 1, 5),
    frame(8, "X") + frame(8, "") + "L X+3 Y+4 Z+5": (3, 4, 5),
    TURNED + "L X+2 Y+0 Z+1": (2 * C30, 1, 1),
    SHIFTED + TURNED + "L X+2 Y+4 Z+1": (10 + 2 * C30 - 2, 5 + 1 + 4 * C30, 1),
    SHIFTED + TURNED + "L X+0 Y+0 Z+0|L IX+2": (10 + 2 * C30, 6, 0),
    SHIFTED + TURNED + "L X+0 Y+0 Z+0|CC X+0 Y+0|LP PR+2 PA+60": (10, 7, 0),
    SHIFTED + TURNED + "L X+2 Y+0 Z+0|CC X+0 Y+0|CP IPA+60 DR+": (10, 7, 0),
    frame(10, "ROT+30") + frame(10, "IROT+60") + "L X+2 Y+1 Z+0": (-1, 2, 0),
    frame(10, "ROT+30") + frame(10, "ROT+0") + "L X+2 Y+1 Z+0": (2, 1, 0),
    frame(26, "X2 Y0,5") + "L X+3 Y+4 Z+5": (6, 2, 5),
    # canned cycles leave the tool at the second set-up clearance, which counts from the surface
    "L X+10 Y+20 Z+90|" + DRILL + "L X+30 M99|L Y+25": (30, 25, 43),
    "L X+10 Y+20 Z+90|" + DRILL + "CYCL CALL|L IX+5": (15, 20, 43),
    "L X+10 Y+20 Z+90|" + DRILL + "L X+30 M89|L Y+25|L Z+50|L IZ+5": (30, 25, 48),
    "L X+10 Y+20 Z+90|" + DRILL + "L X+30 M89|L Y+25 M99|L Z+60|L IZ+5": (30, 25, 65),
    "L X+10 Y+20 Z+90|" + DRILL + "L X+30 M89|CYCL DEF 4.0 POCKET|L Z+60|L IZ+5": (30, 20, 65),
    "L X+10 Y+20 Z+90|" + DRILL + "CYCL CALL POS X+1 Y+2 Z+5 FMAX|L IX+5": (6, 2, 48),
    # behind the end nothing runs
    "L X+10 Y+20 Z+30 M30|L X+99": (10, 20, 30),
}  # fmt: skip


@pytest.mark.parametrize("text", KLARTEXT)
def test_klartext(text):
    program = f"BEGIN PGM T MM|{text}|END PGM T MM|".replace("|", "\n")
    assert positions(program, "heidenhain")[-1] == pytest.approx(KLARTEXT[text], abs=1e-6)


def test_klartext_in_inches():
    program = "BEGIN PGM T INCH\nL X+1 Y+0,5 Z-2\nCC X+0 Y+0.5\nLP PR+2 PA+90\nL IX+1\nEND PGM T INCH\n"
    assert positions(program, "heidenhain")[-1] == pytest.approx((25.4, 63.5, -50.8))


T30 = math.tan(math.radians(30.0))
ISO = {
    # corners that the control breaks
    "G1 X20. ,C2. F100.|Y20. ,R5.|X0.": (0, 20, 0),
    "G1 X20. , R 5. F100.|G3 X30. Y10. R10. ,C1.|G1 Y50.": (30, 50, 0),
    "G91 G1 X20. ,C2. F100.|Y20. ,R5.|X-5.": (15, 20, 0),
    "G19 G1 Y20. ,C2. F100.|Z20.": (0, 20, 20),
    # lines by their angle
    "G1 X30. ,A30. F100.": (30, 30 * T30, 0),
    "G1 Y30. ,A30. F100.": (30 / T30, 30, 0),
    "G1 X-30. ,A150. F100.|Y0. ,A-30.": (0, 0, 0),
    "G1 X10. ,A0. F100.|Y5. ,A90.|X0. ,A180.": (0, 5, 0),
    "G18|G1 Z30. ,A30. F100.": (30 * T30, 0, 30),
    "G20|G1 X1. ,A45. F9.": (25.4, 25.4, 0),
    "G1 X30. ,A30. ,R2. F100.|Y0.": (30, 0, 0),
}


@pytest.mark.parametrize("text", ISO)
def test_iso(text):
    program = f"G21 G17 G90 G94 G54|G0 X0. Y0. Z0.|{text}|".replace("|", "\n")
    assert positions(program, "iso", control={"family": "fanuc"})[-1] == pytest.approx(ISO[text], abs=1e-6)


SUBPROGRAM = "%_N_MAIN_MPF|{}|M30|%_N_PART_SPF|{}|M17"

SIEMENS = {
    # absolute, increments, and both in one block
    "G0 X10 Y20 Z30": (10, 20, 30),
    "G0 X10 Y20 Z30|G91 G1 X5 Y-2.5 Z.5 F100": (15, 17.5, 30.5),
    "G0 X10 Y20 Z30|X=IC(5) Y=AC(1)": (15, 1, 30),
    "G0 X10 Y20 Z30|G91 X=AC(5) Y1|G90 Z3": (5, 21, 3),
    "G0 X=10+2*3 Y=-4 Z=10/4": (16, -4, 2.5),
    "N10 G0 X10 Y20 Z30|N20 G1 X1EX1 F100": (10, 20, 30),
    # inches: G70 of the geometry, G700 of all
    "G70 G0 X1 Y2 Z0": (25.4, 50.8, 0),
    "G0 X10 Y20 Z30|G700 X1|G710 Y5": (25.4, 5, 30),
    "G0 X0 Y0 Z0|G70 G2 X2 Y0 I1 J0 F10|G71 G1 X5": (5, 0, 0),
    # planes and arcs
    "G0 X50 Y0 Z0|G3 X0 Y50 I-50 J0 F100": (0, 50, 0),
    "G0 X50 Y0 Z0|G3 X0 Y50 I=AC(0) J=AC(0) Z-3 TURN=2 F100": (0, 50, -3),
    "G0 X50 Y0 Z0|G3 X0 Y50 CR=50 F100|G91 G2 X5 Y5 CR=5": (5, 55, 0),
    "G0 X50 Y0 Z0|G3 I-50 J0 AR=90 F100": (0, 50, 0),
    "G0 X50 Y0 Z0|G3 X0 Y50 AR=90 F100": (0, 50, 0),
    "G0 X50 Y0 Z0|G3 X0 Y50 I=IC(-50) J=IC(0) F100|SPOS[1]=90": (0, 50, 0),
    "G18|G0 X0 Y0 Z50|G3 X50 Z0 I0 K-50 F100": (50, 0, 0),
    "G19|G0 X0 Y50 Z0|G3 Y0 Z50 J-50 K0 F100": (0, 0, 50),
    "G0 X60 Y20 Z0|X50|G1 X60 F9|CT X70 Y30|G1 X0": (0, 30, 0),
    # polar coordinates
    "G0 X0 Y0 Z0|G111 X10 Y20|G1 AP=30 RP=5 F100": (10 + 5 * C30, 22.5, 0),
    "G0 X0 Y0 Z0|G111 X10 Y20|G1 AP=30 RP=5 F100|AP=IC(60)": (10, 25, 0),
    "G0 X3 Y4 Z0|G110 X1 Y1|G0 AP=90 RP=2": (4, 7, 0),
    "G0 X3 Y4 Z0|G111 X10 Y0|G112 X1 Y1|G0 AP=0 RP=2": (13, 1, 0),
    "G0 X50 Y0 Z0|G111 X0 Y0|G3 AP=90 RP=50 F100": (0, 50, 0),
    # corners
    "G0 X0 Y0 Z0|G1 X20 CHF=2 F100|Y20 RND=5|X0": (0, 20, 0),
    # frames, chained
    "TRANS X10 Y5|G0 X1 Y2 Z3": (11, 7, 3),
    "TRANS X10 Y5|ATRANS X1|G0 X1 Y2 Z3": (12, 7, 3),
    "TRANS X10 Y5|TRANS Z1|G0 X1 Y2 Z3": (1, 2, 4),
    "TRANS X10 Y5|TRANS|G0 X1 Y2 Z3": (1, 2, 3),
    "ROT Z30|G0 X2 Y0 Z1": (2 * C30, 1, 1),
    "ROT RPL=30|G0 X2 Y0 Z1": (2 * C30, 1, 1),
    "G18|ROT RPL=90|G0 X0 Y5 Z2": (2, 5, 0),
    "TRANS X10 Y5|AROT Z30|G0 X2 Y4 Z1": (10 + 2 * C30 - 2, 6 + 4 * C30, 1),
    "ROT Z30|ATRANS X10|G0 X0 Y0 Z0": (10 * C30, 5, 0),
    "TRANS X10|ROT Z90|G0 X1 Y2 Z0": (-2, 1, 0),
    "ROT X90|G0 X1 Y2 Z3": (1, -3, 2),
    "ROT Y90|G0 X1 Y2 Z3": (3, 2, -1),
    "ROT X90 Z90|G0 X1 Y2 Z3": (3, 1, 2),  # about Z, then about the X that came of it
    "MIRROR X0|G0 X1 Y2 Z3": (-1, 2, 3),
    "TRANS X10|AMIRROR X0 Y0|G0 X1 Y2 Z3": (9, -2, 3),
    "TRANS X10|AROT Z90|AMIRROR X0|G0 X1 Y2 Z3": (8, -1, 3),
    "SCALE X2 Y2 Z2|G0 X1 Y2 Z3": (2, 4, 6),
    "SCALE X2 Z0.5|G0 X1 Y2 Z3": (2, 2, 1.5),
    "TRANS X10|ASCALE X2 Y2|ATRANS X1|G0 X1 Y2 Z3": (14, 4, 3),
    "TRANS X10|AROT Z30|AROT Z-10|G0 X1 Y0 Z0": (10 + C20, S20, 0),
    "TRANS X10|G0 X0 Y0 Z0|G91 X1 Y1|G90 X5": (15, 1, 0),
    "TRANS X10|AROT Z90|G0 X0 Y0 Z0|G91 X1": (10, 1, 0),
    # work offsets and machine coordinates
    "G54 G0 X1 Y2 Z3": (101, 202, 303),
    "G54 G0 X1 Y2 Z3|G500 X1 Y2 Z3": (1, 2, 3),
    "G54 G0 X1 Y2 Z3|G53 X5": (5, 202, 303),
    "G54|TRANS X10|G0 X1 Y2 Z3|SUPA Z9": (111, 202, 9),
    "G54|TRANS X10|G0 X1 Y2 Z3|G153 X9 Y9|X1": (111, 9, 303),
    "T1 M6 D1|G54 G0 X1 Y2 Z3": (101, 202, 403),
    "T1 M6 D1|G54 G0 X1 Y2 Z3 D0": (101, 202, 303),
    # variables, fields, strings
    "R1=5 R2=2|R3=R1*R2+1|G0 X=R3 Y=-R1 Z=R1/R2": (11, -5, 2.5),
    "DEF REAL DE[3]=SET(1,2,3)|G0 X=DE[0] Y=DE[1]+DE[2] Z=DE[2]": (1, 5, 3),
    "DEF REAL FE[2,2]=SET(1,2,3,4)|G0 X=FE[0,1] Y=FE[1,0] Z=FE[1,1]": (2, 3, 4),
    "DEF INT NN=7|G0 X=NN DIV 2 Y=NN MOD 2 Z=NN/2": (3, 1, 3.5),
    'DEF STRING[8] SS="AB"|IF SS=="AB" GOTOF EE|G0 X1 Y1 Z1|EE: G0 X2 Y2 Z2': (2, 2, 2),
    "G0 X=10*SIN(30) Y=10*COS(60) Z=ATAN2(1,1)": (5, 5, 45),
    "G0 X=SQRT(16)+POT(2) Y=ABS(-3) Z=ROUND(2.5)": (8, 3, 3),
    "G0 X=TRUNC(2.9) Y=MINVAL(4,3) Z=BOUND(0,5,9)": (2, 3, 5),
    "G0 X=2+3*4 Y=(2+3)*4 Z=12/3/2": (14, 20, 2),
    # positions that the program reads
    "G0 X10 Y20 Z30|X=$AA_IW[X]+5 Y=$AA_IW[Z]": (15, 30, 30),
    "TRANS X5|G0 X10 Y20 Z30|R1=$AA_IW[X]*2|X1|Y=R1": (6, 20, 30),
    "G54 G0 X1 Y2 Z3|R1=$AA_IM[Z]-$AA_IW[Z]|X=R1": (400, 202, 303),
    "G0 X0 Y0 Z0|REPEAT|X=IC(10) Z=IC(2)|UNTIL $AA_IW[Z]>9-0.05": (50, 0, 10),
    "G0 X0 Y0 Z0|G1 X10 F9|IF $AA_IW[X]>5 GOTOF AA|Y1|AA: Z=ABS(-$AA_IW[X])": (10, 0, 10),
    # the run of the program
    "G0 X0 Y0 Z0|FOR R1=1 TO 3|X=R1*10|ENDFOR": (30, 0, 0),
    "G0 X0 Y0 Z0|R1=0|WHILE R1<4|R1=R1+1|X=R1|ENDWHILE": (4, 0, 0),
    "G0 X0 Y0 Z0|R1=0|REPEAT|R1=R1+1|X=R1|UNTIL R1>=3": (3, 0, 0),
    "G0 X0 Y0 Z0|R1=2|CASE R1 OF 1 GOTOF AA 2 GOTOF BB DEFAULT GOTOF CC|AA: X1|BB: X2|CC: Y1": (2, 1, 0),
    "G0 X0 Y0 Z0|R1=1|IF R1==1|X1|ELSE|X2|ENDIF": (1, 0, 0),
    "G0 X0 Y0 Z0|G91|AGAIN: X10|REPEATB AGAIN P=3": (40, 0, 0),
    "G0 X0 Y0 Z0|G91|BEG: X10|FIN: Y1|REPEAT BEG FIN P=2|G90": (30, 3, 0),
    SUBPROGRAM.format("G0 X0 Y0 Z0|G91|PART P3|G90 Z5", "X10|Y1"): (30, 3, 5),
    SUBPROGRAM.format("G0 X0 Y0 Z0|PART(4, 2)", "PROC PART(REAL A, REAL B=7)|G0 X=A Y=B"): (4, 2, 0),
    SUBPROGRAM.format("G0 X0 Y0 Z0|PART(4)", "PROC PART(REAL A, REAL B=7)|G0 X=A Y=B"): (4, 7, 0),
    # cycles leave the tool on the retraction plane
    "G0 X10 Y20 Z90|CYCLE81(40,0,2,-20)|X5": (5, 20, 40),
    "G0 X10 Y20 Z90|MCALL CYCLE82(40,0,2,-20,,1)|X5|Y5|MCALL|X0": (0, 5, 40),
    "G0 X10 Y20 Z30|M30|X99": (10, 20, 30),
}  # fmt: skip


@pytest.mark.parametrize("text", SIEMENS)
def test_siemens(text):
    program = f"{text}|".replace("|", "\n")
    if not text.startswith("%"):
        program = f"G17 G90 G71 G94\n{program}"
    found = positions(program, "siemens", offsets=["G54=100,200,300"])
    assert found[-1] == pytest.approx(SIEMENS[text], abs=1e-6)


# ---- rotary axes

AXIS = 100.0
"""Height of the axis A of the machine trunnion_ac, whose table tilts about it, mm; C is on this table, at X 0 Y 0."""


def on_the_table(x, y, z, a, c):
    """Machine X Y Z of a point of the workpiece: the table turns it by -C about Z, then by -A about X."""
    c, a = math.radians(-c), math.radians(-a)
    x, y = x * math.cos(c) - y * math.sin(c), x * math.sin(c) + y * math.cos(c)
    y, z = y * math.cos(a) - (z - AXIS) * math.sin(a), AXIS + y * math.sin(a) + (z - AXIS) * math.cos(a)
    return x, y, z


def tilted(x, y, z, a):
    """A point of a plane turned about X by `a` degrees, in the coordinates of the workpiece."""
    a = math.radians(a)
    return x, y * math.cos(a) - z * math.sin(a), y * math.sin(a) + z * math.cos(a)


UPRIGHT = "T1 M6 D1|G0 X0 Y0 Z300 A0 C0|"
PLANE_20, PLANE_LOWER = (f'CYCLE800(1,"",0,57,0,0,0,20,0,0,0,0,0,{way})|' for way in (1, -1))
TURNING = {
    UPRIGHT + "TRAORI|G1 X10 Y20 Z50 A0 C90 F100": (*on_the_table(10, 20, 50, 0, 90), 0, 90),
    UPRIGHT + "TRAORI(1)|G1 X10 Y20 Z50 A20 C30 F100": (*on_the_table(10, 20, 50, 20, 30), 20, 30),
    UPRIGHT + "TRAORI|G1 X10 Y20 Z50 A20 C30 F100|TRAFOOF|G0 Z300": (*on_the_table(10, 20, 50, 20, 30)[:2], 300, 20, 30),
    UPRIGHT + "TRANS X5|TRAORI|ROT Z90|G1 X10 Y20 Z50 A20 C30 F100": (*on_the_table(-20, 10, 50, 20, 30), 20, 30),
    UPRIGHT + "TRAORI|ORIWKS|G1 X10 Y20 Z50 A3=0 B3=0 C3=1 F100": (*on_the_table(10, 20, 50, 0, 0), 0, 0),
    UPRIGHT + "G0 A=IC(20) C=DC(350)": (0, 0, 300, 20, -10),
    UPRIGHT + "G0 C=ACP(10)|G91 C5|G90 A-3": (0, 0, 300, -3, 15),
}  # fmt: skip
PLANES = {
    PLANE_20 + "G0 X10 Y20 Z50": (10, 20, 50),
    PLANE_20 + "G0 X10 Y20 Z50|TRANS X1 Y2|X10 Y20|G91 G1 Z-5 F100": (11, 22, 45),
    PLANE_20 + "AROT Z90|G0 X10 Y20 Z50": (-20, 10, 50),
    "TRANS X5|" + PLANE_20 + "G0 X10 Y20 Z50": (10, 20, 50),  # a new plane ends programmed frames
    PLANE_LOWER + "G0 X10 Y20 Z50": (10, 20, 50),
    'CYCLE800(1,"",0,57,1,2,3,20,0,0,4,5,6,1)|G0 X10 Y20 Z50': None,
}


def length_added(point):
    """Positions of the axes with a tool of 100 mm."""
    x, y, z, *rest = point
    return (x, y, z + 100.0, *rest)


@pytest.mark.parametrize("text", TURNING)
def test_siemens_with_rotary_axes(text):
    program = f"G17 G90 G71 G94|{text}|".replace("|", "\n")
    found = positions(program, "siemens", "trunnion_ac", "XYZAC")
    assert found[-1] == pytest.approx(length_added(TURNING[text]), abs=1e-6)


@pytest.mark.parametrize("text", PLANES)
def test_siemens_planes(text):
    program = f"G17 G90 G71 G94|{UPRIGHT}{text}|".replace("|", "\n")
    x, y, z, *angles = positions(program, "siemens", "trunnion_ac", "XYZAC")[-1]
    plane = PLANES[text]
    wanted = tilted(10, 20, 50, 20) if plane is None else tilted(*plane, 20)
    if plane is None:  # X0 Y0 Z0 before the turn, X1 Y1 Z1 in the plane
        wanted = tuple(a + b for a, b in zip((1, 2, 3), tilted(14, 25, 56, 20), strict=True))
    assert angles == pytest.approx([-20.0, 180.0] if PLANE_LOWER in text else [20.0, 0.0])
    assert (x, y, z) == pytest.approx(length_added(on_the_table(*wanted, *angles)), abs=1e-6)


HEAD_5 = "TOOL CALL 1 Z S1000|L X+0 Y+0 Z+300 A+0 C+0 R0 FMAX|"
PLANE_H = "PLANE SPATIAL SPA+20 SPB+0 SPC+0 TURN FMAX SEQ+|"
TURNING_H = {
    "M128|L X+10 Y+20 Z+50 A+0 C+90 F100": on_the_table(10, 20, 50, 0, 90),
    "M128|L X+10 Y+20 Z+50 A+20 C+30 F100": on_the_table(10, 20, 50, 20, 30),
    "FUNCTION TCPM F TCP AXIS POS PATHCTRL AXIS|L X+10 Y+20 Z+50 A+20 C+30 F100": on_the_table(10, 20, 50, 20, 30),
    "M128|L X+10 Y+20 Z+50 A+20 C+30 F100|M129|L X+1 Y+2 Z+3": (1, 2, 3),
    "TRANS DATUM AXIS Z+5|M128|L X+10 Y+20 Z+50 A+0 C+90 F100": on_the_table(10, 20, 55, 0, 90),
    frame(10, "ROT+90") + "M128|L X+10 Y+20 Z+50 A+20 C+30 F100": on_the_table(-20, 10, 50, 20, 30),
    frame(7, "X+5") + "M128|L X+10 Y+20 Z+50 A+20 C+30 F100": on_the_table(15, 20, 50, 20, 30),
    "PLANE AXIAL A+20 C+0 TURN FMAX|L X+10 Y+20 Z+50 FMAX": on_the_table(*tilted(10, 20, 50, 20), 20, 0),
    "PLANE AXIAL A+20 C+0 TURN FMAX|L X+10 Y+20 Z+50 FMAX|L IZ-5": on_the_table(*tilted(10, 20, 45, 20), 20, 0),
    "PLANE AXIAL A+20 C+0 TURN FMAX|" + frame(7, "X+1 Y+2") + "L X+10 Y+20 Z+50": on_the_table(*tilted(11, 22, 50, 20), 20, 0),
    frame(7, "X+1 Y+2") + "PLANE AXIAL A+20 C+0 TURN FMAX|L X+10 Y+20 Z+50": on_the_table(
        *(a + b for a, b in zip((1, 2, 0), tilted(10, 20, 50, 20), strict=True)), 20, 0
    ),
    PLANE_H + "L X+10 Y+20 Z+50 FMAX": on_the_table(*tilted(10, 20, 50, 20), 20, 0),
    PLANE_H + frame(10, "ROT+90") + "L X+10 Y+20 Z+50 FMAX": on_the_table(*tilted(-20, 10, 50, 20), 20, 0),
    PLANE_H + "PLANE RELATIV SPA-20 TURN FMAX|L X+10 Y+20 Z+50 FMAX": (10, 20, 50),
    "PLANE VECTOR BX+1 BY+0 BZ+0 NX+0 NY-0.5 NZ+0.8660254 TURN FMAX SEQ+|L X+10 Y+20 Z+50": on_the_table(
        *tilted(10, 20, 50, 30), 30, 0
    ),
    "PLANE EULER EULPR+0 EULNU+20 EULROT+90 TURN FMAX SEQ+|L X+10 Y+20 Z+50": on_the_table(
        *tilted(-20, 10, 50, 20), 20, 0
    ),
    "PLANE AXIAL A+20 C+0 TURN FMAX|L X+10 Y+20 Z+50|PLANE RESET TURN FMAX|L X+1 Y+2 Z+3": (1, 2, 3),
}  # fmt: skip


@pytest.mark.parametrize("text", TURNING_H)
def test_klartext_with_rotary_axes(text):
    program = f"BEGIN PGM T MM|{HEAD_5}{text}|END PGM T MM|".replace("|", "\n")
    found = positions(program, "heidenhain", "trunnion_ac")
    assert found[-1] == pytest.approx(length_added(TURNING_H[text]), abs=1e-6)
