"""Codes and limits that all dialects share: addresses of axes, M codes, the inch."""

from __future__ import annotations

AXES = "XYZABCUVW"
INCH = 25.4
LARGEST = 1e9
"""No control has a number of this size."""

TOOL_CHANGE, PALLET_CHANGE = 6.0, 60.0
PROGRAM_ENDS = frozenset((2.0, 30.0))
HARMLESS_M = frozenset(
    map(float, [*range(12), 13, 14, 16, 17, 18, 19, 29, 30, 48, 49, 50, 51, 52, 53, PALLET_CHANGE, 88, 89])
)
SKIPPABLE_M = HARMLESS_M - PROGRAM_ENDS - {TOOL_CHANGE, PALLET_CHANGE}
"""Whether they run does not change what other blocks mean."""
