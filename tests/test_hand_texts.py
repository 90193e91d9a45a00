"""Corrected programs of three dialects, reckoned by hand line by line.

The machine is at every position +100, -200, +300 um beside X, Y, Z: the correction is X -0.1 Y +0.2 Z -0.3 in
machine coordinates, turned, mirrored and scaled as the frame is. A line of a table is `before | after`, a line alone
stays as it is, and `+ line` is one that is added.
"""

import io
import re

import pytest
from support.programs import AT_MOST, load, model_of, setup_of, source_of

from kinematics.basis import Polynomial
from kinematics.effects import ErrorMotion
from postproc.correct.job import Job
from postproc.correct.pipeline import Pipeline
from postproc.dialects import find_dialect
from postproc.text.source import ENCODING

SHIFT_UM = {"X": 100.0, "Y": -200.0, "Z": 300.0}
HEADS = {
    "heidenhain": "BEGIN PGM A MM\nTOOL CALL 1 Z S1000\nL X+10 Y+10 Z+50 R0 FMAX | L X+9.9000 Y+10.2000 Z+49.7000 R0 FMAX\n",
    "iso": "G21 G17 G90 G94 G54\nG0 X10. Y10. Z50. | G0 X9.9000 Y10.2000 Z49.7000\n",
    "siemens": "G17 G90 G71 G94\nG0 X10 Y10 Z50 | G0 X9.9000 Y10.2000 Z49.7000\n",
}


def model(machine, slope=0.0):
    """The same error everywhere; with a slope, E_XX grows by so many um per m."""
    effects = []
    for axis, um in SHIFT_UM.items():
        low, high = machine.axes[machine.index(axis)].travel
        effects.append(ErrorMotion(axis, axis, Polynomial((low, high), 0), (um,), u=(1.0,)))
    if slope:
        travel = machine.axes[machine.index("X")].travel
        effects.append(ErrorMotion("X", "X", Polynomial(travel, 1), (0.0, slope * travel[1] * 1e-3), u=(1.0,) * 2))
    return model_of(machine, *effects)


def written(dialect, text, **options):
    """The corrected program without the mark."""
    machine, out, source = load("gantry"), io.BytesIO(), source_of(text)
    slope = options.pop("slope", 0.0)
    job = Job(
        source,
        find_dialect(dialect, "", ""),
        machine,
        model(machine, slope),
        setup_of(machine, ["1=0,0,0"]),
        travel_check=False,
        **AT_MOST,
        **options,
    )
    Pipeline(job).run(out, lambda _: None)
    return re.sub(r"[(;] ?NCOMP .*\n", "", out.getvalue().decode(ENCODING), count=1)


def check(dialect, table, **options):
    before, after = [], []
    head = HEADS[dialect].replace("9.9000", "9.8990") if "slope" in options else HEADS[dialect]
    for line in (head + table.strip("\n")).split("\n"):
        left, bar, right = line.partition(" | ")
        if left.startswith("+ "):
            after.append(left[2:])
            continue
        before.append(left.rstrip())
        after.append(right.strip() if bar else left.rstrip())
    found = written(dialect, "\n".join([*before, ""]), **options)
    assert found == "\n".join([*after, ""])


