"""The G and M codes of ISO / Fanuc / LinuxCNC programs, by their effect on the path: followed, harmless or refused."""

from __future__ import annotations

from postproc.control.codes import (
    AXES,
    DISTANCES,
    DWELL,
    INCH,
    INVERSE_TIME,
    MOTION,
    PALLET_CHANGE,
    PLANES,
    PROBE_BESIDE,
    TOOL_CHANGE,
)
from postproc.motion.arcs import CENTRES

MEANINGFUL = frozenset(AXES + CENTRES + "RGMTHO")
"""Addresses that move the tool or change the meaning of others."""

CYCLES = frozenset(map(float, (73, 74, 81, 82, 83, 84, 85, 86, 89)))
"""One hole at each position: the program gives position and depth, the control makes the moves between them."""
FINE_BORING = 76.0
"""A cycle on FANUC, a thread on LinuxCNC."""
CYCLE_WORDS = frozenset("NFSTHDPQRKL$")
"""Words that may be in a block of a cycle besides G, M and axes."""
CYCLE_END, RETURN_TO_LEVEL, RETURN_TO_R = 80.0, 98.0, 99.0

# Neither move the tool nor change where coordinates point: dwell, exact stop and path modes, cancels, speed modes,
# the end of data.
HARMLESS_G = frozenset([*(4.0, 5.0, 5.1, 8.0, 9.0, 11.0, 61.0, 61.1, 62.0, 63.0, 64.0), *(96.0, 97.0, 103.0, 187.0)])
PATH_MODES = frozenset((9.0, 61.0, 61.1, 62.0, 64.0, 187.0))
"""Exact stop and path modes: whether they are on does not change the meaning of other blocks."""
UNITS = {20.0: INCH, 21.0: 1.0}
OTHER_UNITS = {70.0: 20.0, 71.0: 21.0}
"""Codes of units on some controls (Mach3), turning cycles on others: with the code of the same unit."""
TURNING_WORDS = frozenset("PQUWDRIJKLH")
TURNING_CYCLES: dict[float, tuple[str, ...]] = {
    70.0: ("PQ",),
    71.0: ("PQ", "UR"),
    72.0: ("PQ", "WR"),
    73.0: ("PQU", "PQW", "UWR"),
    75.0: ("PQ", "R"),
    76.0: ("PQ",),
}
"""Multiple repetitive cycles of FANUC lathes, with the words of a block by which one is no cycle of a mill."""
CENTRE_DISTANCES = frozenset((90.1, 91.1))
FEED_MODES = frozenset((INVERSE_TIME, 94.0, 95.0))
WORK_OFFSETS = {**{float(g): f"G{g}" for g in range(54, 60)}, 59.1: "G59.1", 59.2: "G59.2", 59.3: "G59.3"}
LENGTH_CODES = frozenset((43.0, 43.4, 43.5, 49.0))
EXTENDED = frozenset((54.1, 154.0))
"""With P; 154 is HAAS's."""
OFFSET_CODES = EXTENDED | WORK_OFFSETS.keys()
FRAME_CODES = LENGTH_CODES | OFFSET_CODES

COMPENSATION, COMPENSATION_END = frozenset((41.0, 42.0, 41.1, 42.1)), 40.0
POLAR, POLAR_END = 16.0, 15.0
NOT_MOVING = frozenset((DWELL, 5.0, 5.1))
"""Codes that use the coordinates of their block for something else than a move: a dwell, splines, fast path modes."""
DATA, GIVEN_LENGTH, LOCAL, UPRIGHT = 10.0, 43.1, 52.0, 53.1
SCALE, SCALE_END, MIRROR, MIRROR_END = 51.0, 50.0, 51.1, 50.1
ROTATION, TILT, ROTATION_END = 68.0, 68.2, 69.0
PRESET, PRESET_END, PRESET_OFF, PRESET_ON = 92.0, 92.1, 92.2, 92.3
TURNS = frozenset((ROTATION, SCALE, MIRROR, TILT))
COORDINATE_CHANGES = TURNS | {
    DATA,
    GIVEN_LENGTH,
    LOCAL,
    UPRIGHT,
    SCALE_END,
    MIRROR_END,
    PRESET,
    PRESET_END,
    PRESET_OFF,
    PRESET_ON,
}
"""Codes that change the meaning of coordinates by the words of their block."""
ENDS = (SCALE_END, MIRROR_END, ROTATION_END, PRESET_END)
"""Without axis words these end something, independent of the other codes of the block; in the order of execution."""
BESIDE_COORDINATE_CHANGES = frozenset((*PLANES, *UNITS, 40.0, 69.0, 90.0, 94.0))
"""Codes that may be in a block with one of those."""
NAMING = NOT_MOVING | COORDINATE_CHANGES
TOWARDS = frozenset((38.2, 38.3, 38.4, 38.5))
"""Probing moves of LinuxCNC and grbl, which are modal."""
ONE_SHOT = NAMING | {28.0, 30.0, 53.0}
GROUPS = (
    frozenset(MOTION) | CYCLES,
    CYCLES | {CYCLE_END},
    frozenset((RETURN_TO_LEVEL, RETURN_TO_R)),
    frozenset(PLANES),
    frozenset(UNITS),
    FEED_MODES,
    DISTANCES,
    CENTRE_DISTANCES,
    LENGTH_CODES,
    OFFSET_CODES,
    ONE_SHOT,
    COMPENSATION | {COMPENSATION_END},
    frozenset((POLAR, POLAR_END)),
    frozenset((ROTATION, TILT, ROTATION_END)),
)
"""A block may contain one code of a group: of two, some controls use the last, others each for the words after it.

G80 may be in a block with G0 to G3: FANUC and LinuxCNC end the cycle and run the motion, others refuse the block."""

