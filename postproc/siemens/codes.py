"""The words of Siemens 840D blocks by their effect on the path: followed, harmless or refused."""

from __future__ import annotations

import re

from postproc.control.codes import DISTANCES, DWELL, INCH, MOTION, PLANES
from postproc.motion.arcs import CENTRES


def _all(text: str) -> frozenset[str]:
    return frozenset(text.split())


CALCULATED_ARCS = frozenset(("CIP", "CT"))
"""Arcs that a correction writes as G2 or G3."""
MIDDLES = ("I1", "J1", "K1")
"""The point between of CIP, along X, Y and Z."""
SPLINES = frozenset(("ASPLINE", "BSPLINE", "CSPLINE"))
"""Curves of which the points are corrected."""
SPLINE_ENDS = frozenset(("BAUTO", "BNAT", "BTAN", "EAUTO", "ENAT", "ETAN"))
"""Conditions at the beginning and at the end of a spline."""
SPLINE_WORDS = frozenset(("PW", "SD", "PL"))
"""Weight of a point, degree, and interval of the parameter, of B-splines."""
CALCULATED_CURVES = CALCULATED_ARCS | SPLINES | SPLINE_ENDS
UNITS = {70.0: INCH, 700.0: INCH, 71.0: 1.0, 710.0: 1.0}
FEED_TYPES = frozenset((93.0, 94.0, 95.0, 96.0, 97.0, 961.0, 971.0))
WORK_OFFSETS = frozenset((*map(float, range(54, 58)), *map(float, range(505, 600)), 500.0))
MACHINE = frozenset((53.0, 153.0))
"""The block's coordinates are those of the machine."""
LIMITS = frozenset((25.0, 26.0))
"""The block's coordinates, or its S, are limits of the working area, or of the spindle."""
REFERENCE = frozenset((74.0, 75.0))
POLES = frozenset((110.0, 111.0, 112.0))
"""The block's coordinates are those of a pole, seen from the last position, the zero, or the last pole."""
END_OF_SUBPROGRAM = 17.0
CUTTER_RADIUS, CUTTER_RADIUS_END = frozenset((41.0, 42.0)), 40.0
HARMLESS_G = frozenset(
    map(
        float,
        (
            *(9, 40, 60, 64, 290, 340, 341, 450, 451, 460, 461, 462, 601, 602, 603, 621),
            *range(641, 646), *range(810, 820), *range(820, 830),
        ),
    )
)  # fmt: skip
GROUPS = (
    frozenset(MOTION), frozenset(PLANES), frozenset(UNITS), DISTANCES, FEED_TYPES, WORK_OFFSETS,
    MACHINE | REFERENCE | POLES | LIMITS | {DWELL}, CUTTER_RADIUS | {CUTTER_RADIUS_END},
)  # fmt: skip
REFUSED_G = {
    **dict.fromkeys((33.0, 34.0, 35.0, 63.0, 331.0, 332.0), "cuts a thread, which is not corrected"),
    **dict.fromkeys(
        map(float, (140, 141, 142, 143, 147, 148, 247, 248, 347, 348)),
        "is an approach or retraction path that the control calculates and ncomp does not correct: write its moves",
    ),
    **dict.fromkeys((58.0, 59.0), "shifts the coordinates, which is not followed: write TRANS or ATRANS"),
    5.0: "is a groove path that the control calculates and ncomp does not correct: write its moves",
    7.0: "is a groove path that the control calculates and ncomp does not correct: write its moves",
    291.0: "switches to ISO programs, which are not followed here: write these blocks in a file of their own",
}  # fmt: skip

LENGTH_STAYS = (
    "G18 or G19 with a tool length: the length is taken to stay along Z, which needs setting data SD42940 "
    "($SC_TOOL_LENGTH_CONST) other than 0"
)
HARMLESS_NAMES = _all(
    "BRISK BRISKA SOFT SOFTA DRIVE DRIVEA FFWON FFWOF COMPOF STOPRE DIAMOF CFC CFTCP CFIN FNORM FLIN FCUB "
    "ORIAXES ORIVECT ORIEULER ORIRPY ORIMACHAX ORIPLANE NORM KONT KONTC KONTT CUT2D CUT2DF SPATH UPATH "
    "WALIMON WALIMOF RTLION RTLIOF DYNNORM DYNPOS DYNROUGH DYNSEMIFIN DYNFINISH DYNPREC GROUP_END BLSYNC OVRA "
    "STARTFIFO STOPFIFO FIFOCTRL COMPON COMPCURV COMPCAD COMPSURF PATHCTRL AXCTSWED DISC LIFTFAST CPRECON CPRECOF "
    "OST OSOF OSS OSC OSSE OSD ORISON ORISOF PAROTOF TOROTOF TOFRAMEOF EXTERN FENDNORM SCPARA ADISPOSA SETMS"
)
"""Modes of speed and smoothing, of the path through the rotary axes where these are programmed themselves, resets."""
FRAME_ENDS = _all("PAROTOF TOROTOF TOFRAMEOF")
"""They end rotations of the table and of the tool, which only CYCLE800 may have set here."""
HARMLESS_CALLS = _all(
    "MSG SETAL CYCLE832 CYCLE62 GROUP_BEGIN GROUP_END WORKPIECE FGROUP STOPRE SPCON SPCOF WAITM FFWON DELAYFSTON "
    "SOFTA BRISKA DRIVEA SPOS WAITS WAITP SETMS SETM CLEARM WAITMC"
)
SKIPPABLE_G = frozenset((DWELL, 9.0, 60.0, 64.0, *map(float, range(641, 646))))
SKIPPABLE_NAMES = (HARMLESS_NAMES | HARMLESS_CALLS) - FRAME_ENDS - {"CYCLE832"}
"""Whether they run does not change the meaning of other blocks."""
MEANT_NAMES = _all("SUPA RET TRAFOOF TRAORI ORIWKS ORIMKS MCALL CYCLE800") | CALCULATED_CURVES
"""Words that the interpreter follows, alone or with parentheses."""
FRAME_NAMES = _all("TRANS ATRANS ROT AROT ROTS AROTS CROTS SCALE ASCALE MIRROR AMIRROR")
SPATIAL_NAMES = _all("ROTS AROTS CROTS")

