"""Codes that belong to some families of ISO controls only: followed, harmless or refused there."""

from __future__ import annotations

from collections.abc import Mapping

from postproc.control.codes import DISTANCES, INVERSE_TIME, MOTION, PLANES
from postproc.iso.codes import CYCLE_END, CYCLES, RETURN_TO_LEVEL, RETURN_TO_R, UNITS, WORK_OFFSETS

ANY, FANUC, LINUXCNC, GRBL, MACH3 = "any", "fanuc", "linuxcnc", "grbl", "mach3"

STORED = frozenset((28.1, 30.1))
"""Store the present position as that of G28 or G30 (LinuxCNC, grbl); on Mach3 G28.1 references the axes."""
REFERENCED = 28.1
NORMAL_END = 40.1
"""Ends a normal direction control (FANUC)."""
HARMLESS: Mapping[str, frozenset[float]] = {
    ANY: frozenset((NORMAL_END,)),
    FANUC: frozenset((NORMAL_END,)),
    LINUXCNC: STORED,
    GRBL: STORED,
}
"""Neither move the tool nor change where coordinates point: a position stored, the end of a normal direction."""
OUTPUTS = frozenset(map(float, range(62, 69)))
"""M functions for outputs and inputs."""
HARMLESS_M: Mapping[str, frozenset[float]] = {LINUXCNC: OUTPUTS, GRBL: OUTPUTS | {56.0}}
"""Move nothing: outputs, inputs, and the parking of grbl."""
IN_MACHINE_FRAME = {28.5: 28.0, 30.5: 30.0, 53.5: 53.0}
"""LinuxCNC 2.10: as these codes, in the axes of the machine whatever the kinematics in force."""
SELECT_KINEMATICS, AXIS_KINEMATICS = 12.1, 13.1
KINEMATICS = frozenset((SELECT_KINEMATICS, AXIS_KINEMATICS))
"""LinuxCNC 2.10: the kinematics of a number, and that of the axes of the machine."""

_OTHER_UNITS = "is no unit on this control, and its cycle of a lathe is not corrected: write G20 or G21"
_NORMAL = "turns an axis along the path (normal direction control), which is not corrected: write its positions"
REFUSED: Mapping[str, Mapping[float, str]] = {
    ANY: {
        **dict.fromkeys(
            IN_MACHINE_FRAME,
            "is a move in machine coordinates on LinuxCNC 2.10, and a coordinate system on Mazak: write "
            'family = "linuxcnc" in the machine file',
        ),
    },
    FANUC: {
        **dict.fromkeys((41.1, 42.1), _NORMAL),
        **dict.fromkeys((70.0, 71.0), _OTHER_UNITS),
        **dict.fromkeys((*IN_MACHINE_FRAME, *STORED), "is no code of FANUC: write G53, G28 or G30"),
    },
    LINUXCNC: {
        NORMAL_END: "is no code of LinuxCNC: leave it out",
        **dict.fromkeys((70.0, 71.0), _OTHER_UNITS),
    },
    GRBL: {},
    MACH3: {
        16.0: "counts from the present position on Mach3, which is not followed: write X and Y",
        51.0: "scales each axis by its own word on Mach3, which is not followed: write the coordinates in full size",
        68.0: "has its centre in A and B on Mach3, which is not followed: write rotated coordinates",
    },
}
"""Codes that a family reads differently, or does not have, with the reason of their refusal."""

GRBL_G = frozenset(
    (
        *MOTION,
        *PLANES,
        *UNITS,
        *DISTANCES,
        *WORK_OFFSETS,
        *STORED,
        *CYCLES - {74.0, 84.0},
        *(4.0, 5.0, 5.1, 7.0, 8.0, 10.0, 28.0, 30.0, 33.0, 38.2, 38.3, 38.4, 38.5, 40.0, 43.0, 43.1, 43.2, 49.0, 50.0),
        *(51.0, 53.0, 61.0, 65.0, 66.0, 67.0, 76.0, CYCLE_END, 91.1, 92.0, 92.1, 92.2, 92.3, INVERSE_TIME),
        *(94.0, 95.0, 96.0, 97.0, RETURN_TO_LEVEL, RETURN_TO_R),
    )
)
GRBL_M = frozenset(
    map(float, (0, 1, 2, *range(3, 10), 30, 48, 49, *range(50, 54), 56, 60, 61, *range(62, 69), *range(70, 74), 98, 99))
)
"""What grbl 1.1 and grblHAL have (their lists of supported codes)."""
MACH3_G = frozenset(
    (
        *MOTION,
        *PLANES,
        *UNITS,
        *DISTANCES,
        *WORK_OFFSETS.keys() - {59.1, 59.2, 59.3},
        *CYCLES - {74.0},
        *(4.0, 10.0, 12.0, 13.0, 15.0, 16.0, 28.0, 28.1, 30.0, 31.0, 40.0, 41.0, 42.0, 43.0, 49.0, 50.0, 51.0, 52.0),
        *(53.0, 61.0, 64.0, 68.0, 69.0, 70.0, 71.0, CYCLE_END, 87.0, 88.0, 90.1, 91.1, 92.0, 92.1, 92.2, 92.3),
        *(INVERSE_TIME, 94.0, 95.0, RETURN_TO_LEVEL, RETURN_TO_R),
    )
)
"""What Mach3 has for mills (Using Mach3Mill, chapter 10, table of G codes)."""
KNOWN: Mapping[tuple[str, str], frozenset[float]] = {
    (GRBL, "G"): GRBL_G,
    (GRBL, "M"): GRBL_M,
    (MACH3, "G"): MACH3_G,
}
"""All codes of a family, by the address, for families that refuse every other one; an M of Mach3 may be a macro."""
NAMES = {GRBL: "grbl (1.1 and grblHAL)", MACH3: "Mach3"}
RUN_AGAIN = 47.0
AGAIN = "runs the program again from its first line on Mach3, which is not followed: write M30"


def refused_by_family(family: str, address: str, code: float) -> str:
    """Why a family does not have a G or M code, or why it is not followed there; empty where nothing is against it."""
    if code not in KNOWN.get((family, address), (code,)):
        return f"is no code of {NAMES[family]}: take it out, or write the family of the control"
    if address == "M":
        return AGAIN if family == MACH3 and code == RUN_AGAIN else ""
    return REFUSED.get(family, {}).get(code, "")
