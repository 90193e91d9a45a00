"""Statements that set more than the variable they name: followed, or unknown afterwards, in all dialects."""

import pytest
from support.command import refusal, succeed
from support.siemens_programs import ends

from kinematics.user_error import UserError

HEAD = "G500 G90 G1 X0 Y0 Z0 F100\n"
FOLLOWED = {
    "SET fills from the element on": ("DEF REAL VAL[3]\nVAL[0]=SET(10,20,300)\nX=VAL[2]", 300.0),
    "SET in the middle": ("DEF REAL VAL[2,3]=REP(7)\nVAL[0,2]=SET(1,2,3)\nX=VAL[0,1]*1000+VAL[1,1]*10", 7030.0),
    "REP to the end": ("DEF REAL VAL[4]\nVAL[1]=REP(9)\nX=VAL[3]*10+VAL[0]", 90.0),
    "REP with a number": ("DEF REAL VAL[4]\nVAL[1]=REP(9,2)\nX=VAL[2]*10+VAL[3]", 90.0),
    "R parameters": ("R2=1\nR[1]=SET(10,200)\nX=R2", 200.0),
    "R parameters by a number": ("R2=1\nR1=SET(10,200)\nX=R2", 200.0),
    "R parameters to the last": ("R2=1 R7=3\nR[2]=REP(4)\nX=R7", 4.0),
    "computed": ("DEF INT VAL[3]\nR1=2\nVAL[0]=SET(R1,R1*1.3,R1+0.6)\nX=VAL[1]*10+VAL[2]", 33.0),
    "a truth value": ("DEF BOOL FLAG\nFLAG=5\nIF FLAG==TRUE\nX7\nELSE\nX8\nENDIF", 7.0),
    "rounded up": ("R1=2.1\nX=ROUNDUP(R1)*10+ROUNDUP(-3.6)", 27.0),
    "a function that reads": ('DEF STRING[9] NAME="AB"\nR1=3\nR2=STRLEN(NAME)\nR3=NUMBER(R1)\nX=R1', 3.0),
    "a cycle of the control": ("R1=3\nCYCLE832(0.1,1)\nX=R1", 3.0),
}  # fmt: skip


@pytest.mark.parametrize("case", FOLLOWED)
def test_values_of_several_elements_are_followed(case):
    text, x = FOLLOWED[case]
    assert ends(HEAD + text + "\nM30\n")[-1] == x


UNKNOWN = {
    "a result by reference": ("DEF REAL PT[3,2],RES[3]\nDEF BOOL ST\nST=CALCDAT(PT,3,RES)\nX=RES[0]", "CALCDAT may write"),
    "in a formula": ("DEF REAL RES[3]\nR1=R5+CALCDAT(RES,3,RES)\nX=RES[0]", "CALCDAT may write"),
    "in an argument": ('DEF INT NR\nNR=4\nMSG("A"<<GETACTTD(NR,3))\nX=NR', "GETACTTD may write"),
    "an R parameter": ("R1=4\nR2=MYFUNCTION(R1)\nX=R1", "MYFUNCTION may write"),
    "in a first value": ("DEF REAL RES[3]\nDEF REAL MEETS=INTERSEC(RES,RES,RES)\nX=RES[1]", "INTERSEC may write"),
    "left out of a list": ("DEF REAL VAL[3]\nVAL[0]=SET(1,,3)\nX=VAL[1]", "the list of its values leaves it out"),
    "a longer list": ("DEF REAL VAL[3]\nVAL[1]=SET(1,2,3)\nX=VAL[1]", "fewer elements behind it"),
    "a list for the control": ("$TC_DP3[1,1]=SET(1,2)\nX1", "list of values"),
    "a character": ('DEF STRING[9] WORD="X1"\nWORD[0]="Y"\nIF WORD=="X1"\nX1\nENDIF', "a character of it"),
    "an array as a whole": ("DEF REAL VAL[3]\nVAL=5\nX=VAL[0]", "VAL is no element of VAL[3]"),
    "beyond the array": ("DEF REAL VAL[3]\nVAL[3]=5\nX=VAL[0]", "VAL[3] is no element of VAL[3]"),
}  # fmt: skip


@pytest.mark.parametrize("case", UNKNOWN)
def test_other_results_are_unknown(case):
    text, reason = UNKNOWN[case]
    with pytest.raises(UserError, match=r"test\.mpf:") as refused:
        ends(HEAD + text + "\nM30\n")
    assert reason in str(refused.value)


PASSED = {
    "a procedure": ("DEF INT ERR\nREAD(ERR)\nX=ERR", "READ", "READ may write a result there"),
    "a subprogram": ("R1=4\nMEASURE_ALL(1)\nX=R1", "MEASURE_ALL", "R1 is not known: MEASURE_ALL passes"),
    "ISO": ("#101=4\nG234\nX#101", "G234", "#101 is not known: G234 passes"),
}  # fmt: skip


SETTINGS = ("--machine", "gantry", "--calibration", "none", "--set-up-zero", "--no-travel-check")


@pytest.mark.parametrize("case", PASSED)
def test_results_of_what_passes_are_unknown(case, tmp_path):
    text, passed, reason = PASSED[case]
    head, name = ("G21 G90 G54 G1 X0. Y0. Z0. F100\n", "a.nc") if case == "ISO" else (HEAD, "a.mpf")
    (tmp_path / name).write_text(f"{head}{text}\nM30\n")
    assert reason in refusal(tmp_path / name, *SETTINGS, "--pass-through", passed, "-o", tmp_path / "out.nc")


def test_cycles_of_the_control_keep_r_parameters(tmp_path):
    (tmp_path / "a.mpf").write_text(f"{HEAD}R1=4\nCYCLE977(R1)\nX=R1\nM30\n")
    succeed(tmp_path / "a.mpf", *SETTINGS, "--pass-through", "CYCLE977", "-o", tmp_path / "out.mpf")


TABLES = {
    "columns of a table": 'Q11 = 0\nFN 28: TABREAD Q10 = 6/"X,Y"',
    "columns of a computed line": 'Q11 = 0\nFN 28: TABREAD Q10 = Q6/"X,Y,D" ; data',
    "a circle by three points": "Q11 = 0\nFN 23: Q9 = CDATA Q30",
    "a circle by four points": "Q11 = 0\nFN 24: Q10 = CDATA Q30",
    "a cycle that passes": "Q11 = 0\nCYCL DEF 444 PROBING ~\n Q263=+1",
}


@pytest.mark.parametrize("case", TABLES)
def test_consecutive_parameters_are_unknown(case, tmp_path):
    text = f"BEGIN PGM A MM\nL X+0 Y+0 Z+5 F100\n{TABLES[case]}\nL X+10 Y+Q11\nEND PGM A MM\n"
    (tmp_path / "a.h").write_text(text)
    said = refusal(tmp_path / "a.h", *SETTINGS, "--pass-through", "CYCLDEF444", "-o", tmp_path / "out.h")
    assert "Y+Q11: Q11 is not known" in said


def test_other_parameters_of_a_table_stay(tmp_path):
    text = 'BEGIN PGM A MM\nL X+0 Y+0 Z+5 F100\nQ12 = 7\nFN 28: TABREAD Q10 = 6/"X,Y"\nL Y+Q12\nEND PGM A MM\n'
    (tmp_path / "a.h").write_text(text)
    succeed(tmp_path / "a.h", *SETTINGS, "-o", tmp_path / "out.h")
