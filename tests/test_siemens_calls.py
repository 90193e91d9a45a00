"""Several Siemens programs in one file: calls, parameters, what belongs to whom; data of the control that programs set."""

import numpy as np
import pytest
from support.programs import load, random_model, shifted
from support.siemens_programs import correct, corrected, ends, read

from kinematics.user_error import UserError
from postproc.control.setup import make_setup
from postproc.control_data.tool_tables import read_tool_table
from postproc.correct.check import check
from postproc.motion.moves import Kind

OFFSET = {"X": 3.0, "Y": -4.2, "Z": 5.5}
SHIFT = [-0.003, 0.0042, -0.0055]
MAIN = "%_N_MAIN_MPF\n;$PATH=/_N_WKS_DIR\nG1 X0 Y0 Z0 F500\n"

RUNS = {
    "by number": ("L10\nX9\nM30\n%_N_L10_SPF\nX1\nM17\n", [0, 1, 9]),
    "passes": ("L10 P3\nM30\n%_N_L10_SPF\nX=IC(2)\nM17\n", [0, 2, 4, 6]),
    "passes of a variable": ("R5=2\nN10 PART P=R5\nM30\n%_N_PART_SPF\nX=IC(2)\nRET\n", [0, 2, 4]),
    "leading zeros are names": ("L010\nL10\nM30\n%_N_L10_SPF\nX1\nM17\n%_N_L010_SPF\nX2\nM17\n", [0, 2, 1]),
    "parameters": ("PART(5,R1+2)\nPART(1)\nM30\n%_N_PART_SPF\nPROC PART(REAL AA, REAL BB=7) DISPLOF\nX=AA\nX=BB\nM17\n", [0, 5, 3, 1, 7]),
    "one left out": ("PART(,5)\nM30\n%_N_PART_SPF\nPROC PART(INT AA=3, INT BB)\nX=AA+BB\nM17\n", [0, 8]),
    "variables of their own": ("DEF REAL AA=3\nPART\nX=AA\nM30\n%_N_PART_SPF\nDEF REAL AA=5\nX=AA\nR1=8\nM17\n", [0, 5, 3]),
    "R belongs to all": ("R1=1\nPART\nX=R1\nM30\n%_N_PART_SPF\nR1=8\nM17\n", [0, 8]),
    "labels of their own": ("GOTOF EN\nX99\nEN: PART\nM30\n%_N_PART_SPF\nGOTOF EN\nX99\nEN: X1\nM30\n", [0, 1]),
    "nested": ("AA1\nM30\n%_N_AA1_SPF\nX1\nBB1\nX3\nM17\n%_N_BB1_SPF\nX2\nM2\n", [0, 1, 2, 3]),
    "recursion": ("PART(3)\nM30\n%_N_PART_SPF\nPROC PART(INT NN)\nIF NN>0\nX=NN\nPART(NN-1)\nX=NN*10\nENDIF\nM17\n", [0, 3, 2, 1, 10, 20, 30]),
    "in a loop": ("DEF INT II\nFOR II=1 TO 2\nPART(II)\nENDFOR\nM30\n%_N_PART_SPF\nPROC PART(INT NN)\nX=NN\nM17\n", [0, 1, 2]),
    "by a name in quotes": ('CALL "PART"\nCALL "_N_PART_SPF"\nM30\n%_N_PART_SPF\nX=IC(1)\nM17\n', [0, 1, 2]),
    "by its path": ("PCALL /_N_WKS_DIR/PART(4, 7)\nPCALL /_N_WKS_DIR/_N_PART_SPF (1)\nPCALL PART\nM30\n%_N_PART_SPF\nPROC PART(REAL AA=3, REAL BB=5)\nX=AA+BB\nM17\n", [0, 11, 6, 8]),
    "declared": ("EXTERN PART(REAL)\nPART(4)\nM30\n%_N_PART_SPF\nPROC PART(REAL AA)\nX=AA\nM17\n", [0, 4]),
    "repeated parts": ("REPEAT LA1 P=1\nM30\n%_N_PART_SPF\nLA1: X5\nM17\n", None),
}  # fmt: skip


@pytest.mark.parametrize("name", [name for name in RUNS if RUNS[name][1]])
def test_calls(name):
    text, expected = MAIN + RUNS[name][0].replace("R1+2", "1+2"), RUNS[name][1]
    assert ends(text) == pytest.approx(expected, abs=1e-9)
    assert correct(text) == text
    written = correct(text, model=shifted(load("gantry"), **OFFSET))
    before, after = read(text).target, read(written).target
    np.testing.assert_allclose(after - before, np.broadcast_to(SHIFT, before.shape), atol=1e-9)


