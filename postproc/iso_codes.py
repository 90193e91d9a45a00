"""The G and M codes of ISO / Fanuc / LinuxCNC programs, by what they do to the path: followed, harmless or refused."""

from __future__ import annotations

from postproc.motions import Kind

AXES = "XYZABCUVW"
CENTRES = "IJK"
MEANINGFUL = frozenset(AXES + CENTRES + "RGMTHO")
"""Addresses that move the tool or change what others mean."""
INCH = 25.4
LARGEST = 1e9
"""No control has a number of this size."""

CYCLES = frozenset(map(float, (73, 74, 81, 82, 83, 84, 85, 86, 89)))
"""One hole at each position: the place and the depth are the program's, all between the control's."""
CYCLE_WORDS = frozenset("NFSTHDPQRK")
"""What may stand in a block of a cycle beside G, M and axes."""
CYCLE_END, RETURN_TO_LEVEL, RETURN_TO_R = 80.0, 98.0, 99.0

MOTION = {0.0: Kind.RAPID, 1.0: Kind.LINE, 2.0: Kind.ARC, 3.0: Kind.ARC}

# Neither move the tool nor change where coordinates point: dwell, exact stop and path modes, cancels, speed modes,
# return levels of cycles.
HARMLESS_G = frozenset(
    [
        *(4.0, 5.1, 8.0, 9.0, 15.0, 40.0, 50.1, 61.0, 61.1, 62.0, 63.0, 64.0, 67.0),
        *(92.1, 92.2, 96.0, 97.0),
    ]
)
PLANES = {17.0: "XYZ", 18.0: "ZXY", 19.0: "YZX"}
UNITS = {20.0: INCH, 21.0: 1.0}
DISTANCES = frozenset((90.0, 91.0))
CENTRE_DISTANCES = frozenset((90.1, 91.1))
INVERSE_TIME = 93.0
FEED_MODES = frozenset((INVERSE_TIME, 94.0, 95.0))
WORK_OFFSETS = {**{float(g): f"G{g}" for g in range(54, 60)}, 59.1: "G59.1", 59.2: "G59.2", 59.3: "G59.3"}
LENGTH_CODES = frozenset((43.0, 43.4, 49.0))
OFFSET_CODES = frozenset((54.1, *WORK_OFFSETS))
FRAME_CODES = LENGTH_CODES | OFFSET_CODES

NAMING = frozenset((5.1, 50.1, 92.1, 92.2))
STANDING = NAMING | {4.0}
"""Take the coordinates of their block for something else than a move."""
LOCAL, ROTATION, ROTATION_END = 52.0, 68.0, 69.0
PLACING = frozenset((LOCAL, ROTATION))
"""Take the coordinates of their block for a shift, or for the centre of a rotation."""
ONE_SHOT = STANDING | PLACING | {28.0, 30.0, 53.0}
GROUPS = (
    frozenset(MOTION) | CYCLES | {CYCLE_END},
    frozenset((RETURN_TO_LEVEL, RETURN_TO_R)),
    frozenset(PLANES),
    frozenset(UNITS),
    FEED_MODES,
    DISTANCES,
    CENTRE_DISTANCES,
    LENGTH_CODES,
    OFFSET_CODES,
    ONE_SHOT,
)
"""A block may hold one code of a group: of two, some controls take the last, others each for what follows it."""

REFUSED_G = {
    **dict.fromkeys((5.0, 5.2, 5.3, 6.2), "splines are not corrected"),
    7.0: "diameter programming is not corrected",
    10.0: "sets offsets in the control while it runs",
    **dict.fromkeys((12.0, 13.0, 12.1, 13.1, 7.1, 107.0, 112.0), "polar or cylindrical interpolation is not corrected"),
    16.0: "polar coordinates are not corrected",
    **dict.fromkeys((31.0, 37.0, 38.2, 38.3, 38.4, 38.5), "where a probing move ends is not known"),
    **dict.fromkeys((32.0, 33.0, 33.1, 76.0), "threading is not corrected"),
    **dict.fromkeys((41.0, 42.0, 41.1, 42.1), "cutter radius compensation: the control shifts the path by itself"),
    44.0: "a negative length offset is not corrected",
    43.1: "a length offset given in the program is not corrected",
    **dict.fromkeys((43.5, 53.1), "tool vectors are not corrected"),
    **dict.fromkeys((51.0, 51.1), "scaling or mirroring changes what coordinates mean"),
    **dict.fromkeys((50.0, 92.0, 92.3), "shifts or scales the coordinates"),
    **dict.fromkeys((60.0, 72.1, 72.2), "is not corrected"),
    **dict.fromkeys((65.0, 66.0, 66.1), "calls a macro"),
    **dict.fromkeys((68.2, 68.3, 68.4), "turns the coordinates"),
    **dict.fromkeys((87.0, 88.0), "a boring cycle that shifts the tool or waits for a hand is not corrected"),
}
REFUSED_M = {
    96.0: "jumps when an interrupt comes",
    97.0: "calls a subprogram",
    98.0: "calls a subprogram",
    99.0: "jumps back in the program",
    198.0: "calls a subprogram",
    61.0: "says that another tool is in the spindle",
    **dict.fromkeys((70.0, 71.0, 72.0, 73.0), "brings back other modes on some controls, and mirrors on others"),
    **dict.fromkeys((128.0, 129.0, 428.0, 429.0, 430.0), "switches the kinematics on some controls"),
}
TOOL_CHANGE, PALLET_CHANGE = 6.0, 60.0
PROGRAM_ENDS = frozenset((2.0, 30.0))
HARMLESS_M = frozenset(
    map(float, [*range(12), 13, 14, 16, 17, 18, 19, 29, 30, 48, 49, 50, 51, 52, 53, PALLET_CHANGE, 88, 89])
)
SKIPPABLE_M = HARMLESS_M - PROGRAM_ENDS - {TOOL_CHANGE, PALLET_CHANGE}
"""Whether they run does not change what other blocks mean."""
MOVE_WORDS = frozenset("NFSTHDPQIJKR")
"""What may stand in a move beside G, M and axes."""

CONSTRUCTS = {
    "bracket": "an expression that stands alone is not understood",
    "number": "a number without an address",
}
