"""Programs of three dialects that call one another, for a gantry with errors that are slopes."""

from kinematics.basis import Polynomial
from kinematics.effects import ErrorMotion
from machines import load
from support.programs import model_of

GANTRY = load("gantry")
MODEL = model_of(
    GANTRY,
    ErrorMotion("X", "X", Polynomial((0.0, 5000.0), 1), (20.0, 500.0)),
    ErrorMotion("Y", "X", Polynomial((0.0, 5000.0), 1), (-30.0, 250.0)),
    ErrorMotion("Z", "Y", Polynomial((0.0, 3000.0), 1), (0.0, -150.0)),
)


def written(folder, files):
    """Files of programs by name; returns the folder."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)
    return folder


FANUC = {
    "O0001.nc": "%\nO0001 (MAIN)\nG21 G90 G54 G17\nG0 X100. Y100. Z50.\nM98 P1000 L2\nM98 P0003\nG65 P9001 A450. B650.\nM30\n%\n",
    "O1000.nc": "%\nO1000\nG1 X300. Y200. Z0. F500\nX700.\nM98 P3\nM99\n%\n",
    "3": "O3\nG0 X700. Y300. Z50.\nM99\n",
    "o9001.NC": "%\nO9001 (MACRO)\nG1 X#1 Y#2 Z-1. F200\nM99\n%\n",
}
SIEMENS = {
    "MAIN.MPF": """\
G71 G90 G54 G17
DEF REAL RESULT = 0
R1=0
G0 X100 Y100 Z50
TRANS X0
L100 P2
POCKET(450, 650, "A")
CALL "_N_SIDE_SPF"
EXTCALL "L100.SPF"
DOUBLE(R1+300, RESULT)
G1 X=RESULT Y200 Z10
M30
""",
    "L100.SPF": "G1 X300 Y200 Z0 F500\nX700\nSIDE\nM17\n",
    "_N_SIDE_SPF": "%_N_SIDE_SPF\n;$PATH=/_N_WKS_DIR/_N_PART_WPD\nG0 X700 Y300 Z50\nRET\n",
    "pocket.spf": 'PROC POCKET(REAL AA, REAL BB, STRING[32] TAG="") DISPLOF\nG1 X=AA Y=BB Z-1 F200\nM17\n',
    "TRANS.SPF": "X9\nM17\n",
    "DOUBLE.SPF": "PROC DOUBLE(REAL AA, VAR REAL BB)\nBB=2*AA\nM17\n",
}
KLARTEXT = {
    "main.h": """\
0 BEGIN PGM MAIN MM
1 TOOL CALL 1 Z S2000
2 Q1 = 450
3 QL1 = 7
4 L X+100 Y+100 Z+50 R0 FMAX
5 CALL PGM part
6 CALL PGM sub\\inner.h
7 SEL PGM "macro.H"
8 CALL SELECTED PGM
9 CYCL DEF 12.0 PGM CALL
10 CYCL DEF 12.1 PGM END.H
11 L X+200 Y+500 Z+60 R0 FMAX M99
12 CYCL CALL
13 L X+QL1 Y+0 Z+60 FMAX
14 M30
15 END PGM MAIN MM
""",
    "PART.H": """\
0 BEGIN PGM PART MM
1 CALL LBL 1
2 L X+300 Y+200 Z+0 F500
3 LBL 1
4 L X+700 Y+200 Z+0 F500
5 LBL 0
6 CALL PGM END.H
7 END PGM PART MM
""",
    "sub/inner.h": "BEGIN PGM INNER MM\nQL1 = 1\nCALL PGM deep.h\nEND PGM INNER MM\n",
    "sub/deep.h": "BEGIN PGM DEEP MM\nL X+800 Y+800 Z+50 FMAX\nEND PGM DEEP MM\n",
    "macro.h": "BEGIN PGM MACRO MM\nL X+Q1 Y+650 Z-1 F200\nEND PGM MACRO MM\n",
    "END.H": "BEGIN PGM END MM\nL X+700 Y+300 Z+50 FMAX\nEND PGM END MM\n",
}
