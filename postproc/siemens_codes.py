"""What stands in Siemens 840D blocks, by what it does to the path: followed, harmless or refused."""

from __future__ import annotations

from postproc.iso_codes import INCH
from postproc.motions import Kind


def _all(text: str) -> frozenset[str]:
    return frozenset(text.split())


MOTION = {0.0: Kind.RAPID, 1.0: Kind.LINE, 2.0: Kind.ARC, 3.0: Kind.ARC}
PLANES = {17.0: "XYZ", 18.0: "ZXY", 19.0: "YZX"}
UNITS = {70.0: INCH, 700.0: INCH, 71.0: 1.0, 710.0: 1.0}
DISTANCES = frozenset((90.0, 91.0))
INVERSE_TIME = 93.0
FEED_MODES = frozenset((93.0, 94.0, 95.0, 96.0, 97.0, 961.0, 971.0))
WORK_OFFSETS = frozenset((*map(float, range(54, 58)), *map(float, range(505, 600)), 500.0))
MACHINE = frozenset((53.0, 153.0))
"""The block's coordinates are those of the machine."""
DWELL = 4.0
REFERENCE = frozenset((74.0, 75.0))
HARMLESS_G = frozenset(
    map(
        float,
        (
            *(9, 25, 26, 40, 60, 64, 340, 341, 450, 451, 460, 461, 462, 601, 602, 603, 621),
            *range(641, 646), *range(810, 820), *range(820, 830), 290, 291,
        ),
    )
)  # fmt: skip
GROUPS = (
    frozenset(MOTION), frozenset(PLANES), frozenset(UNITS), DISTANCES, FEED_MODES, WORK_OFFSETS, MACHINE | REFERENCE,
)  # fmt: skip
REFUSED_G = {
    **dict.fromkeys((41.0, 42.0), "tool radius compensation: the control shifts the path by itself"),
    **dict.fromkeys((33.0, 34.0, 35.0, 63.0, 331.0, 332.0), "threading is not corrected"),
    **dict.fromkeys((110.0, 111.0, 112.0), "polar coordinates are not corrected"),
    **dict.fromkeys(map(float, (140, 141, 142, 143, 147, 148, 247, 248, 347, 348)), "the control works out the way"),
    **dict.fromkeys((58.0, 59.0), "shifts the coordinates"),
    5.0: "is a way into a groove that the control works out",
    7.0: "is a way into a groove that the control works out",
}  # fmt: skip

HARMLESS_NAMES = _all(
    "BRISK BRISKA SOFT SOFTA DRIVE DRIVEA FFWON FFWOF COMPOF STOPRE DIAMOF CFC CFTCP CFIN FNORM FLIN FCUB "
    "ORIWKS ORIMKS ORIAXES ORIVECT ORIEULER ORIRPY ORIMACHAX NORM KONT KONTC KONTT CUT2D CUT2DF CUT3DC SPATH UPATH "
    "WALIMON WALIMOF RTLION RTLIOF DYNNORM DYNPOS DYNROUGH DYNSEMIFIN DYNFINISH DYNPREC GROUP_END BLSYNC OVRA "
    "STARTFIFO STOPFIFO FIFOCTRL COMPON COMPCURV COMPCAD COMPSURF PATHCTRL AXCTSWED DISC LIFTFAST CPRECON CPRECOF "
    "OST OSOF OSS OSC OSSE OSD ORISON ORISOF PAROTOF TOROTOF TOFRAMEOF"
)
"""Modes of speed and smoothing, of the path through the rotary axes where these are programmed themselves, resets."""
HARMLESS_CALLS = _all(
    "MSG SETAL CYCLE832 GROUP_BEGIN GROUP_END WORKPIECE FGROUP STOPRE SPCON SPCOF WAITM FFWON DELAYFSTON"
)
FRAME_NAMES = _all("TRANS ATRANS ROT AROT ROTS AROTS CROTS SCALE ASCALE MIRROR AMIRROR")
SPATIAL_NAMES = _all("ROTS AROTS CROTS")
REFUSED_NAMES = {
    **dict.fromkeys(("ASPLINE", "BSPLINE", "CSPLINE", "POLY"), "splines are not corrected"),
    **dict.fromkeys(("CIP", "CT", "INVCW", "INVCCW"), "an arc whose circle the control works out is not corrected"),
    **dict.fromkeys(("DIAMON", "DIAM90", "DIAMONA"), "diameter programming is not corrected"),
    **dict.fromkeys(("TRANSMIT", "TRACYL", "TRAANG"), "transforms the coordinates"),
    **dict.fromkeys(("MCALL", "CALL", "PCALL", "EXTCALL", "ISOCALL"), "calls what stands elsewhere"),
    **dict.fromkeys(("PROC", "EXTERN", "DEFINE", "SETINT"), "declares what other programs are needed for"),
    **dict.fromkeys(("WHEN", "WHENEVER", "EVERY", "FROM", "DO", "ID", "IDS"), "acts beside the program"),
    **dict.fromkeys(("TOROT", "TOFRAME", "PAROT", "TOFRAMEX", "TOFRAMEY", "TOROTX", "TOROTY"), "turns the coordinates"),
    **dict.fromkeys(("MEAS", "MEAW", "MEASA", "MEAWA"), "where a probing move ends is not known"),
    **dict.fromkeys(("RND", "RNDM", "CHF", "CHR"), "the control breaks the corner by itself"),
}  # fmt: skip
HARMLESS_ADDRESSES = _all("N F S H FA FB SPOS SPOSA OVR ADIS ADISPOS")
"""Of words that move no axis of the path."""
CENTRES = "IJK"