def test_a_subprogram_at_one_place_is_corrected():
    text = MAIN + "G0 X5 Y5 Z5\nL10\nG0 X5 Y5 Z5\nL10\nM30\n%_N_L10_SPF\nG1 X10 Y8\nY9 Z1\nM17\n"
    written = correct(text, model=random_model(load("gantry"), 5))
    assert "\nL10\n" in written
    assert written.count("%_N_L10_SPF") == 1
    assert written != text


REFUSED = {
    "L10\nM30\n": "the file has no subprogram L10, and its folder is not known: give its folder by --subprograms",
    "PART\nM30\n%_N_OTHER_SPF\nM17\n": "PART is not known to ncomp",
    "X1 PART\nM30\n%_N_PART_SPF\nM17\n": "the call of PART must be alone in its block",
    "MCALL PART\nMCALL PART\nM30\n%_N_PART_SPF\nM17\n": "another MCALL is active: write MCALL before this one",
    "PART(1,2)\nM30\n%_N_PART_SPF\nPROC PART(REAL AA)\nM17\n": "the call has more arguments than the subprogram has parameters: remove the others",
    "PART\nM30\n%_N_PART_SPF\nPROC PART(REAL AA)\nX=AA\nM17\n": "X=AA: AA is not known: the call omits the argument for AA",
    "PART(X)\nM30\n%_N_PART_SPF\nPROC PART(VAR REAL AA)\nM17\n": "X is neither a declared variable nor an axis",
    "PART\nX1\nM30\n%_N_PART_SPF\nPROC PART SAVE\nTRANS X5\nM17\n": "ends with another frame",
    "DEF REAL BB=3\nPART\nM30\n%_N_PART_SPF\nX=BB\nM17\n": "BB belongs to the calling program",
    "GOTOF THERE\nM30\n%_N_PART_SPF\nTHERE: X1\nM17\n": "the program has no block with the label THERE",
    "PART\nM30\n%_N_PART_SPF\nPART\nM17\n": "call each other more than 100 deep",
    "X1\n%_N_PART_SPF\nX2\nM17\n": "the program before this one has no end",
    RUNS["repeated parts"][0]: "the repetition needs exactly one label LA1 before it",
}


@pytest.mark.parametrize("text", REFUSED)
def test_calls_that_are_refused(text):
    with pytest.raises(UserError, match=r"^test\.mpf:\d+: ") as caught:
        read(MAIN + text)
    assert REFUSED[text] in str(caught.value)


def test_a_subprogram_that_nothing_calls():
    with pytest.raises(UserError, match="AA is not known: this is a subprogram, and no program has called it"):
        read("PROC PART(REAL AA)\nG1 X=AA F100\nM17\n")


SAVED = "%_N_A_MPF\nG71 G90 G17 G54 G0 X0 Y0 Z0\nSTEP(5)\nX20\nM30\n%_N_STEP_SPF\nPROC STEP(REAL DIST){}\nG91 G1 X=DIST F100\nG55\nG90 X7\nG91\nRET\n"


@pytest.mark.parametrize(
    ("save", "last", "rapid"), [(" SAVE", 120.0, True), ("", 227.0, False), (" SAVE DISPLOF", 120.0, True)]
)
def test_modes_of_the_caller_behind_a_subprogram_with_save(save, last, rapid):
    """X20 in G54, G90 and G0 of the caller; without SAVE a feed by 20 from X7 of G55."""
    motions = read(SAVED.format(save), offsets=["G54=100,0,0", "G55=200,0,0"])
    assert motions.machine_target[:, 0].tolist() == [100.0, 105.0, 207.0, last]
    assert (motions.kind[-1] == Kind.RAPID) == rapid


def test_check_sees_what_runs():
    from support.programs import source_of
    from support.siemens_programs import SIEMENS

    text = MAIN + "L10\nM30\n%_N_L10_SPF\nX1\nM17\n%_N_L11_SPF\nX2\nM17\n"
    machine = load("gantry")
    found = check(source_of(text, "test.mpf"), SIEMENS, machine, make_setup(machine, zero=True))
    assert found.refused == []
    assert found.corrected == [3, 7]
    assert found.not_run == [10, 11]