KLARTEXT = {
    "a line": "L X+20 Y+30 Z+5 F500 | L X+19.9000 Y+30.2000 Z+4.7000 F500",
    "axes left out stay where they are": "L X+20 F500 | L X+19.9000 F500\nL Y-5 | L Y-4.8000\nL Z+1 | L Z+0.7000",
    "increments are as long as before": "L IX+5 IY-3 F500\nL IZ-10\nL X+20 IY+1 | L X+19.9000 IY+1",
    "commas": "L X+20,5 Y+30,25 F500 | L X+20,4000 Y+30,4500 F500",
    "no sign": "L X20 Y30 F500 | L X19.9000 Y30.2000 F500",
    "a negative number that becomes positive": "L Y-0.1 F500 | L Y+0.1000 F500",
    "a number that becomes zero": "L X+0.1 Y-0.2 F500 | L X+0.0000 Y+0.0000 F500",
    "numbered": "3 L X+20 F500 | 3 L X+19.9000 F500\n4 L Y+20 | 4 L Y+20.2000",
    "a comment": "L X+20 F500 ; X+20 Y+20 | L X+19.9000 F500 ; X+20 Y+20\n; L X+5",
    "feeds and M functions": "L X+20 F500 M8 | L X+19.9000 F500 M8\nL Y+20 F AUTO M9 | L Y+20.2000 F AUTO M9",
    "machine coordinates": "L Z+100 R0 FMAX M91\nL X+1 Y+1 Z+1 F500 | L X+0.9000 Y+1.2000 Z+0.7000 F500",
    "an arc": "L X+20 Y+0 F500 | L X+19.9000 Y+0.2000 F500\nCC X+10 Y+0 | CC X+9.9000 Y+0.2000\nC X+10 Y+10 DR+ | C X+9.9000 Y+10.2000 DR+",
    "an arc of one coordinate": "L X+20 Y+0 F500 | L X+19.9000 Y+0.2000 F500\nCC X+10 Y+0 | CC X+9.9000 Y+0.2000\nC X+0 DR- | C X-0.1000 DR-",
    "a full circle": "L X+20 Y+0 F500 | L X+19.9000 Y+0.2000 F500\nCC X+10 Y+0 | CC X+9.9000 Y+0.2000\nC X+20 Y+0 DR+ | C X+19.9000 Y+0.2000 DR+",
    "increments of an arc": "L X+20 Y+0 F500 | L X+19.9000 Y+0.2000 F500\nCC IX-10 IY+0\n+ CC X+9.9000 Y+0.2000\nC IX-10 IY+10 DR+",
    "an arc by its radius": "L X+20 Y+0 F500 | L X+19.9000 Y+0.2000 F500\nCR X+10 Y+10 R+10 DR+ | CR X+9.9000 Y+10.2000 R+10 DR+",
    "the longer arc by its radius": "L X+20 Y+0 F500 | L X+19.9000 Y+0.2000 F500\nCR X+10 Y+10 R-10 DR- | CR X+9.9000 Y+10.2000 R-10 DR-",
    "rounded corners": "L X+40 F500 | L X+39.9000 F500\nRND R2\nL Y+40 | L Y+40.2000\nCHF 1\nL X+10 | L X+9.9000",
    "a tangential arc": "L X+30 F500 | L X+29.9000 F500\nCT X+40 Y+20 | CC X+29.9000 Y+20.2000\n+ C X+39.9000 Y+20.2000 DR+",
    "a position about a pole": "CC X+0 Y+0\nLP PR+30 PA+0 F500 | LP PR+29.9007 PA+0.3832 F500\nLP PA+90 | LP PR+30.2002 PA+90.1897",
    "an arc about a pole": "L X+30 Y+0 F500 | L X+29.9000 Y+0.2000 F500\nCC X+0 Y+0 | CC X-0.1000 Y+0.2000\nCP PA+90 DR+",
    "increments about a pole": "L X+30 Y+0 F500 | L X+29.9000 Y+0.2000 F500\nCC X+0 Y+0 | CC X-0.1000 Y+0.2000\nCP IPA+90 DR+",
    "a helix": "L X+30 Y+0 F500 | L X+29.9000 Y+0.2000 F500\nCC X+0 Y+0 | CC X-0.1000 Y+0.2000\nCP IPA+720 IZ-10 DR+",
    "a shift": "CYCL DEF 7.0 DATUM SHIFT\nCYCL DEF 7.1 X+100\nCYCL DEF 7.2 Y+50\nL X+1 Y+2 Z+3 F500 | L X+0.9000 Y+2.2000 Z+2.7000 F500",
    "a rotation by 90 deg": "CYCL DEF 10.0 ROTATION\nCYCL DEF 10.1 ROT+90\nL X+20 Y+5 Z+3 F500 | L X+20.2000 Y+5.1000 Z+2.7000 F500",
    "a rotation by 30 deg": "CYCL DEF 10.0 ROTATION\nCYCL DEF 10.1 ROT+30\nL X+20 Y+5 Z+3 F500 | L X+20.0134 Y+5.2232 Z+2.7000 F500",
    "a rotation by 180 deg": "CYCL DEF 10.0 ROTATION\nCYCL DEF 10.1 ROT+180\nL X+20 Y+5 Z+3 F500 | L X+20.1000 Y+4.8000 Z+2.7000 F500",
    "a rotation by increments": "CYCL DEF 10.0 ROTATION\nCYCL DEF 10.1 ROT+60\nCYCL DEF 10.0 ROTATION\nCYCL DEF 10.1 IROT+30\nL X+20 Y+5 Z+3 F500 | L X+20.2000 Y+5.1000 Z+2.7000 F500",
    "a mirror": "CYCL DEF 8.0 MIRROR IMAGE\nCYCL DEF 8.1 X\nL X+20 Y+5 Z+3 F500 | L X+20.1000 Y+5.2000 Z+2.7000 F500",
    "a mirror of two axes": "CYCL DEF 8.0 MIRROR IMAGE\nCYCL DEF 8.1 X Y\nL X+20 Y+5 Z+3 F500 | L X+20.1000 Y+4.8000 Z+2.7000 F500",
    "an arc that is turned": "CYCL DEF 10.0 ROTATION\nCYCL DEF 10.1 ROT+90\nL X+20 Y+0 Z+3 F500 | L X+20.2000 Y+0.1000 Z+2.7000 F500\nCC X+10 Y+0 | CC X+10.2000 Y+0.1000\nC X+10 Y+10 DR+ | C X+10.2000 Y+10.1000 DR+",
    "a shift and a rotation": "CYCL DEF 7.0 DATUM SHIFT\nCYCL DEF 7.1 X+100\nCYCL DEF 10.0 ROTATION\nCYCL DEF 10.1 ROT-90\nL X+20 Y+5 Z+3 F500 | L X+19.8000 Y+4.9000 Z+2.7000 F500",
    "a rotation that ends": "CYCL DEF 10.0 ROTATION\nCYCL DEF 10.1 ROT+90\nL X+20 Y+5 Z+3 F500 | L X+20.2000 Y+5.1000 Z+2.7000 F500\nCYCL DEF 10.0 ROTATION\nCYCL DEF 10.1 ROT+0\nL X+20 Y+5 Z+3 | L X+19.9000 Y+5.2000 Z+2.7000",
    "a preset": "CYCL DEF 247 DATUM SETTING Q339=+1\nL X+20 Y+5 Z+3 F500 | L X+19.9000 Y+5.2000 Z+2.7000 F500",
    "a label that runs twice": "LBL 1\nL X+20 F500 | L X+19.9000 F500\nL X+30 | L X+29.9000\nLBL 0\nCALL LBL 1\nL Y+1 | L Y+1.2000",
    "repeats by increments": "L X+20 F500 | L X+19.9000 F500\nLBL 1\nL IX+5\nL IY+2\nCALL LBL 1 REP3",
    "parameters": "Q1 = 20\n+ FN 1: QL450 =+Q1 + -0.1000\nL X+Q1 F500 | L X+QL450 F500",
    "a negative parameter": "Q1 = 20\n+ FN 1: QL451 =-Q1 + +0.2000\nL Y-Q1 F500 | L Y+QL451 F500",
    "a feed by a parameter": "Q1 = 500\nL X+20 FQ1 | L X+19.9000 FQ1",
    "FN 9": "FN 0: Q1 = +0\nLBL 1\nL IX+5 F500\nFN 1: Q1 = +Q1 + +1\nFN 12: IF +Q1 LT +3 GOTO LBL 1",
    "drilling": "CYCL DEF 200 DRILLING ~\n  Q200=2 ;SET-UP CLEARANCE ~\n  Q201=-20 ;DEPTH ~\n  Q203=+0 ;SURFACE ~\n  Q204=50 ;2ND CLEARANCE\nL X+20 Y+30 FMAX M99 | L X+19.9000 Y+30.2000 FMAX M99",
    "a drilling call": "CYCL DEF 200 DRILLING ~\n  Q200=2 ;A ~\n  Q201=-20 ;B ~\n  Q203=+0 ;C ~\n  Q204=50 ;D\nL X+20 Y+30 FMAX | L X+19.9000 Y+30.2000 FMAX\nCYCL CALL",
    "radius compensation": "L X+20 Y+20 RL F500 | L X+19.9000 Y+20.2000 RL F500\nL Y+80 | L Y+80.2000\nL X+90 | L X+89.9000\nL X+100 Y+0 R0 | L X+99.9000 Y+0.2000 R0",
    "a dwell and a stop": "CYCL DEF 9.0 DWELL TIME\nCYCL DEF 9.1 DWELL 1\nSTOP M6\nL X+1 Y+1 Z+1 F500 | L X+0.9000 Y+1.2000 Z+0.7000 F500",
}  # fmt: skip


