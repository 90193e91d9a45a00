"""Blocks of all kinds in any order: corrected, or refused with a line and a reason, and the bytes stay without errors."""

import contextlib

import numpy as np
from hypothesis import strategies as st
from support.programs import load, random_model
from support.siemens_programs import correct, read
from support.tiers import drawn

from kinematics.user_error import UserError

BLOCKS = """\
G0 X0 Y0 Z50
G1 X10 Y5 Z20 F500
G1 X=IC(5) Y=AC(3)
X20
B10 C20
B=DC(-10) X5
G2 X30 Y5 I10 J0
G3 X10 Y10 CR=20
G3 X10 Y10 AR=90
G2 I10 AR=45
G3 X=IC(0) I5 TURN=1 Z=IC(-2)
G3 I5
G111 X5 Y5
G110 AP=30 RP=5
G1 AP=30 RP=20
AP=IC(10)
G3 AP=90
G90
G91
G17
G18
G700
G710
G54
G55
TRANS X10 Y5
ATRANS Z=2
AROT Z30
ROT X10 Y20
AMIRROR X0
TRANS
T1 M6
D1
D2
D0
TRAORI
TRAFOOF
G1 X5 Y5 Z30 A3=0.1 B3=0 C3=1
ORIMKS
ORIWKS
CYCLE800(1,"A",0,57,0,0,0,0,20,0)
CYCLE800(1,"A",1,39,5,0,0,10,0,5)
CYCLE800()
MCALL CYCLE81(40,10,2,-5)
MCALL
CYCLE83(R1,10,2,-5)
HOLES1(0,0,0,5,5,3)
SUPA G0 Z300 D0
G53 X5 Y5
G74 Z1=0
G41
G42 X5 Y5
G40 X0
RNDM=2
RND=1 X15 Y15
RNDM=0
R1=R1+1
R1=5
X=R1
$P_UIFR[1]=CTRANS(X,10)
$TC_DP3[1,1]=90
M8
M77
G4 F1
G93
G94
CYCLE832(0.01)
; a
/M8
""".splitlines()


@drawn(
    few=15,
    many=40,
    blocks=st.lists(st.sampled_from(BLOCKS), min_size=1, max_size=14),
    machine=st.sampled_from(["trunnion_bc", "head_table", "dmu50"]),
)
def test_blocks_in_any_order(blocks, machine):
    text = "".join(f"N{10 * i} {block}\n" for i, block in enumerate(["G0 X1 Y2 Z60 B5 C5", *blocks], start=1))
    setup = {"offsets": ["G54=1,2,3"], "tools": ["T1=80"]}
    with contextlib.suppress(UserError):
        assert correct(text, machine, **setup) == text
        before = read(text, machine, **setup)
        written = correct(text, machine, random_model(load(machine), 2, 20.0), **setup)
        after = read(written, machine, **setup)
        assert np.abs(after.machine_target[-1:] - before.machine_target[-1:]).max(initial=0.0) < 0.5