# ---- what programs and archives set in the control


def test_work_offsets_that_a_program_sets_hold_from_their_next_call():
    text = "G54\nG0 X0 Y0 Z0\n$P_UIFR[1]=CTRANS(X,10,Y,20):CROT(Z,0)\n$P_UIFR[1,Z,TR]=5\n$P_UIFR[1,X,FI]=0.5\nTRANS Y1\nX0 Y0 Z0\nG54\nX0 Y0 Z0\n"
    assert read(text, offsets=["G54=1,2,3"]).machine_target.tolist() == [[1, 2, 3], [1, 3, 3], [10.5, 21, 5]]
    assert correct(text, offsets=["G54=1,2,3"]) == text


def test_lengths_that_a_program_sets():
    text = "$TC_DP1[1,1]=120 $TC_DP3[1,1]=80 $TC_DP12[1,1]=0.5\n$TC_DP3[1,2]=90\nT1 M6\nD1 G0 X0 Y0 Z0\nD2 Z0\nD0 Z0\n"
    assert read(text).machine_target[:, 2].tolist() == [80.5, 90, 0]
    notes = corrected("T1 M6\nD2 G0 X0 Y0 Z0\n", tools=["T1=80"])[1]
    assert any("D2 of tool 1 is taken to be as long as D1" in note for note in notes)


ARCHIVE = """\
%_N_TO1_TOA
;$PATH=/_N_TOA_DIR
CHANDATA(1)
$TC_TP1[5]=1
$TC_TP2[5]="MILL 12"
$TC_DP1[5,1]=120 ; $TC_DP4[9,1]=7
N10 $TC_DP3[5,1]=120.5
$TC_DP6[5,1]=6
$TC_DP12[5,1]=-0.02
$TC_DP3[5,2]=99
$P_UIFR[0]=CTRANS():CROT():CSCALE():CMIRROR()
$P_UIFR[1]=CTRANS(X,10.5,Y,-20,Z,0):CROT(X,0,Y,0,Z,0):CSCALE(X,1,Y,1,Z,1):CMIRROR(X,0,Y,0,Z,0)
$P_UIFR[5,X,TR]=1.25
M17
"""


def test_archives_of_tools_and_offsets(tmp_path):
    path = tmp_path / "tools.ini"
    path.write_text(ARCHIVE)
    table = read_tool_table(path)
    assert table.tools == pytest.approx({"5": 120.48, "MILL 12": 120.48, "5 D2": 99, "MILL 12 D2": 99})
    assert table.radii == {"5": 6, "MILL 12": 6}
    assert table.work_offsets == {"G500": {}, "G54": {"X": 10.5, "Y": -20, "Z": 0}, "G505": {"X": 1.25}}
    text = 'G54 T="MILL 12" M6 D2\nG0 X0 Y0 Z0\nD1 Z0\n'
    from support.programs import source_of

    from postproc.dialects import find_dialect
    from postproc.motion.motions import merged
    from postproc.verification.verify import read_motions

    machine = load("gantry")
    motions = merged(
        read_motions(
            source_of(text), find_dialect("siemens", "", ""), machine, make_setup(machine, table=table, zero=True)
        )
    )
    assert motions.machine_target.tolist() == [[10.5, -20, 99], [10.5, -20, pytest.approx(120.48)]]


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        ("$TC_DP4[1,1]=5", "$TC_DP4 is a tool length across the tool axis, which is not corrected"),
        ("$P_UIFR[1,Z,RT]=30", "G54 is rotated, scaled or mirrored, which is not followed"),
        ("$P_UIFR[1]=CTRANS(X,1):CROT(Z,30)", "CROT or CMIRROR rotates or mirrors a frame, which is not followed"),
        ("$P_UIFR[1]=CTRANS(X,R5)", "R5 is not set"),
        ("$P_UIFR[1,X,TR=5", "is not understood"),
        ("CHANDATA(2)\n$TC_DP3[1,1]=5", "another channel"),
        ("$P_UIFR[1,Q,TR]=5", "Q"),
    ],
)
def test_archives_that_are_refused(tmp_path, line, reason):
    path = tmp_path / "tools.ini"
    path.write_text("$TC_DP3[2,1]=5\n" + line + "\n")
    with pytest.raises(UserError, match=r"tools\.ini:[23]: ") as caught:
        read_tool_table(path)
    assert reason in str(caught.value)