@pytest.mark.parametrize("name", KLARTEXT)
def test_klartext(name):
    check("heidenhain", KLARTEXT[name])


SIEMENS = {
    "a line": "G1 X20 Y30 Z5 F500 | G1 X19.9000 Y30.2000 Z4.7000 F500",
    "axes left out stay where they are": "G1 X20 F500 | G1 X19.9000 F500\nY-5 | Y-4.8000\nZ1 | Z0.7000",
    "an equals sign": "G1 X=20 Y=30.5 F500 | G1 X=19.9000 Y=30.7000 F500",
    "increments": "G91 G1 X5 Y-3 F500\nZ-10\nG90 X20 | G90 X19.9000",
    "increments of one word": "G1 X=IC(5) Y30 F500 | G1 X=IC(5) Y30.2000 F500",
    "a position among increments": "G91 G1 X=AC(20) Y5 F500 | G91 G1 X=AC(19.9000) Y5 F500",
    "numbered": "N10 G1 X20 F500 | N10 G1 X19.9000 F500\nN20 Y20 | N20 Y20.2000",
    "a comment": "G1 X20 F500 ; X20 Y20 | G1 X19.9000 F500 ; X20 Y20\n; X5",
    "inches": "G70 G1 X1 Y2 F10 | G70 G1 X0.996063 Y2.007874 F10",
    "machine coordinates": "G53 G0 Z100\nG1 X1 Y1 Z1 F500 | G1 X0.9000 Y1.2000 Z0.7000 F500",
    "an arc": "G1 X20 Y0 F500 | G1 X19.9000 Y0.2000 F500\nG3 X10 Y10 I-10 J0 | G3 X9.9000 Y10.2000 I-10 J0",
    "the centre by itself": "G1 X20 Y0 F500 | G1 X19.9000 Y0.2000 F500\nG3 X10 Y10 I=AC(10) J=AC(0) | G3 X9.9000 Y10.2000 I=AC(9.9000) J=AC(0.2000)",
    "an arc by its radius": "G1 X20 Y0 F500 | G1 X19.9000 Y0.2000 F500\nG3 X10 Y10 CR=10 | G3 X9.9000 Y10.2000 CR=10",
    "the longer arc by its radius": "G1 X20 Y0 F500 | G1 X19.9000 Y0.2000 F500\nG2 X10 Y10 CR=-10 | G2 X9.9000 Y10.2000 CR=-10",
    "a full circle": "G1 X20 Y0 F500 | G1 X19.9000 Y0.2000 F500\nG2 I-10 J0",
    "a helix": "G1 X20 Y0 F500 | G1 X19.9000 Y0.2000 F500\nG3 X20 Y0 Z5 I-10 J0 TURN=2 | G3 X19.9000 Y0.2000 Z4.7000 I-10 J0 TURN=2",
    "an arc of another plane": "G18 G1 X20 Z0 F500 | G18 G1 X19.9000 Z-0.3000 F500\nG2 X10 Z10 I-10 K0 | G2 X9.9000 Z9.7000 I-10 K0",
    "arcs of increments": "G91 G1 X10 Y0 F500\nG3 X-10 Y10 I-10 J0",
    "a shift": "TRANS X100 Y50\nG1 X1 Y2 Z3 F500 | G1 X0.9000 Y2.2000 Z2.7000 F500",
    "a shift and another": "TRANS X100\nATRANS Y50\nG1 X1 Y2 Z3 F500 | G1 X0.9000 Y2.2000 Z2.7000 F500",
    "a rotation by 90 deg": "ROT Z90\nG1 X20 Y5 Z3 F500 | G1 X20.2000 Y5.1000 Z2.7000 F500",
    "a rotation of the plane": "ROT RPL=30\nG1 X20 Y5 Z3 F500 | G1 X20.0134 Y5.2232 Z2.7000 F500",
    "a rotation and another": "ROT Z60\nAROT Z30\nG1 X20 Y5 Z3 F500 | G1 X20.2000 Y5.1000 Z2.7000 F500",
    "a rotation behind a shift": "TRANS X100 Y100\nAROT Z45\nG1 X20 Y5 Z3 F500 | G1 X20.0707 Y5.2121 Z2.7000 F500",
    "a rotation about X": "ROT X90\nG1 X20 Y5 Z3 F500 | G1 X19.9000 Y4.7000 Z2.8000 F500",
    "a rotation about Y": "ROT Y90\nG1 X20 Y5 Z3 F500 | G1 X20.3000 Y5.2000 Z2.9000 F500",
    "a mirror": "MIRROR X0\nG1 X20 Y5 Z3 F500 | G1 X20.1000 Y5.2000 Z2.7000 F500",
    "a scale": "SCALE X2 Y2 Z2\nG1 X20 Y5 Z3 F500 | G1 X19.9500 Y5.1000 Z2.8500 F500",
    "a scale of one half": "SCALE X0.5 Y0.5 Z0.5\nG1 X20 Y5 Z3 F500 | G1 X19.8000 Y5.4000 Z2.4000 F500",
    "an arc that is turned": "ROT Z90\nG1 X20 Y0 Z3 F500 | G1 X20.2000 Y0.1000 Z2.7000 F500\nG3 X10 Y10 I-10 J0 | G3 X10.2000 Y10.1000 I-10 J0",
    "a frame that ends": "ROT Z90\nG1 X20 Y5 Z3 F500 | G1 X20.2000 Y5.1000 Z2.7000 F500\nROT\nX20 Y5 Z3 | X19.9000 Y5.2000 Z2.7000",
    "another work offset": "G55\nG0 X1 Y2 Z3 | G0 X0.9000 Y2.2000 Z2.7000\nG500\nX1 Y2 Z3 | X0.9000 Y2.2000 Z2.7000",
    "polar coordinates": "G111 X0 Y0\nG1 AP=0 RP=30 F500 | G1 X29.9000 Y0.2000 F500\nAP=90 RP=30 | X-0.1000 Y30.2000",
    "a parameter": "R1=20\nG1 X=R1 F500 | G1 X=R1-0.1000 F500\nY=R1*2 | Y=R1*2+0.2000",
    "a parameter that is negative": "R1=20\nG1 X=-R1 F500 | G1 X=-R1-0.1000 F500",
    "a position by a parameter": "R1=20\nG1 X=AC(R1) Y=IC(R1) F500 | G1 X=AC(R1-0.1000) Y=IC(R1) F500",
    "a position that is read": "G1 X20 F500 | G1 X19.9000 F500\nX=$AA_IW[X]+5 | X=24.9000",
    "a position that is read, among increments": "G91 G1 X=AC($AA_IW[Y]*2) F500 | G91 G1 X=AC(19.9000) F500",
    "a position that is kept": "R1=$AA_IW[Z]\nG1 X20 F500 | G1 X19.9000 F500\nZ=R1 | Z=49.7000\nR2=7\nY=R2 | Y=R2+0.2000",
    "a loop to a position": "REPEAT\nG1 Z=IC(2) F500\nUNTIL $AA_IW[Z]>55\nX20 | X19.9000",
    "a loop of increments": "G91\nFOR R1=1 TO 3\nG1 X5 F500\nENDFOR\nG90",
    "a loop of positions": "DEF INT II\nFOR II=1 TO 3\nG1 X=II*10 F500 | G1 X=II*10-0.1000 F500\nENDFOR",
    "a jump": "R1=0\nMARK:\nG91 G1 X5 F500\nR1=R1+1\nIF R1<3 GOTOB MARK\nG90",
    "modal drilling": "MCALL CYCLE81(50,0,2,-20)\nX20 Y30 | X19.9000 Y30.2000\nX40 | X39.9000 Z49.7000\nMCALL",
    "one hole": "G0 X20 Y30 | G0 X19.9000 Y30.2000\nCYCLE81(50,0,2,-20)",
    "radius compensation": "G41 G1 X20 Y20 D1 F500 | G41 G1 X19.9000 Y20.2000 D1 F500\nY80 | Y80.2000\nX90 | X89.9000\nG40 X100 Y0 | G40 X99.9000 Y0.2000",
    "rounded corners": "G1 X40 RND=2 F500 | G1 X39.9000 RND=2 F500\nY40 CHF=1 | Y40.2000 CHF=1\nX10 | X9.9000",
    "a message and a dwell": 'MSG("X20 Y30")\nG4 F1\nG1 X20 F500 | G1 X19.9000 F500',
    "a subprogram": "UP\nG1 X1 F500 | G1 X0.9000 F500\nM30\n%_N_UP_SPF\nG1 X20 F300 | G1 X19.9000 F300\nM17",
}  # fmt: skip


