"""Codes and limits that the dialects share: addresses of axes, G and M codes, the inch."""

from __future__ import annotations

from postproc.motion.moves import Kind

AXES = "XYZABCUVW"
INCH = 25.4
UNIT_NAMES = {"mm": 1.0, "inch": INCH}
"""Units of a control, mm, by their names in options and machine files."""
LARGEST_CODE = 1e9
"""No control has a number of this size."""

MOTION = {0.0: Kind.RAPID, 1.0: Kind.LINE, 2.0: Kind.ARC, 3.0: Kind.ARC}
PLANES = {17.0: "XYZ", 18.0: "ZXY", 19.0: "YZX"}
"""First, second and normal axis of the working plane."""
ABSOLUTE = 90.0
DISTANCES = frozenset((ABSOLUTE, 91.0))
INVERSE_TIME = 93.0
DWELL = 4.0

TOOL_CHANGE, PALLET_CHANGE = 6.0, 60.0
PROGRAM_ENDS = frozenset((2.0, 30.0))
HARMLESS_M = frozenset(
    map(float, [*range(12), 13, 14, 16, 17, 18, 19, 29, 30, 48, 49, 50, 51, 52, 53, PALLET_CHANGE, 88, 89])
)
PROBE_BESIDE = (
    "probe in a program of its own, or state --probing beside if what it finds changes no coordinate of the contour"
)
"""What to do about a probing move."""
SKIPPABLE_M = HARMLESS_M - PROGRAM_ENDS - {TOOL_CHANGE, PALLET_CHANGE}
"""Whether they run does not change the meaning of other blocks."""
