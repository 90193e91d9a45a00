"""The words of HEIDENHAIN Klartext blocks by their effect on the path: followed, harmless or refused."""

from __future__ import annotations

from postproc.control.codes import PROBE_BESIDE

# Neither move the tool nor change where coordinates point: spindle, coolant, stops, feed modes, path modes, monitoring,
# and what takes back something that is refused or was never there.
HARMLESS_M = frozenset(
    map(
        float,
        (0, 1, *range(3, 6), *range(7, 12), 13, 14, 19, 90, 102, 103, *range(105, 112), 113, *range(115, 119)),
    )
) | frozenset(map(float, (120, 124, 132, 133, *range(134, 139), 141, 145, 148, 149)))
SKIPPABLE_M = frozenset(map(float, (0, 1, *range(3, 6), *range(7, 12), 13, 14, 19)))
"""Spindle, coolant and stops: whether they run does not change the meaning of other blocks."""
PROGRAM_END_M = frozenset((2.0, 30.0))
MEANT_M = frozenset((6.0, 89.0, 91.0, 92.0, 94.0, 99.0, 126.0, 127.0, 128.0, 129.0, 140.0, 143.0)) | PROGRAM_END_M
REFUSED_M = {
    **dict.fromkeys((95.0, 96.0, 97.0, 98.0), "changes the path at corners, which is not corrected"),
    101.0: "changes to a replacement tool, whose length is not known: write TOOL CALL",
    104.0: "returns to an earlier datum, which is not known: write cycle 247",
    112.0: "rounds corners, which is not corrected: write cycle 32",
    114.0: "compensates tilted axes, which is not followed: write M128",
    130.0: "refers to the coordinates before tilting, which is not followed: write PLANE RESET instead",
    142.0: "deletes modal states of the control, which is not followed",
    144.0: "includes the tilted axes in the coordinates, which is not followed: write M128",
    150.0: "ends a move at a limit switch, whose position is not known",
    **dict.fromkeys(map(float, range(200, 205)), "controls laser cutting, which is not corrected"),
}
AXIS_M = {
    118.0: "superimposes moves of the handwheel, which are not known",
    138.0: "selects the axes that M128 compensates, which is not followed",
}
"""With axes behind them."""

SPINDLE, COOLANT = 110, 111
"""Q parameters of the state of the spindle and of the coolant."""
SET_BY_CONTROL: dict[str, tuple[int, ...]] = {
    "TOOL CALL": (109,),
    **dict.fromkeys(("M3", "M4", "M5"), (SPINDLE,)),
    **dict.fromkeys(("M8", "M9"), (COOLANT,)),
    **dict.fromkeys(("M13", "M14"), (SPINDLE, COOLANT)),
}
"""Q parameters that a statement makes the control set, in addition to Q108, Q114 and Q120 to Q122, which ncomp works
out (TNC 640, preassigned Q parameters)."""

COMPENSATIONS = frozenset(("RL", "RR", "R+", "R-"))
DIRECTIONS = {"DR+": 1, "DR-": -1}

# Cycles that only a call runs, and data for them; dwell, oriented spindle stop, tolerance.
HARMLESS_CYCLES = frozenset((*range(1, 7), 9, *range(13, 19), *range(20, 26), *range(27, 30), 32, 39)) | frozenset(
    (*range(200, 216), 225, *range(230, 234), 240, 241, *range(251, 259), *range(262, 268), *range(270, 277), 392)
)
PROGRAM_CALL_CYCLE = 12
PATTERN_CYCLES = {
    220: frozenset(("Q216", "Q217", "Q244", "Q245", "Q246", "Q247", "Q241", "Q200", "Q203", "Q204")),
    221: frozenset(("Q225", "Q226", "Q237", "Q238", "Q242", "Q243", "Q224", "Q200", "Q203", "Q204")),
}
"""Cycles that run where they are defined, and the words that each needs."""
FRAME_CYCLES = {
    7: ("I?[XYZABCUVW]", 0.0, "shifts the datum"),
    8: ("", 0.0, "mirrors the coordinates"),
    10: ("I?ROT", 0.0, "turns the coordinates"),
    11: ("SCL", 1.0, "scales the coordinates"),
    19: ("[ABC]", 0.0, "tilts the working plane"),
    26: ("[XYZ]", 1.0, "scales the coordinates"),
}
"""The words that a cycle may have, the value of each that changes nothing, and what any other does."""
PRESET_CYCLE = 247
CALL_M, MODAL_CALL_M = 99.0, 89.0
"""Run the cycle after the move of the block, and after each move until M99 or another cycle."""
TRANSFORMATION_CYCLES = frozenset((7, 8, 10, 11, 26))
DATA_CYCLES = frozenset((9, 13, 14, 20, 32, 392))
"""Cycles that run at their definition or hold data: a call does not run them."""

CYCLES_AT_START = frozenset((1, 2, 3, 4, 5, 17, 18))
"""Cycles that begin at the present position and return to it."""
CYCLES_AT_POSITION = frozenset((*range(200, 210), 240, 241))
"""Begin at X Y of the tool, above a surface Q203; they end at Q204 or Q200 above it."""
DRILLING_CYCLES = CYCLES_AT_POSITION - {202, 204, 208}
"""Those that move along Z alone; 202 and 204 also move off the wall, 208 mills on a helix."""
CYCLES_AROUND_POSITION = frozenset((*range(251, 259), *range(262, 266), 267))
"""Begin there too, but may end elsewhere."""
CONTOUR_CYCLES = frozenset((21, 22, 23, 24, 25))
"""Run along the contour of labels that cycle 14 names, independent of the position of the tool."""

HARMLESS_FN = frozenset((*range(14, 17), 18, 20, 23, 24, 26, 27, 28, 37, 38))
PLC_FN = frozenset((19, 29))
REFUSED_FN = {
    17: "sets data of the control, whose effect is not known to ncomp",
    25: "sets a preset while the program runs, which is not followed: write cycle 247",
}

HARMLESS_KINDS = frozenset(("blank", "blank_form", "definition", "control", "text_assignment"))
MOVING_KINDS = frozenset(
    (
        "line",
        "circle",
        "circle_radius",
        "tangent",
        "polar_line",
        "polar_circle",
        "polar_tangent",
        "approach",
        "departure",
        "normal_line",
    )
)
REFUSED_KINDS = {
    "free_contour": "free contours (FK) are not corrected: write L and C",
    "selection": "ncomp does not read the file that SEL selects",
    "probe": f"the end of a probing move is not known: {PROBE_BESIDE}",
}