@pytest.mark.parametrize("name", SIEMENS)
def test_siemens(name):
    check("siemens", SIEMENS[name])


ISO = {
    "rounded corners": "G1 X40. ,R2. F500. | G1 X39.9000 ,R2. F500.\nY40. ,C1. | Y40.2000 ,C1.\nX10. | X9.9000",
    "corners of increments": "G91 G1 X10. ,R2. F500.\nY10.",
    "a line by its angle": "G1 X40. ,A0. F500. | G1 X39.9000 Y10.2000 F500.\nG1 Y30. ,A45. ,R1. | G1 Y30.2000 X59.9000 ,R1.\nX0. | X-0.1000",
    "an arc behind a corner": "G1 X40. ,R2. F500. | G1 X39.9000 ,R2. F500.\nG3 Y40. R15. ,C1. | G3 Y40.2000 R15. ,C1.\nG1 X10. | G1 X9.9000",
}  # fmt: skip


@pytest.mark.parametrize("name", ISO)
def test_iso(name):
    check("iso", ISO[name])


SLOPED = {
    "heidenhain": {
        "a line": "L X+1000 Y+10 F500 | L X+999.8000 Y+10.2000 F500\nL X+2000 | L X+1999.7000",
        "increments": "L IX+1000 F500 | L IX+999.9000 F500\nL IX+1000 | L IX+999.9000",
        "there and back": "L X+1000 F500 | L X+999.8000 F500\nL X+0 | L X-0.1000",
    },
    "siemens": {
        "a line": "G1 X1000 Y10 F500 | G1 X999.8000 Y10.2000 F500\nX2000 | X1999.7000",
        "increments": "G91 G1 X1000 F500 | G91 G1 X999.9000 F500\nX1000 | X999.9000",
        "a line and an increment": "G1 X1000 Y0 F500 | G1 X999.8000 Y0.2000 F500\nG91\nX1000 | X999.9000",
    },
}


@pytest.mark.parametrize(("dialect", "name"), [(d, name) for d, table in SLOPED.items() for name in table])
def test_an_error_that_grows_along_x(dialect, name):
    """100 um per m: the correction of X is -0.1 mm at 0 and another -0.1 mm every 1000 mm."""
    check(dialect, SLOPED[dialect][name], slope=100.0, tolerance_um=1000.0)