PROBING = frozenset((31.0, 37.0, *TOWARDS))
"""Move until the probe switches."""
REFUSED_G = {
    **dict.fromkeys((5.2, 5.3, 6.2), "programs a spline, which is not corrected"),
    7.0: "selects diameter programming, which is not corrected",
    **dict.fromkeys(
        (12.1, 13.1, 7.1, 107.0, 112.0, 113.0),
        "selects polar or cylindrical interpolation, which is not corrected",
    ),
    **dict.fromkeys((12.0, 13.0, 150.0), "mills a pocket by a cycle of the control, which is not corrected"),
    **dict.fromkeys(PROBING, f"is a probing move, and its end position is not known from the program: {PROBE_BESIDE}"),
    28.2: "references the axes, and their positions after it are not known to ncomp: reference them before the program",
    **dict.fromkeys((32.0, 33.0, 33.1), "cuts a thread, which is not corrected"),
    76.0: 'is threading on LinuxCNC and fine boring on FANUC: write family = "fanuc" in the machine file',
    **dict.fromkeys(
        (41.2, 42.2, 41.3, 41.4, 41.5, 42.4, 42.5),
        "selects radius compensation in space, which is not corrected",
    ),
    43.2: "adds a second length offset to the first, which is not corrected",
    44.0: "selects a negative length offset, which is not corrected",
    **dict.fromkeys((60.0, 72.1, 72.2), "is not corrected"),
    **dict.fromkeys((65.0, 66.0), "calls a macro by a computed code: write the code as a number"),
    66.1: "calls a macro after every block, which is not corrected: call it by G65 or G66",
    **dict.fromkeys((53.6, 68.1, 68.3, 68.4), "rotates the coordinates in a form that is not corrected"),
    **dict.fromkeys(
        (87.0, 88.0),
        "is a boring cycle that shifts the tool or waits for the operator, which is not corrected",
    ),
}
TOOL_IS = 61.0
REFUSED_M = {
    96.0: "jumps at an interrupt, and the time of the interrupt is not known from the program",
    **dict.fromkeys((97.0, 98.0), "calls a subprogram by a computed code: write the code as a number"),
    99.0: "jumps back in the program by a computed code: write the code as a number",
    TOOL_IS: 'sets the tool in the spindle on LinuxCNC: write Q, and family = "linuxcnc" in the machine file',
    **dict.fromkeys(
        (70.0, 71.0, 72.0, 73.0),
        "restores modes on some controls and mirrors on others: program the modes by G codes",
    ),
    **dict.fromkeys((128.0, 129.0, 428.0, 429.0, 430.0), "switches the kinematics on some controls"),
}
AFTER_MOTION = frozenset((TOOL_CHANGE, PALLET_CHANGE))
"""Run before the move of their block on some controls, after it on others."""
BESIDE_LEAVING = frozenset("NFSTHD$")
"""Words that are allowed in a block of G28, G30 and G53, besides G, M and axes."""
MOVE_WORDS = frozenset("NFSTHDPQIJKR$")
"""Words that may be in a move besides G, M and axes."""

CORNERS = frozenset((",C", ",R"))
"""Chamfer and rounding of the corner between the block and the next."""
ANGLE = ",A"
"""The angle of a line, which gives one coordinate of its end."""
CORNER_WORDS = CORNERS | {ANGLE}

CONSTRUCTS = {
    "bracket": "the expression has no address before it: write the address",
    "number": "the number has no address before it: write the address",
}