CYCLES_AT_POSITION = _all("CYCLE81 CYCLE82 CYCLE83 CYCLE84 CYCLE840 CYCLE85 CYCLE86 CYCLE87 CYCLE88 CYCLE89")
"""One hole at the present position; they leave the tool on the retraction plane of their first argument."""
DRILLING_CYCLES = CYCLES_AT_POSITION - {"CYCLE86"}
"""Those that move along the drilling axis alone; CYCLE86 also moves off the wall."""
CYCLES_ELSEWHERE = _all(
    "HOLES1 HOLES2 CYCLE801 CYCLE802 POCKET1 POCKET2 POCKET3 POCKET4 SLOT1 SLOT2 LONGHOLE CYCLE61 CYCLE63 CYCLE64 "
    "CYCLE70 CYCLE71 CYCLE72 CYCLE76 CYCLE77 CYCLE78 CYCLE79 CYCLE90 CYCLE899"
)
"""Cycles whose positions are arguments."""
CYCLES = CYCLES_AT_POSITION | CYCLES_ELSEWHERE
MOVING_NAMES = CYCLES | {"SUPA", "CYCLE800"}
"""Words that move the tool to other positions than those of a path."""

MEASURING = re.compile(r"CYCLE(9[67]\d|982|99\d)")
"""Measuring cycles."""
CALLS = _all("CALL EXTCALL PCALL")
"""Words before the name of a program in quotes."""
BY_PATH = "PCALL"
"""The word before the path of a program without quotes, and its arguments."""
REFUSED_NAMES = {
    "POLY": "begins polynomials, which are not corrected: write G1, G2 or G3",
    **dict.fromkeys(("INVCW", "INVCCW"), "is an involute, which is not corrected: write G1, G2 or G3"),
    **dict.fromkeys(
        ("DIAMON", "DIAM90", "DIAMONA"), "begins diameter programming, which is not corrected: write radii and DIAMOF"
    ),
    **dict.fromkeys(
        ("TRANSMIT", "TRACYL", "TRAANG"),
        "transforms the coordinates, which is not followed: write the coordinates of the axes",
    ),
    **dict.fromkeys(("CALL", "PCALL", "EXTCALL"), 'calls a program in a form that is not followed: write CALL "NAME"'),
    "ISOCALL": "calls an ISO program, and a called program must be of the same dialect: write its blocks",
    **dict.fromkeys(
        ("PROC", "DEFINE", "SETINT"), "declares a subprogram, macro or interrupt in a form that is not followed"
    ),
    **dict.fromkeys(
        ("WHEN", "WHENEVER", "EVERY", "FROM", "DO", "ID", "IDS"),
        "is a synchronised action, which runs in parallel with the program and is not followed: remove it",
    ),
    **dict.fromkeys(
        ("TOROT", "TOFRAME", "PAROT", "TOFRAMEX", "TOFRAMEY", "TOROTX", "TOROTY"),
        "rotates the coordinates, which is not followed: write ROT, AROT or CYCLE800",
    ),
    **dict.fromkeys(
        ("MEAS", "MEAW", "MEASA", "MEAWA"),
        "probes, and the end of a probing move is not known: probe in a program of its own",
    ),
    **dict.fromkeys(
        ("CUT3DC", "CUT3DF", "CUT3DFS", "CUT3DFF"),
        "is tool radius compensation in space, which is not corrected: write the path of the tool",
    ),
}
HARMLESS_ADDRESSES = _all("N F S H FA FB FZ FD FRC FRCM SPOS SPOSA OVR OVRRAP ADIS ADISPOS SCC DISC")
"""Addresses of words that move no axis of the path."""
VECTOR = ("A3", "B3", "C3")
"""The direction of the tool, from its tip."""
VECTOR_WORDS = frozenset(VECTOR)
CORNERS = frozenset(("RND", "RNDM", "CHF", "CHR"))
"""Words of corners that the control breaks between this block and the next."""
MOVE_ADDRESSES = frozenset((*CENTRES, *MIDDLES, "CR", "AR", "TURN", "AP", "RP")) | VECTOR_WORDS
